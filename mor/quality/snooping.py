"""Data snooping after Baarda."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence, Set
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mor.model.images import is_image_point
from mor.model.parameters import Values
from mor.quality.assessment import Levels, Quality, assess, is_complete
from mor.quality.outliers import (
    BY_CHANCE,
    SUSPECT,
    SuspectedOutliers,
    cost_of_residuals,
    reintersected,
    sizes_of,
    slots_of_ends,
    with_suspects,
)
from mor.quality.robust_estimation import exclude
from mor.quality.test_statistics import ObservationQuality, comparable, critical_value, sidak
from mor.solve.iterate import Adjustment, SolverSettings, adjust
from mor.solve.problem import Problem
from mor.types import BoolArray, FloatArray, IntArray

# ---- Which observations data snooping takes out in a round: the worst, and others that are not flagged for its error.

_BESIDE_THE_WORST = 0.5
"""Part of the largest |w| from which on others are taken out in the same round, if that error shows by less in them."""
LOCAL = ("point", "rotation", "base")
"""Kinds of blocks by which the error of one observation shows in another one."""

Block = tuple[str, str]
"""Kind and name."""


class Entry(NamedTuple):
    """One component of an observation row."""

    group: int
    row: int
    component: int


class TestedEntry(NamedTuple):
    """An entry and its test value."""

    entry: Entry
    test: float


class BlockRows(NamedTuple):
    """Points, or frames, of some rows of a group."""

    kind: str
    names: tuple[str, ...]
    """(k,)"""
    rows: IntArray
    """(k,) how many rows each of them has; −1 where it is not free."""


class FlaggedRows(NamedTuple):
    """Rows of a group in which something is flagged, and what the choice among them asks for."""

    group: int
    rows: IntArray
    """(k,)"""
    tests: FloatArray
    """(k, m)"""
    flags: BoolArray
    """(k, m)"""
    active: BoolArray
    """(k, m) what takes part."""
    together: BoolArray
    """(k,) image points all components of which are controlled for themselves."""
    absorbed: FloatArray
    """(k,) the largest (1 − r)/r of a row's components; infinite for correlated ones."""
    slots: tuple[BlockRows, ...]


class ExclusionCandidate(NamedTuple):
    """A row that may go in this round."""

    size: float
    """The largest |w| of it."""
    place: tuple[int, int]
    """Order among equal ones: group and row."""
    blocks: Mapping[Block, int]
    """Its free points and frames, with the number of rows that these have."""
    absorbed: float
    tested: tuple[TestedEntry, ...]
    """What goes with it: all components of an image point that are controlled for themselves, or the worst one."""


def flagged_rows(quality: Quality) -> list[FlaggedRows]:
    """The rows of each group in which something is flagged."""
    problem, found = quality.adjustment.problem, []
    counts = rows_of_blocks(problem)
    for number, (group, flags) in enumerate(zip(problem.groups, quality.flagged, strict=True)):
        rows = np.flatnonzero(flags.any(axis=1))
        if not len(rows):
            continue
        active = group.used_among(rows)
        one = quality.groups[number].at(rows)
        free = np.where(active, one.freedom, -np.inf).max(axis=1)
        together = is_image_point(group.type) & (free >= np.count_nonzero(active, axis=1))
        slots = tuple(
            _slot(problem, slot.kind, blocks[rows], counts[slot.kind])
            for slot, blocks in group.blocks_by_slot
            if slot.kind in LOCAL
        )
        tests = quality.reliability[number].at(rows).test
        absorbed = _absorbed_of_controlled(one)
        found.append(FlaggedRows(number, rows, tests, flags[rows], active, together, absorbed, slots))
    return found


def rows_of_blocks(problem: Problem) -> dict[str, IntArray]:
    """Return the number of rows used of each point and frame, by kind."""
    counts = {
        kind: np.zeros(len(columns), dtype=np.int64) for kind, columns in problem.index.columns.items() if kind in LOCAL
    }
    for group in problem.groups:
        taking_part = group.used.any(axis=1)
        for slot, blocks in group.blocks_by_slot:
            if slot.kind in counts:
                counts[slot.kind] += np.bincount(blocks[taking_part], minlength=len(counts[slot.kind]))
    return counts


def candidates(flagged: Sequence[FlaggedRows], cannot: Collection[Entry]) -> list[ExclusionCandidate]:
    """Return entries that may be removed in a round, without those in ``cannot``: all above half of the largest |w|."""
    sizes = [comparable(np.where(_may_go(one, cannot), np.abs(one.tests), 0.0)) for one in flagged]
    least = max(_BESIDE_THE_WORST * max((float(size.max()) for size in sizes), default=0.0), np.nextafter(0.0, 1.0))
    return [
        ExclusionCandidate(
            float(size[k].max()),
            (one.group, int(one.rows[k])),
            {(slot.kind, slot.names[k]): int(slot.rows[k]) for slot in one.slots if slot.rows[k] >= 0},
            float(one.absorbed[k]),
            _going(one, int(k), size[k]),
        )
        for one, size in zip(flagged, sizes, strict=True)
        for k in np.flatnonzero(size.max(axis=1) >= least)
    ]


def worst_first(all_candidates: Iterable[ExclusionCandidate]) -> list[TestedEntry]:
    """The worst of the candidates, and others nearly as bad that are not so for its error, nor for each other's."""
    ordered = sorted(all_candidates, key=lambda one: (-one.size, *one.place))
    used: dict[Block, float] = {}
    room: dict[Block, int] = {}
    chosen: list[TestedEntry] = []
    for one in ordered:
        if one.size < _BESIDE_THE_WORST * ordered[0].size:
            break
        met = one.blocks.keys() & used.keys()
        if not met or (
            one.absorbed * max(used[block] for block in met) <= _BESIDE_THE_WORST**2
            and min(room[block] for block in met) > 0
        ):
            for block, rows in one.blocks.items():
                used[block] = max(one.absorbed, used.get(block, 0.0))
                # One in ten rows of a frame or a point may go in a round, so that the rest outvotes them.
                room[block] = room.get(block, rows // 10) - 1
            chosen += one.tested
    return chosen


def _may_go(one: FlaggedRows, cannot: Collection[Entry]) -> BoolArray:
    flags = one.flags.copy()
    for entry in cannot:
        if entry.group == one.group:
            flags[one.rows == entry.row, entry.component] = False
    return flags


def _going(one: FlaggedRows, k: int, sizes: FloatArray) -> tuple[TestedEntry, ...]:
    """The worst component of a row; all components of a ray, where each is controlled for itself."""
    components = np.flatnonzero(one.active[k]) if one.together[k] else [int(np.argmax(sizes))]
    return tuple(TestedEntry(Entry(one.group, int(one.rows[k]), int(c)), float(one.tests[k, c])) for c in components)


def _slot(problem: Problem, kind: str, blocks: IntArray, counts: IntArray) -> BlockRows:
    free = (problem.index.columns[kind][blocks] >= 0).any(axis=1)
    ids = problem.index.blocks[kind].ids
    return BlockRows(kind, tuple(ids[block] for block in blocks.tolist()), np.where(free, counts[blocks], -1))


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


# ---- Points at which snooping may have believed the wrong observations, intersected again once nothing else is to
# be done.
#
# Observations go out one after the other, the worst at that moment: of a point with two wrong rays good ones may go
# first, and what is left agrees because it can hardly do otherwise. No test of what is out against the rest can tell
# then. All observations of such points can: where most of them have it, others are out, and less is left to explain.

Masks = tuple[BoolArray, ...]
"""(n, m) of each group."""


class Elsewhere(NamedTuple):
    """Values with some points at other places, and what is out there."""

    values: Values
    out: Masks


def other_places(problem: Problem, values: Values, out: Masks) -> Elsewhere | None:
    """Return other places of points whose observations agree on one that the rest without ``out`` contradicts.

    ``problem``: with nothing out that may come back. Nothing where nothing is out, or no point is elsewhere.
    """
    kept_out = problem.left_out
    if "point" not in problem.index.blocks or not any(
        (mask & ~kept).any() for mask, kept in zip(out, kept_out, strict=True)
    ):
        return None
    moved = reintersected(problem, values, sizes_of(problem.groups, values), gain=BY_CHANCE)
    # Return removed entries after points have moved: all suspects of these points, and those removed of the others.
    points: BoolArray = np.asarray((moved["point"] != values["point"]).any(axis=1))
    if not points.any():
        return None
    sizes = sizes_of(problem.groups, moved)
    masks = tuple(mask.copy() for mask in out)
    for group, size, mask in zip(problem.groups, sizes, masks, strict=True):
        # (n,) rows that see one of some points (k,).
        rows = np.zeros(group.count, dtype=bool)
        for slot in slots_of_ends(group):
            rows |= points[group.blocks[slot]]
        suspect = (size > SUSPECT).any(axis=1, keepdims=True)
        mask[rows] = (group.left_out | (group.mask & suspect))[rows]
    return Elsewhere(moved, masks)


def cost_at(problem: Problem, values: Values) -> float:
    """Return the cost of all observations at some values; removed ones count with the cost of removal."""
    return cost_of_residuals(sizes_of(problem.groups, values), problem.observations)


# ---- Data snooping (W. Baarda): the worst observation is taken out, the rest adjusted again, until nothing else is
# flagged.
#
# Several are taken out at once where none of them may be flagged for another one's error alone: where they
# share neither a point nor a frame, or are so well controlled that it shows but little in each other's
# residual. After every adjustment what was taken out is tested against the rest (its residual has the
# variance σ² + aᵀQa), and put back where it fits. What goes out a second time stays out until nothing else is
# to be done; then it is tested once more, for its neighbours may have gone since, and what still does not
# bear the company of the rest stays out for good. Points at which it may have been the wrong ones are looked
# at in the end (:mod:`mor.quality.snooping`). The two coordinates of a ray are one pointing and go together,
# as long as both are controlled.

_MOST_ROUNDS = 100
"""Rounds after which snooping ends, clean or not; a round takes out every error that does not hide another one."""

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


class SnoopingResult(NamedTuple):
    """Outcome of data snooping."""

    sigma0_before: float
    """σ0 of the adjustment of all observations."""
    kept_out: Masks
    """What took no part even then."""
    quality: Quality
    """Quality of the adjustment without the excluded ones."""
    steps: tuple[Snooped, ...]
    clean: bool
    """False where a flagged observation could not be excluded."""

    def after(self, earlier: SnoopingResult) -> SnoopingResult:
        """Both together, this one being the later."""
        return earlier._replace(quality=self.quality, steps=(*earlier.steps, *self.steps), clean=self.clean)


class Excluded(NamedTuple):
    """An entry that was taken out, against the rest."""

    entry: Entry
    test: float
    fits: bool
    """True where its row may come back: every entry of it that is out fits the rest."""


class _AssessedAdjustment(NamedTuple):
    """An assessed adjustment without what is out."""

    problem: Problem
    """With nothing out but what is kept out."""
    levels: Levels
    aposteriori: bool
    quality: Quality

    @property
    def redundancy(self) -> int:
        return self.quality.redundancy

    @property
    def excluded(self) -> tuple[Excluded, ...]:
        quality = self.quality
        found: list[Excluded] = []
        for number, (group, kept) in enumerate(
            zip(quality.adjustment.problem.groups, self.problem.left_out, strict=True)
        ):
            out: BoolArray = group.left_out & ~kept
            rows = np.flatnonzero(out.any(axis=1))
            if not len(rows):
                continue
            tests = quality.reliability[number].at(rows).test
            fits: BoolArray = np.asarray(~(out[rows] & ~(np.abs(tests) < quality.critical)).any(axis=1))
            found += [
                Excluded(Entry(number, int(rows[k]), int(c)), float(tests[k, c]), bool(fits[k]))
                for k, c in np.argwhere(out[rows])
            ]
        return tuple(found)

    def worst(self, cannot: Collection[Entry]) -> list[TestedEntry]:
        """Return entries to remove, the worst first, without those in ``cannot``; empty if none is flagged."""
        return worst_first(candidates(flagged_rows(self.quality), cannot))

    def without(self, out: Out) -> _AssessedAdjustment | None:
        """The same without other entries, or nothing where that is no solution.

        Nor where unknowns hang on what is out: with its vanishing weight it determines them, and Σ r tells.
        """
        return self._from(self.quality.adjustment.values, masks_of(self.problem.left_out, out))

    def elsewhere(self, out: Out) -> tuple[_AssessedAdjustment, Out] | None:
        """The same with points where all their observations put them, and what is out there, if they are elsewhere."""
        values = self.quality.adjustment.values
        other = other_places(self.problem, values, masks_of(self.problem.left_out, out))
        if other is None:
            return None
        found = self._from(other.values, other.out)
        if found is None:
            return None
        better = cost_at(self.problem, found.quality.adjustment.values) < cost_at(self.problem, values)
        return (found, entries_of(_but(other.out, self.problem.left_out))) if better else None

    def _from(self, values: Values, out: Masks) -> _AssessedAdjustment | None:
        adjustment = adjust(exclude(self.problem, out), values)
        if not adjustment.outcome.is_solution:
            return None
        quality = assess(adjustment, self.levels, self.aposteriori)
        complete = is_complete(quality.redundancy_sum, quality.redundancy)
        return self._replace(quality=quality) if complete else None


def snoop(
    problem: Problem,
    quality: Quality,
    levels: Levels,
    aposteriori: bool,
    excluded: Masks | None = None,
) -> SnoopingResult:
    """Snoop through a problem from an assessed adjustment of it; ``excluded`` (n, m) is out to begin with."""
    first = _AssessedAdjustment(problem, levels, aposteriori, quality)
    begun, out = None, Out()
    if excluded is not None:
        out = entries_of(_but(excluded, problem.left_out))
        begun = first.without(out)
    tried, out = (begun, out) if begun is not None else (first, Out())
    tried, steps, clean = snooping_rounds(tried, out, first.redundancy)
    return SnoopingResult(quality.sigma0, problem.left_out, tried.quality, steps, clean)


def snooping_rounds(
    tried: _AssessedAdjustment, out: Out, redundancy: int
) -> tuple[_AssessedAdjustment, tuple[Snooped, ...], bool]:
    """Take out and put back until nothing else is to be done, in at most 100 rounds.

    ``redundancy`` is that of all observations. Also return the steps, and whether nothing flagged had to stay.
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
        # Part of the redundancy beyond which no more is taken out: then what is out outvotes what controls it.
        if len(out) > 0.5 * redundancy:
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
    return tried, tuple(steps), clean


def _fitting(tried: _AssessedAdjustment, stays_out: Set[Entry]) -> list[TestedEntry]:
    return [TestedEntry(one.entry, one.test) for one in tried.excluded if one.fits and one.entry not in stays_out]


def _tested(tried: _AssessedAdjustment, entries: Set[Entry]) -> list[TestedEntry]:
    return [TestedEntry(one.entry, one.test) for one in tried.excluded if one.entry in entries]


def _steps(number: int, changed: list[TestedEntry], out: Out) -> list[Snooped]:
    return [Snooped(number, *one.entry, one.test, one.entry not in out) for one in changed]


def entries_of(masks: Masks) -> Out:
    """The entries that are true in masks (n, m) of each group."""
    return Out(
        Entry(number, int(row), int(component))
        for number, mask in enumerate(masks)
        for row, component in np.argwhere(mask)
    )


def masks_of(kept_out: Masks, out: Collection[Entry]) -> Masks:
    """Masks (n, m) of each group that are true for what is kept out, and for some entries."""
    masks = tuple(mask.copy() for mask in kept_out)
    for entry in out:
        masks[entry.group][entry.row, entry.component] = True
    return masks


# ---- Things of which data snooping took most observations out: then rather they are wrong, as a whole, than each
# of these.
#
# Where more than half of what an image, a set of directions or a point was seen by is gone, what is left may
# be the wrong half: it agrees with itself, and no test of what was taken out against the rest can tell.


class TakenOut(NamedTuple):
    """A thing and its observation rows."""

    kind: str
    """``rotation`` for images and instruments, ``point`` for what they see, or are measured between."""
    block: int
    excluded: int
    observations: int


def mostly_out(snooping: SnoopingResult) -> list[TakenOut]:
    """Frames and points of which more than half of the observations were taken out, and at least three."""
    blocks = snooping.quality.adjustment.problem.index.blocks
    found = []
    for kind in ("rotation", "point"):
        if kind in blocks:
            out, whole = _counted(snooping, kind, len(blocks[kind].ids))
            most = np.flatnonzero((2 * out > whole) & (out >= 3))
            found += [TakenOut(kind, int(b), int(out[b]), int(whole[b])) for b in most]
    return found


def _counted(snooping: SnoopingResult, kind: str, count: int) -> tuple[IntArray, IntArray]:
    """(b,) rows of each block of a kind that were taken out, and that there were."""
    out, whole = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    for kept_out, group in zip(snooping.kept_out, snooping.quality.adjustment.problem.groups, strict=True):
        inside = (group.mask & ~kept_out).any(axis=1)
        gone = inside & (group.left_out & ~kept_out).any(axis=1)
        for slot, blocks in group.blocks_by_slot:
            if slot.kind == kind and (kind == "rotation" or slot.of not in ("image", "station", "system")):
                out += np.bincount(blocks[gone], minlength=count)
                whole += np.bincount(blocks[inside], minlength=count)
    return out, whole


# ---- Suspects that fit the adjustment of the rest come back: then which they are does not hang on how they were found.
#
# Graduated weights judge an observation by its residual at a place that is still on its way, and end a little
# elsewhere from other start values. What is left out is tested against the rest instead, as data snooping
# does (its residual has the variance σ² + aᵀQa), until nothing fits that is out. It fits unless so large a
# residual is none that chance brings among all observations: of several that are merely unlikely, which one
# goes out would hang on the way again. Those come back and are flagged, as in any adjustment.

Assessed = Callable[[Adjustment], Quality]


def put_back(
    quality: Quality, suspects: SuspectedOutliers, assessed: Assessed, settings: SolverSettings | None = None
) -> tuple[Quality, SuspectedOutliers | None]:
    """Quality of the adjustment with those suspects in it again that fit, and the others; ``None`` where none is left.

    ``assessed``: how an adjustment is assessed. What was given up with a lost block stays out.
    """
    problem, masks = with_suspects(quality.adjustment.problem, suspects)
    kept_out = problem.left_out
    refused = tuple(np.zeros_like(mask) for mask in masks)
    largest = _largest_by_chance(quality, problem.observations)

    def returned(rows: Masks) -> Quality | None:
        out = tuple(a | (b & ~c) for a, b, c in zip(kept_out, masks, rows, strict=True))
        again = adjust(exclude(problem, out), quality.adjustment.values, settings)
        return assessed(again) if again.outcome.is_solution else None

    for _ in range(8):  # of suspects that share a point only one comes back at a time
        fitting = _putting_back_fitting(quality, problem, _but(masks, refused), largest)
        found = returned(fitting) if any(mask.any() for mask in fitting) else None
        if found is None:
            break
        misfits = _misfits(found, fitting, largest)
        if any(mask.any() for mask in misfits):
            refused = tuple(a | b for a, b in zip(refused, misfits, strict=True))
            fitting = _but(fitting, misfits)
            found = returned(fitting) if any(mask.any() for mask in fitting) else quality
        if found is None:
            break
        quality, masks = found, _but(masks, fitting)
        suspects = replace(suspects, masks=_but(suspects.masks, fitting))
    return quality, suspects if suspects.count else None


def _but(masks: Masks, others: Masks) -> Masks:
    return tuple(mask & ~other for mask, other in zip(masks, others, strict=True))


def _misfits(quality: Quality, rows: Masks, largest: float) -> Masks:
    """Rows that are back and do not fit all the same: of a pair of coordinates that was out together each fits less."""
    found = []
    for one, mask in zip(quality.reliability, rows, strict=True):
        test = np.where(mask, np.abs(np.nan_to_num(one.test)), 0.0)
        found.append(mask & (test >= largest).any(axis=1, keepdims=True))
    return tuple(found)


def _largest_by_chance(quality: Quality, observations: int) -> float:
    if quality.levels.familywise is not None:
        return quality.critical
    return critical_value(sidak(quality.levels.snooping, observations))


def _putting_back_fitting(quality: Quality, problem: Problem, masks: Masks, largest: float) -> Masks:
    """Suspects that may fit: rows of which every entry is near enough to the rest, the best one of each point."""
    candidates = []
    for number, mask in enumerate(masks):
        test = np.where(mask, comparable(np.abs(quality.reliability[number].test)), 0.0)
        several = np.count_nonzero(mask, axis=1, keepdims=True) > 1
        fits = mask.any(axis=1) & (test < np.where(several, np.sqrt(2.0), 1.0) * largest).all(axis=1)
        rows = np.flatnonzero(fits)
        candidates += [(float(test[row].max()), number, row) for row in rows.tolist()]
    chosen = tuple(np.zeros_like(mask) for mask in masks)
    taken: set[int] = set()
    for _, number, row in sorted(candidates):
        group = problem.groups[number]
        points = {
            int(blocks[row])
            for slot, blocks in group.blocks_by_slot
            if slot.kind == "point" and (problem.index.columns["point"][blocks[row]] >= 0).any()
        }
        if taken.isdisjoint(points):
            taken |= points
            chosen[number][row] = masks[number][row]
    return chosen
