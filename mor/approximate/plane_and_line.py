"""Planes and lines fitted to points, and the local systems that stand on them."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from mor.approximate.vectors import principal_rows, tangent_axes
from mor.arrays import FloatArray

LINE = 1e-9
"""Extension across, relative to that along, below which points are collinear, or at one place."""


class FitOutcome(Enum):
    """What became of a fit, in words."""

    DETERMINED = "determined"
    TOO_FEW = "too few points: a line needs two, a plane three"
    INVALID = "a coordinate is no number, or a weight is not positive"
    COINCIDENT = "the points lie at one place"
    COLLINEAR = "the points lie in one line: the plane can turn about it"


class FittedPlane(NamedTuple):
    """n · (X − origin) = 0."""

    outcome: FitOutcome
    origin: FloatArray
    """(3,) weighted centre of the points."""
    normal: FloatArray
    """(3,) unit vector; of its two senses the one with the largest component positive."""
    distances: FloatArray
    """(n,) signed distances of the points."""
    sigma0: float
    """Standard deviation of a distance of weight one; not a number for three points."""


class FittedLine(NamedTuple):
    """origin + s · direction."""

    outcome: FitOutcome
    origin: FloatArray
    direction: FloatArray
    """(3,) unit vector from the first towards the last point."""
    distances: FloatArray
    """(n,) distances of the points."""
    along: FloatArray
    """(n,) s of the points."""
    sigma0: float
    """Standard deviation across, per axis, of weight one; not a number for two points."""


def fit_plane(points: FloatArray, weights: FloatArray | None = None) -> FittedPlane:
    """Plane of least Σ w (distance)² through n ≥ 3 points (n, 3): principal axes."""
    points, weight = np.asarray(points, dtype=float), _weights(points, weights)
    outcome, origin, values, axes = _principal(points, weight, 3)
    if outcome is FitOutcome.DETERMINED and values[1] <= LINE * values[0]:
        outcome = FitOutcome.COLLINEAR
    if outcome is not FitOutcome.DETERMINED:
        nothing = np.full(3, np.nan)
        return FittedPlane(outcome, nothing, nothing, np.full(len(points), np.nan), float("nan"))
    normal = axes[2] * np.sign(axes[2][np.argmax(np.abs(axes[2]))])
    distances = (points - origin) @ normal
    redundancy = len(points) - 3
    sigma0 = float(np.sqrt(weight @ distances**2 / redundancy)) if redundancy > 0 else float("nan")
    return FittedPlane(outcome, origin, normal, distances, sigma0)


def fit_line(points: FloatArray, weights: FloatArray | None = None) -> FittedLine:
    """Line of least Σ w (distance)² through n ≥ 2 points (n, 3): principal axes."""
    points, weight = np.asarray(points, dtype=float), _weights(points, weights)
    outcome, origin, _, axes = _principal(points, weight, 2)
    if outcome is not FitOutcome.DETERMINED:
        nothing, none = np.full(3, np.nan), np.full(len(points), np.nan)
        return FittedLine(outcome, nothing, nothing, none, none, float("nan"))
    direction = axes[0] * (1.0 if axes[0] @ (points[-1] - points[0]) >= 0.0 else -1.0)
    along = (points - origin) @ direction
    distances = np.linalg.norm(points - origin - np.outer(along, direction), axis=1)
    redundancy = 2 * len(points) - 4
    sigma0 = float(np.sqrt(weight @ distances**2 / redundancy)) if redundancy > 0 else float("nan")
    return FittedLine(outcome, origin, direction, distances, along, sigma0)


def frame_on_plane(plane: FittedPlane) -> tuple[FloatArray, FloatArray]:
    """Position (3,) and rotation D (3, 3) of a local system with the plane as Z̄ = 0."""
    across = tangent_axes(plane.normal)
    return plane.origin, np.stack([across[:, 0], across[:, 1], plane.normal])


def frame_on_line(line: FittedLine) -> tuple[FloatArray, FloatArray]:
    """Position (3,) and rotation D (3, 3) of a local system with the line as Z̄ axis, X̄ = Ȳ = 0."""
    across = tangent_axes(line.direction)
    return line.origin, np.stack([across[:, 0], across[:, 1], line.direction])


def _weights(points: FloatArray, weights: FloatArray | None) -> FloatArray:
    return np.ones(len(points)) if weights is None else np.asarray(weights, dtype=float)


def _principal(
    points: FloatArray, weight: FloatArray, fewest: int
) -> tuple[FitOutcome, FloatArray, FloatArray, FloatArray]:
    nothing = np.full(3, np.nan), np.full(3, np.nan), np.full((3, 3), np.nan)
    if len(points) < fewest:
        return FitOutcome.TOO_FEW, *nothing
    if not np.all(np.isfinite(points)) or not np.all(weight > 0.0):
        return FitOutcome.INVALID, *nothing
    origin = weight @ points / np.sum(weight)
    values, axes = principal_rows((points - origin) * np.sqrt(weight / np.sum(weight))[:, None])
    if values[0] <= 1e-14 * float(np.max(np.abs(points))):
        return FitOutcome.COINCIDENT, *nothing
    return FitOutcome.DETERMINED, origin, values, axes
