"""What a table of measurements is, by the names of its columns: for beginning a project from what there is."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from mor.errors import InputError, Problem
from mor.input_files import TABLE, read_text
from mor.project.tables.guarded import plain
from mor.units import ANGLE_UNITS, LENGTH_UNITS, PIXEL

KINDS: Mapping[str, tuple[str, ...]] = {
    "image": ("image", "point", "x", "y"),
    "zenith_directions": ("station", "to", "horizontal", "zenith"),
    "directions": ("station", "to", "horizontal"),
    "angle": ("at", "from", "to", "angle"),
    "distance": ("from", "to", "distance"),
    "bearing": ("from", "to", "bearing"),
    "zenith_angle": ("from", "to", "zenith_angle"),
    "vertical_direction": ("from", "to", "vertical_direction"),
    "vector": ("from", "to", "dx", "dy", "dz"),
    "height_difference": ("from", "to", "dz"),
    "images": ("id", "omega", "phi", "kappa"),
    "images with a camera": ("id", "camera"),
    "stations": ("id", "orientation"),
    "stations over points": ("id", "point", "height"),
    "points": ("id", "x", "y", "z"),
}
"""Columns that tell what a table is, the first that fits."""
_OTHER_NAMES = {
    **dict.fromkeys(("photo", "image_id", "img", "bild"), "image"),
    **dict.fromkeys(("point_id", "punkt", "pt", "target", "name", "number", "nr"), "point"),
    **dict.fromkeys(("length", "dist", "strecke"), "distance"),
    **dict.fromkeys(("hz", "direction", "richtung"), "horizontal"),
    **dict.fromkeys(("v", "zd"), "zenith"),
    **dict.fromkeys(("point_a", "start", "von"), "from"),
    **dict.fromkeys(("point_b", "end", "nach"), "to"),
    **dict.fromkeys(("dh", "height_difference"), "dz"),
    **{f"s{name}": f"sigma_{name}" for name in ("x", "y", "z")},
    **dict.fromkeys(("std", "stdev", "sigma_distance"), "sigma"),
    "x0": "x",
    "y0": "y",
    "z0": "z",
}
_KNOWN = {name for names in KINDS.values() for name in names} | {
    "sigma",
    "height",
    "from_height",
    "station_height",
    "to_height",
    "set",
    "face",
}
_UNITS = {**LENGTH_UNITS, **ANGLE_UNITS, PIXEL: 1.0}
PLACES = ("point", "at", "from", "to", "station")
"""Columns of measurements that name points."""
_LONGEST_HEADING = 200
_NUMBER = re.compile(r"^[-+]?[\d.]")


class Found(NamedTuple):
    """A table that was recognised."""

    path: Path
    kind: str
    columns: Mapping[str, str]
    """Its columns by their names in a project; those that mean nothing here are missing."""
    units: Mapping[str, str]
    """Units that the names of columns say."""
    delimiter: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def texts(self, name: str) -> list[str]:
        """Cells of a column, empty where it is missing."""
        if name not in self.columns:
            return []
        place = self.header.index(self.columns[name])
        return [plain(row[place].strip()) for row in self.rows if len(row) > place]

    @property
    def has_sigma(self) -> bool:
        """True where the table has σ."""
        return any(name.startswith("sigma") for name in self.columns)


def recognise(path: Path) -> Found:
    """Read a table and say what it is. Raises :class:`InputError` where that cannot be told."""
    lines = read_text(path, TABLE).split("\n")
    first = lines[0] if lines else ""
    delimiter = max(",;\t", key=first.count)
    try:
        rows = tuple(tuple(row) for row in csv.reader(lines, delimiter=delimiter) if row)
    except csv.Error as error:
        words = f"this is no table: {error}; is a quote not closed?"
        raise InputError([Problem(words, str(path))]) from None
    header = tuple(cell.strip() for cell in rows[0]) if rows else ()
    if not header or any(_NUMBER.match(cell) for cell in header):
        words = "expected a header with the names of the columns in the first line"
        raise InputError([Problem(words, str(path), 1)])
    columns, units = _named(header)
    kind = next((kind for kind, wanted in KINDS.items() if set(wanted) <= set(columns)), None)
    if kind is None:
        raise InputError(
            [Problem(f"what is this? found the columns {', '.join(header)}; {_wanted()}", str(path), 1)]
        )
    if kind == "points" and _means(columns["id"]) == "image":
        kind = "images"
    return Found(path, kind.split(" ")[0], columns, units, delimiter, header, rows[1:])


def told_apart(tables: Sequence[Found]) -> list[Found]:
    """The tables again, where lists of points that are images of the other tables are lists of images.

    A list ``id, x, y, z`` may hold points, or projection centres by GNSS: the measurements tell which of them. Raises
    :class:`InputError` for a list with both.
    """
    images = {name for table in tables if table.kind == "image" for name in table.texts("image")}
    points = {name for table in tables for place in PLACES for name in table.texts(place)}
    return [
        _told_apart(table, images - points, points) if table.kind == "points" else table for table in tables
    ]


def _told_apart(table: Found, images: set[str], points: set[str]) -> Found:
    ids = table.texts("id")
    of_images, of_points = ([name for name in ids if name in known] for known in (images, points))
    if of_images and of_points:
        words = (
            f"image {of_images[0]!r} and point {of_points[0]!r} stand in one list; make two tables of it, "
            "positions of images and points"
        )
        raise InputError([Problem(words, str(table.path))])
    return table._replace(kind="images") if of_images else table


def _named(header: tuple[str, ...]) -> tuple[dict[str, str], dict[str, str]]:
    """Columns by the names of the project, with the units their names carry (``x_mm``, ``x [mm]``)."""
    columns: dict[str, str] = {}
    units: dict[str, str] = {}
    meant = {_means(cell) for cell in header}
    is_list = {"x", "y", "z"} <= meant and not {"image", "point"} <= meant
    for cell in header:
        name, unit = _means(cell), _plain(cell)[1]
        if name in ("point", "image") and (is_list or _has_angles(header)):
            name = "id"
        if (name in _KNOWN or name.startswith("sigma_")) and name not in columns:
            columns[name] = cell
            if unit:
                units[name] = unit
    return columns, units


def _has_angles(header: tuple[str, ...]) -> bool:
    return {"omega", "phi", "kappa"} <= {_plain(cell)[0] for cell in header}


def _means(cell: str) -> str:
    """Name of a column as a project has it."""
    name = _plain(cell)[0]
    return _OTHER_NAMES.get(name, name)


def _plain(cell: str) -> tuple[str, str]:
    """Name and unit of a column heading."""
    if len(cell) > _LONGEST_HEADING:
        return cell.strip().lower(), ""
    match = re.match(r"^(.*?)[\s_]*(?:\[([^\]]*)\]|\(([^)]*)\)|_([A-Za-zµ]+))$", cell.strip())
    if match:
        unit = next(group for group in match.groups()[1:] if group is not None)
        if unit in _UNITS:
            return match[1].strip().lower(), unit
    return cell.strip().lower(), ""


def _wanted() -> str:
    return "known are " + "; ".join(
        f"{kind}: {', '.join(names)}" for kind, names in KINDS.items() if kind != "images with a camera"
    )
