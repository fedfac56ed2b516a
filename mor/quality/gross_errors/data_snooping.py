"""Data snooping (W. Baarda): the worst observation is taken out, the rest adjusted again, until the rest is clean.

Several are taken out at once where none of them may be flagged for another one's error alone: where they share neither
a point nor a frame, or are so well controlled that it shows but little in each other's residual. After every adjustment
what was taken out is tested against the rest (its residual has the variance σ² + aᵀQa), and put back where it fits.
What goes out a second time stays out until nothing else is to be done; then it is tested once more, for its neighbours
may have gone since, and what still does not bear the company of the rest stays out for good. Points at which it may
have been the wrong ones are looked at in the end (:mod:`mor.quality.gross_errors.other_places`). The two coordinates of
a ray are one pointing and go together, as long as both are controlled.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mor.adjustment.problem import Problem
from mor.adjustment.solve import adjust
from mor.adjustment.state import Adjustment, Iteration
from mor.allowance import LEAST, Allowance, allowed, counted_in, spend
from mor.arrays import BoolArray, FloatArray
from mor.observations import is_image_point
from mor.quality.assess import Levels, Quality, assess
from mor.quality.diagnosis.self_check import is_complete
from mor.quality.gross_errors.exclusion import exclude
from mor.quality.gross_errors.other_places import Masks, cost_at, other_places
from mor.quality.reliability.observation_quality import ObservationQuality
from mor.quality.tests.test_statistics import comparable

_BESIDE_THE_WORST = 0.5
"""Part of the largest |w| from which on others are taken out in the same round, if that error shows by less in them."""
_OF_ITS_ROWS = 10
"""One of so many rows of a frame or a point may go in a round beside others of it, so that the rest outvotes them."""
_MOST_ROUNDS = 500
ADJUSTMENTS = 100
"""Adjustments that snooping may take where a network is large."""
ASSESSING = 3
"""Iterations that are as much work as assessing an adjustment."""
_MOST_OUT = 0.5
"""Part of the redundancy beyond which no more is taken out: then what is out outvotes what controls it."""
_LOCAL = ("point", "rotation", "base")
"""Kinds of blocks by which the error of one observation shows in another one."""

Watcher = Callable[[Iteration], None]
Block = tuple[str, int]
"""Kind and number."""


class Snooped(NamedTuple):
    """One observation that was taken out or put back, and its test value at that moment."""

    round: int
    group: int
    row: int
    component: int
    test: float
    taken_out: bool


class Snooping(NamedTuple):
    """Outcome of data snooping."""

    before: Quality
    """Quality of the adjustment of all observations."""
    quality: Quality
    """Quality of the adjustment without the excluded ones."""
    steps: tuple[Snooped, ...]
    clean: bool
    """False where something flagged could not be taken out."""

    def after(self, earlier: Snooping) -> Snooping:
        """Both together, this one being the later."""
        return self._replace(before=earlier.before, steps=(*earlier.steps, *self.steps))


def snoop(
    problem: Problem,
    quality: Quality,
    levels: Levels,
    aposteriori: bool,
    excluded: tuple[BoolArray, ...] | None = None,
    watch: Watcher | None = None,
) -> Snooping:
    """Snoop through a problem from an assessed adjustment of it; ``excluded`` (n, m) is out to begin with."""
    state = _State(problem, levels, aposteriori, watch)
    kept_out = tuple(group.left_out for group in problem.groups)
    first, out = quality, tuple(mask.copy() for mask in kept_out)
    if excluded is not None:
        wanted = tuple(a | b for a, b in zip(out, excluded, strict=True))
        begun = state.assessed(quality.adjustment, wanted)
        if begun is not None:
            quality, out = begun, wanted
    steps: list[Snooped] = []
    stays_out, for_good, cannot = (tuple(np.zeros_like(mask) for mask in out) for _ in range(3))
    clean, further = False, Allowance(allowed(problem.observations, ADJUSTMENTS, LEAST // 2))
    for number in range(1, _MOST_ROUNDS + 1):
        chosen = _worst(quality, cannot)
        fitting = _fitting(quality, kept_out, stays_out)
        if not chosen and not fitting:
            fitting = _fitting(quality, kept_out, for_good)
            _mark(for_good, fitting)
        if not chosen and not fitting:
            with counted_in(further):
                elsewhere = state.elsewhere(quality, out) if further.is_left else None
            if elsewhere is not None:
                there, others = elsewhere
                _remember(steps, number, quality, _but(out, others), out)
                _remember(steps, number, there, _but(others, out), out)
                quality, out = there, others
                continue
            clean = not any((flags & ~bad).any() for flags, bad in zip(quality.flagged, cannot, strict=True))
            clean = clean and not any(bad.any() for bad in cannot)
            break
        if _taken_out(out, kept_out) > _MOST_OUT * first.redundancy:
            break  # it is not single errors that do not fit
        if not further.is_left:
            break
        for change in ([*chosen, *fitting], chosen[:1] or fitting[:1]):
            tried = _changed(out, change)
            with counted_in(further):
                found = state.assessed(quality.adjustment, tried)
            if found is not None:
                _remember(steps, number, quality, change, out)
                _mark(stays_out, [entry for entry in change if out[entry[0]][entry[1:]]])
                quality, out = found, tried
                break
        else:
            _mark(cannot if chosen else stays_out, chosen[:1] or fitting[:1])
            _mark(for_good, [] if chosen else fitting[:1])
    return Snooping(first, quality, tuple(steps), clean)


Entries = list[tuple[int, int, int]]


class _State(NamedTuple):
    """What every round needs."""

    problem: Problem
    levels: Levels
    aposteriori: bool
    watch: Watcher | None

    def assessed(self, last: Adjustment, out: tuple[BoolArray, ...]) -> Quality | None:
        """Quality without the entries ``out``, or nothing where that is no solution.

        Nor where unknowns hang on what is out: with its vanishing weight it determines them, and Σ r tells.
        """
        adjustment = adjust(exclude(self.problem, out), last.values, watch=self.watch)
        if not adjustment.outcome.is_solution:
            return None
        spend(ASSESSING * adjustment.plan.work)
        quality = assess(adjustment, self.levels, self.aposteriori)
        return quality if is_complete(quality.redundancy_sum, quality.redundancy) else None

    def elsewhere(self, quality: Quality, out: Masks) -> tuple[Quality, Masks] | None:
        """Quality with points where all their observations put them, and what is out then; nothing where they stay."""
        values = quality.adjustment.values
        other = other_places(self.problem, values, out)
        if other is None:
            return None
        found = self.assessed(quality.adjustment._replace(values=other.values), other.out)
        better = found is not None and cost_at(self.problem, found.adjustment.values) < cost_at(
            self.problem, values
        )
        return (found, other.out) if found is not None and better else None


def _but(masks: Masks, others: Masks) -> Entries:
    """Entries of the masks that are not in the others."""
    pairs = zip(masks, others, strict=True)
    return [(k, int(row), int(entry)) for k, (a, b) in enumerate(pairs) for row, entry in np.argwhere(a & ~b)]


def _taken_out(out: tuple[BoolArray, ...], kept_out: tuple[BoolArray, ...]) -> int:
    return sum(int(np.count_nonzero(now & ~before)) for now, before in zip(out, kept_out, strict=True))


def _mark(masks: tuple[BoolArray, ...], entries: Entries) -> None:
    for group, row, component in entries:
        masks[group][row, component] = True


def _changed(out: tuple[BoolArray, ...], entries: Entries) -> tuple[BoolArray, ...]:
    changed = tuple(mask.copy() for mask in out)
    for group, row, component in entries:
        changed[group][row, component] ^= True
    return changed


def _remember(
    steps: list[Snooped], number: int, quality: Quality, entries: Entries, out: tuple[BoolArray, ...]
) -> None:
    for group, row, component in entries:
        value = float(quality.reliability[group].at(np.array([row])).test[0, component])
        steps.append(Snooped(number, group, row, component, value, not out[group][row, component]))


def _worst(quality: Quality, cannot: tuple[BoolArray, ...]) -> Entries:
    """The worst observation, and others nearly as bad that are not so for its error, nor for each other's."""
    sizes = [
        comparable(np.where(flags & ~bad, np.abs(one.test), 0.0))
        for flags, bad, one in zip(quality.flagged, cannot, quality.reliability, strict=True)
    ]
    rows = [size.max(axis=1) if size.size else np.zeros(0) for size in sizes]
    largest = max((float(row.max()) for row in rows if row.size), default=0.0)
    if largest == 0.0:
        return []
    candidates = [
        (float(row[i]), group, int(i))
        for group, row in enumerate(rows)
        for i in np.flatnonzero(row >= max(_BESIDE_THE_WORST * largest, np.nextafter(0.0, 1.0)))
    ]
    absorbed = [_absorbed_of_controlled(one) for one in quality.groups]
    room = _room(quality.adjustment.problem)
    used: dict[Block, float] = {}
    chosen: Entries = []
    for _, group, row in sorted(candidates, key=lambda candidate: (-candidate[0], *candidate[1:])):
        blocks, own = _local_blocks(quality, group, row), float(absorbed[group][row])
        shared = blocks & used.keys()
        if not shared or (
            own * max(used[block] for block in shared) <= _BESIDE_THE_WORST**2
            and min(room[block] for block in shared) > 0
        ):
            for block in blocks:
                used[block], room[block] = max(own, used.get(block, 0.0)), room[block] - 1
            chosen += _together(quality, group, row, sizes[group][row])
    return chosen


def _room(problem: Problem) -> Counter[Block]:
    """How many rows of each block may go in one round."""
    rows: Counter[Block] = Counter()
    for group in problem.groups:
        taking_part = (group.mask & ~group.left_out).any(axis=1)
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind in _LOCAL:
                counts = np.bincount(blocks[taking_part])
                rows.update(
                    {(slot.kind, block): int(counts[block]) for block in np.flatnonzero(counts).tolist()}
                )
    return Counter({block: count // _OF_ITS_ROWS for block, count in rows.items()})


def _absorbed_of_controlled(one: ObservationQuality) -> FloatArray:
    """(n,) the largest (1 − r)/r of a row's components; infinite for correlated ones.

    An error shows in another observation by the correlation ρ of their residuals, wᵢ = ρᵢⱼ wⱼ, and as that of adjusted
    observations is 1 at most, ρ² ≤ (1 − rᵢ)/rᵢ · (1 − rⱼ)/rⱼ.
    """
    r = np.nan_to_num(one.r, nan=1.0)
    found: FloatArray = np.max((1.0 - r) / np.maximum(r, np.finfo(float).tiny), axis=1, initial=0.0)
    if one.correlated is not None:
        found[one.correlated.rows] = np.inf
    return found


def _local_blocks(quality: Quality, group: int, row: int) -> set[Block]:
    """Free points and frames of an observation."""
    problem = quality.adjustment.problem
    one = problem.groups[group]
    return {
        (slot.kind, int(blocks[row]))
        for slot, blocks in zip(one.type.slots, one.blocks, strict=True)
        if slot.kind in _LOCAL and (problem.index.columns[slot.kind][blocks[row]] >= 0).any()
    }


def _together(quality: Quality, group: int, row: int, sizes: FloatArray) -> Entries:
    """The worst component of a row; all components of a ray, where each is controlled for itself."""
    one = quality.adjustment.problem.groups[group]
    active = np.flatnonzero(one.mask[row] & ~one.left_out[row])
    if is_image_point(one.type) and quality.groups[group].at(np.array([row])).freedom[0, active].max() >= len(
        active
    ):
        return [(group, row, int(component)) for component in active]
    return [(group, row, int(np.argmax(sizes)))]


def _fitting(quality: Quality, kept_out: tuple[BoolArray, ...], stays_out: tuple[BoolArray, ...]) -> Entries:
    """Excluded rows of which every entry fits the rest."""
    entries: Entries = []
    for number, group in enumerate(quality.adjustment.problem.groups):
        out = group.left_out & ~kept_out[number]
        if not out.any():
            continue
        misfits: BoolArray = out & ~(np.abs(quality.reliability[number].test) < quality.critical)
        fits = out & ~stays_out[number] & ~np.any(misfits, axis=1, keepdims=True)
        entries += [(number, int(row), int(component)) for row, component in np.argwhere(fits)]
    return entries
