"""The rows of a project's tables, each where its domain is: files in a folder that all processes see.

Rays go where their point goes, points to the last domain they have rays from, or to that of most of them, images
wherever they have rays. All that is not image coordinates in a file stays together: the *ground*, a domain of its own,
which has the points and images that it names, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray

from mor.arrays import IntArray, SmallIntArray
from mor.errors import InputError, Problem
from mor.project.domains.division import Halves, halved, without_empty
from mor.project.domains.refusals import is_divided
from mor.project.domains.tables import ROWS_AT_A_TIME, pieces
from mor.project.file.model import Project
from mor.project.file.nodes import Document
from mor.project.network.reading import table_label
from mor.project.tables.columns import Place

Rows: TypeAlias = Callable[[str, int], Iterator[pl.DataFrame]]
"""What reads a table, by its section and number, a part at a time."""
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

    def cut(count: int) -> _Cut:
        domain, tree = halved(places, np.maximum(amount, 1e-3), min(count, images.height))
        of_images = ids.with_columns(domain=pl.Series(domain, dtype=pl.Int32))
        return _Cut(domain, tree, _points(rows, divided, of_images))

    domain, tree, of_points = _divided(cut, count, rays_of_domain)
    used = np.bincount(of_points.domains, minlength=int(domain.max()) + 1) > 0
    tree, number = without_empty(tree, used)
    count = int(number.max()) + 1
    of_images = ids.with_columns(domain=pl.Series(number[domain], dtype=pl.Int32))
    of_points = of_points._replace(domains=number[of_points.domains].astype(np.int32))
    ground = count if has_ground(project) else -1
    if ground >= 0:
        tree, count = (tree, ground), count + 1
    names = _texts(document, rows, project, divided) if ground >= 0 else pl.Series("id", [], dtype=pl.String)
    totals, seen = np.zeros(count, dtype=np.int64), []
    for k in divided:
        for piece, frame in enumerate(rows("observations", k)):
            placed = frame.with_columns(domain=of_points.of(frame["point"], 0))
            seen.append(placed.group_by("image", "domain").len())
            totals += np.bincount(placed["domain"].to_numpy(), minlength=count)
            _write(folder, ("observations", k), piece, placed)
    lone = ground if ground >= 0 else 0
    _divide_images(folder, project, rows, pl.concat(seen), of_images, names, ground)
    _divide_points(folder, project, rows, of_points, names, ground, lone)
    return Parts(folder, tree, count, ground, tuple(totals.tolist()), of_images.height)


def names_in_order(project: Project, document: Document, source: Path, section: str) -> list[str]:
    """Names of the points, or images, in the order of the project."""
    return [
        name
        for number, table in enumerate(getattr(project, section))
        for frame in pieces(table, Place(document, (section, number), source))
        for name in frame["id"].to_list()
    ]


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


def hashed(names: pl.Series) -> pl.Series:
    """(n,) numbers that are the same for the same names."""
    return names.hash()


class _OfPoints(NamedTuple):
    """Domain of each point, by a hash of its name: of a hundred million rows a join would look at all names each time.

    Two names with the same hash are in the same domain, which is as good as any other.
    """

    hashes: NDArray[np.uint64]
    """(p,) ascending."""
    domains: SmallIntArray

    def of(self, names: pl.Series, otherwise: int) -> pl.Series:
        """(n,) domains of names; ``otherwise`` where no ray has one."""
        wanted = hashed(names).to_numpy()
        if len(self.hashes) == 0:
            return pl.repeat(otherwise, len(wanted), dtype=pl.Int32, eager=True)
        # In ascending order what is looked at next is near in memory: of twenty million points an eighth of the time.
        order = np.argsort(wanted)
        at = np.empty(len(wanted), dtype=np.int64)
        at[order] = np.searchsorted(self.hashes, wanted[order])
        at = np.minimum(at, len(self.hashes) - 1)
        return pl.Series(np.where(self.hashes[at] == wanted, self.domains[at], np.int32(otherwise)))


class _Cut(NamedTuple):
    """Images divided, and what their points are then."""

    domain: IntArray
    """(n,) of the images."""
    tree: Halves
    points: pl.DataFrame
    """By ascending ``hash`` of the name: ``last`` and ``most``, the last domain with rays of it, and that of most of
    them, the first one of several; number of its ``rays``."""

    @property
    def largest(self) -> float:
        """Rays of the largest domain where all points are in the last one."""
        weights = self.points["rays"].to_numpy().astype(float)
        return float(np.bincount(self.points["last"].to_numpy(), weights=weights).max(initial=0.0))

    def of_points(self, rule: str) -> _OfPoints:
        """Domains of the points."""
        return _OfPoints(self.points["hash"].to_numpy(), self.points[rule].to_numpy())


def _divided(
    cut: Callable[[int], _Cut], count: int, rays_of_domain: int
) -> tuple[IntArray, Halves, _OfPoints]:
    """Domain (n,) of the images, the tree of about ``count`` domains, and domains of the points.

    With a point in the last domain that it has rays from, none before it has images of that one: borders are half as
    wide as where a point goes where most of its rays come from, and their dense matrices take an eighth of the time.
    The last domains are larger then, for which a few more of them make up; not where domains are as small as images.
    """
    found = cut(count)
    if found.largest <= rays_of_domain:
        return found.domain, found.tree, found.of_points("last")
    more = cut(int(np.ceil(count * found.largest / rays_of_domain)))
    if more.largest <= rays_of_domain:
        return more.domain, more.tree, more.of_points("last")
    return found.domain, found.tree, found.of_points("most")


def _points(rows: Rows, divided: list[int], of_images: pl.DataFrame) -> pl.DataFrame:
    """Domains that points have rays from, as :class:`_Cut` has them."""
    counts = pl.DataFrame(schema={"hash": pl.UInt64, "domain": pl.Int32, "len": pl.UInt32})
    waiting: list[pl.DataFrame] = []

    def together() -> pl.DataFrame:
        return pl.concat([counts, *waiting]).group_by("hash", "domain").agg(pl.col("len").sum())

    for k in divided:
        for frame in rows("observations", k):
            found = frame.select("image", hash=hashed(frame["point"]))
            found = found.join(of_images, left_on="image", right_on="id", how="left")
            found = found.with_columns(pl.col("domain").fill_null(0))
            waiting.append(found.group_by("hash", "domain").len())
            if sum(part.height for part in waiting) > max(counts.height, ROWS_AT_A_TIME):
                counts, waiting = together(), []
    # Most rays first, then the first domain: the largest of these numbers.
    order = (pl.col("len").cast(pl.Int64) * (_LAST + 1)) + (_LAST - pl.col("domain").cast(pl.Int64))
    first = (_LAST - pl.col("most") % (_LAST + 1)).cast(pl.Int32).alias("most")
    points = (
        together()
        .group_by("hash")
        .agg(
            pl.col("domain").max().alias("last"), order.max().alias("most"), pl.col("len").sum().alias("rays")
        )
    )
    return points.with_columns(first).sort("hash")


_LAST = 2**31 - 1
"""No domain has a larger number."""


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
    of_points: _OfPoints,
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
