"""Movements of points in one adjustment: tables, and the section of the text report."""
