"""The rows of a project's tables, each where its domain is: files in a folder that all processes see.

Rays go where their point goes, points to the last domain they have rays from, or to that of most of them, images
wherever they have rays. All that is not image coordinates in a file stays together: the *ground*, a domain of its own,
which has the points and images that it names, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.arrays import IntArray
from mor.errors import InputError, Problem
from mor.project.domains.division import Halves, halved, without_empty
from mor.project.domains.division_of_points import Cut, OfPoints, divide_points, rays_of_points
from mor.project.domains.refusals import is_divided
from mor.project.domains.tables import Rows, pieces
from mor.project.domains.undeclared import (
    Found,
    Named,
    are_free,
    declared,
    notes_of,
    undeclared_in_order,
    undeclared_names,
)
from mor.project.file.model import Datum, Project
from mor.project.file.nodes import Document
from mor.project.network.entities import unknown_name
from mor.project.network.reading import table_label
from mor.project.tables.columns import Place

Section = tuple[str, int]
"""Section of the project file and number of the table in it."""


@dataclass(frozen=True)
class Parts:
    """How a project was divided."""

    folder: Path
    tree: Halves
    count: int
    """Number of domains."""
    ground: int
    """The domain with all that is not divided; −1 where there is nothing of it."""
    rays: tuple[int, ...]
    """Image points of each domain."""
    images: int
    """Number of images."""
    notes: tuple[Problem, ...] = ()
    """What is noted of points that no table declares."""

    @property
    def lonely(self) -> int:
        """The domain that has what is not divided."""
        return self.ground if self.ground >= 0 else 0

    def files(self, section: Section, domain: int) -> list[Path]:
        """Files with the rows of a table in a domain, in their order."""
        return sorted((self.folder / f"{section[0]}-{section[1]}").glob(f"{domain:05d}-*.parquet"))


def divide(project: Project, document: Document, source: Path, folder: Path, rays_of_domain: int) -> Parts:
    """Divide the tables of a project, found from ``source``, into files in a folder. Raises :class:`InputError`."""

    def rows(section: str, number: int) -> Iterator[pl.DataFrame]:
        table = getattr(project, section)[number]
        return pieces(table, Place(document, (section, number), source))

    divided = [k for k, entry in enumerate(project.observations) if is_divided(entry)]
    work = _counted(rows("observations", k) for k in divided)
    images = _images(project, document, rows).join(work, left_on="id", right_on="image", how="left")
    amount = images["rays"].fill_null(0).to_numpy().astype(float)
    count = max(-(-int(amount.sum()) // rays_of_domain), 1)
    places, ids = images.select("x", "y", "z").to_numpy(), images.select("id")

    def cut(count: int) -> Cut:
        domain, tree = halved(places, np.maximum(amount, 1e-3), min(count, images.height))
        of_images = ids.with_columns(domain=pl.Series(domain, dtype=pl.Int32))
        return Cut(domain, tree, rays_of_points(rows, divided, of_images))

    domain, tree, of_points = divide_points(cut, count, rays_of_domain)
    used = np.bincount(of_points.domains, minlength=int(domain.max()) + 1) > 0
    tree, number = without_empty(tree, used)
    count = int(number.max()) + 1
    of_images = ids.with_columns(domain=pl.Series(number[domain], dtype=pl.Int32))
    of_points = of_points._replace(domains=number[of_points.domains].astype(np.int32))
    ground = count if has_ground(project) else -1
    if ground >= 0:
        tree, count = (tree, ground), count + 1
    names = _texts(document, rows, project, divided) if ground >= 0 else pl.Series("id", [], dtype=pl.String)
    _check_datum(project, document, rows, of_points)
    to = _To(folder, of_points, names, ground)
    totals, seen = _divide_rays(to, rows, divided, count)
    notes = _divide_undeclared(to, project, document, source, rows, divided) if are_free(project) else ()
    _divide_images(folder, project, rows, seen, of_images, names, ground)
    _divide_points(folder, project, rows, of_points, names, ground, ground if ground >= 0 else 0)
    return Parts(folder, tree, count, ground, tuple(totals.tolist()), of_images.height, notes)


def datum_points(datum: Any) -> dict[str, list[str]]:
    """Names of points, or of groups of points, that carry the datum, by components; none where all points do."""
    if not isinstance(datum, Datum) or (datum.minimal is None and datum.free == "all"):
        return {}
    chosen: Any = datum.minimal if datum.minimal is not None else datum.free
    if not isinstance(chosen, dict):
        chosen = {"".join(datum.components): list(chosen)}
    return {axes: [some] if isinstance(some, str) else list(some) for axes, some in chosen.items()}


def _check_datum(project: Project, document: Document, rows: Rows, of_points: OfPoints) -> None:
    """Raise :class:`InputError` where the datum names points that are in no table; no domain misses those of others."""
    unknown = dict.fromkeys(name for some in datum_points(project.datum).values() for name in some)
    for table in project.points:
        unknown.pop(table.group or "", None)
    for k in range(len(project.points) if unknown else 0):
        for frame in rows("points", k):
            for name in frame["id"].filter(frame["id"].is_in(list(unknown))).to_list():
                unknown.pop(name, None)
    if are_free(project):
        named = of_points.of(pl.Series(list(unknown), dtype=pl.String), -1) < 0
        unknown = dict.fromkeys(pl.Series(list(unknown), dtype=pl.String).filter(named).to_list())
    if unknown:
        path = ("datum",)
        place = document.file_of(path), document.line(path)
        raise InputError([Problem(unknown_name("datum point", name, ()), *place) for name in unknown])


class _To(NamedTuple):
    """Where rows go."""

    folder: Path
    points: OfPoints
    names: pl.Series
    """Every text in what is not divided."""
    ground: int


def _divide_rays(to: _To, rows: Rows, divided: list[int], count: int) -> tuple[IntArray, pl.DataFrame]:
    """Rays go where their points are; how many each domain has, and which images they are of."""
    totals, seen = np.zeros(count, dtype=np.int64), []
    for k in divided:
        for piece, frame in enumerate(rows("observations", k)):
            placed = frame.with_columns(domain=to.points.of(frame["point"], 0))
            seen.append(placed.group_by("image", "domain").len())
            totals += np.bincount(placed["domain"].to_numpy(), minlength=count)
            _write(to.folder, ("observations", k), piece, placed)
    return totals, pl.concat(seen)


def _divide_undeclared(
    to: _To, project: Project, document: Document, source: Path, rows: Rows, divided: list[int]
) -> tuple[Problem, ...]:
    """Points that no table declares go where their rays are, and to the ground; what is noted of them."""
    known, section, piece = declared(project, rows), ("points", len(project.points)), 0
    for k in divided:
        for frame in rows("observations", k):
            ids = undeclared_names(frame.select("point"), known).rename({"point": "id"})
            both = ids.with_columns(domain=to.points.of(ids["id"], 0))
            if to.ground >= 0:
                both = pl.concat([both, _in_ground(ids, to.names, to.ground)])
            _write_owned(to.folder, section, piece, ids, both)
            piece += 1

    def names() -> Iterator[pl.Series]:
        for file in sorted((to.folder / f"points-{section[1]}").glob("*.parquet")):
            yield pl.read_parquet(file)["id"].unique(maintain_order=True)

    named = Named(to.points.hashes, to.points.rays)
    return notes_of(project, document, source, rows, Found(known, named, names, to.names))


def names_in_order(project: Project, document: Document, source: Path, section: str) -> list[str]:
    """Names of the points, or images, in the order of the project."""

    def rows(section: str, number: int) -> Iterator[pl.DataFrame]:
        return pieces(getattr(project, section)[number], Place(document, (section, number), source))

    names = [
        name
        for number in range(len(getattr(project, section)))
        for frame in rows(section, number)
        for name in frame["id"].to_list()
    ]
    further = undeclared_in_order(project, rows) if section == "points" and are_free(project) else []
    return [*names, *further]


def group_names(project: Project) -> list[str]:
    """Names of observation groups in the order of their entries: those of tables, then of what is known beforehand."""
    sections = ("observations", "points", "images", "stations", "systems")
    return [
        table_label(section, number, table)
        for section in sections
        for number, table in enumerate(getattr(project, section))
    ]


def _counted(tables: Iterable[Iterable[pl.DataFrame]]) -> pl.DataFrame:
    """Number of rays of each image."""
    parts = [frame.group_by("image").agg(rays=pl.len()) for table in tables for frame in table]
    return pl.concat(parts).group_by("image").agg(pl.col("rays").sum())


_TIES = ("position", "leader", "pair", "shared_height", "shared_eccentricity")
"""Columns by which images have a block in common with others."""


def _images(project: Project, document: Document, rows: Rows) -> pl.DataFrame:
    """Names and places of all images; a start value goes before a value."""
    found, problems = [], []
    for k in range(len(project.images)):
        place = Place(document, ("images", k), Path())
        for frame in rows("images", k):
            tied = [name for name in _TIES if name in frame.columns]
            told = any(frame[name].cast(pl.String).fill_null("").ne("").any() for name in tied)
            if told or not project.images[k].values.keys().isdisjoint(_TIES):
                problems.append(
                    place.problem("domains do not do images that share something, or follow another one")
                )
            axes = [[name for name in (f"start_{axis}", axis) if name in frame.columns] for axis in "xyz"]
            if "id" not in frame.columns or not all(axes):
                problems.append(place.problem("to be divided by place, images need columns id, x, y and z"))
                continue
            values = (
                pl.coalesce(
                    [pl.col(name).cast(pl.Float64, strict=False).fill_nan(None) for name in names]
                ).alias(axis)
                for axis, names in zip("xyz", axes, strict=True)
            )
            found.append(frame.select(pl.col("id"), *values))
            if found[-1].null_count().sum_horizontal().item():
                words = "to be divided by place, images need start values as plain numbers (mor approximate)"
                problems.append(place.problem(words))
    if problems or not found:
        raise InputError(problems or [Problem("there are no images to divide", document.file)])
    return pl.concat(found)


def has_ground(project: Project) -> bool:
    """True where something is not divided."""
    others = any(not is_divided(entry) for entry in project.observations)
    return bool(others or project.checks or project.features or project.stations or project.systems)


def _texts(document: Document, rows: Rows, project: Project, divided: list[int]) -> pl.Series:
    """Every text in all that is not divided: whatever it names is among them."""
    found: set[str] = set()

    def collect(node: object) -> None:
        if isinstance(node, dict):
            for value in node.values():
                collect(value)
        elif isinstance(node, list):
            for value in node:
                collect(value)
        elif isinstance(node, str):
            found.update((node, node.partition(":")[2]))

    for section in ("features", "stations", "systems"):
        collect(document.data.get(section))
    entries = document.data.get("observations") or []
    collect([entry for k, entry in enumerate(entries) if k not in divided])
    collect(document.data.get("checks"))
    tables = [("observations", k) for k in range(len(project.observations)) if k not in divided]
    tables += [
        (section, k)
        for section in ("checks", "stations", "systems")
        for k in range(len(getattr(project, section)))
    ]
    for section, k in tables:
        if getattr(project, section)[k].file is None:
            continue
        for frame in rows(section, k):
            for column in frame.iter_columns():
                if column.dtype == pl.String or column.dtype.is_integer():
                    names = column.cast(pl.String).str.strip_chars().unique().drop_nulls().to_list()
                    found.update(names)
                    found.update(name.partition(":")[2] for name in names)
    return pl.Series("id", sorted(found), dtype=pl.String)


def _divide_images(
    folder: Path,
    project: Project,
    rows: Rows,
    seen: pl.DataFrame,
    of_images: pl.DataFrame,
    names: pl.Series,
    ground: int,
) -> None:
    """Images go to every domain they have rays in, and to the ground; the first of these owns them."""
    placed = seen.select(pl.col("image").alias("id"), pl.col("domain").cast(pl.Int32)).unique()
    lost = of_images.join(placed, on="id", how="anti")
    both = pl.concat([placed, lost])
    if ground >= 0:
        both = pl.concat([both, _in_ground(of_images, names, ground)])
    _write_several(folder, "images", len(project.images), rows, both)


def _divide_points(
    folder: Path,
    project: Project,
    rows: Rows,
    of_points: OfPoints,
    names: pl.Series,
    ground: int,
    lone: int,
) -> None:
    """Points go to their domain, and to the ground where it names them; those without rays stay with it."""
    for k in range(len(project.points)):
        for piece, frame in enumerate(rows("points", k)):
            ids = frame.select("id").unique()
            both = ids.with_columns(domain=of_points.of(ids["id"], lone))
            if ground >= 0:
                both = pl.concat([both, _in_ground(ids, names, ground)]).unique()
            _write_owned(folder, ("points", k), piece, frame, both)


def _in_ground(ids: pl.DataFrame, names: pl.Series, ground: int) -> pl.DataFrame:
    chosen = ids.select("id").filter(pl.col("id").is_in(names.implode()))
    return chosen.with_columns(domain=pl.lit(ground, dtype=pl.Int32))


def _write_several(folder: Path, section: str, count: int, rows: Rows, both: pl.DataFrame) -> None:
    for k in range(count):
        for piece, frame in enumerate(rows(section, k)):
            _write_owned(folder, (section, k), piece, frame, both.unique())


OWNED = "mor:owned"
SHARED = "mor:shared"
"""Columns that say whether this domain is the first to have a thing, and whether another one has it, too."""


def _write_owned(folder: Path, section: Section, piece: int, frame: pl.DataFrame, both: pl.DataFrame) -> None:
    marked = both.with_columns(
        (pl.col("domain") == pl.col("domain").min().over("id")).alias(OWNED),
        (pl.len().over("id") > 1).alias(SHARED),
    )
    _write(folder, section, piece, frame.join(marked, on="id", how="inner", maintain_order="left"))


def _write(folder: Path, section: Section, piece: int, frame: pl.DataFrame) -> None:
    """One file for every domain that has rows of a piece of a table."""
    place = folder / f"{section[0]}-{section[1]}"
    place.mkdir(parents=True, exist_ok=True)
    for (domain,), part in frame.partition_by("domain", as_dict=True, maintain_order=True).items():
        part.drop("domain").write_parquet(place / f"{domain:05d}-{piece:06d}.parquet", compression="lz4")
