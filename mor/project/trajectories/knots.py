"""Knots of the trajectories of a project: from tables, or at a spacing between the rows of tables."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.errors import Problem
from mor.geometry.rotations import angles_from_rotation, rotation_from_angles
from mor.geometry.trajectory import linear_weights, pose_at
from mor.observations.time.trajectory import CUBIC, LINEAR
from mor.parameters.kinds import POINT, ROTATION
from mor.project.edge import UnitError
from mor.project.file.model_trajectories import Trajectory as Declared
from mor.project.network.entities import entities
from mor.project.network.poses import positions, rotations
from mor.project.network.reading import Reading
from mor.project.tables.columns import tell_rows
from mor.project.tables.statuses import component_columns, number_column
from mor.project.tables.tables import Column, Place, Rows, read_table
from mor.project.trajectories.model import Trajectory, knot_name, said_time
from mor.units import TIME

_POSE = (*POINT.names, *ROTATION.names)


def read_trajectories(reading: Reading) -> None:
    """Trajectories with their knots: a position and a rotation each."""
    ids: list[str] = []
    blocks: list[tuple[IntArray, IntArray]] = []
    declared = reading.project.trajectories
    if declared and _refused(reading):
        reading.broken.add("trajectory")
        declared = []
    for number, table in enumerate(declared):
        reading.begin("trajectories", number, table)
        place = reading.at("trajectories", number)
        columns = [
            Column("trajectory", required=True),
            number_column("time", TIME, reading.edge, required=True),
            *component_columns((*POINT.components, *ROTATION.components), reading.edge),
        ]
        rows = read_table(table, columns, place, reading.problems)
        reading.watch(table.file)
        if rows is None:
            continue
        before = len(ids)
        for knots in _read_table(reading, table, place, rows):
            reading.trajectories[knots.name] = knots
            ids += [knot_name(knots.name, time) for time in knots.times]
            blocks.append((knots.positions, knots.rotations))
        reading.table_ids["trajectories", number] = ids[before:]
        reading.end("knot", len(ids) - before)
    none = [(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))]
    position, rotation = (np.concatenate(part) for part in zip(*(blocks or none), strict=True))
    reading.shop.things["knot"] = entities(ids, {"position": position, "rotation": rotation})
    reading.shop.things["trajectory"] = entities(reading.trajectories, {})


def _refused(reading: Reading) -> bool:
    """True, and told, where trajectories have no place in a project."""
    project, place = reading.project, reading.at("trajectories")
    words = [
        (reading.edge.axes.xy != "en", "trajectories need axes: {xy: en}"),
        (project.world is not None, "trajectories in the world are not provided for: give plane coordinates"),
        (project.settings.dimensions != "xyz", "trajectories need settings: {dimensions: xyz}"),
    ]
    told = [place.problem(said) for wrong, said in words if wrong]
    reading.problems.extend(told)
    return bool(told)


class _Lengths(NamedTuple):
    """Spacing and gap of a table in seconds; NaN if there is none."""

    spacing: float
    gap: float


def _read_table(reading: Reading, table: Declared, place: Place, rows: Rows) -> list[Trajectory]:
    """The trajectories of one table; mistakes are told."""
    before = len(reading.problems)
    lengths = _Lengths(
        _seconds(reading, place, "spacing", table.spacing), _seconds(reading, place, "gap", table.gap)
    )
    if lengths.gap < lengths.spacing:
        words = "gap: shorter than the spacing of the knots; expected a longer one"
        reading.problems.append(place.problem(words, "gap"))
    if table.spacing is not None:
        _only_starts(reading, table, place, rows)
    names = rows.names("trajectory")
    time = rows.number("time")
    own = [np.flatnonzero(names.numbers == k) for k in range(len(names.known))]
    for name, mine in zip(names.known, own, strict=True):
        _check_rows(reading, name, rows.take(mine), time[mine])
    if len(reading.problems) > before:
        return []
    return [
        found
        for name, mine in zip(names.known, own, strict=True)
        if (found := _trajectory(reading, table, name, rows.take(mine), lengths)) is not None
    ]


def _seconds(reading: Reading, place: Place, key: str, text: str | None) -> float:
    """A length of time above 0, NaN if there is none; mistakes are told."""
    if text is None:
        return float("nan")
    try:
        value = reading.edge.number(text, TIME)
    except UnitError as error:
        reading.problems.append(place.problem(f"{key}: {error}", key))
        return float("nan")
    if value <= 0.0:
        reading.problems.append(place.problem(f"{key}: found {text}, expected a time above 0", key))
    return value


def _only_starts(reading: Reading, table: Declared, place: Place, rows: Rows) -> None:
    """Rows between which knots are laid give start values and no more."""
    if table.fixed:
        words = "fixed: knots at a spacing are free; observe them by rows of type trajectory_position"
        reading.problems.append(place.problem(words, "fixed"))
    given = [f"{kind}_{name}" for kind in ("sigma", "start") for name in _POSE]
    for name in given:
        if np.isfinite(rows.number(name)).any():
            words = (
                f"{name}: rows of a table with a spacing are start values of knots in between; what was observed goes "
                "among the observations (trajectory_position, trajectory_attitude)"
            )
            reading.problems.append(place.problem(words))


def _check_rows(reading: Reading, name: str, rows: Rows, time: FloatArray) -> None:
    """Times of one trajectory must ascend, and there must be two of them."""
    problems = reading.problems
    if name in reading.trajectories:
        problems.append(
            Problem(f"trajectory {name!r} has a table of its own already", rows.file, int(rows.lines[0]))
        )
    step = np.diff(time, prepend=-np.inf)
    tell_rows(
        problems, step == 0.0, rows, lambda row: f"trajectory {name!r}: {said_time(time[row])} is given twice"
    )
    words = "trajectory {0!r}: {1} comes after {2}; expected times in ascending order"
    tell_rows(
        problems,
        step < 0.0,
        rows,
        lambda row: words.format(name, said_time(time[row]), said_time(time[row - 1])),
    )
    if len(time) < LINEAR:
        words = f"trajectory {name!r} has one row; a trajectory needs two knots, four for cubic interpolation"
        problems.append(Problem(words, rows.file, int(rows.lines[0])))


def _trajectory(
    reading: Reading, table: Declared, name: str, rows: Rows, lengths: _Lengths
) -> Trajectory | None:
    times = rows.number("time")
    stretch: IntArray = np.cumsum(np.diff(times, prepend=times[0]) > lengths.gap)
    if not np.isnan(lengths.spacing):
        times, stretch, position, rotation = _at_spacing(reading, name, rows, stretch, lengths.spacing)
    count = np.bincount(stretch)
    cubic = table.interpolation == "cubic"
    short = np.flatnonzero(count < (CUBIC if cubic else LINEAR))
    if len(short):
        begin = said_time(times[stretch == short[0]][0])
        least = CUBIC if cubic else LINEAR
        words = (
            f"trajectory {name!r}: the stretch that begins at {begin} has too few knots ({count[short[0]]}); expected "
            f"{least} or more"
        )
        reading.problems.append(Problem(words, rows.file, int(rows.lines[0])))
        return None
    if np.isnan(lengths.spacing):
        labels = [f"knot {knot_name(name, time)}" for time in times]
        position = positions(reading, rows, labels, table.fixed)
        rotation = rotations(reading, rows, labels, table.fixed)
    return Trajectory(name, times, np.asarray(stretch), position, rotation, cubic)


def _at_spacing(
    reading: Reading, name: str, rows: Rows, stretch: IntArray, spacing: float
) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
    """Knots at equal steps no longer than ``spacing``, from the first to the last row of each stretch, all free.

    Returns times, stretches, position and rotation blocks.
    """
    given = rows.number("time")
    pieces = []
    for k in range(int(stretch[-1]) + 1):
        ends = given[stretch == k][[0, -1]]
        steps = max(int(np.ceil((ends[1] - ends[0]) / spacing - _WHOLE)), 1) if ends[1] > ends[0] else 0
        pieces.append(np.linspace(ends[0], ends[1], steps + 1))
    times = np.concatenate(pieces)
    numbers = np.repeat(np.arange(len(pieces)), [len(piece) for piece in pieces])
    values = np.stack([rows.number(component) for component in _POSE], axis=1)
    values = between_rows(given, values, times)
    labels = [f"knot {knot_name(name, time)}" for time in times]
    free, nothing = np.ones((len(times), 3), dtype=bool), np.full((len(times), 3), np.nan)
    blocks = [
        reading.shop.store(kind.key).add(labels, part, free, nothing)
        for kind, part in ((POINT, values[:, :3]), (ROTATION, values[:, 3:]))
    ]
    return times, numbers, blocks[0], blocks[1]


_WHOLE = 1e-9
"""Part of a step that round-off may add to a whole number of them."""


def between_rows(given: FloatArray, values: FloatArray, times: FloatArray) -> FloatArray:
    """Poses (n, 6) at ``times``, linear between rows at ascending times ``given`` (m,) with values (m, 6).

    Rows without a position, or without an attitude, are passed over there; NaN if there are not two. Before the
    first row and behind the last the nearest two are extended.
    """
    result = np.full((len(times), 6), np.nan)
    for part in (slice(0, 3), slice(3, 6)):
        known = np.flatnonzero(np.isfinite(values[:, part]).all(axis=1))
        if len(known) < LINEAR:
            continue
        t, row = given[known], values[known]
        before = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
        two = before[:, None] + np.arange(LINEAR)
        angles = row[two][:, :, 3:] if part.start else np.zeros((len(times), LINEAR, 3))
        place = row[two][:, :, :3]
        pose = pose_at(
            place, rotation_from_angles(angles), linear_weights(t[before + 1] - t[before]), times - t[before]
        )
        result[:, part] = angles_from_rotation(pose.rotation) if part.start else pose.position
    return result
