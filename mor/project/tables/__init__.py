"""Tables of a project: sources, columns, numbers in internal units."""
