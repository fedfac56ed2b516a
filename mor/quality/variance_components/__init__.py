"""Variance components of observation groups."""
