"""What its own observations say of a few unknowns while all others are held: σ, and how well they fit.

At given values the block of the normal matrix that belongs to the unknowns of one thing, a point or a pose, is inverted
by itself; nothing is solved for. Misclosures are observed − computed at these values, in units of σ.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mor.adjustment.linearise import linearise, rotation_tangents
from mor.adjustment.problem import Problem
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.parameters.index import Values

CHUNK = 50_000
"""Observation rows that are linearised at a time."""
DETERMINED = 1e-10
"""Smallest eigenvalue of the block, its diagonal brought to one, from which on it is determined."""


class Local(NamedTuple):
    """Of n things with up to k unknowns each."""

    sigma: FloatArray
    """(n, k) σ a priori, everything else held; NaN where the own observations do not determine the thing."""
    misfit: FloatArray
    """(n,) root mean square of the misclosures in units of their σ; NaN where there are no observations."""
    observations: IntArray
    """(n,) observations that depend on the thing."""


def local_precision(problem: Problem, values: Values, columns: IntArray) -> Local:
    """Precision of things whose unknowns are ``columns`` (n, k), −1 where there are fewer.

    An unknown may belong to one thing only. Correlations between observations are not looked at.
    """
    count, size = columns.shape
    owner, place = np.full((2, problem.index.count + 1), -1, dtype=np.int64)
    thing, slot = np.nonzero(columns >= 0)
    owner[columns[thing, slot]], place[columns[thing, slot]] = thing, slot
    normal, squares = np.zeros((count, size, size)), np.zeros(count)
    observations = np.zeros(count, dtype=np.int64)
    for jacobian, misclosure, column in _weighted(problem, values):
        whose = np.where(column >= 0, owner[column], -1)
        for first in range(whose.shape[1]):
            mine = np.flatnonzero(whose[:, first] >= 0)
            one = whose[mine, first]
            _add_products(normal, jacobian[mine], whose[mine], place[column[mine]], first)
            # A thing that several columns of a row belong to counts the row once.
            fresh = ~(whose[mine, :first] == one[:, None]).any(axis=1)
            seen = misclosure[mine[fresh]]
            np.add.at(squares, one[fresh], np.nansum(seen**2, axis=1))
            np.add.at(observations, one[fresh], np.isfinite(seen).sum(axis=1))
    with np.errstate(invalid="ignore", divide="ignore"):
        misfit = np.sqrt(squares / observations)
    return Local(_sigma(normal, columns >= 0), misfit, observations)


def _weighted(problem: Problem, values: Values) -> Iterator[tuple[FloatArray, FloatArray, IntArray]]:
    """Jacobians and misclosures in units of σ, NaN in the misclosure where nothing counts, and their columns.

    What depends on a value that is missing does not count.
    """
    tangent = rotation_tangents(problem.index, values)
    for group in problem.groups:
        for start in range(0, group.count, CHUNK):
            rows = np.arange(start, min(start + CHUNK, group.count))
            found = linearise(group, problem.index, values, tangent, rows)
            counts = group.mask[rows] & ~group.left_out[rows]
            counts &= np.isfinite(found.jacobian).all(axis=2) & np.isfinite(found.misclosure)
            with np.errstate(divide="ignore", invalid="ignore"):
                weight = np.where(counts, 1.0 / group.sigma[rows], 0.0)
            weighted = np.where(counts[:, :, None], found.jacobian, 0.0) * weight[:, :, None]
            yield weighted, np.where(counts, found.misclosure * weight, np.nan), found.columns


def _add_products(
    normal: FloatArray, jacobian: FloatArray, whose: IntArray, place: IntArray, first: int
) -> None:
    """Products of one column of every row with all columns of the same thing."""
    size = normal.shape[1]
    for other in range(whose.shape[1]):
        same = np.flatnonzero(whose[:, first] == whose[:, other])
        if len(same):
            products = np.sum(jacobian[same, :, first] * jacobian[same, :, other], axis=1)
            cell = (whose[same, first] * size + place[same, first]) * size + place[same, other]
            np.add.at(normal.reshape(-1), cell, products)


def _sigma(normal: FloatArray, used: BoolArray) -> FloatArray:
    """Roots of the diagonals of the inverse blocks."""
    diagonal = np.sqrt(np.einsum("nii->ni", normal))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    scaled = normal / (scale[:, :, None] * scale[:, None, :]) + np.where(used, 0.0, 1.0)[:, :, None] * np.eye(
        normal.shape[1]
    )
    sound = np.isfinite(scaled).all(axis=(1, 2))
    scaled[~sound] = np.eye(normal.shape[1])
    sound &= np.linalg.eigvalsh(scaled)[:, 0] > DETERMINED
    scaled[~sound] = np.eye(normal.shape[1])
    sigma = np.sqrt(np.einsum("nii->ni", np.linalg.inv(scaled))) / scale
    return np.where(used & sound[:, None], sigma, np.nan)
