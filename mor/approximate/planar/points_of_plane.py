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
    Homography,
    fit_homography,
    homographies_of_four,
    misfits,
    significance_of_points,
)
from mor.arrays import BoolArray, IntArray

LEVEL = 0.001
AGREES = float(chdtri(2, LEVEL))
"""Σ (v/σ)² up to which a point is carried over: two conditions, at the level of data snooping.

A point of the plane told from it loses nothing: it gets a height of none within its σ. One off it and taken for one of
it bends the shape, and is told without a height, with the σ of a point of the plane: hence no 5 σ.
"""
LEAST = 5
"""Points that must agree: any four do."""
PART = 0.5
"""Part of the points that must agree: in a crowd some always lie in a plane by accident."""
SAMPLES = 200
STEPS, ROUNDS = 3, 5
"""Adjustments of the half that fits best, and of all that agree."""


def carried_over(a: Bundle, b: Bundle) -> BoolArray:
    """(n,) true for the points of the plane that most of the n homologous rays of two images lie in.

    All of them where each fits to the others and all together, or where fewer than five, or less than half, would be
    left: what is wrong then shows in the misfit.
    """
    everything = np.ones(len(a), dtype=bool)
    whole = fit_homography(a, b)
    fits = _variance(whole) == 1.0 and np.all(significance_of_points(a, b, whole, everything) < AGREES)
    if len(a) <= LEAST or fits:
        return everything
    kept = _best_half(a, b, _samples(len(a)))
    for _ in range(ROUNDS):
        homography = fit_homography(a.take(kept), b.take(kept))
        now = significance_of_points(a, b, homography, kept) < AGREES * _variance(homography)
        if np.sum(now) < max(LEAST, PART * len(a)):
            return everything
        if np.array_equal(now, kept):
            break
        kept = now
    return kept


def _variance(homography: Homography) -> float:
    """Variance of unit weight where σ are too small beyond doubt, else one."""
    redundancy = homography.redundancy
    too_small = redundancy > 0 and homography.objective > float(chdtri(redundancy, LEVEL))
    return homography.objective / redundancy if too_small else 1.0


def _samples(count: int) -> IntArray:
    if comb(count, 4) <= SAMPLES:
        return np.array(list(combinations(range(count), 4)))
    generator = np.random.default_rng(count)
    return np.stack([generator.permutation(count)[:4] for _ in range(SAMPLES)])


def _best_half(a: Bundle, b: Bundle, samples: IntArray) -> BoolArray:
    """The half of the points that fits best: least trimmed squares (P. J. Rousseeuw 1984) over ``samples`` (m, 4).

    Grown from there a collineation is not bent by points off the plane that hide each other.
    """
    half = max(LEAST, int(np.ceil(PART * len(a))))
    found = misfits(a, b, homographies_of_four(a.directions[samples], b.directions[samples]))
    best = found[np.argmin(np.sum(np.sort(found, axis=1)[:, :half], axis=1))]
    for _ in range(STEPS):
        kept = np.zeros(len(a), dtype=bool)
        kept[np.argsort(best)[:half]] = True
        best = significance_of_points(a, b, fit_homography(a.take(kept), b.take(kept)), kept)
    return kept
