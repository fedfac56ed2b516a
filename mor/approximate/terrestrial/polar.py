"""Polar points, heights and rays: from directions, vertical directions and distances to coordinates and back.

Bearings t = atan2(ΔX, ΔY) run clockwise from +Y. A set of directions r has an orientation κ, r = t + κ.
Vertical directions v are positive upwards; of a zenith angle z it is v = π/2 − z. All angles in radians.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray

AGREES = 0.05
"""Radians up to which sights agree: places may be rough."""
CANDIDATES = 100
"""Sights of which the orientation of a set may be that of one."""
SAME = 1e-9
"""Mean absolute differences (radians) that are the same."""


class Orientation(NamedTuple):
    """Orientation of a set of directions."""

    kappa: float
    """κ of r = t + κ, in (−π, π]; not a number where nothing was sighted."""
    residuals: FloatArray
    """(n,) computed minus observed direction."""
    resultant: float
    """Length of the mean of the unit vectors: 1 where all sights agree, near 0 where they contradict."""


def bearing(start: FloatArray, end: FloatArray) -> FloatArray:
    """Bearings (…) from ``start`` to ``end`` (…, 2 or 3)."""
    difference = np.asarray(end, dtype=float) - np.asarray(start, dtype=float)
    return np.asarray(np.arctan2(difference[..., 0], difference[..., 1]))


def polar_rays(directions: FloatArray, verticals: FloatArray) -> FloatArray:
    """Unit rays (n, 3) in the axes of a theodolite with r = atan2(X*, Y*) and v = atan(Z*/√(X*² + Y*²))."""
    level = np.cos(verticals)
    return np.stack([level * np.sin(directions), level * np.cos(directions), np.sin(verticals)], axis=-1)


def polar_points(
    station: FloatArray, kappa: float, directions: FloatArray, verticals: FloatArray, distances: FloatArray
) -> FloatArray:
    """Points (n, 3) from a levelled station (3,): directions, vertical directions and slope distances (n,)."""
    rays = polar_rays(np.asarray(directions) - kappa, verticals)
    return np.asarray(np.asarray(station) + rays * np.asarray(distances)[:, None])


def orient(station: FloatArray, points: FloatArray, directions: FloatArray) -> Orientation:
    """Orientation of ``directions`` (n,) from a station (2 or 3,) to known ``points`` (n, 2 or 3).

    The mean of those that agree with the sight of the least sum of absolute differences from all the others: a median
    on the circle, which a few wrong identities do not turn.
    """
    differences = np.asarray(directions) - bearing(station, points)
    if not len(differences):
        return Orientation(float("nan"), differences, 0.0)
    units = np.exp(1j * differences)
    candidates = units[np.linspace(0, len(units) - 1, min(len(units), CANDIDATES)).astype(int)]
    apart = np.abs(np.angle(candidates[:, None] * units.conj())).sum(axis=1)
    median = candidates[apart <= apart.min() + SAME * len(units)].mean()
    near = np.abs(np.angle(units * np.conj(median))) <= AGREES
    kappa = float(np.angle(units[near].mean() if near.any() else median))
    return Orientation(kappa, np.angle(np.exp(1j * kappa) * units.conj()), abs(units.mean()))
