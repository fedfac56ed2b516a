"""Which of many points lie in one plane: those that one collineation carries from the first image to each other.

Killian: the evaluations of two images, compared with each other, tell a point in the plane from one off it.
"""

from __future__ import annotations

from itertools import combinations
from math import comb

import numpy as np
from scipy.special import chdtri

from mor.approximate.bundle import Bundle
from mor.approximate.planar.homography import (
    fit_homography,
    homographies_of_four,
    misfits,
    significance_of_points,
)
from mor.approximate.planar.two_images import BY_ITSELF
from mor.arrays import BoolArray, IntArray

AGREES = float(chdtri(2, BY_ITSELF))
"""Σ (v/σ)² up to which a point is carried over: two conditions, 5 σ."""
LEAST = 5
"""Points that must agree: any four do."""
PART = 0.5
"""Part of the points that must agree: in a crowd some always lie in a plane by accident."""
SAMPLES = 200
ROUNDS = 5


def carried_over(a: Bundle, b: Bundle) -> BoolArray:
    """(n,) true for the points of the plane that most of the n homologous rays of two images lie in.

    All of them where each fits to the others, or where fewer than five, or less than half, would be left: what is wrong
    then shows in the misfit.
    """
    everything = np.ones(len(a), dtype=bool)
    if len(a) <= LEAST or np.all(significance_of_points(a, b, fit_homography(a, b), everything) < AGREES):
        return everything
    kept = _largest(a, b, _samples(len(a)))
    for _ in range(ROUNDS):
        if np.sum(kept) < max(LEAST, PART * len(a)):
            return everything
        homography = fit_homography(a.take(kept), b.take(kept))
        variance = max(1.0, homography.objective / max(homography.redundancy, 1))
        now = significance_of_points(a, b, homography, kept) < AGREES * variance
        if np.array_equal(now, kept):
            break
        kept = now
    return kept


def _samples(count: int) -> IntArray:
    if comb(count, 4) <= SAMPLES:
        return np.array(list(combinations(range(count), 4)))
    generator = np.random.default_rng(count)
    return np.stack([generator.permutation(count)[:4] for _ in range(SAMPLES)])


def _largest(a: Bundle, b: Bundle, samples: IntArray) -> BoolArray:
    """Points that agree, twice generously, with the four of ``samples`` (m, 4) of least truncated Σ (v/σ)²."""
    found = misfits(a, b, homographies_of_four(a.directions[samples], b.directions[samples]))
    limit = 4.0 * AGREES
    return np.asarray(found[np.argmin(np.sum(np.minimum(found, limit), axis=1))] < limit)
