"""The section ``motions``: velocities, annual oscillations, steps, coordinates of every epoch."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import Problem
from mor.observations import OBSERVED_DIFFERENCES, ObservationGroup
from mor.observations.names import names_of
from mor.parameters.kinds import COSINE, MOTIONS, SINE, VELOCITY, BlockKind
from mor.project.file.motions import Motion as MotionTable
from mor.project.motion.model import AT, MovingPoint
from mor.project.motion.times import decimal_year
from mor.project.network.entities import entities, unknown_name
from mor.project.network.equalities import ContradictionError, Equality, settle_equalities
from mor.project.network.points import add_points
from mor.project.network.poses import in_dimensions, inwards
from mor.project.network.reading import Reading, table_label
from mor.project.tables.statuses import Statuses, component_columns, component_rows, number_column
from mor.project.tables.tables import Column, Place, Rows, read_table
from mor.units import LENGTH, Component

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
            reading.problems.append(reading.at("epochs").problem(f"reference: {error}", "reference"))
    if not project.motions:
        return
    nothing = np.zeros(len(reading.shop.things["point"].ids), dtype=np.int64)
    neutral = {kind.key: nothing + reading.shop.neutral(kind.key) for kind in MOTIONS}
    points = reading.shop.things["point"]
    reading.shop.things["point"] = entities(points.ids, {**points.parts, **neutral})
    steps: list[_Step] = []
    for number, table in enumerate(project.motions):
        reading.begin("motions", number, table)
        place = reading.at("motions", number)
        rows = _rows(reading, table, place)
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
            _own_epochs(reading, rows, moving)
        else:
            _add_motion(reading, table, rows, moving)
    _take_steps(reading, steps)


def _rows(reading: Reading, table: MotionTable, place: Place) -> Rows | None:
    """Rows of a table; of named points a row for each."""
    components = (
        STEP if table.model == "steps" else [c for k in _KINDS.get(table.model, ()) for c in k.components]
    )
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
        words = f"model {table.model} has no component {wrong[0]!r} (known: {', '.join(known)})"
        reading.problems.append(place.problem(words, "fixed"))
        return None
    return read_table(table, columns, place, reading.problems)


def _named(reading: Reading, patterns: list[str], place: Place) -> list[str]:
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
            reading.problems.append(place.problem(unknown_name("point", pattern, points.ids), "points"))
        found |= dict.fromkeys(here)
    return list(found)


def _point(reading: Reading, rows: Rows, row: int) -> MovingPoint | None:
    """The point of a row, which moves from now on; ``None`` if there is none."""
    name, points = rows.series("id")[row], reading.shop.things["point"]
    if name not in points.numbers:
        if "point" not in reading.broken:
            words = unknown_name("point", name, points.ids)
            reading.problems.append(Problem(words, rows.file, int(rows.lines[row])))
        return None
    block = points.part(name, "position")
    return reading.motion.points.setdefault(block, MovingPoint(name, [], block))


def _tell_twice(reading: Reading, rows: Rows, row: int, words: str) -> None:
    reading.problems.append(Problem(words, rows.file, int(rows.lines[row])))


def _own_epochs(reading: Reading, rows: Rows, moving: list[MovingPoint]) -> None:
    for row, point in enumerate(moving):
        if point.own_epochs or point.steps or point.motions:
            _tell_twice(reading, rows, row, _MOVES_ALREADY.format(repr(point.name)))
        point.own_epochs = True


def _add_motion(reading: Reading, table: MotionTable, rows: Rows, moving: list[MovingPoint]) -> None:
    """Blocks of velocity or oscillation, 0 where nothing is said of them."""
    names = [point.name for point in moving]
    for kind in _KINDS[table.model]:
        for component in kind.names:
            rows.numbers[component] = np.nan_to_num(rows.number(component))
        own = [name for name in table.fixed if name in kind.names]
        statuses = component_rows(rows, kind.components, own, reading.problems, rows.number("sigma"))
        statuses = in_dimensions(statuses, reading)
        blocks = reading.shop.store(kind.key).add(names, *inwards(reading.edge, statuses))
        points = reading.shop.things["point"]
        for row, (point, block) in enumerate(zip(moving, blocks.tolist(), strict=True)):
            if point.own_epochs:
                _tell_twice(reading, rows, row, _MOVES_ALREADY.format(repr(point.name)))
            elif kind.key in point.motions:
                words = (
                    f"point {point.name!r} has a velocity already"
                    if kind is VELOCITY
                    else f"point {point.name!r} has an annual oscillation already"
                )
                _tell_twice(reading, rows, row, words)
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
    problem: Problem


def _steps(
    reading: Reading, table: MotionTable, rows: Rows, moving: list[MovingPoint], group: str
) -> list[_Step]:
    for component in STEP:
        rows.numbers[component.name] = np.nan_to_num(rows.number(component.name))
    statuses = component_rows(rows, STEP, table.fixed, reading.problems, rows.number("sigma"))
    statuses = inwards(reading.edge, in_dimensions(statuses, reading))
    steps = []
    for row, point in enumerate(moving):
        text = rows.series("time")[row]
        here = Problem("", rows.file, int(rows.lines[row]))
        try:
            time = decimal_year(text)
        except ValueError as error:
            reading.problems.append(Problem(f"time: {error}", here.file, here.line))
            continue
        label = f"{point.name}{AT}{text}"
        own = (statuses.values[row], statuses.free[row], statuses.sigma[row])
        steps.append(_Step(point, time, label, *own, group, here))
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
            reading.problems.append(Problem(words, step.problem.file, step.problem.line))
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
        reading.problems.append(reading.at("motions").problem(f"steps: {error}"))
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
