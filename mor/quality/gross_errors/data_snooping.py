"""Data snooping (W. Baarda): the worst observation is taken out, the rest adjusted again, until the rest is clean.

Several are taken out at once where none of them may be flagged for another one's error alone: where they share neither
a point nor a frame, or are so well controlled that it shows but little in each other's residual. After every adjustment
what was taken out is tested against the rest (its residual has the variance σ² + aᵀQa), and put back where it fits.
What goes out a second time stays out until nothing else is to be done; then it is tested once more, for its neighbours
may have gone since, and what still does not bear the company of the rest stays out for good. Points at which it may
have been the wrong ones are looked at in the end (:mod:`mor.quality.gross_errors.other_places`). The two coordinates of
a ray are one pointing and go together, as long as both are controlled.

A network may be at hand in parts (:class:`Tried`): the rounds are the same.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Set
from typing import Generic, NamedTuple, Protocol, Self, TypeVar

import numpy as np

from mor.adjustment.problem import Problem
from mor.adjustment.solve import adjust
from mor.adjustment.state import Iteration
from mor.arrays import BoolArray
from mor.parameters.index import Values
from mor.quality.assess import Levels, Quality, assess
from mor.quality.diagnosis.self_check import is_complete
from mor.quality.gross_errors.exclusion import exclude
from mor.quality.gross_errors.other_places import Masks, cost_at, other_places
from mor.quality.gross_errors.worst_first import Entry, Tested, candidates, flagged_rows, worst_first

_MOST_ROUNDS = 100
"""Rounds after which snooping ends, clean or not; a round takes out every error that does not hide another one."""
_MOST_OUT = 0.5
"""Part of the redundancy beyond which no more is taken out: then what is out outvotes what controls it."""

Watcher = Callable[[Iteration], None]
Out = frozenset[Entry]
"""What is taken out."""


class Snooped(NamedTuple):
    """One observation that was taken out or put back, and its test value at that moment."""

    round: int
    group: int
    row: int
    component: int
    test: float
    taken_out: bool
    part: int = 0
    """Of the network, where it is in parts."""


class Snooping(NamedTuple):
    """Outcome of data snooping."""

    sigma0_before: float
    """σ0 of the adjustment of all observations."""
    kept_out: Masks
    """What took no part even then."""
    quality: Quality
    """Quality of the adjustment without the excluded ones."""
    steps: tuple[Snooped, ...]
    clean: bool
    """False where something flagged could not be taken out."""

    def after(self, earlier: Snooping) -> Snooping:
        """Both together, this one being the later."""
        return earlier._replace(quality=self.quality, steps=(*earlier.steps, *self.steps), clean=self.clean)


class Excluded(NamedTuple):
    """An entry that was taken out, against the rest."""

    entry: Entry
    test: float
    fits: bool
    """True where its row may come back: every entry of it that is out fits the rest."""


class Tried(Protocol):
    """An assessed adjustment without what is out; of a network as a whole, or of one in parts."""

    @property
    def redundancy(self) -> int:
        """n − u + d."""

    @property
    def excluded(self) -> tuple[Excluded, ...]:
        """What is out, in order."""

    def worst(self, cannot: Collection[Entry]) -> list[Tested]:
        """What goes in a round, the worst first, entries in ``cannot`` apart; nothing where nothing is flagged."""

    def without(self, out: Out) -> Self | None:
        """The same without other entries, or nothing where that is no solution.

        Nor where unknowns hang on what is out: with its vanishing weight it determines them, and Σ r tells.
        """

    def elsewhere(self, out: Out) -> tuple[Self, Out] | None:
        """The same with points where all their observations put them, and what is out there, if they are elsewhere."""


T = TypeVar("T", bound=Tried)


class Ended(NamedTuple, Generic[T]):
    """How the rounds of data snooping ended."""

    tried: T
    steps: tuple[Snooped, ...]
    clean: bool


def snoop(
    problem: Problem,
    quality: Quality,
    levels: Levels,
    aposteriori: bool,
    excluded: Masks | None = None,
    watch: Watcher | None = None,
) -> Snooping:
    """Snoop through a problem from an assessed adjustment of it; ``excluded`` (n, m) is out to begin with."""
    first = _Whole(problem, levels, aposteriori, watch, quality)
    begun, out = None, Out()
    if excluded is not None:
        out = entries_of(
            tuple(mask & ~group.left_out for group, mask in zip(problem.groups, excluded, strict=True))
        )
        begun = first.without(out)
    tried, out = (begun, out) if begun is not None else (first, Out())
    ended = rounds(tried, out, first.redundancy)
    kept_out = tuple(group.left_out for group in problem.groups)
    return Snooping(quality.sigma0, kept_out, ended.tried.quality, ended.steps, ended.clean)


def rounds(tried: T, out: Out, redundancy: int) -> Ended[T]:
    """Take out and put back until nothing else is to be done, in at most 100 rounds.

    ``redundancy`` is that of all observations.
    """
    steps: list[Snooped] = []
    stays_out, for_good, cannot = set[Entry](), set[Entry](), set[Entry]()
    clean = False
    for number in range(1, _MOST_ROUNDS + 1):
        chosen = tried.worst(cannot)
        fitting = _fitting(tried, stays_out)
        if not chosen and not fitting:
            fitting = _fitting(tried, for_good)
            for_good.update(one.entry for one in fitting)
        if not chosen and not fitting:
            elsewhere = tried.elsewhere(out)
            if elsewhere is not None:
                there, others = elsewhere
                steps += _steps(number, _tested(tried, out - others), out)
                steps += _steps(number, _tested(there, others - out), out)
                tried, out = there, others
                continue
            clean = not cannot
            break
        if len(out) > _MOST_OUT * redundancy:
            break  # it is not single errors that do not fit
        for change in ([*chosen, *fitting], chosen[:1] or fitting[:1]):
            wanted = out ^ {one.entry for one in change}
            found = tried.without(wanted)
            if found is not None:
                steps += _steps(number, change, out)
                stays_out |= out - wanted
                tried, out = found, wanted
                break
        else:
            (cannot if chosen else stays_out).add((chosen or fitting)[0].entry)
            for_good.update(one.entry for one in ([] if chosen else fitting[:1]))
    return Ended(tried, tuple(steps), clean)


def _fitting(tried: Tried, stays_out: Set[Entry]) -> list[Tested]:
    """Excluded entries that may come back."""
    return [Tested(one.entry, one.test) for one in tried.excluded if one.fits and one.entry not in stays_out]


def _tested(tried: Tried, entries: Set[Entry]) -> list[Tested]:
    return [Tested(one.entry, one.test) for one in tried.excluded if one.entry in entries]


def _steps(number: int, changed: list[Tested], out: Out) -> list[Snooped]:
    return [
        Snooped(number, *one.entry[:3], one.test, one.entry not in out, one.entry.part) for one in changed
    ]


def excluded_entries(quality: Quality, kept_out: Masks, part: int = 0) -> tuple[Excluded, ...]:
    """What is out of an adjustment, and not kept out of it, in the order of groups and rows."""
    found: list[Excluded] = []
    for number, (group, kept) in enumerate(zip(quality.adjustment.problem.groups, kept_out, strict=True)):
        out: BoolArray = group.left_out & ~kept
        rows = np.flatnonzero(out.any(axis=1))
        if not len(rows):
            continue
        tests = quality.reliability[number].at(rows).test
        fits: BoolArray = np.asarray(~(out[rows] & ~(np.abs(tests) < quality.critical)).any(axis=1))
        found += [
            Excluded(Entry(number, int(rows[k]), int(c), part), float(tests[k, c]), bool(fits[k]))
            for k, c in np.argwhere(out[rows])
        ]
    return tuple(found)


class _Whole(NamedTuple):
    """A network as a whole."""

    problem: Problem
    """With nothing out but what is kept out."""
    levels: Levels
    aposteriori: bool
    watch: Watcher | None
    quality: Quality

    @property
    def redundancy(self) -> int:
        return self.quality.redundancy

    @property
    def excluded(self) -> tuple[Excluded, ...]:
        return excluded_entries(self.quality, self._kept_out)

    def worst(self, cannot: Collection[Entry]) -> list[Tested]:
        return worst_first(candidates(flagged_rows(self.quality), cannot), {})

    def without(self, out: Out) -> _Whole | None:
        return self._from(self.quality.adjustment.values, masks_of(self._kept_out, out))

    def elsewhere(self, out: Out) -> tuple[_Whole, Out] | None:
        values = self.quality.adjustment.values
        other = other_places(self.problem, values, masks_of(self._kept_out, out))
        if other is None:
            return None
        found = self._from(other.values, other.out)
        if found is None:
            return None
        there = found.quality.adjustment.values
        better = cost_at(self.problem, there) < cost_at(self.problem, values)
        others = tuple(mask & ~kept for mask, kept in zip(other.out, self._kept_out, strict=True))
        return (found, entries_of(others)) if better else None

    @property
    def _kept_out(self) -> Masks:
        return tuple(group.left_out for group in self.problem.groups)

    def _from(self, values: Values, out: Masks) -> _Whole | None:
        """From other values, without other entries."""
        adjustment = adjust(exclude(self.problem, out), values, watch=self.watch)
        if not adjustment.outcome.is_solution:
            return None
        quality = assess(adjustment, self.levels, self.aposteriori)
        complete = is_complete(quality.redundancy_sum, quality.redundancy)
        return self._replace(quality=quality) if complete else None


def entries_of(masks: Masks, part: int = 0) -> Out:
    """The entries that are true in masks (n, m) of each group."""
    return Out(
        Entry(number, int(row), int(component), part)
        for number, mask in enumerate(masks)
        for row, component in np.argwhere(mask)
    )


def masks_of(kept_out: Masks, out: Collection[Entry]) -> Masks:
    """Masks (n, m) of each group that are true for what is kept out, and for some entries."""
    masks = tuple(mask.copy() for mask in kept_out)
    for entry in out:
        masks[entry.group][entry.row, entry.component] = True
    return masks
