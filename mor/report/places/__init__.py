"""Points of a network on the earth: their table, their section of the report."""
