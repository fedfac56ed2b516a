"""Commands before the measurement, and of many projects at once."""
