"""Relative orientation of two bundles (K. Rinner)."""
