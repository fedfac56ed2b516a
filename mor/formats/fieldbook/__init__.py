"""Field books of total stations."""
