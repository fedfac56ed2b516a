"""The adjusted project: the project again, with the adjusted values as start values."""
