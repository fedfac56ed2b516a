"""Draw a project: points with their σ if results exist, images, lines of sight."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.arrays import FloatArray, IntArray
from mor.counting import counted
from mor.errors import InputError, Problem
from mor.formats.content import Content, content_of, images, points
from mor.input_files import note_input
from mor.project.file.nodes import Document
from mor.project.network.build import build_network
from mor.project.tables.sources import from_file, from_rows

_LINES = {
    "distance": ("from", "to"),
    "horizontal_distance": ("from", "to"),
    "height_difference": ("from", "to"),
    "vector": ("from", "to"),
    "bearing": ("from", "to"),
    "azimuth": ("from", "to"),
    "astronomic_azimuth": ("from", "to"),
    "gnss_vector": ("from", "to"),
    "ellipsoid_arc": ("from", "to"),
    "ellipsoid_chord": ("from", "to"),
    "mean_sea_level_distance": ("from", "to"),
    "zenith_angle": ("from", "to"),
    "vertical_direction": ("from", "to"),
}
"""Observations between two points, which a drawing shows as lines."""


class Drawing(NamedTuple):
    """Everything in metres, in the axes of the project or in its reference system; σ NaN if there is none."""

    title: str
    ids: list[str]
    xyz: FloatArray
    """(n, 3)."""
    sigma: FloatArray
    """(n, 3)."""
    ellipses: FloatArray
    """(n, 3) semi-axes a, b and the bearing (rad, counterclockwise from +x) of a; NaN if there is none."""
    images: list[str]
    centres: FloatArray
    """(m, 3)."""
    lines: list[tuple[str, str]]
    axes: str
    """Compass directions of x and y."""
    crs: str = ""
    """Name (URN) of the reference system on the earth that they are in, where it has one."""
    degrees: bool = False
    """True if x and y are longitude and latitude in degrees."""
    notes: tuple[Problem, ...] = ()
    """What was left out, and how much."""


def drawing(document: Document, folder: Path) -> Drawing:
    """The drawing of a project; of an adjusted one (``adjusted.yaml``) with the σ of the results beside it.

    Raises :class:`InputError` if no point has coordinates.
    """
    content = content_of(document, folder)
    if content.project.world is not None:
        return _on_earth(content)
    found, photos = points(content), images(content)
    metres = content.edge.metres
    placed = np.flatnonzero(np.isfinite(found.values[:, :2]).all(axis=1))
    if not len(placed):
        words = "no point has coordinates; convert an adjusted project (results/adjusted.yaml)"
        raise InputError([Problem(words, document.file)])
    ids = [found.ids[k] for k in placed.tolist()]
    xyz = np.nan_to_num(found.values[placed]) * metres
    sigma, ellipses = _precision(folder / "points.csv", ids, metres)
    oriented = np.flatnonzero(np.isfinite(photos.values[:, :3]).all(axis=1))
    return Drawing(
        content.project.title,
        ids,
        xyz,
        sigma,
        ellipses,
        [photos.ids[k] for k in oriented.tolist()],
        photos.values[oriented, :3] * metres,
        _lines(content, set(ids)),
        content.project.axes.xy,
        notes=_left_out(content, found.values, placed),
    )


def _left_out(content: Content, values: FloatArray, placed: IntArray) -> tuple[Problem, ...]:
    """Notes on points without coordinates, and without a height in a network that has heights."""
    file, notes = content.document.file, []
    missing = len(values) - len(placed)
    flat = int(np.count_nonzero(~np.isfinite(values[placed, 2]))) if len(placed) else 0
    if missing:
        notes.append(Problem(f"{counted(missing, 'point')} without coordinates: left out", file))
    if flat and "z" in content.project.settings.dimensions:
        notes.append(Problem(f"{counted(flat, 'point')} without a height: drawn at height 0", file))
    return tuple(notes)


def drawing_in_metres(document: Document, folder: Path) -> Drawing:
    """The drawing of a project that is not in latitude and longitude. Raises :class:`InputError`."""
    shown = drawing(document, folder)
    if shown.degrees:
        words = "latitude and longitude cannot be drawn in metres; geojson has them"
        raise InputError([Problem(words, document.file)])
    return shown


def _on_earth(content: Content) -> Drawing:
    """Points in their reference system; places of images are not known before an adjustment."""
    network = build_network(content.project, content.document, content.folder)
    world, numbers = network.world, network.things["point"].parts["position"]
    assert world is not None
    positions = network.start["point"][numbers]
    placed = np.flatnonzero(np.isfinite(positions).all(axis=1))
    ids = [network.things["point"].ids[k] for k in placed.tolist()]
    N = world.geoid_at(numbers, positions)[placed]
    xyz = world.from_object(positions[placed], N)
    degrees = world.system.kind == "geographic"
    per_unit = [np.degrees(1.0), np.degrees(1.0), world.metres] if degrees else [world.metres] * 3
    xyz = xyz[:, [1, 0, 2] if degrees else [0, 1, 2]] * per_unit
    sigma = _sigma_of_places(content.folder / "places.csv", ids) * world.metres
    nothing = np.full((len(ids), 3), np.nan)
    lines = _lines(content, set(ids))
    centres = np.zeros((0, 3))
    title, urn = content.project.title, world.system.urn
    notes = _left_out(content, positions, placed)
    return Drawing(title, ids, xyz, sigma, nothing, [], centres, lines, "en", urn, degrees, notes)


def _sigma_of_places(path: Path, ids: list[str]) -> FloatArray:
    """σ (n, 3) east, north, up by the table of results, NaN if there is none."""
    rows: dict[str, dict[str, str | None]] = {}
    if path.is_file():
        note_input(path)
        rows = {row["id"]: row for row in pl.read_csv(path, infer_schema=False).iter_rows(named=True)}
    columns = ("seast", "snorth", "sup")
    return np.array([[_number(rows.get(name, {}).get(key)) for key in columns] for name in ids])


def _precision(path: Path, ids: list[str], metres: float) -> tuple[FloatArray, FloatArray]:
    """σ and error ellipses in plan by the table of results, NaN if there is none."""
    sigma, ellipses = np.full((len(ids), 3), np.nan), np.full((len(ids), 3), np.nan)
    if not path.is_file():
        return sigma, ellipses
    note_input(path)
    table = pl.read_csv(path, infer_schema=False)
    if not {"id", "sx", "sy", "sz", "rxy"} <= set(table.columns):
        return sigma, ellipses
    rows = {row["id"]: row for row in table.iter_rows(named=True)}
    for k, name in enumerate(ids):
        row = rows.get(name)
        if row is None:
            continue
        values = [_number(row[key]) for key in ("sx", "sy", "sz", "rxy")]
        sigma[k] = np.array(values[:3]) * metres
        ellipses[k] = _ellipse(float(sigma[k, 0]), float(sigma[k, 1]), values[3])
    return sigma, ellipses


def _number(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return float("nan")


def _ellipse(sx: float, sy: float, r: float) -> tuple[float, float, float]:
    """Semi-axes and bearing of the standard ellipse."""
    if not np.isfinite([sx, sy, r]).all():
        return float("nan"), float("nan"), float("nan")
    values, vectors = np.linalg.eigh([[sx * sx, r * sx * sy], [r * sx * sy, sy * sy]])
    a, b = np.sqrt(np.maximum(values[::-1], 0.0))
    return float(a), float(b), float(np.arctan2(vectors[1, 1], vectors[0, 1]))


def _lines(content: Content, known: set[str]) -> list[tuple[str, str]]:
    """Pairs of points that observations connect, each once."""
    found: dict[tuple[str, str], None] = {}
    for number, entry in enumerate(content.project.observations):
        ends = _LINES.get(entry.type)
        if ends is None:
            continue
        problems: list[Problem] = []
        place = content.place("observations", number)
        rows = entry.rows is not None
        source = from_rows(entry, place, problems) if rows else from_file(entry, {}, place, problems)
        if source is None or problems:
            raise InputError(problems)
        if not set(ends) <= set(source.columns):
            continue
        first, second = (source.columns[end].cast(pl.String).to_list() for end in ends)
        for pair in zip(first, second, strict=True):
            if set(pair) <= known and pair[::-1] not in found:
                found[pair] = None
    return list(found)
