"""What many simulated measurements say of the statistics of one adjustment: bias, coverage, levels, power.

The adjustment at the true place has cofactors Q, redundancy numbers r and critical values. Each run draws errors,
adjusts, and compares with the truth: the solution with Q, the residuals with their tests. In a second adjustment of
each run an observation drawn at random has an error of the size ∇ that its test finds with the power β0. What is
counted here is added up run by run; sums of chunks of runs, added in their order, do not depend on who worked them out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from scipy.special import chdtri, fdtri

from mor.adjustment.linearise import misclosures
from mor.adjustment.problem import Problem
from mor.adjustment.state import Adjustment
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry import tolerant
from mor.geometry.rotations import angles_from_rotation
from mor.parameters.index import Values, moves_by_angles
from mor.quality.assess import Quality
from mor.quality.simulation.measurements import errors, with_observed
from mor.quality.tests.test_statistics import CONTROLLED, global_test

CONFIDENCE = 0.95
"""Of the regions whose coverage is counted."""

Solve = Callable[[Problem], Adjustment | None]
"""Adjusts a problem; nothing where no start values are found."""


@dataclass(frozen=True)
class Truth:
    """The adjustment at the true place, and what its statistics promise."""

    problem: Problem
    """With observations that are free of errors."""
    place: Values
    quality: Quality

    @cached_property
    def sigma(self) -> FloatArray:
        """(u,) σ of the unknowns for σ0 = 1; 0 where the datum holds one."""
        index = self.problem.index
        variance = np.zeros(index.count)
        for kind, columns in index.columns.items():
            diagonal = np.diagonal(self.quality.cofactors[kind], axis1=1, axis2=2)
            variance[columns[columns >= 0]] = diagonal[columns >= 0]
        return np.sqrt(np.maximum(variance, 0.0))

    @cached_property
    def points(self) -> IntArray:
        """(p,) point blocks that have something unknown."""
        return np.flatnonzero((self.problem.index.columns["point"] >= 0).any(axis=1))

    @cached_property
    def regions(self) -> tuple[FloatArray, IntArray]:
        """(p, 3, 3) pseudo-inverses of the cofactors of the points, and (p,) their ranks."""
        q = np.nan_to_num(self.quality.cofactors["point"][self.points])
        if not len(q):
            return np.zeros((0, 3, 3)), np.zeros(0, dtype=np.int64)
        values, vectors = tolerant.eigh(q)
        kept = values > 1e-10 * np.maximum(values[:, -1:], 1e-300)
        inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
        return np.einsum("pij,pj,pkj->pik", vectors, inverse, vectors), kept.sum(axis=1)

    @cached_property
    def testable(self) -> tuple[BoolArray, ...]:
        """(n, m) by group: observations that have a test."""
        found = []
        for group, one in zip(self.problem.groups, self.quality.groups, strict=True):
            with np.errstate(invalid="ignore"):
                controlled = one.q_weighted > CONTROLLED * one.precision
            found.append(np.asarray(controlled & group.mask & ~group.left_out))
        return tuple(found)

    def tests(self, values: Values, problem: Problem) -> FloatArray:
        """(t,) test values w_B of all observations that have a test, with the residuals at these values."""
        weighted = [
            np.nan_to_num(-misclosures(group, values)) / np.nan_to_num(group.sigma, nan=1.0) ** 2
            for group in problem.groups
        ]
        flat = np.concatenate([part.ravel() for part in weighted])
        for cluster in problem.clusters:
            v = np.concatenate([np.nan_to_num(-misclosures(g, values)).ravel() for g in problem.groups])
            flat[cluster.entries] = tolerant.solve(cluster.covariance, v[cluster.entries])
        q = np.concatenate([one.q_weighted.ravel() for one in self.quality.groups])
        chosen = np.concatenate([mask.ravel() for mask in self.testable])
        return np.asarray(flat[chosen] / np.sqrt(q[chosen]))

    def corrections(self, values: Values) -> FloatArray:
        """(u,) what a solution differs from the truth."""
        index = self.problem.index
        found = np.zeros(index.count)
        for kind, columns in index.columns.items():
            free = columns >= 0
            found[columns[free]] = self._difference(kind, values[kind])[free]
        return found

    def _difference(self, kind: str, values: FloatArray) -> FloatArray:
        true, blocks = self.place[kind], self.problem.index.blocks[kind]
        if not blocks.kind.is_rotation:
            return values - true
        turn = values @ np.swapaxes(true, 1, 2)
        skew = 0.5 * (np.swapaxes(turn, 1, 2) - turn)
        small = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        angles = angles_from_rotation(values) - angles_from_rotation(true)
        folded = np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi
        return np.where(moves_by_angles(blocks)[:, None], folded, small)


@dataclass(frozen=True)
class Tally:
    """Counts and sums over runs; those of more runs are their sums."""

    runs: FloatArray
    """() number of runs."""
    solved: FloatArray
    """() runs that led to a solution."""
    correction: FloatArray
    """(u,) Σ (x̂ − x)/σ."""
    square: FloatArray
    """(u,) Σ ((x̂ − x)/σ)²."""
    covered: FloatArray
    """(p,) runs in which the confidence region of a point, with σ0 a priori, covers it."""
    covered_after: FloatArray
    """(p,) the same with σ0 a posteriori."""
    coverage: FloatArray
    """(2,) Σ of the share of points that are covered, and of its square."""
    omega: FloatArray
    """() Σ vᵀPv."""
    rejected: FloatArray
    """() runs that the global test rejects."""
    flagged: FloatArray
    """(2,) Σ of the share of observations that are flagged, and of its square."""
    planted: FloatArray
    """() runs with a planted error that led to a solution."""
    found: FloatArray
    """() those of them in which the test of this observation finds it."""
    objective: FloatArray
    """() Σ of w² of all observations that have a test, by their number."""

    def __add__(self, other: Tally) -> Tally:
        return Tally(*(getattr(self, one.name) + getattr(other, one.name) for one in fields(self)))

    def arrays(self) -> dict[str, FloatArray]:
        """The sums by name, to be kept."""
        return {one.name: np.asarray(getattr(self, one.name), dtype=float) for one in fields(self)}


def tally_of(arrays: Mapping[str, FloatArray]) -> Tally:
    """A tally that was kept."""
    return Tally(*(np.asarray(arrays[one.name], dtype=float) for one in fields(Tally)))


def empty_tally(truth: Truth) -> Tally:
    """The tally of no run."""
    u, p = truth.problem.index.count, len(truth.points)
    zero, two = np.zeros(()), np.zeros(2)
    return Tally(
        zero, zero, np.zeros(u), np.zeros(u), np.zeros(p), np.zeros(p), two, zero, zero, two, zero, zero, zero
    )


def one_run(truth: Truth, seed: int, number: int, solve: Solve) -> Tally:
    """The tally of one run; the same for the same seed and number, whatever was run before."""
    generator = np.random.default_rng([seed, number])
    drawn = errors(truth.problem, generator)
    observed = [group.observed + e for group, e in zip(truth.problem.groups, drawn, strict=True)]
    noisy = with_observed(truth.problem, observed)
    tally = empty_tally(truth)
    adjustment = solve(noisy)
    tally = replace(tally, runs=np.ones(()))
    if adjustment is not None and adjustment.outcome.is_solution:
        tally = _counted(truth, tally, adjustment, noisy)
    return _with_power(truth, tally, noisy, observed, generator, solve)


def _counted(truth: Truth, tally: Tally, adjustment: Adjustment, noisy: Problem) -> Tally:
    quality, omega = truth.quality, adjustment.normals.objective
    redundancy = quality.redundancy
    dx = truth.corrections(adjustment.values)
    z = np.where(truth.sigma > 0.0, dx / np.where(truth.sigma > 0.0, truth.sigma, 1.0), 0.0)
    inverse, rank = truth.regions
    d = (adjustment.values["point"] - truth.place["point"])[truth.points]
    size = np.einsum("pi,pij,pj->p", d, inverse, d)
    covered = (size <= chdtri(np.maximum(rank, 1), 1.0 - CONFIDENCE)).astype(float)
    after = np.zeros(len(rank))
    if redundancy > 0:
        limit = rank * fdtri(np.maximum(rank, 1), redundancy, CONFIDENCE)
        after = (size <= limit * omega / redundancy).astype(float)
    w = truth.tests(adjustment.values, noisy)
    share = float((np.abs(w) > quality.critical).mean()) if len(w) else 0.0
    part = float(covered.mean()) if len(covered) else 0.0
    test = global_test(omega, redundancy, quality.levels.overall)
    return replace(
        tally,
        solved=np.ones(()),
        correction=z,
        square=z**2,
        covered=covered,
        covered_after=after,
        coverage=np.array([part, part**2]),
        omega=np.asarray(omega),
        rejected=np.asarray(0.0 if test.accepted else 1.0),
        flagged=np.array([share, share**2]),
        objective=np.asarray(float(np.mean(w**2)) if len(w) else 0.0),
    )


def _with_power(
    truth: Truth,
    tally: Tally,
    noisy: Problem,
    observed: list[FloatArray],
    generator: np.random.Generator,
    solve: Solve,
) -> Tally:
    """The tally with an error of the size ∇ in one observation, drawn among all that have a test."""
    ends = np.cumsum([np.count_nonzero(mask) for mask in truth.testable])
    count = int(ends[-1])
    if count == 0:
        return tally
    chosen, sign = int(generator.integers(count)), 1.0 if generator.random() < 0.5 else -1.0
    number = int(np.searchsorted(ends, chosen, side="right"))
    mask = truth.testable[number]
    row, component = np.argwhere(mask)[chosen - int(ends[number]) + int(np.count_nonzero(mask))]
    nabla = float(truth.quality.reliability[number].at(np.array([row])).smallest[0, component])
    with_error = [values.copy() if k == number else values for k, values in enumerate(observed)]
    with_error[number][row, component] += sign * nabla
    adjustment = solve(with_observed(noisy, with_error))
    if adjustment is None or not adjustment.outcome.is_solution:
        return tally
    w = truth.tests(adjustment.values, adjustment.problem)[chosen]
    hit = abs(float(w)) > truth.quality.critical
    return replace(tally, planted=np.ones(()), found=np.asarray(1.0 if hit else 0.0))
