"""Report start values, their sources, and their confidence."""
