"""Relative and planar orientation on their own: tables in, plain data and text out."""
