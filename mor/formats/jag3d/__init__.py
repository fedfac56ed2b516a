"""JAG3D's column text."""
