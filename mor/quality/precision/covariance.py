"""Covariances of any unknowns together, in the datum of the adjustment: what the stored blocks do not hold.

Columns of the inverse come from one solution each; the S-transformation carries them into the datum, which also makes
them independent of the minimal datum the factorisation happened to take.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant
from mor.quality.assess import Quality

_AT_A_TIME = 200


class RelativeEllipsoid(NamedTuple):
    """Precision of the difference of two points (second minus first)."""

    difference: FloatArray
    """(3,) internal axes."""
    covariance: FloatArray
    """(3, 3)."""
    axes: FloatArray
    """(3,) standard semi-axes, the largest first."""
    directions: FloatArray
    """(3, 3) their unit directions, one in each row."""


def joint_cofactors(quality: Quality, columns: IntArray) -> FloatArray:
    """(k, k) cofactors (σ0 = 1) of the unknowns ``columns`` (k,); zero rows for −1, which is fixed."""
    used = np.unique(columns[columns >= 0])
    inverse = quality.adjustment.inverse
    result = np.zeros((len(used), len(used)))
    for first in range(0, len(used), _AT_A_TIME):
        part = used[first : first + _AT_A_TIME]
        right = np.zeros((quality.adjustment.problem.index.count, len(part)))
        right[part, np.arange(len(part))] = 1.0
        result[:, first : first + len(part)] = inverse.solve(right)[used]
    result = 0.5 * (result + result.T) + quality.datum.correction(used, used)
    where = np.searchsorted(used, np.maximum(columns, used.min(initial=0)))
    free = columns >= 0
    picked = result[np.ix_(where, where)] if len(used) else np.zeros((len(columns), len(columns)))
    return np.where(free[:, None] & free[None, :], picked, 0.0)


def relative_ellipsoid(quality: Quality, first: int, second: int) -> RelativeEllipsoid:
    """Relative error ellipsoid between two point blocks."""
    columns = quality.adjustment.problem.index.columns["point"][[first, second]].ravel()
    q = joint_cofactors(quality, columns) * quality.sigma_factor**2
    covariance = q[:3, :3] + q[3:, 3:] - q[:3, 3:] - q[3:, :3]
    eigenvalues, vectors = tolerant.eigh(0.5 * (covariance + covariance.T))
    points = quality.adjustment.values["point"]
    return RelativeEllipsoid(
        points[second] - points[first],
        covariance,
        np.sqrt(np.maximum(eigenvalues[::-1], 0.0)),
        vectors[:, ::-1].T,
    )
