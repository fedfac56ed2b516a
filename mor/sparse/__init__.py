"""Sparse symmetric block matrices: ordering, multifrontal Cholesky, selected inverse. Knows no geodesy."""
