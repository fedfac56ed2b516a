"""Cofactors and covariances of the unknowns."""
