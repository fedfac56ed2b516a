"""Field books of total stations and levels."""
