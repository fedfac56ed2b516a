"""STAR*NET input data."""
