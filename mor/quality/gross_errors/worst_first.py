"""Which observations data snooping takes out in a round: the worst, and others that are not flagged for its error.

A network may be at hand in parts: each tells what it has that may be the worst, the choice is made among all of these.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mor.adjustment.problem import Problem
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.observations import is_image_point
from mor.quality.assess import Quality
from mor.quality.reliability.observation_quality import ObservationQuality
from mor.quality.tests.test_statistics import comparable

_BESIDE_THE_WORST = 0.5
"""Part of the largest |w| from which on others are taken out in the same round, if that error shows by less in them."""
_OF_ITS_ROWS = 10
"""One of so many rows of a frame or a point may go in a round beside others of it, so that the rest outvotes them."""
LOCAL = ("point", "rotation", "base")
"""Kinds of blocks by which the error of one observation shows in another one."""

Block = tuple[str, str]
"""Kind and name."""


class Entry(NamedTuple):
    """One component of an observation row."""

    group: int
    row: int
    component: int
    part: int = 0
    """Of the network, where it is in parts: groups and rows are numbered in each of them."""


class Tested(NamedTuple):
    """An entry and its test value."""

    entry: Entry
    test: float


class Slot(NamedTuple):
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
    slots: tuple[Slot, ...]


class Candidate(NamedTuple):
    """A row that may go in this round."""

    size: float
    """The largest |w| of it."""
    place: tuple[int, int, int]
    """Order among equal ones: of the group, of the part, of the row."""
    blocks: Mapping[Block, int]
    """Its free points and frames, with the number of rows that these have in this part."""
    absorbed: float
    tested: tuple[Tested, ...]
    """What goes with it: all components of an image point that are controlled for themselves, or the worst one."""


def flagged_rows(quality: Quality) -> list[FlaggedRows]:
    """The rows of each group in which something is flagged."""
    problem, found = quality.adjustment.problem, []
    counts = rows_of_blocks(problem)
    for number, (group, flags) in enumerate(zip(problem.groups, quality.flagged, strict=True)):
        rows = np.flatnonzero(flags.any(axis=1))
        if not len(rows):
            continue
        active: BoolArray = group.mask[rows] & ~group.left_out[rows]
        one = quality.groups[number].at(rows)
        free = np.where(active, one.freedom, -np.inf).max(axis=1)
        together = is_image_point(group.type) & (free >= np.count_nonzero(active, axis=1))
        slots = tuple(
            _slot(problem, slot.kind, blocks[rows], counts[slot.kind])
            for slot, blocks in zip(group.type.slots, group.blocks, strict=True)
            if slot.kind in LOCAL
        )
        tests = quality.reliability[number].at(rows).test
        absorbed = _absorbed_of_controlled(one)
        found.append(FlaggedRows(number, rows, tests, flags[rows], active, together, absorbed, slots))
    return found


def rows_of_blocks(problem: Problem) -> dict[str, IntArray]:
    """How many rows that take part each point and frame has, by kind."""
    counts = {
        kind: np.zeros(len(columns), dtype=np.int64)
        for kind, columns in problem.index.columns.items()
        if kind in LOCAL
    }
    for group in problem.groups:
        taking_part = (group.mask & ~group.left_out).any(axis=1)
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind in counts:
                counts[slot.kind] += np.bincount(blocks[taking_part], minlength=len(counts[slot.kind]))
    return counts


def candidates(
    flagged: Sequence[FlaggedRows],
    cannot: Collection[Entry],
    places: Sequence[int] | None = None,
    part: int = 0,
) -> list[Candidate]:
    """What may go in a round, entries in ``cannot`` apart: nothing else has half of the largest |w| there is.

    ``places``: where each group stands among those of the whole network, of which this is a part.
    """
    sizes = [comparable(np.where(_may_go(one, cannot, part), np.abs(one.tests), 0.0)) for one in flagged]
    least = max(
        _BESIDE_THE_WORST * max((float(size.max()) for size in sizes), default=0.0), np.nextafter(0.0, 1.0)
    )
    return [
        Candidate(
            float(size[k].max()),
            (places[one.group] if places is not None else one.group, part, int(one.rows[k])),
            {(slot.kind, slot.names[k]): int(slot.rows[k]) for slot in one.slots if slot.rows[k] >= 0},
            float(one.absorbed[k]),
            _going(one, int(k), size[k], part),
        )
        for one, size in zip(flagged, sizes, strict=True)
        for k in np.flatnonzero(size.max(axis=1) >= least)
    ]


def worst_first(all_candidates: Iterable[Candidate], shared: Mapping[Block, int]) -> list[Tested]:
    """The worst of the candidates, and others nearly as bad that are not so for its error, nor for each other's.

    ``shared``: points and frames that several parts have, with the number of rows of all parts.
    """
    ordered = sorted(all_candidates, key=lambda one: (-one.size, *one.place))
    used: dict[Block, float] = {}
    room: dict[Block, int] = {}
    chosen: list[Tested] = []
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
                room[block] = room.get(block, shared.get(block, rows) // _OF_ITS_ROWS) - 1
            chosen += one.tested
    return chosen


def _may_go(one: FlaggedRows, cannot: Collection[Entry], part: int) -> BoolArray:
    flags = one.flags.copy()
    for entry in cannot:
        if (entry.part, entry.group) == (part, one.group):
            flags[one.rows == entry.row, entry.component] = False
    return flags


def _going(one: FlaggedRows, k: int, sizes: FloatArray, part: int) -> tuple[Tested, ...]:
    """The worst component of a row; all components of a ray, where each is controlled for itself."""
    components = np.flatnonzero(one.active[k]) if one.together[k] else [int(np.argmax(sizes))]
    return tuple(
        Tested(Entry(one.group, int(one.rows[k]), int(c), part), float(one.tests[k, c])) for c in components
    )


def _slot(problem: Problem, kind: str, blocks: IntArray, counts: IntArray) -> Slot:
    free = (problem.index.columns[kind][blocks] >= 0).any(axis=1)
    ids = problem.index.blocks[kind].ids
    return Slot(kind, tuple(ids[block] for block in blocks.tolist()), np.where(free, counts[blocks], -1))


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
