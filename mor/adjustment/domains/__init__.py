"""Helmert blocks: a network in domains, each a problem of its own, joined in the unknowns they have in common."""
