"""The starting point of a search: the network, how its adjustment ended, and values at which most observations fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from mor.adjustment.problem import Problem
from mor.adjustment.solve import Settings, adjust
from mor.adjustment.state import Adjustment, Iteration, Outcome, Watcher
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.diagnose.hypothesis import Fit
from mor.errors import InputError
from mor.observations import ObservationGroup
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.quality.assess import assess
from mor.quality.gross_errors.description_length import (
    cost_of_residuals,
    factor_of_sigmas,
    price_of_gross_error,
    sizes_of,
)
from mor.quality.gross_errors.exclusion import exclude
from mor.quality.gross_errors.graduated_weights import robust_scales
from mor.quality.gross_errors.reintersection import SUSPECT
from mor.quality.solved import PossibleCause
from mor.sparse.cholesky import NotFiniteError

SMALL = 20_000
"""Observations up to which graduated weights and intersections of single points take next to no time."""
_ITERATIONS = 15
_PATIENCE = 2
"""Iterations one after the other that do not halve vᵀPv, as long as it is far from what is expected."""
_PART_OUT, _MASS = 0.05, 3
"""Part of a group that is out, and number of its rows, from which on a single observation explains nothing."""
_AT_LEAST = 3
"""Rows of an image or a station of which half is more than chance."""


Make = Callable[[Network, Values, Values], Problem]
Begin = Callable[[Network], Values | None]


@dataclass(frozen=True)
class Situation:
    """What is known of a network whose observations do not agree."""

    network: Network
    start: Values
    values: Values
    """Where most observations fit: the solution, or where graduated weights lead."""
    solution: Adjustment | None
    """The adjustment, where there is one; suspects may be left out of it."""
    make: Make
    begin: Begin
    unstarted: frozenset[str] = frozenset()
    """Names of things without start values: what refers to them does not fit, and there is no place where most fit."""

    settled: bool = True
    """False where the values are start values, and nothing is known of where most observations fit."""
    scored: tuple[PossibleCause, ...] = ()
    """Possible causes by score tests of the solution, the best first."""
    larger: bool = True
    """False where all that is rejected is smaller than its σ says."""

    @cached_property
    def sizes(self) -> tuple[FloatArray, ...]:
        """|v|/σ (n, m) of every group, 0 where not observed; ∞ where start values are missing."""
        if self.unstarted:
            return tuple(np.where(self._concerned(group), np.inf, 0.0) for group in self.network.groups)
        problem = self.make(self.network, self.start, self.values)
        return sizes_of(problem.groups, self.values)

    def _concerned(self, group: ObservationGroup) -> BoolArray:
        """(n, m) observations that refer to something without start values."""
        rows = np.zeros(group.count, dtype=bool)
        for column in group.references:
            rows |= np.array([name in self.unstarted for name in column], dtype=bool)
        return group.mask & rows[:, None]

    @property
    def begun(self) -> bool:
        """False where start values could not be worked out."""
        return not self.unstarted

    @cached_property
    def linearised(self) -> Adjustment:
        """The normal equations of all observations, suspects among them, where most of them fit.

        Raises :class:`InputError`, :class:`NotFiniteError` where an observation has no value there.
        """
        with np.errstate(all="ignore"):
            return adjust(self.make(self.network, self.values, self.values), self.values, Settings(0))

    @cached_property
    def redundancy_numbers(self) -> tuple[FloatArray, ...] | None:
        """Redundancy numbers (n, m) of every group where most observations fit; nothing where that is not known."""
        if not self.settled:
            return None
        try:
            here = self.linearised
        except (InputError, NotFiniteError):
            return None
        return None if here.outcome is Outcome.SINGULAR else redundancy_numbers(here)

    @cached_property
    def redundancy_of_solution(self) -> tuple[FloatArray, ...] | None:
        """Redundancy numbers (n, m) of every group in the adjustment there is."""
        if self.solution is None:
            return None
        return redundancy_numbers(self.solution)

    @property
    def count(self) -> int:
        """Number of observations."""
        return self.network.observations

    def worst_rows(self, group: int, most: int) -> IntArray:
        """Rows of a group with an observation that does not fit beside the others, the worst first."""
        largest = self.sizes[group].max(axis=1, initial=0.0)
        order = np.argsort(-largest, kind="stable")[:most]
        worst: IntArray = order[largest[order] > self.limit]
        return worst

    @cached_property
    def limit(self) -> float:
        """|v|/σ beyond which an observation does not fit beside the others.

        In large networks few errors leave half of all residuals as they are: the median tells how large chance makes
        them. In small ones an error is in all residuals.
        """
        if self.count <= SMALL or self.unstarted:
            return SUSPECT
        scale = robust_scales(self.make(self.network, self.start, self.values), self.sizes).overall
        return max(SUSPECT, scale * price_of_gross_error(self.count))

    @cached_property
    def misfitting(self) -> tuple[BoolArray, ...]:
        """(n, m) observations that do not fit."""
        return tuple(size > SUSPECT for size in self.sizes)

    @property
    def most_do_not_fit(self) -> bool:
        """True where half of all rows have an observation that does not fit."""
        pairs = zip(self.network.groups, self.misfitting, strict=False)
        return 2 * sum(int(bad.any(axis=1).sum()) for _, bad in pairs) > sum(
            g.count for g in self.network.groups
        )

    @cached_property
    def many_are_out(self) -> bool:
        """True if more than 5 % of a group, or all of it, are left out of the solution: no single mistake did that."""
        if self.solution is None:
            return False
        for group in self.solution.problem.groups:
            out, count = int(group.left_out.any(axis=1).sum()), group.count
            if out >= _MASS and (out > _PART_OUT * count or out == count):
                return True
        return False

    @cached_property
    def something_is_wrong_as_a_whole(self) -> bool:
        """True where half of a group, of an image or of a station does not fit: only then a change of all of it may."""
        for group, bad in zip(
            self.network.groups, self.misfitting, strict=False
        ):  # checks, left out, come last
            rows = bad.any(axis=1)
            if group.count >= _AT_LEAST and 2 * np.count_nonzero(rows) >= group.count:
                return True
            whole = np.bincount(group.references[0].numbers)
            wrong = np.bincount(group.references[0].numbers, weights=rows, minlength=len(whole))
            if ((whole >= _AT_LEAST) & (2 * wrong >= whole)).any():
                return True
        return False

    @cached_property
    def fit(self) -> Fit:
        """How well the network fits as it is.

        At start values nothing fits yet: they are compared with a fit that leaves twice of what is expected, and with
        observations that refer to nothing as good as wrong.
        """
        if not self.settled:
            lost = sum(int(np.isinf(size).sum()) for size in self.sizes)
            length = 2.0 * self.count + lost * 2.0 * float(np.log(max(self.count, 2)))
            return Fit(self.start, np.inf, 0, length, np.inf)
        problem = self.make(self.network, self.values, self.values)
        return fit_of(problem, self.values, self.defect, self.count)

    @property
    def defect(self) -> int:
        """Movements of the whole network that the observations leave free; 0 where that is not known."""
        return 0 if self.solution is None else self.solution.defect.dimension


def redundancy_numbers(adjustment: Adjustment) -> tuple[FloatArray, ...]:
    """Redundancy numbers (n, m) of every group, NaN where not observed or left out."""
    return tuple(group.r for group in assess(adjustment).groups)


def fit_of(problem: Problem, values: Values, defect: int, count: int, cost: float = 0.0) -> Fit:
    """How well some values fit the observations, ``cost`` being that of the choice of their model."""
    sizes = sizes_of(problem.groups, values)
    used = [size[~group.left_out] for size, group in zip(sizes, problem.groups, strict=True)]
    return Fit(
        values,
        float(sum(np.sum(size**2) for size in used)),
        problem.observations - problem.index.count + defect,
        cost_of_residuals(used, count) + cost,
        factor_of_sigmas(used),
    )


def controlled_part(situation: Situation, changed: Network, after: Adjustment) -> float:
    """Mean redundancy number of the changed observations, where most fit without the change and with it; 1 of none."""
    masks = changed_observations(situation.network, changed)
    parts = [_mean(situation.redundancy_numbers, masks), _mean(redundancy_numbers(after), masks)]
    known = [part for part in parts if np.isfinite(part)]
    return float(np.mean(known)) if known else 1.0


def changed_observations(old: Network, new: Network) -> list[BoolArray]:
    """(n, m) observations of every group that have another value or σ than before."""
    pairs = zip(old.groups, new.groups, strict=True)
    return [a.mask & ((a.observed != b.observed) | (a.sigma != b.sigma)) for a, b in pairs]


def _mean(numbers: tuple[FloatArray, ...] | None, masks: list[BoolArray]) -> float:
    if numbers is None:
        return np.nan
    chosen = np.concatenate([r[mask] for r, mask in zip(numbers, masks, strict=False)])
    return float(np.nanmean(chosen)) if np.isfinite(chosen).any() else np.nan


class HopelessError(Exception):
    """An iteration that leads nowhere."""


def attempt(problem: Problem, begin: Values) -> Adjustment:
    """An adjustment that ends early where it leads nowhere.

    Raises:
        HopelessError: it does not come near to a solution as quickly as one that will.
    """
    with np.errstate(all="ignore"):
        return adjust(problem, begin, Settings(_ITERATIONS), _impatient())


def without_row(situation: Situation, group: int, row: int) -> Values:
    """Where the others lead without a row; where most fit, if they have no solution."""
    problem = situation.make(situation.network, situation.start, situation.values)
    masks = [own.left_out.copy() for own in problem.groups]
    masks[group][row] = True
    try:
        found = attempt(exclude(problem, masks), situation.values)
    except (InputError, NotFiniteError, HopelessError):
        return situation.values
    return found.values if found.outcome.is_solution else situation.values


def _impatient() -> Watcher:
    """A watcher that ends an iteration which does not come near to a solution as quickly as one that will."""
    seen: list[float] = []

    def watch(iteration: Iteration) -> None:
        seen.append(iteration.objective)
        last = seen[-1 - _PATIENCE :]
        slow = len(last) > _PATIENCE and all(b > 0.5 * a for a, b in pairwise(last))
        if (
            slow
            and iteration.objective > 25.0 * max(iteration.redundancy, 1)
            and iteration.largest_change > 1.0
        ):
            raise HopelessError

    return watch
