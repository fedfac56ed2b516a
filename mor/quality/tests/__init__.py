"""Statistical tests and their levels."""
