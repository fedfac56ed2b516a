"""Block-sparse matrices: ordering, Cholesky factorisation, selected inverse."""
