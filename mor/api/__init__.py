"""The front door for Python: read or build a project, adjust it, look at the result."""
