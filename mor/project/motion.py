"""Motions of points: declared models, epochs, rows that observe them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import partial
from itertools import groupby
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from mor.model.contract import Names, ObservationGroup, Reference, names_of, some_rows
from mor.model.coordinates import OBSERVED_DIFFERENCES
from mor.model.parameters import COSINE, MOTIONS, SINE, VELOCITY, BlockKind
from mor.model.trajectory import basis, moving
from mor.project.entities import (
    AT,
    ContradictionError,
    Equality,
    MovingPoint,
    Reading,
    TimeModel,
    decimal_year,
    entities,
    settle_equalities,
    table_label,
    unknown_name,
)
from mor.project.points import add_points, in_dimensions, inwards
from mor.project.rows import ReadGroup
from mor.project.schema import MotionEntry
from mor.project.tables import (
    MOST_TOLD,
    Column,
    Rows,
    Statuses,
    TableLocation,
    component_columns,
    component_rows,
    number_column,
    read_table,
)
from mor.types import BoolArray, FloatArray, IntArray
from mor.units import LENGTH, Component

# ---- The section ``motions``: velocities, annual oscillations, steps, coordinates of every epoch.

STEP = tuple(Component(f"d{axis}", LENGTH) for axis in "xyz")
_KINDS: dict[str, tuple[BlockKind, ...]] = {"velocity": (VELOCITY,), "seasonal": (SINE, COSINE)}
_MOVES_ALREADY = "point {} has coordinates of its own in every epoch, and no movement beside"


def read_motions(reading: Reading) -> None:
    """Moving points with their blocks; what is wrong with them is told."""
    project = reading.project
    if project.epochs.reference is not None:
        try:
            decimal_year(project.epochs.reference)
        except ValueError as error:
            reading.at("epochs").tell(f"reference: {error}", "reference")
    if not project.motions:
        return
    nothing = np.zeros(len(reading.shop.things["point"].ids), dtype=np.int64)
    neutral = {kind.key: nothing + reading.shop.neutral(kind.key) for kind in MOTIONS}
    points = reading.shop.things["point"]
    reading.shop.things["point"] = entities(points.ids, {**points.parts, **neutral})
    steps: list[_Step] = []
    for number, table in enumerate(project.motions):
        reading.begin("motions", number, table)
        rows = _rows(reading, table, reading.at("motions", number))
        reading.motion.tables.append((table.model, rows.text("id") if rows is not None else []))
        if rows is None:
            continue
        found = [_point(reading, rows, row) for row in range(rows.count)]
        if None in found:
            continue
        moving = [point for point in found if point is not None]
        if table.model == "steps":
            steps += _steps(reading, table, rows, moving, table_label("motions", number, table))
        elif table.model == "epochs":
            for row, point in enumerate(moving):
                if point.own_epochs or point.steps or point.motions:
                    rows.tell(row, _MOVES_ALREADY.format(repr(point.name)))
                point.own_epochs = True
        else:
            _add_motion(reading, table, rows, moving)
    _take_steps(reading, steps)


def _rows(reading: Reading, table: MotionEntry, place: TableLocation) -> Rows | None:
    components = STEP if table.model == "steps" else [c for k in _KINDS.get(table.model, ()) for c in k.components]
    columns = [Column("id", required=True), *component_columns(components, reading.edge)]
    columns += [number_column("sigma", LENGTH, reading.edge)] if components else []
    columns += [Column("time", required=True)] if table.model == "steps" else []
    if table.points is not None:
        names = _named(reading, table.points, place)
        if not names:
            return None
        table = table.model_copy(update={"columns": ["id"], "rows": [[name] for name in names]})
    known = [component.name for component in components]
    wrong = [name for name in table.fixed if name not in known]
    if wrong:
        place.tell(f"model {table.model} has no component {wrong[0]!r} (known: {', '.join(known)})", "fixed")
        return None
    return read_table(table, columns, place)


def _named(reading: Reading, patterns: list[str], place: TableLocation) -> list[str]:
    """Points that names, groups and patterns stand for; coordinates of single epochs are no points of their own."""
    points = reading.shop.things["point"]
    of_block = dict(zip(points.parts["position"].tolist(), points.ids, strict=True))
    own = [name for name in points.ids if name.partition(AT)[0] not in points.numbers or AT not in name]
    found: dict[str, None] = {}
    for pattern in patterns:
        if pattern in points.numbers:
            here = [pattern]
        elif pattern in reading.groups:
            here = [of_block[block] for block in reading.groups[pattern]]
        else:
            here = [name for name in own if fnmatchcase(name, pattern)]
        if not here and "point" not in reading.broken:
            place.tell(unknown_name("point", pattern, points.ids), "points")
        found |= dict.fromkeys(here)
    return list(found)


def _point(reading: Reading, rows: Rows, row: int) -> MovingPoint | None:
    name, points = rows.series("id")[row], reading.shop.things["point"]
    if name not in points.numbers:
        if "point" not in reading.broken:
            rows.tell(row, unknown_name("point", name, points.ids))
        return None
    block = points.part(name, "position")
    return reading.motion.points.setdefault(block, MovingPoint(name, [], block))


def _add_motion(reading: Reading, table: MotionEntry, rows: Rows, moving: list[MovingPoint]) -> None:
    names = [point.name for point in moving]
    for kind in _KINDS[table.model]:
        for component in kind.names:
            rows.numbers[component] = np.nan_to_num(rows.number(component))
        own = [name for name in table.fixed if name in kind.names]
        statuses = component_rows(rows, kind.components, own, rows.number("sigma"))
        statuses = in_dimensions(statuses, reading)
        blocks = reading.shop.store(kind.key).add(names, *inwards(reading.edge, statuses))
        points = reading.shop.things["point"]
        for row, (point, block) in enumerate(zip(moving, blocks.tolist(), strict=True)):
            if point.own_epochs:
                rows.tell(row, _MOVES_ALREADY.format(repr(point.name)))
            elif kind.key in point.motions:
                words = (
                    f"point {point.name!r} has a velocity already"
                    if kind is VELOCITY
                    else f"point {point.name!r} has an annual oscillation already"
                )
                rows.tell(row, words)
                return
            point.motions[kind.key] = block
            points.parts[kind.key][points.numbers[point.name]] = block


class _Step(NamedTuple):
    """A step of a point: when, by how much in internal axes, and where it was said."""

    point: MovingPoint
    time: float
    label: str
    size: FloatArray
    free: BoolArray
    sigma: FloatArray
    group: str
    rows: Rows
    row: int


def _steps(reading: Reading, table: MotionEntry, rows: Rows, moving: list[MovingPoint], group: str) -> list[_Step]:
    for component in STEP:
        rows.numbers[component.name] = np.nan_to_num(rows.number(component.name))
    statuses = component_rows(rows, STEP, table.fixed, rows.number("sigma"))
    statuses = inwards(reading.edge, in_dimensions(statuses, reading))
    steps = []
    for row, point in enumerate(moving):
        text = rows.series("time")[row]
        try:
            time = decimal_year(text)
        except ValueError as error:
            rows.tell(row, f"time: {error}")
            continue
        label = f"{point.name}{AT}{text}"
        own = (statuses.values[row], statuses.free[row], statuses.sigma[row])
        steps.append(_Step(point, time, label, *own, group, rows, row))
    return steps


def _take_steps(reading: Reading, steps: list[_Step]) -> None:
    """Coordinates after every step: tied to those before it, free of them, or with an observed difference."""
    ties: list[Equality] = []
    observed: dict[str, list[tuple[_Step, int, int]]] = {}
    for step in sorted(steps, key=lambda step: step.time):
        point = step.point
        times = [time for time, _ in point.steps]
        if point.own_epochs or step.time in times:
            words = (
                _MOVES_ALREADY.format(repr(point.name))
                if point.own_epochs
                else f"point {point.name!r} has a step at this time already"
            )
            step.rows.tell(step.row, words)
            continue
        before = point.steps[-1][1] if point.steps else point.block
        block = block_at(reading, [step.label], np.array([before]), step.size[None])[0]
        point.steps.append((step.time, int(block)))
        reading.motion.stands_for[int(block)] = point.block
        for component in np.flatnonzero(~step.free).tolist():
            ties.append(Equality(component, before, int(block), float(step.size[component])))
        if np.isfinite(step.sigma).any():
            observed.setdefault(step.group, []).append((step, before, int(block)))
    absent = np.array([c not in reading.project.settings.dimensions for c in "xyz"])
    try:
        settle_equalities(reading.shop.store("point"), [tie for tie in ties if not absent[tie.component]])
    except ContradictionError as error:
        reading.at("motions").tell(f"steps: {error}")
    reading.motion_groups += [_observed_steps(reading, name, found) for name, found in observed.items()]


def _observed_steps(reading: Reading, name: str, found: list[tuple[_Step, int, int]]) -> ObservationGroup:
    sigma = np.array([step.sigma for step, _, _ in found])
    size = np.array([step.size for step, _, _ in found])
    ids = reading.shop.store("point").ids
    ends = [[before for _, before, _ in found], [after for _, _, after in found]]
    return ObservationGroup(
        name=name,
        type=OBSERVED_DIFFERENCES["point"],
        blocks=tuple(np.array(blocks, dtype=np.int64) for blocks in ends),
        observed=np.where(np.isfinite(sigma), size, np.nan),
        sigma=sigma,
        constants=np.zeros((len(found), 0)),
        references=tuple(names_of([f"point {ids[block]}" for block in blocks]) for blocks in ends),
    )


def block_at(reading: Reading, labels: list[str], before: IntArray, moved: FloatArray) -> IntArray:
    """Blocks of coordinates that points have from a time on, called so: declared ones, or new ones that are free.

    New ones start at the coordinates of the blocks ``before`` (n,), ``moved`` by (n, 3).
    """
    points = reading.shop.things["point"]
    result = np.array(
        [points.part(name, "position") if name in points.numbers else -1 for name in labels], dtype=np.int64
    )
    new = np.flatnonzero(result < 0)
    if len(new):
        store = reading.shop.store("point")
        start = store.start_values(store.all_values())[before[new]] + moved[new]
        nothing = np.full(start.shape, np.nan)
        statuses = Statuses(start, np.ones(start.shape, dtype=bool), nothing, nothing.copy())
        result[new] = add_points(reading, [labels[k] for k in new], in_dimensions(statuses, reading))
    return result


# ---- Which epoch an observation, an image or a station belongs to.

EPOCH = Column("epoch")
NONE = -1
"""Epoch of a row, an image or a station that has none."""


def epochs_of_rows(reading: Reading, rows: Rows) -> IntArray:
    """(n,) number of the epoch that each row of a table gives; −1 where it gives none. Each mistake is told once."""
    if "epoch" not in rows.texts:
        return np.full(rows.count, NONE, dtype=np.int64)
    names = rows.names("epoch")
    numbers = np.full(len(names.known), NONE, dtype=np.int64)
    for k, text in enumerate(names.known):
        if not text:
            continue
        try:
            numbers[k] = reading.motion.epoch(text)
        except ValueError as error:
            rows.tell(int(np.argmax(names.numbers == k)), f"epoch: {error}")
    return numbers[names.numbers]


def remember_epochs(reading: Reading, space: str, names: list[str], rows: Rows) -> None:
    """Keep the epochs of images or stations for the observations that refer to them."""
    epochs = epochs_of_rows(reading, rows)
    known = reading.motion.epoch_of.setdefault(space, {})
    known |= {name: epoch for name, epoch in zip(names, epochs.tolist(), strict=True) if epoch != NONE}


def row_epochs(reading: Reading, rows: Rows, references: tuple[Reference, ...], names: tuple[Names, ...]) -> IntArray:
    """(n,) epoch of every row: its own, or that of its image or station; −1 where nothing says any.

    Where two of them differ, that is a mistake, which is told.
    """
    epochs = epochs_of_rows(reading, rows)
    if not any(reading.motion.epoch_of.values()):
        return epochs
    for reference, named in zip(references, names, strict=True):
        of_name = np.array([_epoch_of(reading, reference, name) for name in named.known], dtype=np.int64)
        found = of_name[named.numbers] if len(of_name) else epochs
        differ = (found != NONE) & (epochs != NONE) & (found != epochs)
        rows.tell_where(differ, partial(_differing, reading.motion, named, found, epochs))
        epochs = np.where(epochs == NONE, found, epochs)
    return epochs


def _differing(motion: TimeModel, names: Names, found: IntArray, given: IntArray, row: int) -> str:
    own, other = (motion.labels[int(epochs[row])] for epochs in (found, given))
    return f"{names[row]} is of epoch {own}, this row of {other}"


def _epoch_of(reading: Reading, reference: Reference, name: str) -> int:
    for space in reference.among:
        bare = name.removeprefix(f"{space}:").removeprefix("centre:" if space == "image" else "\0")
        if space in reading.motion.epoch_of and bare in reading.motion.epoch_of[space]:
            return reading.motion.epoch_of[space][bare]
        things = reading.shop.things.get(space)
        if things is not None and bare in things.numbers:
            return NONE
    return NONE


# ---- Observations at their epochs: rows that see a moving point refer to where it is at that time.


def settle_reference(reading: Reading) -> None:
    """t0: as the project says, or the first of the epochs."""
    given = reading.project.epochs.reference
    with suppress(ValueError):  # told where the section is read
        reading.motion.reference = decimal_year(given) if given is not None else min(reading.motion.times, default=0.0)


def at_their_epochs(reading: Reading, groups: list[ReadGroup]) -> list[ReadGroup]:
    """The groups, rows that see points with velocities or oscillations apart, as their twins."""
    if not reading.motion.points:
        return groups
    if reading.section == "observations":
        settle_reference(reading)
        _settle_first_epochs(reading, groups)
    return [part for group in groups for part in _at_its_epochs(reading, group)]


def _settle_first_epochs(reading: Reading, groups: list[ReadGroup]) -> None:
    motion = reading.motion
    free = np.array(sorted(b for b, point in motion.points.items() if point.own_epochs), dtype=np.int64)
    for found in groups if len(free) else ():
        for slot, blocks in found.group.blocks_by_slot:
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


def _at_its_epochs(reading: Reading, found: ReadGroup) -> list[ReadGroup]:
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
        times = np.array(motion.times)[epochs[rows]]
        times = np.where(epochs[rows] == NONE, motion.reference, times)
        parts.append(_moving(_some(whole, rows), [column[rows] for column in motions], basis(times, motion.reference)))
    return parts


def _called_by_epoch(reading: Reading, group: ObservationGroup, blocks: list[IntArray]) -> tuple[Names, ...]:
    """Names of rows, those of points with other coordinates at the time by the names of these."""
    called = []
    for reference, names in zip(group.type.references, group.references, strict=True):
        for k, slot in enumerate(group.type.slots):
            if slot.kind == "point" and slot.of == reference.name and "point" in reference.among:
                names = _renamed(reading, names, np.asarray(group.blocks[k], dtype=np.int64), blocks[k])
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


def _moving(found: ReadGroup, motions: list[IntArray], constants: np.ndarray) -> ReadGroup:
    group = found.group
    blocks, constants = (*group.blocks, *motions), np.concatenate([group.constants, constants], axis=1)
    return replace(found, group=replace(group, type=moving(group.type), blocks=blocks, constants=constants))


def _some(found: ReadGroup, rows: IntArray) -> ReadGroup:
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


def _all_have_epochs(reading: Reading, group: ObservationGroup, positions: list[int], without: BoolArray) -> bool:
    if not without.any():
        return True
    moving = reading.motion.points
    for row in np.flatnonzero(without)[:MOST_TOLD].tolist():
        seen = [int(group.blocks[k][row]) for k in positions]
        name = next(moving[block].name for block in seen if block in moving)
        words = (
            f"point {name!r} moves, and this row has no epoch: give the row, or its image or station, a column epoch"
        )
        reading.problems.append(group.message(row, words))
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
    for block, of_block in groupby(_apart(pairs, epochs), key=itemgetter(0)):
        yield block, [epoch for _, epoch in of_block]


def _add_epochs(reading: Reading, pairs: IntArray, group: ObservationGroup, rows: IntArray, which: IntArray) -> None:
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
            reading.problems.append(group.message(row, words))
            continue
        new.append((block, epoch))
    if not new:
        return
    labels = [f"{motion.points[block].name}{AT}{motion.labels[epoch]}" for block, epoch in new]
    added = block_at(reading, labels, np.array([block for block, _ in new], dtype=np.int64), np.zeros((len(new), 3)))
    for (block, epoch), own in zip(new, added.tolist(), strict=True):
        motion.points[block].by_epoch[epoch] = own
        motion.stands_for[own] = block
