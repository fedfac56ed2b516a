"""Line scanners: where their line is, and at what time each row of an image was scanned."""

from __future__ import annotations

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.errors import Problem
from mor.project.edge import ImageScale, UnitError, split
from mor.project.file.model import Camera
from mor.project.network.entities import unknown_name
from mor.project.network.reading import Reading
from mor.project.tables.columns import tell_rows
from mor.project.tables.statuses import number_column
from mor.project.tables.tables import Column, read_table
from mor.project.trajectories.model import Lines, Scanner
from mor.units import IMAGE, NUMBER, TIME


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
        reading.problems.append(place.problem(f"{key}: {error}", key))
    if not scale.corner:
        words = "a line scanner needs coordinates: corner; its rows count from the first line"
        reading.problems.append(place.problem(words))
    if camera.readout is not None:
        words = "a camera has a readout time or is a line scanner, not both"
        reading.problems.append(place.problem(words, "readout"))
    reading.scanners[name] = Scanner(line_time, line)


def read_line_times(reading: Reading) -> None:
    """Times of lines from the tables of line times, by the image they are of."""
    for number, table in enumerate(reading.project.line_times):
        columns = [
            Column("image", required=True),
            number_column("row", NUMBER, reading.edge, required=True),
            number_column("time", TIME, reading.edge, required=True),
        ]
        rows = read_table(table, columns, reading.at("line_times", number), reading.problems)
        reading.watch(table.file)
        if rows is None:
            reading.broken.add("image")
            continue
        names = rows.names("image")
        for k, name in enumerate(names.known):
            own = rows.take(np.flatnonzero(names.numbers == k))
            lines = Lines(own.number("row"), own.number("time"))
            step = np.minimum(np.diff(lines.rows, prepend=-np.inf), np.diff(lines.times, prepend=-np.inf))
            words = f"image {name!r}: rows and times of its lines must ascend"
            tell_rows(reading.problems, step <= 0.0, own, words)
            said = ""
            if len(lines.rows) < _TWO:
                said = f"image {name!r} has one line with a time, expected two at least"
            elif name in reading.lines:
                said = f"the times of the lines of image {name!r} are given in two tables"
            if said:
                reading.problems.append(Problem(said, own.file, int(own.lines[0])))
            reading.lines[name] = lines


def check_line_times(reading: Reading, images: tuple[str, ...]) -> None:
    """Tell line times of images that do not exist."""
    place = reading.at("line_times")
    for name in reading.lines:
        if name not in images and "image" not in reading.broken:
            reading.problems.append(place.problem(f"line_times: {unknown_name('image', name, images)}"))


def row_times(lines: Lines, rows: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Time (n,) of rows, seconds per row there, and false where no line has a time."""
    place = np.clip(np.searchsorted(lines.rows, rows, side="right") - 1, 0, len(lines.rows) - 2)
    rate = np.diff(lines.times)[place] / np.diff(lines.rows)[place]
    inside = (rows >= lines.rows[0]) & (rows <= lines.rows[-1]) | lines.steady
    return lines.times[place] + rate * (rows - lines.rows[place]), rate, np.asarray(inside)


_TWO = 2
