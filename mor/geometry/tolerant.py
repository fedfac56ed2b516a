"""Functions of numpy.linalg that return NaN for a matrix they cannot decompose, instead of raising.

Start values and diagnosis work on stacks of candidates: a singular matrix, or one with infinities, belongs to a
candidate that is none. With NumPy a single one ends the whole stack. Comparisons with NaN are false, so that a caller
passes such a candidate over. Arguments and results are those of NumPy; matrices (..., m, n) may be stacked.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mor.arrays import FloatArray


def solve(matrix: NDArray[Any], right: NDArray[Any]) -> FloatArray:
    """Return x of matrix · x = right; (n, k) right-hand sides, or (n,) of a single matrix."""
    if right.ndim == 1:
        return np.asarray(solve(matrix, right[:, None])[..., 0])
    return np.asarray(_each(np.linalg.solve, matrix, right))


def inv(matrix: NDArray[Any]) -> FloatArray:
    """Return inverses (..., n, n)."""
    return np.asarray(_each(np.linalg.inv, matrix))


def cholesky(matrix: NDArray[Any]) -> FloatArray:
    """Return lower triangles L (..., n, n) of L Lᵀ."""
    return np.asarray(_each(np.linalg.cholesky, matrix))


def pinv(matrix: NDArray[Any], rcond: float = 1e-15, hermitian: bool = False) -> FloatArray:
    """Return pseudo-inverses (..., n, m)."""
    return np.asarray(_each(lambda one: np.linalg.pinv(one, rcond, hermitian), matrix))


def eigh(matrix: NDArray[Any]) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues (..., n), ascending, and eigenvectors (..., n, n) of symmetric matrices."""
    return tuple(_each(np.linalg.eigh, matrix))


def eigvalsh(matrix: NDArray[Any]) -> FloatArray:
    """Return eigenvalues (..., n) of symmetric matrices, ascending."""
    return np.asarray(_each(np.linalg.eigvalsh, matrix))


def eig(matrix: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return eigenvalues (..., n) and eigenvectors (..., n, n)."""
    return tuple(_each(np.linalg.eig, matrix))


def eigvals(matrix: NDArray[Any]) -> NDArray[Any]:
    """Return eigenvalues (..., n)."""
    return np.asarray(_each(np.linalg.eigvals, matrix))


def svd(matrix: NDArray[Any], full_matrices: bool = True) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return U, singular values, descending, and Vᵀ."""
    return tuple(_each(lambda one: np.linalg.svd(one, full_matrices), matrix))


def singular_values(matrix: NDArray[Any]) -> FloatArray:
    """Return singular values (..., min(m, n)), descending."""
    return np.asarray(_each(lambda one: np.linalg.svd(one, compute_uv=False), matrix))


def lstsq(matrix: NDArray[Any], right: NDArray[Any], rcond: float | None = None) -> FloatArray:
    """Return the least-squares solution (n,) or (n, k) of one system matrix · x = right."""
    if np.isfinite(matrix).all() and np.isfinite(right).all():
        try:
            return np.asarray(np.linalg.lstsq(matrix, right, rcond=rcond)[0], dtype=np.float64)
        except np.linalg.LinAlgError:
            pass
    return np.full((matrix.shape[1], *right.shape[1:]), np.nan)


def _each(operation: Callable[..., Any], *stacks: NDArray[Any]) -> Any:
    """Apply an operation to stacks of matrices, member by member if NumPy refuses them together.

    Matrices that are not finite never reach LAPACK, which writes of them to standard output.
    """
    bad = ~np.isfinite(stacks[0]).all(axis=(-2, -1))
    if not bad.any():
        try:
            return operation(*stacks)
        except np.linalg.LinAlgError:
            if operation in (np.linalg.solve, np.linalg.inv):
                bad = np.linalg.slogdet(stacks[0])[0] == 0.0
    usable = np.where(bad[..., None, None], np.eye(*stacks[0].shape[-2:]), stacks[0]), *stacks[1:]
    try:  # all others at once, with unit matrices instead of the bad ones
        found = operation(*usable)
    except np.linalg.LinAlgError:
        found = _one_by_one(operation, *usable)
    several = found if isinstance(found, tuple) else (found,)
    marked = [
        np.where(bad.reshape(bad.shape + (1,) * (part.ndim - bad.ndim)), np.nan, part) for part in several
    ]
    return tuple(marked) if isinstance(found, tuple) else marked[0]


def _one_by_one(operation: Callable[..., Any], *stacks: NDArray[Any]) -> Any:
    count = np.broadcast_shapes(*(stack.shape[:-2] for stack in stacks))
    members = [
        np.broadcast_to(stack, (*count, *stack.shape[-2:])).reshape(-1, *stack.shape[-2:]) for stack in stacks
    ]
    like = operation(*(np.eye(*stack.shape[-2:]) for stack in stacks))
    several = isinstance(like, tuple)
    found: list[list[NDArray[Any]]] = []
    for one in zip(*members, strict=True):
        try:
            result = operation(*one)
        except np.linalg.LinAlgError:
            result = (
                tuple(np.full_like(part, np.nan) for part in like) if several else np.full_like(like, np.nan)
            )
        found.append(list(result) if several else [result])
    parts = [np.stack(part).reshape(*count, *part[0].shape) for part in zip(*found, strict=True)]
    return tuple(parts) if several else parts[0]
