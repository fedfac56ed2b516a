"""Which of many points lie in one plane: those that one collineation carries from the first image to each other.

Killian: the evaluations of two images, compared with each other, tell a point in the plane from one off it.
"""

from __future__ import annotations

from itertools import combinations
from math import comb

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.planar.homography import fit_homography, linear_homography
from mor.approximate.planar.two_images import misfit_limit
from mor.approximate.vectors import cross
from mor.arrays import BoolArray, FloatArray, IntArray

AGREES = 5.0
"""Residual in units of σ up to which a point is carried over."""
LEAST = 5
"""Points that must agree: any four do."""
PART = 0.5
"""Part of the points that must agree: in a crowd some always lie in a plane by accident."""
SAMPLES = 200
ROUNDS = 5


def carried_over(a: Bundle, b: Bundle) -> BoolArray:
    """(n,) true for the points of the plane that most of the n homologous rays of two images lie in.

    All of them where they fit together, or where fewer than five, or less than half, would be left: what is wrong
    then shows in the misfit.
    """
    everything = np.ones(len(a), dtype=bool)
    if len(a) <= LEAST or _fits(a, b):
        return everything
    kept = min((_agreeing(a, b, sample) for sample in _samples(len(a))), key=lambda one: one[0])[1]
    for _ in range(ROUNDS):
        if np.sum(kept) < max(LEAST, PART * len(a)):
            return everything
        matrix = fit_homography(a.take(kept), b.take(kept)).matrix
        now = _residuals(a, b, matrix) < AGREES
        if np.array_equal(now, kept):
            break
        kept = now
    return kept


def _fits(a: Bundle, b: Bundle) -> bool:
    homography = fit_homography(a, b)
    return homography.objective <= misfit_limit(homography.redundancy)


def _samples(count: int) -> IntArray:
    if comb(count, 4) <= SAMPLES:
        return np.array(list(combinations(range(count), 4)))
    generator = np.random.default_rng(count)
    return np.stack([generator.permutation(count)[:4] for _ in range(SAMPLES)])


def _agreeing(a: Bundle, b: Bundle, sample: IntArray) -> tuple[float, BoolArray]:
    """Truncated Σ (v/σ)² of the collineation of four points, and the points that agree with it, twice generously."""
    residuals = _residuals(a, b, linear_homography(a.take(sample), b.take(sample)))
    return float(np.sum(np.minimum(residuals, 2.0 * AGREES) ** 2)), np.asarray(residuals < 2.0 * AGREES)


def _residuals(a: Bundle, b: Bundle, matrix: FloatArray) -> FloatArray:
    """Misfits of the rays in units of σ: the angles in b and in a, each by its own σ, share their errors."""
    there = _angles(a.rays @ matrix.T, b.rays) / (b.sigma / np.linalg.norm(b.rays, axis=1))
    back = _angles(b.rays @ _adjugate(matrix).T, a.rays) / (a.sigma / np.linalg.norm(a.rays, axis=1))
    return np.asarray(1.0 / np.hypot(1.0 / np.maximum(there, 1e-9), 1.0 / np.maximum(back, 1e-9)))


def _adjugate(matrix: FloatArray) -> FloatArray:
    rows = matrix
    return np.stack([cross(rows[1], rows[2]), cross(rows[2], rows[0]), cross(rows[0], rows[1])], axis=1)


def _angles(first: FloatArray, second: FloatArray) -> FloatArray:
    sine = np.linalg.norm(cross(first, second), axis=1)
    return np.asarray(np.arctan2(sine, np.abs(np.sum(first * second, axis=1))))
