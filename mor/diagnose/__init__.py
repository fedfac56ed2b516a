"""Search for mistakes in a rejected network."""
