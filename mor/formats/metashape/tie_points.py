"""Tie points of Metashape's projects: PLY files of points, and of projections, one for each camera.

Source: DBAT, which reads them of ``.psz``, and programs that read and write those of ``.psx``: ``doc.xml`` names the
files in ``<points>`` and ``<projections camera_id>``; points have ``x y z id`` in the system of the chunk, projections
``x y id`` in pixels, further properties (colours, sizes of key points) among them.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.arrays import FloatArray, IntArray
from mor.counting import counted
from mor.errors import InputError, Problem
from mor.formats.draft import Draft, usable
from mor.formats.xml import Element
from mor.input_files import TABLE, check_size

ARCHIVE = "archive"
"""Attribute of a point cloud: the archive its files are in."""
UNREADABLE = (
    zipfile.BadZipFile,
    zlib.error,
    NotImplementedError,
    RuntimeError,
    EOFError,
    OSError,
    ValueError,
)
"""What a damaged archive raises."""
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
"""Types of properties as numpy calls them."""
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
_BEGINNINGS = ("tie", "tie_point_", "tie_point_of_metashape_")
"""What names of tie points begin with: the first that no marker begins with."""
_HEAD = 1 << 14
"""Bytes that the head of a PLY file may have."""


class Projections(NamedTuple):
    """Projections of a camera: numbers of its points (n,), pixels (n, 2)."""

    camera: str
    points: IntArray
    xy: FloatArray


class TiePoints(NamedTuple):
    """Points: numbers (n,), chunk coordinates (n, 3); projections by camera."""

    numbers: IntArray
    xyz: FloatArray
    projections: list[Projections]


def read_tie_points(cloud: Element, path: Path) -> TiePoints:
    """The tie points that a point cloud names. Raises :class:`InputError`."""
    archive = Path(cloud.attributes.get(ARCHIVE, str(path)))
    try:
        with zipfile.ZipFile(archive) as files:
            named = [*cloud.all("points"), *cloud.all("projections")]
            check_size(sum(_size(files, one, archive) for one in named), archive, TABLE)
            points = [_vertices(files, one, archive, "xyz") for one in cloud.all("points")]
            seen = [
                (one.attributes.get("camera_id", ""), _vertices(files, one, archive, "xy"))
                for one in cloud.all("projections")
            ]
    except UNREADABLE as error:
        raise InputError([Problem(f"this archive cannot be read: {error}", str(archive))]) from None
    numbers = np.concatenate([np.zeros(0, dtype=np.int64), *(_column(one, "id") for one in points)])
    xyz = np.concatenate([np.zeros((0, 3)), *(_coordinates(one, "xyz") for one in points)])
    projections = [Projections(camera, _column(one, "id"), _coordinates(one, "xy")) for camera, one in seen]
    numbers_, first = np.unique(numbers, return_index=True)
    if not usable(xyz) or not all(usable(one.xy) for one in projections):
        raise InputError([Problem("a coordinate of a tie point is no number up to 1e30", str(archive))])
    return TiePoints(numbers_, xyz[first], projections)


def _size(files: zipfile.ZipFile, named: Element, archive: Path) -> int:
    """Bytes of a file that an element names. Raises :class:`InputError` if it is not there."""
    name = named.attributes.get("path", "")
    try:
        return files.getinfo(name).file_size
    except KeyError:
        words = f"found no file {name!r} in this archive, which <{named.name}> names"
        raise InputError([Problem(words, str(archive))]) from None


def _vertices(files: zipfile.ZipFile, named: Element, archive: Path, axes: str) -> np.ndarray:
    """The vertices of a PLY file, whose properties are columns, coordinates and id among them."""
    name = named.attributes.get("path", "")
    try:
        return _ply(files.read(name), (*axes, "id"))
    except ValueError as error:
        raise InputError([Problem(f"{name}: {error}", str(archive))]) from None


def _ply(content: bytes, needed: tuple[str, ...]) -> np.ndarray:
    """Vertices of a binary PLY file. Raises ``ValueError``."""
    end = re.search(rb"\nend_header\r?\n", content[:_HEAD])
    if not content.startswith(b"ply") or end is None:
        raise ValueError("found no head of a PLY file")
    lines = [line.split() for line in content[: end.start()].decode("ascii", "replace").splitlines()]
    said = next((words[1] for words in lines if words[:1] == ["format"] and len(words) > 1), "")
    if said not in _ORDERS:
        raise ValueError(f"found the format {said!r}, expected {' or '.join(_ORDERS)}")
    elements = [words for words in lines if words[:1] == ["element"]]
    properties = [words[1:] for words in lines if words[:1] == ["property"]]
    if (
        len(elements) != 1
        or len(elements[0]) != 3
        or elements[0][1] != "vertex"
        or not elements[0][2].isdecimal()
    ):
        raise ValueError("expected vertices and nothing else")
    if not properties or not all(len(words) == 2 and words[0] in _TYPES for words in properties):
        raise ValueError("found a property that is no plain number")
    names = [words[1] for words in properties]
    if len(set(names)) < len(names):
        raise ValueError("found a property twice")
    form = np.dtype([(name, _ORDERS[said] + _TYPES[type_]) for type_, name in properties])
    count = int(elements[0][2])
    if count * form.itemsize != len(content) - end.end():
        raise ValueError(
            f"found {len(content) - end.end()} bytes of vertices, expected {count} · {form.itemsize}"
        )
    missing = [name for name in needed if name not in names]
    if missing:
        raise ValueError(f"found no property {missing[0]}")
    return np.frombuffer(content, form, count, end.end())


def _column(vertices: np.ndarray, name: str) -> IntArray:
    """Whole numbers of a property; what is no whole number belongs to nothing (−1)."""
    values = vertices[name]
    if values.dtype.kind == "f":
        values = np.where(np.isfinite(values) & (np.abs(values) < 1e15), values, -1)
    return np.asarray(values.astype(np.int64))


def _coordinates(vertices: np.ndarray, names: str) -> FloatArray:
    """Coordinates (n, size); what is no number is told later."""
    with np.errstate(invalid="ignore"):
        return np.stack([vertices[name].astype(float) for name in names], axis=1)


def put_tie_points(
    draft: Draft,
    tie: TiePoints,
    images: dict[str, str],
    markers: Collection[str],
    xyz: FloatArray | None,
    sigma: str,
) -> None:
    """Points that are seen in two images or more, and their projections, as tables.

    ``images``: names by camera; ``xyz``: start values in the system of the poses, where those are read.
    """
    seen = [one for one in tie.projections if one.camera in images]
    names = pl.Series([images[one.camera] for one in seen], dtype=pl.String)
    owner = np.repeat(np.arange(len(seen)), [len(one.points) for one in seen])
    points = np.concatenate([np.zeros(0, dtype=np.int64), *(one.points for one in seen)])
    xy = np.concatenate([np.zeros((0, 2)), *(one.xy for one in seen)])
    place = np.searchsorted(tie.numbers, points).clip(0, max(len(tie.numbers) - 1, 0))
    known = tie.numbers[place] == points if len(tie.numbers) else np.zeros(len(points), dtype=bool)
    pairs = np.unique(np.stack([place[known], owner[known]], axis=1), axis=0)
    enough = np.bincount(pairs[:, 0], minlength=len(tie.numbers)) >= 2
    kept = known & (enough[place] if len(enough) else known)
    if len(points) > int(kept.sum()):
        count = counted(len(points) - int(kept.sum()), "projection")
        draft.note(f"{count} of tie points without coordinates, or in one image only: not read")
    if not kept.any():
        return
    begin = next(word for word in _BEGINNINGS if not any(name.startswith(word) for name in markers))
    ids = pl.Series(tie.numbers).cast(pl.String)
    table = {"id": (begin + ids).filter(pl.Series(enough))}
    if xyz is not None:
        table |= {axis: pl.Series(xyz[enough, k]) for k, axis in enumerate("xyz")}
    draft.frame("points", "tie points", pl.DataFrame(table))
    rays = {"image": names.gather(owner[kept]), "point": begin + ids.gather(place[kept])}
    rays |= {"x": pl.Series(xy[kept, 0]), "y": pl.Series(xy[kept, 1])}
    draft.frame(
        "observations",
        "projections of tie points",
        pl.DataFrame(rays),
        type="image",
        units="px",
        values={"sigma": sigma},
    )
    draft.note(f"{counted(int(enough.sum()), 'tie point')}, σ = {sigma} px for their projections")
