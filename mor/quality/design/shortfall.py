"""How far a plan is from what is required of it, in one number, for many changes of the plan at once.

The shortfall adds up, for every coordinate with a required σ, by how much its variance is beyond the limit in parts of
that, and for every observation with a required redundancy number, by how much it is below in parts of that: it is 0
where all is reached. An external reliability δ̄0 is a redundancy number, r = δ0²/(δ0² + δ̄0²); of correlated observations
their own r is taken for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry import tolerant
from mor.quality.assess import Quality
from mor.quality.design.interest import Interest, Unit
from mor.quality.design.requirements import RequiredControl, RequiredPrecision, Requirement

REACHED = 1e-9
"""Shortfall that is round-off."""
_BEYOND = 1e12
"""Variance of a candidate's value, by that of its measurement, beyond which it says nothing: it is no such sight."""
_SPARED = 1e-9
"""Smallest eigenvalue of R below which something would be undetermined without the observations."""


class Wanted(NamedTuple):
    """What is required, as limits of single rows."""

    variance: FloatArray
    """(t,) limits of the variances of the coordinates ``rows``."""
    rows: IntArray
    ellipsoids: IntArray
    """(e, 3) rows of points whose longest semi-axis is limited."""
    ellipsoid_limit: FloatArray
    """(e,) limits of their squares."""
    least_r: FloatArray
    """(m,) least redundancy number of each observation, 0 where nothing is required."""

    def with_least(self, least_r: FloatArray) -> Wanted:
        """The same with other least redundancy numbers (m,)."""
        return self._replace(least_r=least_r)

    @property
    def is_empty(self) -> bool:
        """True where nothing is required."""
        return not (len(self.rows) or len(self.ellipsoids) or (self.least_r > 0.0).any())


class Outcome(NamedTuple):
    """What a plan would be after each of c changes, (c,) each."""

    shortfall: FloatArray
    precision: FloatArray
    """Mean of variance/limit of the coordinates that are looked at."""
    largest_ratio: FloatArray
    """Largest σ by its limit; NaN where none is required."""
    smallest_r: FloatArray
    """Of the observations with a required r, or of all where there is none."""
    possible: BoolArray
    """False where something would be undetermined."""


def wanted_of(
    required: Sequence[Requirement], interest: Interest, quality: Quality, names: Sequence[str]
) -> Wanted:
    """Limits of single rows; ``names`` are those of all groups, candidates last."""
    rows, limits, ellipsoids, squares = [], [], [], []
    least = np.zeros(len(interest.group))
    for one in required:
        if isinstance(one, RequiredPrecision):
            places = interest.coordinates[one.blocks]
            if one.components:
                chosen = places[:, list(one.components)]
                chosen = chosen[chosen >= 0]
                rows.append(chosen)
                limits.append(np.full(len(chosen), one.limit**2))
            else:
                ellipsoids.append(places)
                squares.append(np.full(len(places), one.limit**2))
    of_group = least_redundancies(required, quality, names)
    observed = interest.group >= 0
    least[observed] = of_group[interest.group[observed]]
    none = np.zeros(0, dtype=np.int64)
    return Wanted(
        np.concatenate([np.zeros(0), *limits]),
        np.concatenate([none, *rows]),
        np.concatenate([np.zeros((0, 3), dtype=np.int64), *ellipsoids]),
        np.concatenate([np.zeros(0), *squares]),
        least,
    )


def least_redundancies(required: Sequence[Requirement], quality: Quality, names: Sequence[str]) -> FloatArray:
    """(g,) required redundancy numbers of the observations of groups of these names; 0 where there are none."""
    least = np.zeros(len(names))
    for one in required:
        if isinstance(one, RequiredControl):
            r = _least_r(one, quality)
            here = [k for k, name in enumerate(names) if any(fnmatchcase(name, p) for p in one.pattern)]
            least[here] = np.maximum(least[here], r)
    return least


def _least_r(one: RequiredControl, quality: Quality) -> float:
    if one.of == "r":
        return one.limit
    return quality.noncentrality / (quality.noncentrality + one.limit**2)


def redundancies(interest: Interest, diagonal: FloatArray, K: FloatArray) -> FloatArray:
    """(m,) redundancy numbers of the observations, correlated ones in their own sense."""
    r = 1.0 - diagonal
    for rows, triangle in interest.correlated:
        r[rows] = 1.0 - np.diagonal(triangle @ K[np.ix_(rows, rows)] @ tolerant.inv(triangle))
    return r


def solvable(R: FloatArray) -> BoolArray:
    """(c,) true where R (c, k, k) has an inverse that is worth something.

    It has none where something would be undetermined without the observations, or where a candidate is so far outside
    of what its equation holds for that its derivatives are beyond all measure.
    """
    finite = np.asarray(np.isfinite(R).all(axis=(1, 2)))
    values = tolerant.eigvalsh(np.where(finite[:, None, None], R, np.eye(R.shape[1])))
    return np.asarray(finite & (values[:, 0] > _SPARED) & (values[:, -1] < _BEYOND))


def outcomes(interest: Interest, wanted: Wanted, units: Sequence[Unit], sign: float) -> Outcome:
    """What becomes of the plan by adding (+1) or sparing (−1) each of some units, all of the same size k."""
    K = interest.cofactors
    index = np.stack([unit.rows for unit in units])  # (c, k)
    count, k = index.shape
    R = np.eye(k) + sign * K[index[:, :, None], index[:, None, :]]
    possible = solvable(R)
    R[~possible] = np.eye(k)
    L = tolerant.inv(tolerant.cholesky(R))  # R⁻¹ = LᵀL
    W = np.einsum("cjk,cmk->cmj", L, K[:, index].transpose(1, 0, 2))  # (c, m, k): K_·j Lᵀ
    diagonal = np.diagonal(K)[None] - sign * np.einsum("cmj,cmj->cm", W, W)
    r = 1.0 - diagonal
    for rows, triangle in interest.correlated:
        own = K[np.ix_(rows, rows)][None] - sign * W[:, rows] @ W[:, rows].transpose(0, 2, 1)
        r[:, rows] = 1.0 - np.diagonal(triangle @ own @ tolerant.inv(triangle), axis1=1, axis2=2)
    taking = np.broadcast_to(interest.active, (count, len(K))).copy()
    taking[np.arange(count)[:, None], index] = sign > 0.0
    return judged_outcome(interest, wanted, diagonal, r, taking, K, W, possible, sign)


def judged_outcome(
    interest: Interest,
    wanted: Wanted,
    diagonal: FloatArray,
    r: FloatArray,
    taking: BoolArray,
    K: FloatArray,
    W: FloatArray,
    possible: BoolArray,
    sign: float = 1.0,
) -> Outcome:
    """What becomes of a plan by changes that take W Wᵀ (c, m, k) from its cofactors K, or add it."""
    ellipsoids = _largest_axes(K, W, wanted.ellipsoids, sign)
    return _judged(interest, wanted, diagonal, r, taking, ellipsoids, possible)


def _largest_axes(K: FloatArray, W: FloatArray, points: IntArray, sign: float) -> FloatArray:
    """(c, e) largest eigenvalues of the cofactors of points after each change; fixed coordinates are 0."""
    if not len(points):
        return np.zeros((len(W), 0))
    known = points >= 0
    both = known[:, :, None] & known[:, None, :]
    block = np.where(both, K[points[:, :, None], points[:, None, :]], 0.0)
    moved = np.where(known[None, :, :, None], W[:, points], 0.0)  # (c, e, 3, k)
    after = block[None] - sign * moved @ moved.transpose(0, 1, 3, 2)
    return np.asarray(tolerant.eigvalsh(after)[..., -1])


def _judged(
    interest: Interest,
    wanted: Wanted,
    diagonal: FloatArray,
    r: FloatArray,
    taking: BoolArray,
    ellipsoids: FloatArray,
    possible: BoolArray,
) -> Outcome:
    parts = np.concatenate(
        [diagonal[:, wanted.rows] / wanted.variance, ellipsoids / wanted.ellipsoid_limit], axis=1
    )
    least = wanted.least_r
    asked = least > 0.0
    below = np.maximum(1.0 - r[:, asked] / least[asked], 0.0) * taking[:, asked]
    beyond = np.maximum(parts - 1.0, 0.0)
    beyond[beyond < REACHED] = 0.0
    below[below < REACHED] = 0.0
    observed = taking & (asked if asked.any() else interest.group >= 0)
    smallest = np.where(observed, r, np.inf).min(axis=1)
    return Outcome(
        beyond.sum(axis=1) + below.sum(axis=1),
        _precision(interest, parts, diagonal),
        np.sqrt(parts.max(axis=1)) if parts.shape[1] else np.full(len(parts), np.nan),
        np.maximum(smallest, 0.0),
        possible,
    )


def _precision(interest: Interest, parts: FloatArray, diagonal: FloatArray) -> FloatArray:
    """(c,) mean of variance by limit; of the variances of all coordinates where no σ is required."""
    if parts.shape[1]:
        return np.asarray(parts.mean(axis=1))
    rows = np.flatnonzero(interest.group < 0)
    return np.asarray(diagonal[:, rows].mean(axis=1)) if len(rows) else np.zeros(len(diagonal))


def present(interest: Interest, wanted: Wanted) -> Outcome:
    """What the plan is as it stands; arrays of one."""
    K = interest.cofactors
    diagonal = np.diagonal(K).copy()
    r = redundancies(interest, diagonal, K)
    ellipsoids = _largest_axes(K, np.zeros((1, len(K), 1)), wanted.ellipsoids, 1.0)
    return _judged(
        interest,
        wanted,
        diagonal[None],
        r[None],
        interest.active[None],
        ellipsoids,
        np.ones(1, dtype=bool),
    )
