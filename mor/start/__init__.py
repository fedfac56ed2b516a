"""Approximate values."""
