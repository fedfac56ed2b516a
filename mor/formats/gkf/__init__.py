"""GNU Gama files."""
