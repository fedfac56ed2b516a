"""Images on a trajectory: frames at a time, and lines of scanners at the times of their rows."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import Problem
from mor.observations.names import Names
from mor.parameters.kinds import IMAGE_VELOCITY, POINT, ROTATION, ROTATION_RATE, BlockKind
from mor.project.edge import ImageScale
from mor.project.network.reading import Reading
from mor.project.network.set_ups import shared_column
from mor.project.tables.columns import tell_rows
from mor.project.tables.statuses import number_column
from mor.project.tables.tables import Column, Rows
from mor.project.trajectories.model import Lines
from mor.project.trajectories.navigation import clocks, known_trajectories
from mor.project.trajectories.scanners import row_times
from mor.units import TIME

TRAJECTORY = "trajectory"
"""Part of an image: the number of its trajectory, −1 where it has none."""
_FAR = np.array([0.0, 1e6])
"""Rows that say a steady rate, so far apart that times of a day, or of a week, leave it all its digits."""


def trajectory_columns(reading: Reading) -> list[Column]:
    """Columns that put an image on a trajectory."""
    return [Column("trajectory"), number_column("time", TIME, reading.edge)]


def put_on_trajectories(reading: Reading, rows: Rows, names: list[str], free: Collection[str]) -> IntArray:
    """Number of the trajectory of every image (n,), −1 where it has none; its time goes to ``reading``.

    ``free`` are the constants of a set-up that the table frees.
    """
    named, problems = rows.text("trajectory"), reading.problems
    result = np.full(len(names), -1, dtype=np.int64)
    scans = np.array([camera in reading.scanners for camera in rows.text("camera")], dtype=bool)
    on = np.array([bool(name) for name in named], dtype=bool)
    words = "image {0!r} is of a line scanner: it needs a trajectory (column trajectory)"
    tell_rows(problems, scans & ~on, rows, lambda row: words.format(names[row]))
    times = _times(reading, rows, names, scans)
    lost = ~on & np.isfinite(rows.number("time"))
    tell_rows(problems, lost, rows, lambda row: f"image {names[row]!r} has a time, but no trajectory")
    if not on.any() or not known_trajectories(reading, named, rows) or "trajectory" in reading.broken:
        return result
    timeless = on & np.isnan(times)
    needs = "image {0!r} is on a trajectory, but has no time (column time)"
    tell_rows(problems, timeless, rows, lambda row: needs.format(names[row]))
    _refuse_others(reading, rows, names, on, free)
    ids = list(reading.trajectories)
    for i in np.flatnonzero(on & ~timeless).tolist():
        trajectory = reading.trajectories[named[i]]
        if not trajectory.clock(times[i : i + 1]).inside[0]:
            words = f"image {names[i]!r}: {trajectory.outside(float(times[i]))}"
            problems.append(Problem(words, rows.file, int(rows.lines[i])))
        result[i] = ids.index(named[i])
        reading.image_times[names[i]] = float(times[i])
    return result


def _times(reading: Reading, rows: Rows, names: list[str], scans: BoolArray) -> FloatArray:
    """Times (n,) of images, those of line scanners of their first lines; how these go on goes to ``reading``."""
    times, cameras = rows.number("time").copy(), rows.text("camera")
    for i, name in enumerate(names):
        if not scans[i]:
            if name in reading.lines:
                words = (
                    f"image {name!r} has times of its lines, but its camera has neither line_time nor line"
                )
                reading.problems.append(Problem(words, rows.file, int(rows.lines[i])))
            continue
        if name in reading.lines:
            if np.isfinite(times[i]):
                words = (
                    f"image {name!r} has a time, and a table of the times of its lines; expected one of them"
                )
                reading.problems.append(Problem(words, rows.file, int(rows.lines[i])))
            times[i] = reading.lines[name].times[0]
            continue
        step = reading.scanners[cameras[i]].line_time
        if np.isnan(step) and "camera" not in reading.broken:
            words = f"image {name!r}: its camera has no line_time, and there is no table of the times of its lines"
            reading.problems.append(Problem(words, rows.file, int(rows.lines[i])))
        reading.lines[name] = Lines(_FAR, times[i] + step * _FAR, True)
    return times


def _refuse_others(
    reading: Reading, rows: Rows, names: list[str], on: BoolArray, free: Collection[str]
) -> None:
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
        tell_rows(
            reading.problems,
            on & wrong,
            rows,
            lambda row, said=words: f"image {names[row]!r} is on a trajectory: {said}",  # type: ignore[misc]
        )


def _given(rows: Rows, kinds: tuple[BlockKind, ...], named: list[str]) -> BoolArray:
    """(n,) true where a row says something of these kinds, or names one."""
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
    """Where rows of image coordinates are on their trajectories."""

    knots: tuple[IntArray, ...]
    """Position, then rotation blocks (n,) of the knots."""
    constants: FloatArray
    """(n, q) of their clocks; of line scanners before them the observed y and seconds by y."""


def clocks_of_rows(
    reading: Reading,
    rows: Rows,
    image: Names,
    y: FloatArray,
    scanner: ImageScale | None,
    later: FloatArray | None,
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
        tell_rows(reading.problems, ~timed, rows, lambda row: words.format(_rows_of(scanner, y)[row]))
        found = clocks(reading, names, times, rows) if timed.all() else None
        own = np.stack([y, rate], axis=1)
    if found is None:
        return None
    clock, positions, rotations = found
    return RowClocks((*positions.T, *rotations.T), np.concatenate([own, clock.constants], axis=1))


def _rows_of(scale: ImageScale, y: FloatArray) -> FloatArray:
    """Rows from the upper edge of the image, of y inside."""
    rows: FloatArray = scale.centre[1] - y / scale.pixel
    return rows


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
            rows[mine] = np.clip(
                rows[mine], lines.rows[0], lines.rows[-1]
            )  # which row it is, its place will say
        times[mine], rate[mine], timed[mine] = row_times(lines, rows[mine])
    return times, -rate / scale.pixel, timed
