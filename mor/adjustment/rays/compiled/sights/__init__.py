"""Kernels that say where cameras see points, one ray at a time, and what that depends on."""
