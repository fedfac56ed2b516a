"""All points, images and observations as text, a part of the rows at a time: what a full report has besides."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import polars as pl

from mor.project.edge import ImageScale
from mor.project.file.model import Project
from mor.report.domains.results import Inlined
from mor.report.domains.tables import part_files, read_part
from mor.report.layout import heading
from mor.report.text import ellipses, images, points, residuals
from mor.report.words.datum import datum_name
from mor.report.words.language import Words

_ROWS_TOGETHER = 50_000
"""Rows of a table, which then begins anew: its columns are as wide as their widest cell, which all rows tell."""


def listed(
    parts: Path,
    inlined: Inlined,
    project: Project,
    scales: Mapping[str, ImageScale],
    datum: str,
    words: Words,
) -> Iterator[str]:
    """The sections, in pieces, from the parts of the tables in a folder; few points in the order of the project."""
    length = project.units.length

    def of_images() -> Iterator[str]:
        for frame in _pieces(parts / "images", inlined.images):
            yield "\n".join(images.listed(frame, project, scales, words))

    def of_points() -> Iterator[str]:
        for frame in _pieces(parts / "points", inlined.points):
            yield points.listed(frame, length, words)

    def of_ellipses() -> Iterator[str]:
        for frame in _pieces(parts / "points", inlined.points):
            known = frame.filter(pl.col("ellipse_a").is_not_null())
            if known.height:
                yield ellipses.plan(known.select("id", *_ELLIPSE).to_dicts(), project, words)

    def of_observations() -> Iterator[str]:
        for frame in _pieces(parts / "residuals", inlined.residuals):
            yield residuals.rows_of(frame, words)

    yield from _section(words("Images"), of_images())
    of_datum = words("Points (datum: {datum})", datum=datum_name(datum, words))
    yield from _section(of_datum, of_points())
    if project.settings.dimensions != "z":
        yield from _section(words("Error ellipses"), of_ellipses())
    yield from _section(words("All observations"), of_observations())


_ELLIPSE = [pl.col(f"ellipse_{name}").alias(name) for name in ("a", "b", "azimuth")]


def _section(title: str, tables: Iterable[str]) -> Iterator[str]:
    yield f"\n{heading(title)}\n"
    for number, text in enumerate(tables):
        yield "\n" * (number > 0) + text + "\n"


def _pieces(folder: Path, inlined: pl.DataFrame | None) -> Iterator[pl.DataFrame]:
    frames = [inlined] if inlined is not None else map(read_part, part_files(folder))
    for frame in frames:
        for first in range(0, frame.height, _ROWS_TOGETHER):
            yield frame[first : first + _ROWS_TOGETHER]
