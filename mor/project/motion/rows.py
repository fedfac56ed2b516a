"""Observations at their epochs: rows that see a moving point refer to where it is at that time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby
from operator import itemgetter

import numpy as np

from mor.arrays import BoolArray, IntArray
from mor.errors import Problem
from mor.observations import ObservationGroup, some_rows
from mor.observations.motion.moving import basis, moving
from mor.observations.names import Names
from mor.parameters.kinds import MOTIONS
from mor.project.motion.declared import block_at
from mor.project.motion.epochs import NONE
from mor.project.motion.model import AT
from mor.project.motion.times import decimal_year
from mor.project.network.reading import Reading
from mor.project.observations.observation_rows import Group
from mor.project.tables.columns import MOST_TOLD


def settle_reference(reading: Reading) -> None:
    """t0: as the project says, or the first of the epochs."""
    given = reading.project.epochs.reference
    try:
        reading.motion.reference = (
            decimal_year(given) if given is not None else min(reading.motion.times, default=0.0)
        )
    except ValueError:
        return  # told where the section is read


def at_their_epochs(reading: Reading, groups: list[Group]) -> list[Group]:
    """The groups, rows that see points with velocities or oscillations apart, as their twins."""
    if not reading.motion.points:
        return groups
    if reading.section == "observations":
        settle_reference(reading)
        _settle_first_epochs(reading, groups)
    return [part for group in groups for part in _at_its_epochs(reading, group)]


def _settle_first_epochs(reading: Reading, groups: list[Group]) -> None:
    """Points with coordinates of every epoch have their own in the first one that sees them."""
    motion = reading.motion
    free = np.array(sorted(b for b, point in motion.points.items() if point.own_epochs), dtype=np.int64)
    for found in groups if len(free) else ():
        for slot, blocks in zip(found.group.type.slots, found.group.blocks, strict=True):
            if slot.kind != "point" or found.epochs is None:
                continue
            rows = np.flatnonzero(np.isin(blocks, free) & (found.epochs != NONE))
            pairs = np.unique(blocks[rows].astype(np.int64) * len(motion.times) + found.epochs[rows])
            for block, epochs in _epochs_of_blocks(pairs, len(motion.times)):
                motion.points[block].epochs.update(epochs)
    for block in free.tolist():
        point = motion.points[block]
        if point.epochs:
            point.by_epoch[min(point.epochs, key=motion.times.__getitem__)] = block


def _at_its_epochs(reading: Reading, found: Group) -> list[Group]:
    motion, group = reading.motion, found.group
    positions = [k for k, slot in enumerate(group.type.slots) if slot.kind == "point"]
    own = np.array(sorted(motion.points), dtype=np.int64)
    sees = np.zeros(group.count, dtype=bool)
    for k in positions:
        sees |= np.isin(group.blocks[k], own)
    if not sees.any():
        return [found]
    epochs = found.epochs if found.epochs is not None else np.full(group.count, NONE, dtype=np.int64)
    if not _all_have_epochs(reading, group, positions, sees & (epochs == NONE)):
        return [found]
    blocks = list(group.blocks)
    motions: list[IntArray] = []
    moves = np.zeros(group.count, dtype=bool)
    for k in positions:
        placed, of_place = _placed(reading, np.asarray(blocks[k], dtype=np.int64), epochs, group)
        motions += of_place
        moves |= np.any([column != 0 for column in of_place], axis=0)
        blocks[k] = placed
    references = _called_by_epoch(reading, group, blocks)
    whole = replace(found, group=replace(group, blocks=tuple(blocks), references=references))
    entry = reading.project.observations[found.entry]
    together = entry.covariance is not None or entry.cluster is not None
    moves |= moves.any() and together
    parts = [] if moves.all() else [_some(whole, np.flatnonzero(~moves))]
    if moves.any():
        rows = np.flatnonzero(moves)
        times = np.array(motion.times)[epochs[rows]] if moves.any() else np.zeros(0)
        times = np.where(epochs[rows] == NONE, motion.reference, times)
        parts.append(
            _moving(_some(whole, rows), [column[rows] for column in motions], basis(times, motion.reference))
        )
    return parts


def _called_by_epoch(reading: Reading, group: ObservationGroup, blocks: list[IntArray]) -> tuple[Names, ...]:
    """Names of rows, those of points with other coordinates at the time by the names of these."""
    called = []
    for reference, names in zip(group.type.references, group.references, strict=True):
        for k, slot in enumerate(group.type.slots):
            if slot.kind == "point" and slot.of == reference.name and "point" in reference.among:
                own = np.asarray(group.blocks[k], dtype=np.int64)
                names = _renamed(reading, names, own, blocks[k])
        called.append(names)
    return tuple(called)


def _renamed(reading: Reading, names: Names, own: IntArray, placed: IntArray) -> Names:
    rows = np.flatnonzero(own != placed)
    points = reading.motion.points
    pairs, which = np.unique(own[rows] * len(names.known) + names.numbers[rows], return_inverse=True)
    called = [names.known[name] == points[block].name for block, name in _apart(pairs, len(names.known))]
    rows = rows[np.array(called, dtype=bool)[which.ravel()]]
    if not len(rows):
        return names
    others, which = np.unique(placed[rows], return_inverse=True)
    ids = reading.shop.store("point").ids
    numbers = np.array(names.numbers, dtype=np.int32)
    numbers[rows] = len(names.known) + which.ravel()
    return Names(numbers, (*names.known, *(ids[block] for block in others.tolist())))


def _moving(found: Group, motions: list[IntArray], constants: np.ndarray) -> Group:
    group = found.group
    return replace(
        found,
        group=replace(
            group,
            type=moving(group.type),
            blocks=(*group.blocks, *motions),
            constants=np.concatenate([group.constants, constants], axis=1),
        ),
    )


def _some(found: Group, rows: IntArray) -> Group:
    """Some rows of a group as it was read."""
    if len(rows) == found.group.count:
        return found
    return replace(
        found,
        group=some_rows(found.group, rows),
        rows=found.rows[rows],
        covariances=None if found.covariances is None else found.covariances[rows],
        clusters=None if found.clusters is None else found.clusters.take(rows),
        epochs=None if found.epochs is None else found.epochs[rows],
    )


def _all_have_epochs(
    reading: Reading, group: ObservationGroup, positions: list[int], without: BoolArray
) -> bool:
    """False if a row sees a moving point at no time; each such row is told."""
    if not without.any():
        return True
    moving = reading.motion.points
    for row in np.flatnonzero(without)[:MOST_TOLD].tolist():
        seen = [int(group.blocks[k][row]) for k in positions]
        name = next(moving[block].name for block in seen if block in moving)
        words = (
            f"point {name!r} moves, and this row has no epoch: give the row, or its image or station, a column "
            "epoch"
        )
        line = int(group.lines[row]) if len(group.lines) > row else 0
        reading.problems.append(Problem(words, group.file, line))
    return False


def _placed(
    reading: Reading, blocks: IntArray, epochs: IntArray, group: ObservationGroup
) -> tuple[IntArray, list[IntArray]]:
    """Blocks (n,) of the coordinates at the epochs, and of each kind of movement, 0 where there is none."""
    motion = reading.motion
    placed = blocks.copy()
    of_place = [np.zeros(len(blocks), dtype=np.int64) for _ in MOTIONS]
    rows = np.flatnonzero(np.isin(blocks, np.array(sorted(motion.points), dtype=np.int64)))
    pairs, which = np.unique(blocks[rows] * len(motion.times) + epochs[rows], return_inverse=True)
    _add_epochs(reading, pairs, group, rows, which)
    there: list[int] = []
    moved: list[list[int]] = []
    for block, of_block in _epochs_of_blocks(pairs, len(motion.times)):
        point = motion.points[block]
        if reading.section == "observations":
            point.epochs.update(of_block)
        there += [
            point.by_epoch.get(epoch, block) if point.own_epochs else point.at(epoch, motion.times[epoch])
            for epoch in of_block
        ]
        moved += [[point.motions.get(kind.key, 0) for kind in MOTIONS]] * len(of_block)
    placed[rows] = np.array(there, dtype=np.int64)[which.ravel()]
    for column, of_pairs in zip(of_place, zip(*moved, strict=True), strict=False):
        column[rows] = np.array(of_pairs, dtype=np.int64)[which.ravel()]
    return placed, of_place


def _apart(pairs: IntArray, count: int) -> list[tuple[int, int]]:
    """First and second number of pairs (n,) kept as first · count + second."""
    first, second = np.divmod(pairs, count)
    return list(zip(first.tolist(), second.tolist(), strict=True))


def _epochs_of_blocks(pairs: IntArray, epochs: int) -> Iterator[tuple[int, list[int]]]:
    """Blocks of ascending pairs (n,) block · epochs + epoch, and the epochs of each."""
    for block, of_block in groupby(_apart(pairs, epochs), key=itemgetter(0)):
        yield block, [epoch for _, epoch in of_block]


def _add_epochs(
    reading: Reading, pairs: IntArray, group: ObservationGroup, rows: IntArray, which: IntArray
) -> None:
    """Coordinates of their own for points in epochs that have not come before; the first epoch has the point's."""
    motion = reading.motion
    new: list[tuple[int, int]] = []
    for block, epoch in _apart(pairs, len(motion.times)):
        point = motion.points[block]
        if not point.own_epochs or epoch in point.by_epoch:
            continue
        if reading.section != "observations":
            row = int(rows[int(np.argmax(which.ravel() == 0))])
            words = f"point {point.name!r} was not observed in the epoch {motion.labels[epoch]}"
            line = int(group.lines[row]) if len(group.lines) > row else 0
            reading.problems.append(Problem(words, group.file, line))
            continue
        new.append((block, epoch))
    if not new:
        return
    labels = [f"{motion.points[block].name}{AT}{motion.labels[epoch]}" for block, epoch in new]
    before = np.array([block for block, _ in new], dtype=np.int64)
    added = block_at(reading, labels, before, np.zeros((len(new), 3)))
    for (block, epoch), own in zip(new, added.tolist(), strict=True):
        motion.points[block].by_epoch[epoch] = own
        motion.stands_for[own] = block
