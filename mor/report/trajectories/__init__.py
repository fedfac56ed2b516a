"""Trajectories in reports: knots, and how instruments were mounted."""
