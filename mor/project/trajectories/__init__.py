"""Trajectories of a project: their knots, what is on them, what was observed of them."""
