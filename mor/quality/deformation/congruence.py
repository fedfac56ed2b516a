"""Congruence: have points moved between two epochs?

The movements d of the points that both epochs have, with cofactors Q_d = Q_1 + Q_2, in one datum over those points. The
hypothesis that nothing moved is tested with T = dᵀ Q_d⁺ d, rank h: T/h against the χ² distribution (σ0 known) or, over
the pooled variance of both epochs, the F distribution (H. Pelzer, 1971). Where it is rejected, the point whose removal
from the datum leaves the rest most congruent is taken to have moved, and so on until the rest is congruent. A movement
with its own 3 × 3 cofactors is then tested for every point, in the datum of the stable ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, fdtri

from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant
from mor.quality.assess import Quality
from mor.quality.precision.covariance import joint_cofactors
from mor.quality.tests.p_values import log_p_chi2, log_p_f

_RANK = 1e-10


class MovementTest(NamedTuple):
    """Test of one movement."""

    movement: FloatArray
    """(3,)."""
    sigma: FloatArray
    """(3,) standard deviations, a posteriori."""
    statistic: float
    """dᵀ Q⁺ d/h for σ0 = 1."""
    ratio: float
    """The same over the estimated variance factor."""
    freedom: int
    log_p: float
    """Natural logarithm of the p-value with σ0 known."""
    log_p_estimated: float
    """With σ0 estimated."""
    cofactors: FloatArray
    """(3, 3) of the movement, for σ0 = 1."""


class Congruence(NamedTuple):
    """Outcome of a congruence test over n points."""

    global_test: MovementTest | None
    """Test of all movements in the datum over all common points."""
    critical: float
    stable: BoolArray
    """(n,) points that carry the datum in the end."""
    points: tuple[MovementTest, ...]
    variance: float
    """Pooled variance factor."""
    redundancy: int


def movement_test(d: FloatArray, q: FloatArray, variance: float, redundancy: int) -> MovementTest:
    """Test of a movement d (k,) with cofactors q (k, k); directions without any variance are left out."""
    size = np.sqrt(np.maximum(np.diagonal(q), 0.0))
    scale = np.where(size > 0.0, size, 1.0)
    eigenvalues, axes = tolerant.eigh(q / np.outer(scale, scale))
    used = eigenvalues > _RANK * max(float(eigenvalues[-1]), 1e-300)
    along = axes[:, used].T @ (d / scale)
    freedom = int(np.count_nonzero(used))
    total = float(np.sum(along**2 / eigenvalues[used]))
    mean = total / freedom if freedom else 0.0
    ratio = mean / variance if variance > 0.0 else np.inf
    log_p = log_p_chi2(np.array([total]), np.array([float(freedom)]))
    log_estimated = log_p_f(np.array([ratio]), float(freedom), redundancy)
    return MovementTest(
        d, np.sqrt(variance) * size, mean, ratio, freedom, float(log_p[0]), float(log_estimated[0]), q
    )


def pair_movement(quality: Quality, first: int, second: int) -> MovementTest:
    """Movement from one point to another of the same adjustment, in which every epoch has its own points."""
    columns = quality.adjustment.problem.index.columns["point"][[first, second]].ravel()
    q = joint_cofactors(quality, columns)
    cofactors = q[:3, :3] + q[3:, 3:] - q[:3, 3:] - q[3:, :3]
    points = quality.adjustment.values["point"]
    d = np.where(np.diagonal(cofactors) > 0.0, points[second] - points[first], 0.0)
    return movement_test(d, cofactors, quality.sigma0**2, quality.redundancy)


def congruence(
    d: FloatArray,
    q: FloatArray,
    generators: FloatArray,
    variance: float,
    redundancy: int,
    level: float,
    known: bool = False,
) -> Congruence:
    """Congruence test of movements d (n, 3) with cofactors q (3n, 3n).

    ``generators`` (3n, k) are movements of the whole network that neither epoch determines: the datum is free in them.
    ``known``: σ0 = 1 is known; otherwise the pooled ``variance`` is used.
    """
    n = len(d)
    stable = np.ones(n, dtype=bool)
    first: MovementTest | None = None
    while True:
        moved, cofactors = _in_datum(d, q, generators, stable)
        here = np.repeat(stable, 3)
        test = movement_test(moved.ravel()[here], cofactors[np.ix_(here, here)], variance, redundancy)
        critical = _critical(test.freedom, redundancy, level, known)
        first = first or test
        value = test.statistic if known else test.ratio
        enough = test.freedom > 1 and np.count_nonzero(stable) > 1
        if value <= critical or not enough or test.freedom == 0:
            break
        stable[_most_moved(moved, cofactors, stable)] = False
    tests = tuple(
        movement_test(moved[i], cofactors[3 * i : 3 * i + 3, 3 * i : 3 * i + 3], variance, redundancy)
        for i in range(n)
    )
    overall = _critical(first.freedom, redundancy, level, known)
    return Congruence(first, overall, stable, tests, variance, redundancy)


def _critical(freedom: int, redundancy: int, level: float, known: bool) -> float:
    if freedom == 0:
        return 0.0
    if known or redundancy <= 0:
        return float(chdtri(freedom, level)) / freedom
    return float(fdtri(freedom, redundancy, 1.0 - level))


def _in_datum(
    d: FloatArray, q: FloatArray, generators: FloatArray, stable: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Movements and cofactors in the datum over the stable points (S-transformation)."""
    if generators.shape[1] == 0:
        return d, q
    B = generators * np.repeat(stable, 3)[:, None]
    S = np.eye(len(q)) - generators @ tolerant.pinv(B.T @ generators, rcond=1e-12) @ B.T
    return (S @ d.ravel()).reshape(d.shape), S @ q @ S.T


def _most_moved(d: FloatArray, q: FloatArray, stable: BoolArray) -> int:
    """The stable point without which the others are most congruent.

    Without point B, T falls by T_B = (P d)_Bᵀ (P_BB)⁺ (P d)_B, P the inverse of the cofactors (Pelzer's decomposition).
    """
    where = np.flatnonzero(stable)
    here = np.repeat(stable, 3)
    P = tolerant.pinv(q[np.ix_(here, here)], rcond=_RANK, hermitian=True)
    pulled = P @ d.ravel()[here]
    parts = []
    for k in range(len(where)):
        own = slice(3 * k, 3 * k + 3)
        parts.append(
            float(pulled[own] @ tolerant.pinv(P[own, own], rcond=1e-9, hermitian=True) @ pulled[own])
        )
    return int(where[int(np.argmax(parts))])
