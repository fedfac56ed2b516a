"""Terrestrial observations: distances, directions, angles, coordinate differences."""
