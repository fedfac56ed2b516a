"""What a drawing shows of a project: points with their σ where results are beside it, images, lines of sight."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.errors import InputError, Problem
from mor.formats.content import Content, content_of, images, points
from mor.project.file.nodes import Document
from mor.project.tables.sources import from_file, from_rows

_LINES = {
    "distance": ("from", "to"),
    "horizontal_distance": ("from", "to"),
    "height_difference": ("from", "to"),
    "vector": ("from", "to"),
    "bearing": ("from", "to"),
    "zenith_angle": ("from", "to"),
    "vertical_direction": ("from", "to"),
}
"""Observations between two points, which a drawing shows as lines."""


class Drawing(NamedTuple):
    """Everything in metres, in the axes of the project; σ NaN where there is none."""

    title: str
    ids: list[str]
    xyz: FloatArray
    """(n, 3)."""
    sigma: FloatArray
    """(n, 3)."""
    ellipses: FloatArray
    """(n, 3) semi-axes a, b and the bearing (rad, counterclockwise from +x) of a; NaN where there is none."""
    images: list[str]
    centres: FloatArray
    """(m, 3)."""
    lines: list[tuple[str, str]]
    axes: str
    """Compass directions of x and y."""


def drawing(document: Document, folder: Path) -> Drawing:
    """The drawing of a project; of an adjusted one (``adjusted.yaml``) with the σ of the results beside it.

    Raises :class:`InputError` where no point has coordinates.
    """
    content = content_of(document, folder)
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
    )


def _precision(path: Path, ids: list[str], metres: float) -> tuple[FloatArray, FloatArray]:
    """σ and error ellipses in plan by the table of results, NaN where there is none."""
    sigma, ellipses = np.full((len(ids), 3), np.nan), np.full((len(ids), 3), np.nan)
    if not path.is_file():
        return sigma, ellipses
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
