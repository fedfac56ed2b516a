"""The Python interface, and the way from a project to its results."""
