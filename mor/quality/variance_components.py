"""Variance components: how far the residuals of each group agree with the σ the group came with.

Two methods estimate the factor f_g of the variances of each group from its part Ω_g of vᵀPv:

    simplified   f_g = Ω_g/Σr_g (W. Förstner, 1979), as if the groups did not mix; σ of about √(2/Σr_g) of itself,
    helmert      f = S⁻¹ Ω with Helmert's full system (see ``helmert.py``); σ out of the covariance matrix 2 S⁻¹.

Taken into the weights and repeated until nothing changes, both end at the same place, the restricted maximum likelihood
estimate; of one step alone, only the full system is unbiased. It needs the covariance matrix of all unknowns, so that
large problems are left to the simplified one. What is told is the factor of σ, √f_g, and its standard deviation,
½ σ(f_g)/√f_g.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from mor.model import rotations
from mor.model.contract import ObservationGroup
from mor.quality.assessment import Levels, Quality, assess
from mor.quality.robust_estimation import reweighted
from mor.quality.test_statistics import omega_of, redundancy_of
from mor.solve.iterate import Adjustment, adjust
from mor.solve.problem import Problem
from mor.types import BoolArray, FloatArray

Method = Literal["simplified", "helmert"]


class Components(NamedTuple):
    """Estimated factors of the σ of each group."""

    factors: FloatArray
    """(g,) factor on σ; 1 where the group has too little redundancy."""
    sigma: FloatArray
    """(g,) their standard deviations, NaN where there is none."""
    settled: bool
    rounds: int
    method: Method = "simplified"
    """How they were found: simplified also where Helmert's system was asked for, but is too large or singular."""
    iterated: bool = False
    """True where the weights have them in."""

    def of(self, group: ObservationGroup, number: int) -> FloatArray:
        """(n, m) the factor of a group for each of its observations."""
        return np.full(group.observed.shape, self.factors[number])


def components(quality: Quality, method: Method = "simplified") -> Components:
    """Factors of σ from one adjustment, nothing iterated.

    A group whose component comes out negative, which Helmert's estimate allows, has neither factor nor σ.
    """
    redundancy = group_sums(quality)[1]
    # Redundancy from which on a group's factor is told.
    return _told(_estimate(quality, method, redundancy >= 0.5))


def _told(found: _Estimate) -> Components:
    possible = found.variances >= 0.0
    factors = np.sqrt(np.where(possible, found.variances, 1.0))
    sigma = np.where(possible, factors * found.spread, np.nan)
    return Components(factors, sigma, False, 1, found.method)


def iterated_components(
    quality: Quality, levels: Levels, aposteriori: bool, method: Method = "simplified"
) -> tuple[Components, Quality]:
    """Factors of σ iterated into the weights, and the quality of the adjustment with them."""
    problem = quality.adjustment.problem
    total, estimated = np.ones(len(problem.groups)), np.ones(len(problem.groups), dtype=bool)
    for rounds in range(1, 101):
        # The component of a group with less redundancy may run away to zero: it keeps the σ it came with.
        estimated &= group_sums(quality)[1] >= 2.0 - 1e-6
        found = _step(quality, method, estimated)
        step = np.where(estimated & (found > 0.0), found, 1.0 / total)
        total = total * step
        adjustment = _adjusted(quality.adjustment, problem, total)
        if not adjustment.outcome.is_solution:
            return Components(total, np.full(len(total), np.nan), False, rounds, method, True), quality
        quality = assess(adjustment, levels, aposteriori)
        if has_settled(step):
            break
    settled = has_settled(step)
    last = _estimate(quality, method, estimated)
    sigma = np.where(estimated, total * last.spread, np.nan)
    return Components(total, sigma, settled, rounds, last.method, True), quality


def has_settled(step: FloatArray) -> bool:
    """True where the factors (g,) of a round change nothing any more."""
    return bool(np.abs(step - 1.0).max(initial=0.0) < 1e-7)


class _Estimate(NamedTuple):
    """Factors f (g,) of the variances; ½ σ(f)/f (g,), NaN where there is no estimate; how they were found."""

    variances: FloatArray
    spread: FloatArray
    method: Method


def _helmert_system(quality: Quality) -> FloatArray | None:
    """Helmert's system of the groups; nothing where it has no room."""
    # Imported here: its sparse library loads longer than a small project is adjusted.
    from mor.quality.helmert import affordable, helmert_system

    return helmert_system(quality) if affordable(quality) else None


def _estimate(quality: Quality, method: Method, estimated: BoolArray) -> _Estimate:
    """Factors of the variances of the groups to be estimated; all others keep their σ, with the factor 1."""
    omega, redundancy = group_sums(quality)
    system = _helmert_system(quality) if method == "helmert" and estimated.any() else None
    if system is not None:
        own, rest = system[np.ix_(estimated, estimated)], system[np.ix_(estimated, ~estimated)]
        size = np.sqrt(np.diagonal(own))
        # Smallest eigenvalue of Helmert's system, scaled to unit diagonal, from which the groups can be told apart.
        if rotations.eigvalsh(own / np.outer(size, size))[0] > 1e-6:
            variances, spread = np.ones(len(omega)), np.full(len(omega), np.nan)
            inverse = rotations.inv(own)
            variances[estimated] = inverse @ (omega[estimated] - rest.sum(axis=1))
            spread[estimated] = np.sqrt(0.5 * np.diagonal(inverse))
            return _Estimate(variances, spread, "helmert")
    return _simplified(omega, redundancy, estimated)


def _simplified(omega: FloatArray, redundancy: FloatArray, estimated: BoolArray) -> _Estimate:
    safe = np.where(estimated, redundancy, np.nan)
    return _Estimate(np.where(estimated, omega / safe, 1.0), 1.0 / np.sqrt(2.0 * safe), "simplified")


def _step(quality: Quality, method: Method, estimated: BoolArray) -> FloatArray:
    """Factors (g,) to multiply σ with; simplified ones where some of Helmert's are negative.

    0 where there is none: also a simplified one is negative where groups share a covariance.
    """
    found = _estimate(quality, method, estimated).variances
    if (found <= 0.0).any():
        found = _estimate(quality, "simplified", estimated).variances
    return np.asarray(np.sqrt(np.maximum(found, 0.0)))


def _adjusted(last: Adjustment, problem: Problem, total: FloatArray) -> Adjustment:
    factors = [np.full(group.observed.shape, f) for group, f in zip(problem.groups, total, strict=True)]
    return adjust(reweighted(problem, factors), last.values)


def group_sums(quality: Quality) -> tuple[FloatArray, FloatArray]:
    """(g,) Ω_g = Σ v·Pv and Σ r of each group."""
    omega = np.array([omega_of(group) for group in quality.groups])
    redundancy = np.array([redundancy_of(group) for group in quality.groups])
    return omega, redundancy
