"""Variance components: how far the residuals of each group agree with the σ the group came with.

Ω_g/Σr_g, the part of vᵀPv of a group over its redundancy, estimates the factor of its variances (W. Förstner, 1979).
Taken into the weights and repeated until nothing changes, it is the Helmert estimate, and equals the restricted maximum
likelihood one. Its σ is about √(2/Σr_g) of itself: below, the standard deviation of the factor of σ, ½ of that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mor.adjustment.problem import Problem
from mor.adjustment.solve import Adjustment, adjust
from mor.geometry.arrays import FloatArray
from mor.observations import ObservationGroup
from mor.quality.assess import Levels, Quality, assess
from mor.quality.exclusion import reweighted

_REPORTED = 0.5
"""Redundancy from which on a group's factor is told."""
_LEAST = 2.0
"""Redundancy a group must have, with its final weights too, for its factor to be iterated into the weights.

Others keep the σ they came with: the component of so small a group may run away to zero.
"""
_ROUNDS = 100
_SETTLED = 1e-7


@dataclass(frozen=True)
class Components:
    """Estimated factors of the σ of each group."""

    factors: FloatArray
    """(g,) factor on σ; 1 where the group has too little redundancy."""
    sigma: FloatArray
    """(g,) their standard deviations, NaN where there is none."""
    settled: bool
    rounds: int

    def of(self, group: ObservationGroup, number: int) -> FloatArray:
        """(n, m) the factor of a group for each of its observations."""
        return np.full(group.observed.shape, self.factors[number])


def components(quality: Quality) -> Components:
    """Factors of σ from one adjustment, nothing iterated."""
    omega, redundancy = group_sums(quality)
    estimated = redundancy >= _REPORTED
    factors = np.sqrt(np.where(estimated, omega / np.where(estimated, redundancy, 1.0), 1.0))
    return Components(factors, _sigma(factors, redundancy), False, 1)


def iterated_components(quality: Quality, levels: Levels, aposteriori: bool) -> tuple[Components, Quality]:
    """Factors of σ iterated into the weights, and the quality of the adjustment with them."""
    problem = quality.adjustment.problem
    total, estimated = np.ones(len(problem.groups)), np.ones(len(problem.groups), dtype=bool)
    for rounds in range(1, _ROUNDS + 1):
        estimated &= group_sums(quality)[1] >= _LEAST - 1e-6
        found = components(quality).factors
        step = np.where(estimated & (found > 0.0), found, 1.0 / total)
        total = total * step
        adjustment = _adjusted(quality.adjustment, problem, total)
        if not adjustment.outcome.is_solution:
            return Components(total, np.full(len(total), np.nan), False, rounds), quality
        quality = assess(adjustment, levels, aposteriori)
        if np.abs(step - 1.0).max(initial=0.0) < _SETTLED:
            break
    settled = bool(np.abs(step - 1.0).max(initial=0.0) < _SETTLED)
    _, redundancy = group_sums(quality)
    sigma = np.where(estimated, _sigma(total, redundancy), np.nan)
    return Components(total, sigma, settled, rounds), quality


def _adjusted(last: Adjustment, problem: Problem, total: FloatArray) -> Adjustment:
    factors = [np.full(group.observed.shape, f) for group, f in zip(problem.groups, total, strict=True)]
    return adjust(reweighted(problem, factors), last.values)


def group_sums(quality: Quality) -> tuple[FloatArray, FloatArray]:
    """(g,) Ω_g = Σ v·Pv and Σ r of each group."""
    omega = np.array([float(np.nansum(group.v * group.weighted)) for group in quality.groups])
    redundancy = np.array([float(np.nansum(group.r)) for group in quality.groups])
    return omega, redundancy


def _sigma(factors: FloatArray, redundancy: FloatArray) -> FloatArray:
    estimated = redundancy >= _REPORTED
    return np.where(estimated, factors / np.sqrt(2.0 * np.where(estimated, redundancy, 1.0)), np.nan)
