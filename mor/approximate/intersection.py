"""Spatial intersection: a point from its rays in frames of known position and attitude."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.reprojection import ahead, reproject
from mor.approximate.vectors import unit
from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant

PARALLEL = 3.0
"""Rays are parallel if the distance along them is not known to a part of one in so many."""
WRONG = 5.0
"""σ0 beyond which the rays do not meet."""


class IntersectionOutcome(Enum):
    """What became of an intersection, in words."""

    DETERMINED = "the rays meet in front of their frames"
    TOO_FEW = "fewer than two rays"
    PARALLEL = "the rays are parallel, or all but: their intersection is at no determined distance"
    BEHIND = "the rays meet behind a frame"
    DOES_NOT_MEET = "the rays do not meet within their precision"

    @property
    def usable(self) -> bool:
        """True if the point can serve as a start value."""
        return self is IntersectionOutcome.DETERMINED


class Intersection(NamedTuple):
    """A point and how well its rays determine it."""

    outcome: IntersectionOutcome
    point: FloatArray
    """(3,); of parallel rays not a number."""
    covariance: FloatArray
    """(3, 3) for the a-priori σ of the rays."""
    sigma0: float
    """√(Σ (v/σ)² / (2n − 3))."""
    residuals: FloatArray
    """(n, 2) in units of σ."""
    front: BoolArray
    """(n,)"""
    angle: float
    """Largest angle between two of the rays, in radians, at most π/2."""


def intersect(
    bundle: Bundle, positions: FloatArray, rotations: FloatArray, iterations: int = 10
) -> Intersection:
    """Intersect n ≥ 2 rays: ray i of ``bundle`` stands in the frame ``positions[i]`` (3,), ``rotations[i]``
    (3, 3).

    Closed form: the point of least Σ |distance from ray|², weighted by (distance of the frame)⁻²; then Gauss–
    Newton on the measured coordinates. The covariance follows from the latter.
    """
    if len(bundle) < 2:
        return _failed(IntersectionOutcome.TOO_FEW, len(bundle))
    rays = unit(np.einsum("nij,ni->nj", rotations, bundle.rays))
    angle = float(np.arcsin(min(1.0, np.max(np.linalg.norm(np.cross(rays[:, None], rays[None]), axis=-1)))))
    if angle < PARALLEL * bundle.noise:
        return _failed(IntersectionOutcome.PARALLEL, len(bundle), angle)
    point = nearest_point(positions, rays)
    for _ in range(iterations):
        star = np.einsum("nij,nj->ni", rotations, point - positions)
        computed = reproject(bundle, star)
        design = (computed.by_star @ rotations).reshape(-1, 3)
        step = -tolerant.lstsq(design, computed.residuals.ravel(), rcond=None)
        point = point + step
        if not np.all(np.isfinite(point)) or np.linalg.norm(step) < 1e-13 * np.max(np.abs(point - positions)):
            break
    return _judged(bundle, positions, rotations, point, angle)


def nearest_point(positions: FloatArray, directions: FloatArray) -> FloatArray:
    """Point (3,) nearest to n lines through ``positions`` (n, 3) along unit ``directions`` (n, 3).

    Solved twice: the second time every distance counts by the range at which it is seen. Raises nothing;
    parallel lines give the solution of least norm relative to the mean position.
    """
    centre = positions.mean(axis=0)
    weights = np.ones(len(positions))
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    point = centre
    for _ in range(2):
        normal = np.einsum("n,nij->ij", weights, across)
        side = np.einsum("n,nij,nj->i", weights, across, positions - centre)
        point = centre + tolerant.lstsq(normal, side, rcond=1e-15)
        ranges = np.linalg.norm(point - positions, axis=1)
        if not ranges.any():
            break  # all lines come from one place
        weights = 1.0 / np.maximum(ranges, 1e-9 * (np.max(ranges) + 1e-300)) ** 2
    return np.asarray(point)


def _judged(
    bundle: Bundle, positions: FloatArray, rotations: FloatArray, point: FloatArray, angle: float
) -> Intersection:
    star = np.einsum("nij,nj->ni", rotations, point - positions)
    computed = reproject(bundle, star)
    design = (computed.by_star @ rotations).reshape(-1, 3)
    values, axes = tolerant.eigh(design.T @ design)
    residuals = computed.residuals
    sigma0 = float(np.sqrt(np.sum(residuals**2) / (2 * len(bundle) - 3)))
    front = ahead(bundle, star)
    distance = float(np.min(np.linalg.norm(star, axis=1)))
    if not np.all(np.isfinite(point)) or values[0] * distance**2 < PARALLEL**2:
        return _failed(IntersectionOutcome.PARALLEL, len(bundle), angle)
    outcome = IntersectionOutcome.DETERMINED
    if sigma0 > WRONG:
        outcome = IntersectionOutcome.DOES_NOT_MEET
    elif not np.all(front):
        outcome = IntersectionOutcome.BEHIND
    return Intersection(outcome, point, (axes / values) @ axes.T, sigma0, residuals, front, angle)


def _failed(outcome: IntersectionOutcome, rays: int, angle: float = 0.0) -> Intersection:
    nothing = np.full((rays, 2), np.nan)
    front = np.zeros(rays, dtype=bool)
    return Intersection(outcome, np.full(3, np.nan), np.full((3, 3), np.nan), np.nan, nothing, front, angle)
