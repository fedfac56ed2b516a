"""Points that rest on an observation: more than half of their variance, in some direction, comes from it.

An error of σ_i in observation i moves a point by x = (Q Aᵀ P)_i σ_i. Of the variance of the point in any direction it
has the share of the square of that movement, at most xᵀ Q_pp⁺ x, which is 1 where nothing else determines it.
"""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant
from mor.quality.assess import Quality
from mor.quality.reliability.influence_on_unknowns import Entry, movements

_HALF = 0.5
_NUMBERS = 2_000_000
_FLAT = 1e-10
"""Part of the largest variance of a point below which it has none in a direction."""


def most_at_a_time(quality: Quality) -> int:
    """Observations whose movements of all unknowns have room."""
    return max(1, _NUMBERS // max(quality.adjustment.problem.index.count, 1))


def carried_points(quality: Quality, entries: list[Entry]) -> list[IntArray]:
    """Point blocks that each of the observations carries, those first that it carries most of."""
    if not entries:
        return []
    problem = quality.adjustment.problem
    columns = problem.index.columns["point"]
    sigma = np.array([problem.groups[e.group].sigma[e.row, e.component] for e in entries])
    moved = movements(quality, entries, sigma)
    Q = np.nan_to_num(quality.cofactors["point"])
    least = _HALF * _below_eigenvalues(Q)
    found = []
    for k in range(len(entries)):
        x = np.where(columns >= 0, moved[columns, k], 0.0)
        some = np.flatnonzero(np.einsum("pi,pi->p", x, x) >= least)
        share = np.sum(np.einsum("pij,pj->pi", _inverse_roots(Q[some]), x[some]) ** 2, axis=1)
        carried = share > _HALF
        order = np.argsort(-np.round(share[carried], 6), kind="stable")
        found.append(some[carried][order])
    return found


def _below_eigenvalues(Q: FloatArray) -> FloatArray:
    """(p,) bounds from below of the eigenvalues of cofactor matrices (p, 3, 3), 0 of singular ones.

    The product of two of the three is at most the square of half of their sum. What round-off does to the determinant
    is taken off.
    """
    trace = np.trace(Q, axis1=1, axis2=2)
    determinant = np.einsum("pi,pi->p", Q[:, :, 0], np.cross(Q[:, :, 1], Q[:, :, 2]))
    above = np.maximum(determinant - _FLAT * trace**3, 0.0)
    return np.asarray(4.0 * np.divide(above, trace**2, out=np.zeros(len(Q)), where=trace > 0.0))


def _inverse_roots(Q: FloatArray) -> FloatArray:
    """(p, 3, 3) roots of the pseudo-inverses of cofactor matrices."""
    eigenvalues, axes = tolerant.eigh(Q)
    used = eigenvalues > _FLAT * np.maximum(eigenvalues[:, -1:], 1e-300)
    scale = np.where(used, 1.0 / np.sqrt(np.where(used, eigenvalues, 1.0)), 0.0)
    roots: FloatArray = scale[:, :, None] * np.swapaxes(axes, 1, 2)
    return roots
