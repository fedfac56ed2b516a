"""Closed-form similarity between two sets of points, in space and in the plane; weighted, with or without
scale.

target = λ R source + t. The rotation is the orthogonal factor of the weighted cross-covariance (P. H.
Schönemann 1966; B. K. P. Horn 1987; S. Umeyama 1991 for the sign of the determinant), the scale follows
from the spreads. A local system X̄ = λ D (X − X0) is the same with D = R, X0 = ``origin``.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry import tolerant

LINE = 1e-9
"""Extension across, relative to that along, below which points lie in a line, or at one place."""
BETTER = 10.0
"""So many times smaller must the residuals of the reflection be for the sets to count as mirrored."""


class SimilarityOutcome(Enum):
    """What became of a similarity, in words."""

    DETERMINED = "determined"
    TOO_FEW = "fewer common points than the transformation needs"
    INVALID = "a coordinate is no number, or the sets differ in size"
    COINCIDENT = "the points of one set all lie at one place"
    COLLINEAR = "the points lie in one line: the turn about it is open"
    MIRRORED = "one set is the mirror image of the other: a left-handed system, or exchanged axes"

    @property
    def usable(self) -> bool:
        """True if the transformation can serve as a start value."""
        return self is SimilarityOutcome.DETERMINED


class Similarity(NamedTuple):
    """target = scale · rotation · source + translation, in d = 2 or 3 dimensions."""

    outcome: SimilarityOutcome
    scale: float
    rotation: FloatArray
    """(d, d)"""
    translation: FloatArray
    """(d,)"""
    residuals: FloatArray
    """(n, d) transformed minus target, in the unit of the target."""
    sigma0: float
    """Standard deviation of a coordinate of weight one; not a number without redundancy."""

    def transform(self, points: FloatArray) -> FloatArray:
        """Carry points (n, d) over."""
        return np.asarray(self.scale * points @ self.rotation.T + self.translation)

    @property
    def origin(self) -> FloatArray:
        """(d,) the source point that becomes the zero of the target: X0 of a local system."""
        return np.asarray(-self.rotation.T @ self.translation / self.scale)

    def inverse(self, points: FloatArray) -> FloatArray:
        """Carry points (n, d) of the target back."""
        return np.asarray((points - self.translation) @ self.rotation / self.scale)


def similarity(source: FloatArray, target: FloatArray, weights: FloatArray | None = None) -> Similarity:
    """Similarity with scale of n points (n, d), d = 2 (n ≥ 2) or 3 (n ≥ 3, not collinear); ``weights`` (n,) > 0."""
    return _solved(source, target, weights, scaled=True)


def congruence(source: FloatArray, target: FloatArray, weights: FloatArray | None = None) -> Similarity:
    """Return the same with scale 1."""
    return _solved(source, target, weights, scaled=False)


def _solved(
    source: FloatArray, target: FloatArray, weights: FloatArray | None, *, scaled: bool
) -> Similarity:
    source, target = np.asarray(source, dtype=float), np.asarray(target, dtype=float)
    weight = np.ones(len(source)) if weights is None else np.asarray(weights, dtype=float)
    refusal = _refusal(source, target, weight)
    if refusal is not None:
        return _failed(refusal, source)
    dimension = source.shape[1]
    centre_source = weight @ source / np.sum(weight)
    centre_target = weight @ target / np.sum(weight)
    a, b = source - centre_source, target - centre_target
    left, values, right = tolerant.svd(b.T @ (a * weight[:, None]))
    proper = np.ones(dimension)
    proper[-1] = np.sign(np.linalg.det(left @ right))
    rotation = (left * proper) @ right
    spread_source, spread_target = (
        float(np.sum(weight[:, None] * a**2)),
        float(np.sum(weight[:, None] * b**2)),
    )
    scale = float(values @ proper) / spread_source if scaled else 1.0
    if not scale > 0.0:
        return _failed(SimilarityOutcome.MIRRORED, source)
    translation = centre_target - scale * rotation @ centre_source
    residuals = scale * source @ rotation.T + translation - target
    objective = float(np.sum(weight[:, None] * residuals**2))
    reflected = float(np.sum(values))
    mirrored_scale = reflected / spread_source if scaled else 1.0
    mirrored = spread_target + mirrored_scale**2 * spread_source - 2.0 * mirrored_scale * reflected
    is_mirrored = proper[-1] < 0.0 and objective > BETTER**2 * max(mirrored, 1e-20 * spread_target)
    redundancy = source.size - dimension - dimension * (dimension - 1) // 2 - int(scaled)
    return Similarity(
        SimilarityOutcome.MIRRORED if is_mirrored else SimilarityOutcome.DETERMINED,
        scale,
        rotation,
        translation,
        residuals,
        float(np.sqrt(objective / redundancy)) if redundancy > 0 else float("nan"),
    )


def _refusal(source: FloatArray, target: FloatArray, weight: FloatArray) -> SimilarityOutcome | None:
    if source.shape != target.shape or len(weight) != len(source) or source.shape[1] not in (2, 3):
        return SimilarityOutcome.INVALID
    if not np.all(np.isfinite(source)) or not np.all(np.isfinite(target)) or not np.all(weight > 0.0):
        return SimilarityOutcome.INVALID
    if len(source) < source.shape[1]:
        return SimilarityOutcome.TOO_FEW
    for points in (source, target):
        values = tolerant.singular_values(points - points.mean(axis=0))
        size = float(np.max(np.abs(points)))
        if values[0] <= 1e-14 * size:
            return SimilarityOutcome.COINCIDENT
        if points.shape[1] == 3 and values[1] <= LINE * values[0]:
            return SimilarityOutcome.COLLINEAR
    return None


def _failed(outcome: SimilarityOutcome, source: FloatArray) -> Similarity:
    dimension = source.shape[1] if source.ndim == 2 else 3
    nothing = float("nan")
    return Similarity(
        outcome,
        nothing,
        np.full((dimension, dimension), nothing),
        np.full(dimension, nothing),
        np.full(source.shape, nothing),
        nothing,
    )
