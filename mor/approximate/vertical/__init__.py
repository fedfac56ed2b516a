"""The vertical of a part, from everything that depends on it."""
