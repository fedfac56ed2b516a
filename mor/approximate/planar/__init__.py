"""Images of a plane object (K. Killian)."""
