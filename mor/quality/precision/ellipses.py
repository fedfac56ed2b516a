"""Error ellipses and ellipsoids: semi-axes and their directions, from covariances of coordinates."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry import tolerant

LEVEL = 1e-9
"""Sine of the elevation up to which an axis counts as level."""


class Ellipses(NamedTuple):
    """Standard error ellipses in plan of n points."""

    a: FloatArray
    """(n,) larger semi-axis."""
    b: FloatArray
    """(n,) smaller semi-axis."""
    azimuth: FloatArray
    """(n,) of the larger one, radians clockwise from north, 0 to π."""


class Ellipsoids(NamedTuple):
    """Standard error ellipsoids of n points."""

    axes: FloatArray
    """(n, 3) semi-axes, the largest first."""
    azimuths: FloatArray
    """(n, 3) of the semi-axes, radians clockwise from north; of that end which does not point down."""
    elevations: FloatArray
    """(n, 3) above the horizontal plane, radians, 0 to π/2."""


def error_ellipses(covariance: FloatArray) -> Ellipses:
    """Ellipses of covariances (n, 2 or more, …) whose first two components are east and north."""
    east, north, both = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    mean, half = 0.5 * (east + north), np.hypot(0.5 * (north - east), both)
    a, b = np.sqrt(np.maximum(mean + half, 0.0)), np.sqrt(np.maximum(mean - half, 0.0))
    return Ellipses(a, b, 0.5 * np.arctan2(2.0 * both, north - east) % np.pi)


def error_ellipsoids(covariance: FloatArray) -> Ellipsoids:
    """Ellipsoids of covariances (n, 3, 3) in east, north, up."""
    eigenvalues, vectors = tolerant.eigh(0.5 * (covariance + np.swapaxes(covariance, 1, 2)))
    directions = np.swapaxes(vectors, 1, 2)[:, ::-1]
    east, north, up = np.moveaxis(directions, -1, 0)
    # Of a level axis both ends are as good: the one in the eastern half, whatever the round-off in its height.
    other_end = np.where(np.abs(up) > LEVEL, up < 0.0, (east < 0.0) | ((east == 0.0) & (north < 0.0)))
    east, north, up = (np.where(other_end, -part, part) for part in (east, north, up))
    return Ellipsoids(
        np.sqrt(np.maximum(eigenvalues[:, ::-1], 0.0)),
        np.arctan2(east, north) % (2.0 * np.pi),
        np.arcsin(np.clip(up, 0.0, 1.0)),
    )


def confidence_factor(dimensions: int, redundancy: float | None, level: float = 0.95) -> float:
    """Factor from the standard ellipse or ellipsoid to that which holds the point with a probability ``level``.

    With σ0 a posteriori of a ``redundancy`` from F, with σ0 a priori (``None``) from χ².
    """
    from scipy.special import chdtri, fdtri

    if redundancy is None:
        return math.sqrt(float(chdtri(dimensions, 1.0 - level)))
    return math.sqrt(dimensions * float(fdtri(dimensions, redundancy, level)))
