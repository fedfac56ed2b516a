"""Parts of a network in systems of their own: what is in them, how they join, and what they give to the network."""
