"""Parts on their way to one system: they begin, grow, and are put together."""
