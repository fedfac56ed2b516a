"""Possible causes in reports: as data, and in words."""
