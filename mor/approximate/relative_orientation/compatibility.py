"""The conditions among Rinner's auxiliary unknowns, and the corrections they give to the ik (Nr. 4).

Nine unknowns and five parameters leave four conditions. The paper takes det(ik) = 0 (13), Σ ik² = 2 (14)
and two of

    |n_k|² + λ_k² = 1,  k = 1, 2, 3                                                                  (16)

with λ_k² the square sum of column k of the adjoint. That set loses a rank exactly in the normal case (base
along an axis of B): it is the diagonal of the matrix equation that the orthonormality of the e_k'' amounts
to,

    (ik)ᵀ(ik) + adjᵀ adj = 1        (n_k · n_l + λ_k λ_l = δ_kl)                                      (16*)

and the diagonal alone does not see the shear of the two axes across the base. With (13) and all six of
(16*) the rank is four for every orientation. (14), and (15) to first order, follow from (16*).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.relative_orientation.rinner import adjoint
from mor.approximate.vectors import cross
from mor.arrays import FloatArray
from mor.geometry import tolerant

UPPER = np.triu_indices(3)
INDEPENDENT = 4


class Compatible(NamedTuple):
    """Auxiliary unknowns that fulfil all conditions."""

    ik: FloatArray
    """(3, 3)"""
    corrections: FloatArray
    """(3, 3) ik minus the unknowns they came from."""
    misclosure: float
    """Largest remaining misclosure of (13) and (16*)."""


def printed_conditions(ik: FloatArray) -> FloatArray:
    """Misclosures (6,) of (13), (14), (15) and the three (16), as the paper prints them."""
    cofactors = adjoint(ik)
    columns = np.sum(ik**2, axis=0) + np.sum(cofactors**2, axis=0) - 1.0
    return np.array([np.linalg.det(ik), np.sum(ik**2) - 2.0, np.sum(cofactors**2) - 1.0, *columns])


def conditions(ik: FloatArray) -> FloatArray:
    """Misclosures (7,) of (13) and the six of (16*)."""
    cofactors = adjoint(ik)
    matrix = ik.T @ ik + cofactors.T @ cofactors - np.eye(3)
    return np.concatenate([[np.linalg.det(ik)], matrix[UPPER]])


def conditions_by_unknowns(ik: FloatArray) -> FloatArray:
    """Derivatives (7, 9) of :func:`conditions` by the ik, row by row (13a), (16) differentiated."""
    changes = np.eye(9).reshape(9, 3, 3)
    cofactors = adjoint(ik)
    columns = [ik[:, k] for k in range(3)]
    moved = np.empty((9, 3, 3))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        moved[:, :, k] = cross(changes[:, :, i], columns[j]) + cross(columns[i], changes[:, :, j])
    half = np.einsum("mi,nmj->nij", ik, changes) + np.einsum("mi,nmj->nij", cofactors, moved)
    symmetric = half + np.swapaxes(half, 1, 2)
    return np.vstack([cofactors.reshape(1, 9), symmetric[:, UPPER[0], UPPER[1]].T])


def compatible_unknowns(ik: FloatArray, normal: FloatArray, iterations: int = 20) -> Compatible:
    """Corrections dik of least (dik)ᵀ N (dik) that make ``ik`` (3, 3) compatible; N the ``normal`` (9, 9)
    of (5).

    Gauss–Newton on the conditions; each step solves the least-squares problem with linearised conditions. The
    unit matrix as ``normal`` gives the nearest compatible unknowns.
    """
    weight = normal / max(np.trace(normal) / 9.0, np.finfo(float).tiny)
    start = ik.ravel()
    current = start
    for _ in range(iterations):
        current, change = _step(current, start, weight)
        if change < 1e-15:
            break
    matrix = current.reshape(3, 3)
    return Compatible(matrix, matrix - ik, float(np.max(np.abs(conditions(matrix)))))


def _step(current: FloatArray, start: FloatArray, weight: FloatArray) -> tuple[FloatArray, float]:
    matrix = current.reshape(3, 3)
    left, values, right = tolerant.svd(conditions_by_unknowns(matrix))
    rows = right[:INDEPENDENT]
    target = -(left[:, :INDEPENDENT].T @ conditions(matrix)) / values[:INDEPENDENT]
    system = np.zeros((9 + INDEPENDENT, 9 + INDEPENDENT))
    system[:9, :9], system[:9, 9:], system[9:, :9] = weight, rows.T, rows
    side = np.concatenate([weight @ (start - current), target])
    step = tolerant.lstsq(system, side, rcond=None)[:9]
    length = float(np.linalg.norm(step))
    return current + step * min(1.0, 0.5 / max(length, 1e-300)), length
