"""Tables of results as plain data and as files."""
