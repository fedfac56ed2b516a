"""Trajectories: knots, navigation, line scanners and images on them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.model.contract import Names, ObservationGroup, ObservationType, coded, names_of
from mor.model.motion import linear_weights, pose_at
from mor.model.parameters import (
    ATTITUDE_SHIFT,
    IMAGE_VELOCITY,
    POINT,
    POSITION_SHIFT,
    ROTATION,
    ROTATION_RATE,
    BlockKind,
)
from mor.model.rotations import angles_from_rotation, rotation_from_angles
from mor.model.trajectory import (
    ATTITUDE,
    CUBIC,
    LINEAR,
    POSITION,
    STEADINESS,
    trajectory_attitude,
    trajectory_position,
)
from mor.project.axes import Edge, ImageScale, UnitError, external, split
from mor.project.entities import (
    Clock,
    Reading,
    RowTimes,
    Scanner,
    Trajectory,
    entities,
    knot_name,
    said_time,
    table_label,
    unknown_name,
)
from mor.project.points import positions, rotations
from mor.project.rows import ReadGroup, group_name, own_or_common, planned_rows, sigma_is_good
from mor.project.schema import Camera, Observations, TrajectoryEntry
from mor.project.stations import shared_column
from mor.project.tables import Column, Rows, TableLocation, component_columns, number_column, read_table, settings
from mor.types import BoolArray, FloatArray, IntArray
from mor.units import IMAGE, NUMBER, TIME

# ---- Line scanners: where their line is, and at what time each row of an image was scanned.


def read_scanner(reading: Reading, name: str, camera: Camera, scale: ImageScale) -> None:
    """Line and line time of a camera, where it is a line scanner; mistakes are told."""
    if camera.line_time is None and camera.line is None:
        return
    place = reading.at("cameras", name)
    line, line_time = 0.0, float("nan")
    try:
        key = "line"
        line = reading.edge.number(camera.line or "0", IMAGE, "", scale)
        key = "line_time"
        if camera.line_time is not None:
            line_time = reading.edge.number(camera.line_time, TIME)
            if not split(camera.line_time)[1]:
                raise UnitError(f"found {camera.line_time}, expected a time with its unit, as in 2 ms")
            if line_time <= 0.0:
                raise UnitError(f"found {camera.line_time}, expected a time above 0")
    except UnitError as error:
        place.tell(f"{key}: {error}", key)
    if not scale.corner:
        place.tell("a line scanner needs coordinates: corner; its rows count from the first line")
    if camera.readout is not None:
        place.tell("a camera has a readout time or is a line scanner, not both", "readout")
    reading.scanners[name] = Scanner(line_time, line)


def read_line_times(reading: Reading) -> None:
    """Read the times of lines by image from the tables of line times."""
    for number, table in enumerate(reading.project.line_times):
        columns = [
            Column("image", required=True),
            number_column("row", NUMBER, reading.edge, required=True),
            number_column("time", TIME, reading.edge, required=True),
        ]
        rows = read_table(table, columns, reading.at("line_times", number))
        reading.watch(table.file)
        if rows is None:
            reading.broken.add("image")
            continue
        names = rows.names("image")
        for k, name in enumerate(names.known):
            own = rows.take(np.flatnonzero(names.numbers == k))
            lines = RowTimes(own.number("row"), own.number("time"))
            step = np.minimum(np.diff(lines.rows, prepend=-np.inf), np.diff(lines.times, prepend=-np.inf))
            own.tell_where(step <= 0.0, f"image {name!r}: rows and times of its lines must ascend")
            said = ""
            if len(lines.rows) < 2:
                said = f"image {name!r} has one line with a time, expected two at least"
            elif name in reading.lines:
                said = f"the times of the lines of image {name!r} are given in two tables"
            if said:
                own.tell(0, said)
            reading.lines[name] = lines


def check_line_times(reading: Reading, images: tuple[str, ...]) -> None:
    """Tell line times of images that do not exist."""
    place = reading.at("line_times")
    for name in reading.lines:
        if name not in images and "image" not in reading.broken:
            place.tell(f"line_times: {unknown_name('image', name, images)}")


def row_times(lines: RowTimes, rows: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Time (n,) of rows, seconds per row there, and false where no line has a time."""
    place = np.clip(np.searchsorted(lines.rows, rows, side="right") - 1, 0, len(lines.rows) - 2)
    rate = np.diff(lines.times)[place] / np.diff(lines.rows)[place]
    inside = (rows >= lines.rows[0]) & (rows <= lines.rows[-1]) | lines.steady
    return lines.times[place] + rate * (rows - lines.rows[place]), rate, np.asarray(inside)


# ---- Knots of the trajectories of a project: from tables, or at a spacing between the rows of tables.

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
        rows = read_table(table, columns, place)
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
        (project.world is not None, "trajectories on the earth are not supported: give plane coordinates"),
        (project.settings.dimensions != "xyz", "trajectories need settings: {dimensions: xyz}"),
    ]
    told = [place.problem(said) for wrong, said in words if wrong]
    reading.problems.extend(told)
    return bool(told)


def _read_table(reading: Reading, table: TrajectoryEntry, place: TableLocation, rows: Rows) -> list[Trajectory]:
    before = len(reading.problems)
    spacing, gap = (_seconds(reading, place, key, getattr(table, key)) for key in ("spacing", "gap"))
    if gap < spacing:
        place.tell("gap: shorter than the spacing of the knots; expected a longer one", "gap")
    if table.spacing is not None:
        _only_starts(table, place, rows)
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
        if (found := _trajectory(reading, table, name, rows.take(mine), spacing, gap)) is not None
    ]


def _seconds(reading: Reading, place: TableLocation, key: str, text: str | None) -> float:
    """A length of time above 0, NaN if there is none; mistakes are told."""
    if text is None:
        return float("nan")
    try:
        value = reading.edge.number(text, TIME)
    except UnitError as error:
        place.tell(f"{key}: {error}", key)
        return float("nan")
    if value <= 0.0:
        place.tell(f"{key}: found {text}, expected a time above 0", key)
    return value


def _only_starts(table: TrajectoryEntry, place: TableLocation, rows: Rows) -> None:
    if table.fixed:
        place.tell("fixed: knots at a spacing are free; observe them by rows of type trajectory_position", "fixed")
    given = [f"{kind}_{name}" for kind in ("sigma", "start") for name in _POSE]
    for name in given:
        if np.isfinite(rows.number(name)).any():
            words = (
                f"{name}: rows of a table with a spacing are start values of knots in between; what was observed goes "
                "among the observations (trajectory_position, trajectory_attitude)"
            )
            place.tell(words)


def _check_rows(reading: Reading, name: str, rows: Rows, time: FloatArray) -> None:
    if name in reading.trajectories:
        rows.tell(0, f"trajectory {name!r} has a table of its own already")
    step = np.diff(time, prepend=-np.inf)
    rows.tell_where(step == 0.0, lambda row: f"trajectory {name!r}: {said_time(time[row])} is given twice")
    words = "trajectory {0!r}: {1} comes after {2}; expected times in ascending order"
    rows.tell_where(step < 0.0, lambda row: words.format(name, said_time(time[row]), said_time(time[row - 1])))
    if len(time) < LINEAR:
        rows.tell(0, f"trajectory {name!r} has one row; a trajectory needs two knots, four for cubic interpolation")


def _trajectory(
    reading: Reading, table: TrajectoryEntry, name: str, rows: Rows, spacing: float, gap: float
) -> Trajectory | None:
    times = rows.number("time")
    stretch: IntArray = np.cumsum(np.diff(times, prepend=times[0]) > gap)
    if not np.isnan(spacing):
        times, stretch, position, rotation = _at_spacing(reading, name, rows, stretch, spacing)
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
        rows.tell(0, words)
        return None
    if np.isnan(spacing):
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
    # Part of a step that round-off may add to a whole number of them.
    round_off = 1e-9
    for k in range(int(stretch[-1]) + 1):
        ends = given[stretch == k][[0, -1]]
        steps = max(int(np.ceil((ends[1] - ends[0]) / spacing - round_off)), 1) if ends[1] > ends[0] else 0
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


# ---- Tables of satellites and inertial systems: positions and attitudes of trajectories at any times.

NAVIGATION = {POSITION: trajectory_position, ATTITUDE: trajectory_attitude}
"""Types a project names, and what makes one for a number of knots."""


def navigation_columns(key: str, edge: Edge) -> list[Column]:
    """Columns of a table of this type."""
    components = NAVIGATION[key](LINEAR).components
    return [
        Column("trajectory", required=True),
        number_column("time", TIME, edge, required=True),
        Column("strip"),
        *(number_column(c.name, c.quantity, edge) for c in components),
        *(number_column(f"sigma_{c.name}", c.quantity, edge) for c in components),
        number_column("sigma", components[0].quantity, edge),
    ]


def navigation_groups(
    reading: Reading, entry: Observations, number: int, rows: Rows, place: TableLocation
) -> list[ReadGroup]:
    """One group for each kind of interpolation that the trajectories of an entry have."""
    if entry.covariance is not None or entry.cluster is not None or entry.ppm or entry.centring:
        place.tell(f"{entry.type} takes no covariance, cluster, ppm or centring")
        return []
    if reading.planned:
        measured = [component.name for component in NAVIGATION[entry.type](LINEAR).components]
        rows = planned_rows(rows, measured, reading, group_name(entry, number))
    names = rows.text("trajectory")
    if not known_trajectories(reading, names, rows):
        return []
    shifts = _shifts(reading, entry, rows, place)
    if shifts is None:
        return []
    result = []
    for order in (LINEAR, CUBIC):
        own = np.array([reading.trajectories[name].order == order for name in names])
        if own.any():
            group = _group(reading, entry, number, rows, np.flatnonzero(own), shifts)
            result += [group] if group is not None else []
    return result


def known_trajectories(reading: Reading, names: Sequence[str], rows: Rows) -> bool:
    """False if a row names a trajectory that does not exist; each name is told once."""
    unknown = [name for name in dict.fromkeys(names) if name and name not in reading.trajectories]
    if "trajectory" not in reading.broken:
        for name in unknown:
            rows.tell(list(names).index(name), unknown_name("trajectory", name, reading.trajectories))
    return not unknown


def clocks(
    reading: Reading, names: Sequence[str], times: FloatArray, rows: Rows, later: FloatArray | None = None
) -> tuple[Clock, IntArray, IntArray] | None:
    """Clock of every row (n,) of trajectories of one kind, and the position and rotation blocks (n, k) of its knots.

    ``None`` if a row is outside its trajectory; each such row is told. So much ``later`` (n,) rows are read out.
    """
    order = reading.trajectories[names[0]].order
    n = len(names)
    whole = Clock(np.zeros((n, order), np.int64), np.zeros((n, 1 + order * order)), np.zeros(n, dtype=bool))
    positions, rotations = np.zeros((n, order), dtype=np.int64), np.zeros((n, order), dtype=np.int64)
    named = np.array(names, dtype=object)
    for name in dict.fromkeys(names):
        mine = np.flatnonzero(named == name)
        trajectory = reading.trajectories[name]
        found = trajectory.clock(times[mine], None if later is None else later[mine])
        for part, own in zip(whole, found, strict=True):
            part[mine] = own
        positions[mine], rotations[mine] = (trajectory.positions[found.knots], trajectory.rotations[found.knots])
    rows.tell_where(~whole.inside, lambda row: reading.trajectories[names[row]].outside(float(times[row])))
    return (whole, positions, rotations) if whole.inside.all() else None


def _group(
    reading: Reading,
    entry: Observations,
    number: int,
    rows: Rows,
    chosen: IntArray,
    shifts: tuple[IntArray, FloatArray],
) -> ReadGroup | None:
    own = rows.take(chosen)
    names, times = own.text("trajectory"), own.number("time")
    found = clocks(reading, names, times, own)
    if found is None:
        return None
    clock, positions, rotations = found
    type_ = NAVIGATION[entry.type](clock.knots.shape[1])
    shift, middle = shifts[0][chosen], shifts[1][chosen]
    common = own.number("sigma")
    observed = np.stack([own.number(c.name) for c in type_.components], axis=1)
    sigma = np.stack([own_or_common(own.number(f"sigma_{c.name}"), common) for c in type_.components], axis=1)
    own.tell_where(np.asarray(~np.isfinite(observed).any(axis=1)), "nothing is observed in this row")
    count = len(chosen)
    arm, _, offset = type_.slots[-3:]
    things, shop = reading.shop.things["instrument"], reading.shop
    blocks = []
    for slot in (arm, offset):
        block = things.part(entry.instrument, slot.part) if entry.instrument else -1
        neutral = 0 if slot.kind == "eccentricity" else -1
        block = neutral if block < 0 else block
        blocks.append(np.full(count, shop.neutral(slot.kind) if block < 0 else block, dtype=np.int64))
    group = ObservationGroup(
        name=group_name(entry, number),
        type=type_,
        blocks=(*positions.T, *rotations.T, blocks[0], shift, blocks[1]),
        observed=observed,
        sigma=sigma * entry.factor,
        constants=np.concatenate([(times - middle)[:, None], clock.constants], axis=1),
        references=(names_of([knot_name(name, time) for name, time in zip(names, times, strict=True)]),),
        external=external(type_, reading.edge),
        lines=own.lines,
        file=own.file,
    )
    if not sigma_is_good(group, own, np.arange(len(chosen))):
        return None
    size = len(type_.components)
    return ReadGroup(group, number, chosen, np.eye(size), np.ones(size))


def _shifts(
    reading: Reading, entry: Observations, rows: Rows, place: TableLocation
) -> tuple[IntArray, FloatArray] | None:
    """Block of shift and drift of every row, and the time they refer to; ``None`` if the instrument is unknown."""
    shifts = {POSITION: (POSITION_SHIFT, "position"), ATTITUDE: (ATTITUDE_SHIFT, "attitude")}
    kind, key = shifts[entry.type]
    known = reading.project.instruments
    if entry.instrument is not None and entry.instrument not in known:
        place.tell(unknown_name("instrument", entry.instrument, known), "instrument")
        return None
    named = zip(rows.text("strip"), rows.text("trajectory"), strict=True)
    strips, times = coded(pl.Series([own or name for own, name in named])).names(), rows.number("time")
    given = getattr(known[entry.instrument], key) if entry.instrument else {}
    blocks, middles = np.zeros(rows.count, dtype=np.int64), np.zeros(rows.count)
    for k, strip in enumerate(strips.known):
        mine = np.flatnonzero(strips.numbers == k)
        middle = 0.5 * float(times[mine].min() + times[mine].max())
        if not given:
            block = reading.shop.neutral(kind.key)
        else:
            assert entry.instrument is not None
            block, middle = _strip(reading, entry.instrument, strip, kind, key, middle)
        blocks[mine], middles[mine] = block, middle
    return blocks, middles


def _strip(
    reading: Reading, instrument: str, strip: str, kind: BlockKind, key: str, middle: float
) -> tuple[int, float]:
    """Block of shift and drift of a strip, and the time it refers to: the middle of the table that names it first."""
    name = f"{instrument} strip {strip}"
    known = reading.strips
    if (kind.key, name) not in known:
        place = reading.at("instruments", instrument, key)
        given = getattr(reading.project.instruments[instrument], key)
        if any(other.startswith(f"{instrument} strip ") for _, other in known):
            place = replace(place, problems=[])  # what is wrong with it is told once
        row = settings(given, kind.components, reading.edge, place)
        reading.shop.begin(f"instrument {instrument}")
        known[kind.key, name] = (int(reading.shop.store(kind.key).add([name], *row)[0]), middle)
    return known[kind.key, name]


# ---- Constancy and smoothness of trajectories: differences of neighbouring knots, observed as 0.


def steadiness_groups(reading: Reading) -> list[ObservationGroup]:
    """One group for every table of trajectories and kind of difference that has a σ."""
    groups = []
    for number, table in enumerate(reading.project.trajectories):
        own = {name.rpartition("@")[0] for name in reading.table_ids.get(("trajectories", number), [])}
        trajectories = [reading.trajectories[name] for name in reading.trajectories if name in own]
        for (key, part), type_ in STEADINESS.items():
            text = getattr(getattr(table, key), part)
            if text is None:
                continue
            place = reading.at("trajectories", number, key)
            try:
                sigma = reading.edge.number(text, type_.components[0].quantity)
                if sigma <= 0.0:
                    raise UnitError(f"found {text}, expected a σ above 0")
            except UnitError as error:
                place.tell(f"{key}: {part}: {error}", part)
                continue
            name = f"{key} of {part}, {table_label('trajectories', number, table)}"
            group = _group_of_steadiness(reading, type_, name, trajectories, sigma)
            groups += [group] if group is not None else []
    return groups


def _group_of_steadiness(
    reading: Reading, type_: ObservationType, name: str, trajectories: list[Trajectory], sigma: float
) -> ObservationGroup | None:
    """Differences of all neighbours of these trajectories; ``None`` if no stretch has enough knots."""
    count = len(type_.slots)
    rotations = type_.slots[0].kind == "rotation"
    blocks: list[IntArray] = []
    intervals: list[FloatArray] = []
    labels: list[str] = []
    for trajectory in trajectories:
        numbers = np.arange(len(trajectory.times) - count + 1)[:, None] + np.arange(count)
        numbers = numbers[trajectory.stretch[numbers[:, 0]] == trajectory.stretch[numbers[:, -1]]]
        blocks.append((trajectory.rotations if rotations else trajectory.positions)[numbers])
        intervals.append(np.diff(trajectory.times[numbers], axis=1))
        labels += [knot_name(trajectory.name, time) for time in trajectory.times[numbers[:, (count - 1) // 2]]]
    if not labels:
        return None
    whole = np.concatenate(blocks)
    size = (len(labels), len(type_.components))
    return ObservationGroup(
        name=name,
        type=type_,
        blocks=tuple(whole.T),
        observed=np.zeros(size),
        sigma=np.full(size, sigma),
        constants=np.concatenate(intervals),
        references=(names_of(labels),),
        external=external(type_, reading.edge),
    )


# ---- Images on a trajectory: frames at a time, and lines of scanners at the times of their rows.

TRAJECTORY = "trajectory"
"""Part of an image: the number of its trajectory, −1 where it has none."""


def trajectory_columns(reading: Reading) -> list[Column]:
    """Columns that put an image on a trajectory."""
    return [Column("trajectory"), number_column("time", TIME, reading.edge)]


def put_on_trajectories(reading: Reading, rows: Rows, names: list[str], free: Collection[str]) -> IntArray:
    """Number of the trajectory of every image (n,), −1 where it has none; its time goes to ``reading``.

    ``free`` are the constants of a set-up that the table frees.
    """
    named = rows.text("trajectory")
    result = np.full(len(names), -1, dtype=np.int64)
    scans = np.array([camera in reading.scanners for camera in rows.text("camera")], dtype=bool)
    on = np.array([bool(name) for name in named], dtype=bool)
    words = "image {0!r} is of a line scanner: it needs a trajectory (column trajectory)"
    rows.tell_where(scans & ~on, lambda row: words.format(names[row]))
    times = _times(reading, rows, names, scans)
    lost = ~on & np.isfinite(rows.number("time"))
    rows.tell_where(lost, lambda row: f"image {names[row]!r} has a time, but no trajectory")
    if not on.any() or not known_trajectories(reading, named, rows) or "trajectory" in reading.broken:
        return result
    timeless = on & np.isnan(times)
    needs = "image {0!r} is on a trajectory, but has no time (column time)"
    rows.tell_where(timeless, lambda row: needs.format(names[row]))
    _refuse_others(rows, names, on, free)
    ids = list(reading.trajectories)
    for i in np.flatnonzero(on & ~timeless).tolist():
        trajectory = reading.trajectories[named[i]]
        if not trajectory.clock(times[i : i + 1]).inside[0]:
            rows.tell(i, f"image {names[i]!r}: {trajectory.outside(float(times[i]))}")
        result[i] = ids.index(named[i])
        reading.image_times[names[i]] = float(times[i])
    return result


def _times(reading: Reading, rows: Rows, names: list[str], scans: BoolArray) -> FloatArray:
    """Times (n,) of images, those of line scanners of their first lines; how these go on goes to ``reading``."""
    times, cameras = rows.number("time").copy(), rows.text("camera")
    # Rows that say a steady rate, so far apart that times of a day, or of a week, leave it all its digits.
    far = np.array([0.0, 1e6])
    for i, name in enumerate(names):
        if not scans[i]:
            if name in reading.lines:
                rows.tell(i, f"image {name!r} has times of its lines, but its camera has neither line_time nor line")
            continue
        if name in reading.lines:
            if np.isfinite(times[i]):
                rows.tell(i, f"image {name!r} has a time, and a table of the times of its lines; expected one of them")
            times[i] = reading.lines[name].times[0]
            continue
        step = reading.scanners[cameras[i]].line_time
        if np.isnan(step) and "camera" not in reading.broken:
            words = f"image {name!r}: its camera has no line_time, and there is no table of the times of its lines"
            rows.tell(i, words)
        reading.lines[name] = RowTimes(far, times[i] + step * far, True)
    return times


def _refuse_others(rows: Rows, names: list[str], on: BoolArray, free: Collection[str]) -> None:
    """Tell images on a trajectory that have a pose or a motion besides, or follow another one."""
    follows = [bool(a or b) for a, b in zip(rows.text("leader"), rows.text("pair"), strict=True)]
    kinds = (IMAGE_VELOCITY, ROTATION_RATE)
    motion = _given(rows, kinds, [shared_column(kind) for kind in kinds])
    motion |= any(name in free for kind in kinds for name in kind.names)
    why = {
        "it has no position or attitude of its own": _given(rows, (POINT, ROTATION), ["position"]),
        "its velocity and rate of rotation are those of the trajectory": motion,
        "it follows no other image": np.array(follows),
    }
    for words, wrong in why.items():
        told = [f"image {name!r} is on a trajectory: {words}" for name in names]
        rows.tell_where(on & wrong, told.__getitem__)


def _given(rows: Rows, kinds: tuple[BlockKind, ...], named: list[str]) -> BoolArray:
    numbers = [f"{of}{c}" for kind in kinds for of in ("", "sigma_", "start_") for c in kind.names]
    given = np.any([np.isfinite(rows.number(name)) for name in numbers], axis=0)
    for name in named:
        given |= np.array([bool(text) for text in rows.text(name)])
    return np.asarray(given)


def pose_blocks(reading: Reading, labels: list[str]) -> tuple[IntArray, IntArray]:
    """Blocks of the poses that images on a trajectory have at their times: no unknowns, filled in later."""
    nothing = np.full((len(labels), 3), np.nan)
    held = np.zeros((len(labels), 3), dtype=bool)
    store = reading.shop.store
    return tuple(store(kind.key).add(labels, nothing, held, nothing) for kind in (POINT, ROTATION))  # type: ignore[return-value]


class RowClocks(NamedTuple):
    """Places of rows of image coordinates on their trajectories."""

    knots: tuple[IntArray, ...]
    """Position, then rotation blocks (n,) of the knots."""
    constants: FloatArray
    """(n, q) of their clocks; of line scanners before them the observed y and seconds by y."""


def clocks_of_rows(
    reading: Reading, rows: Rows, image: Names, y: FloatArray, scanner: ImageScale | None, later: FloatArray | None
) -> RowClocks | None:
    """Clocks of rows (n,) that name images on trajectories of one kind; ``None`` if one is outside, which is told.

    ``y`` (n,) are the observed ones inside; a ``scanner`` has a time for each row. So much ``later`` (n,) than the
    middle of their images rows of a rolling shutter are read out.
    """
    if not reading.broken.isdisjoint(("camera", "trajectory", "image")):
        return None  # their times are wrong, or missing, and that is told already
    images = reading.shop.things["image"]
    ids = list(reading.trajectories)
    names = [ids[k] for k in images.parts[TRAJECTORY][image.numbers].tolist()]
    if scanner is None:
        times = np.array([reading.image_times.get(name, np.nan) for name in image.known])[image.numbers]
        found = clocks(reading, names, times, rows, later)
        own = np.zeros((len(times), 0))
    else:
        times, rate, timed = _scanned(reading, image, scanner, y)
        words = "no line of the image has a time there: row {0:.6g}"
        rows.tell_where(~timed, lambda row: words.format(_rows_of(scanner, y)[row]))
        found = clocks(reading, names, times, rows) if timed.all() else None
        own = np.stack([y, rate], axis=1)
    if found is None:
        return None
    clock, positions, rotations = found
    return RowClocks((*positions.T, *rotations.T), np.concatenate([own, clock.constants], axis=1))


def _rows_of(scale: ImageScale, y: FloatArray) -> FloatArray:
    return np.asarray(scale.centre[1] - y / scale.pixel)


def _scanned(
    reading: Reading, image: Names, scale: ImageScale, y: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Time of every row (n,), seconds by y, and false where its line has no time."""
    times, rate, timed = np.zeros(len(y)), np.ones(len(y)), np.zeros(len(y), dtype=bool)
    rows = _rows_of(scale, y)
    for number in np.unique(image.numbers).tolist():
        mine = np.flatnonzero(image.numbers == number)
        lines = reading.lines[image.known[number]]
        if reading.planned and not lines.steady:
            rows[mine] = np.clip(rows[mine], lines.rows[0], lines.rows[-1])  # which row it is, its place will say
        times[mine], rate[mine], timed[mine] = row_times(lines, rows[mine])
    return times, -rate / scale.pixel, timed
