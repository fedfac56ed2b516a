"""GNU Gama's .gkf."""
