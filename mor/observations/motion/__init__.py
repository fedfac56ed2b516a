"""Points that move while they are observed."""
