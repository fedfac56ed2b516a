"""Points in plan from bearings among points that are not known yet, all at once: each bearing is one linear equation.

(X_j − X_i) cos t − (Y_j − Y_i) sin t = 0, with what is known on the right-hand side. What the null space of the others
does not touch is determined.
"""

from __future__ import annotations

import numpy as np

from mor.approximate.parts.part import Part
from mor.approximate.parts.rule import rule
from mor.approximate.terrestrial.sights import Terrestrial
from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant

MOST = 300
"""Points that are worked out at once, at the most."""
WEAKEST = 1e-3
"""Singular value, in parts of the largest, below which a combination of coordinates is open."""
OPEN = 1e-6
"""Share of a coordinate in an open combination from which on it is open itself."""
FITS = 0.02
"""Radians by which bearings may pass by."""


def grow_by_bearings(part: Part, measured: Terrestrial) -> bool:
    """Add points that bearings determine together with known ones; true where any was added."""
    start, end, t = _bearings(part, measured)
    known = np.asarray(np.isfinite(part.points[:, :2]).all(axis=1))
    open_ = ~(known[start] & known[end])
    start, end, t = start[open_], end[open_], t[open_]
    ends = np.unique(np.concatenate([start, end]))
    points = ends[~known[ends]]
    if not 0 < len(points) <= MOST or not known[ends].any():
        return False
    found = _solved(part, points, start, end, t)
    fresh = points[np.isfinite(found).all(axis=1)]
    if len(fresh) == 0:
        return False
    trial = part.points[:, :2].copy()
    trial[points] = found
    towards = trial[end] - trial[start]
    along = towards[:, 0] * np.sin(t) + towards[:, 1] * np.cos(t)
    across = towards[:, 0] * np.cos(t) - towards[:, 1] * np.sin(t)
    told = np.isfinite(along)
    if np.any(along[told] <= 0.0) or np.any(np.abs(across[told]) > FITS * along[told]):
        return False
    part.points[fresh, :2] = trial[fresh]
    part.how |= {f"point {p}": rule("network of {count} bearings", count=len(t)) for p in fresh.tolist()}
    return True


def _bearings(part: Part, measured: Terrestrial) -> tuple[IntArray, IntArray, FloatArray]:
    """Bearings of the part, from oriented sets and as they were observed: from, to, radians."""
    rows = []
    for number, sight in enumerate(measured.sights):
        kappa = 0.0 if sight.oriented and part.oriented else part.kappas.get(number)
        if kappa is not None:
            seen = np.isfinite(sight.directions)
            rows.append((sight.position, sight.points[seen], sight.directions[seen] - kappa))
    none = np.zeros(0, dtype=np.int64)
    return (
        np.concatenate([none, *(np.full(len(to), at) for at, to, _ in rows)]),
        np.concatenate([none, *(to for _, to, _ in rows)]),
        np.concatenate([np.zeros(0), *(t for *_, t in rows)]),
    )


def _solved(part: Part, points: IntArray, start: IntArray, end: IntArray, t: FloatArray) -> FloatArray:
    """(n, 2) coordinates of the points, NaN where they are open."""
    column = np.full(len(part.points), -1, dtype=np.int64)
    column[points] = np.arange(len(points))
    known = np.unique(np.concatenate([start, end]))
    known = known[column[known] < 0]
    middle = part.points[known, :2].mean(axis=0)
    # At least as many rows as columns, so that the decomposition has the null space.
    A = np.zeros((max(len(t), 2 * len(points)), 2 * len(points)))
    right, rows = np.zeros(len(A)), np.arange(len(t))
    for ends, sign in ((end, 1.0), (start, -1.0)):
        free = column[ends] >= 0
        for axis, factor in ((0, np.cos(t)), (1, -np.sin(t))):
            A[rows[free], 2 * column[ends[free]] + axis] += sign * factor[free]
            fixed = part.points[ends[~free], axis] - middle[axis]
            right[rows[~free]] -= sign * factor[~free] * fixed
    left, values, basis = tolerant.svd(A, full_matrices=False)
    rank = int(np.count_nonzero(values > WEAKEST * values[0]))
    x = basis[:rank].T @ ((left[:, :rank].T @ right) / values[:rank])
    x[np.abs(basis[rank:]).max(axis=0, initial=0.0) > OPEN] = np.nan
    xy = x.reshape(-1, 2) + middle
    return np.where(np.isfinite(xy).all(axis=1)[:, None], xy, np.nan)
