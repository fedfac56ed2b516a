"""SNAP files."""
