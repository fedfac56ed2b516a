"""The joint test of the components of one observation: the two coordinates of a ray, the three of a vector."""

from __future__ import annotations

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant
from mor.quality.tests.test_statistics import CONTROLLED


def joint_statistic(
    weighted: FloatArray, cofactors: FloatArray, here: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """T = uᵀ S⁺ u (n,) and the rank of S (n,), for the components that are there (n, m).

    ``weighted`` u (n, m) and ``cofactors`` S (n, m, m) are P v and P Q_vv P, scaled to unit weights. A direction whose
    eigenvalue of S vanishes is controlled by nothing and left out. T is χ² distributed with the rank as its freedom.
    """
    if weighted.shape[1] == 1:
        safe = np.where(cofactors[:, 0, 0] > CONTROLLED, cofactors[:, 0, 0], np.inf)
        statistic = np.where(here[:, 0], np.nan_to_num(weighted[:, 0]) ** 2 / safe, 0.0)
        return statistic, (here[:, 0] & np.isfinite(safe)).astype(float)
    both = here[:, :, None] & here[:, None, :]
    S = np.where(both, cofactors, 0.0)
    u = np.where(here, np.nan_to_num(weighted), 0.0)
    if weighted.shape[1] == 2:
        return _of_two(u, S)
    eigenvalues, axes = tolerant.eigh(S)
    return _along_axes(np.einsum("nmk,nm->nk", axes, u), eigenvalues)


def _of_two(u: FloatArray, S: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same for two components, in closed form."""
    mean, half = 0.5 * (S[:, 0, 0] + S[:, 1, 1]), 0.5 * (S[:, 0, 0] - S[:, 1, 1])
    radius = np.hypot(half, S[:, 0, 1])
    turn = 0.5 * np.arctan2(S[:, 0, 1], half)
    c, s = np.cos(turn), np.sin(turn)
    along = np.stack([c * u[:, 0] + s * u[:, 1], c * u[:, 1] - s * u[:, 0]], axis=1)
    return _along_axes(along, np.stack([mean + radius, mean - radius], axis=1))


def _along_axes(along: FloatArray, eigenvalues: FloatArray) -> tuple[FloatArray, FloatArray]:
    used = eigenvalues > CONTROLLED
    parts = np.where(used, along**2 / np.where(used, eigenvalues, 1.0), 0.0)
    return parts.sum(axis=1), used.sum(axis=1).astype(float)
