"""Simulated projects, and the report of a Monte Carlo simulation."""
