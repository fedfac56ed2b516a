"""Precision, reliability, tests, robust estimation, variance components, deformation."""
