"""The textbook networks' .dat (F. Krumm)."""
