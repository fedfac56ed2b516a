"""Observation groups of a project: names, σ, correlations, conversion at the edge."""
