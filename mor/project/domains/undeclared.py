"""Points that no table declares, found while the tables are divided: they become one more table of points.

Names are told apart by hashes, as they are where points are divided. Of names that a single character tells from that
of a declared point, those of all the project are asked, whatever domains they are in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray

from mor.errors import InputError, Problem
from mor.project.domains.refusals import is_divided
from mor.project.domains.tables import Rows, hashed, lines_of
from mor.project.file.model import Points, Project
from mor.project.file.nodes import Document
from mor.project.observations.undeclared_points import Slip, alike, told
from mor.project.tables.columns import Place

Names: TypeAlias = Callable[[], Iterator[pl.Series]]
"""What tells names, a part at a time."""
Hashes: TypeAlias = NDArray[np.uint64]
_NO_HASHES: Hashes = np.zeros(0, dtype=np.uint64)
_NAME = "undeclared_points"
"""What their table is called."""


def point_tables(project: Project) -> list[Points]:
    """Tables of points, and one of those that no table declares where the project lets them be free."""
    return [*project.points, *([Points(file=_NAME)] if are_free(project) else [])]


def are_free(project: Project) -> bool:
    """True where points that no table declares are free."""
    return project.settings.undeclared_points == "free"


def declared(project: Project, rows: Rows) -> Hashes:
    """Hashes of the names of all declared points, ascending."""
    found = [
        hashed(frame["id"]).to_numpy() for k in range(len(project.points)) for frame in rows("points", k)
    ]
    return np.unique(np.concatenate([_NO_HASHES, *found]))


def undeclared_names(frame: pl.DataFrame, known: Hashes) -> pl.DataFrame:
    """Rows of a table of image coordinates whose points nothing declares, each point once: ``point`` and the rest.

    Not those with a prefix (``image:B1``): these say what they name.
    """
    new = pl.Series(~np.isin(hashed(frame["point"]).to_numpy(), known))
    name = pl.col("point")
    plain = name.is_not_null() & (name != "") & ~name.str.contains(":", literal=True)
    return frame.filter(new & frame.select(plain).to_series()).unique("point", maintain_order=True)


class Named(NamedTuple):
    """Rows that name points: their hashes, ascending, and how many there are of each."""

    hashes: Hashes
    rays: NDArray[np.uint32]

    def of(self, name: str) -> int:
        """How many rows name one."""
        at = int(np.searchsorted(self.hashes, hashed(pl.Series([name])).to_numpy()[0]))
        return int(self.rays[at])


class Found(NamedTuple):
    """Points that no table declares, as dividing has come upon them."""

    known: Hashes
    """Of the declared ones, ascending."""
    named: Named
    names: Names
    """Their names."""
    elsewhere: pl.Series
    """All texts in what is not divided: who is among them is named by more rows than those of image coordinates."""


def notes_of(
    project: Project, document: Document, source: Path, rows: Rows, found: Found
) -> tuple[Problem, ...]:
    """What is noted of them, as on one machine. Raises :class:`InputError` where a name is a mistake."""
    count = len(np.setdiff1d(found.named.hashes, found.known))
    if not count:
        return ()

    def of_points() -> Iterator[pl.Series]:
        for k in range(len(project.points)):
            for frame in rows("points", k):
                yield frame["id"]

    if count <= len(found.known):
        new, old = _candidates(found.names, of_points)
    else:
        old, new = _candidates(of_points, found.names)
    pairs = alike(new, old)
    others = set(found.elsewhere.filter(found.elsewhere.is_in(list(pairs))).to_list())
    places = _places(project, document, source, rows, set(pairs))
    slips = [
        Slip(name, pairs[name], found.named.of(name) + (name in others), *place)
        for name, place in places.items()
    ]
    mistakes, notes = told(slips, count)
    if mistakes:
        raise InputError(mistakes)
    return tuple(notes)


def _candidates(few: Names, many: Names) -> tuple[list[str], list[str]]:
    """Those of few names and of many that may be alike: what they are without a character has the same hash."""
    wanted = np.unique(np.concatenate([_NO_HASHES, *map(_without_one, few())]))
    found = _with_any(many, wanted)
    return _with_any(few, np.unique(_without_one(pl.Series(found, dtype=pl.String)))), found


def _with_any(parts: Names, wanted: Hashes) -> list[str]:
    """Names that have one of some hashes, each once."""
    found: dict[str, None] = {}
    for names in parts():
        if len(names):
            hit = np.isin(_without_one(names), wanted).reshape(-1, len(names)).any(axis=0)
            found.update(dict.fromkeys(names.filter(pl.Series(hit)).to_list()))
    return list(found)


def _without_one(names: pl.Series) -> Hashes:
    """((k + 1) · n,) hashes of n names of up to k letters: without regard to case, then without each letter, too."""
    plain = names.str.to_lowercase()
    longest = int(plain.str.len_chars().max() or 0)  # type: ignore[arg-type]
    parts = [plain, *(plain.str.slice(0, k) + plain.str.slice(k + 1) for k in range(longest))]
    return np.concatenate([hashed(part).to_numpy() for part in parts])


def _places(
    project: Project, document: Document, source: Path, rows: Rows, names: set[str]
) -> dict[str, tuple[str, int]]:
    """File and line of the first row that names each of some points."""
    found: dict[str, tuple[str, int]] = {}
    for k, entry in enumerate(project.observations):
        if not names or not is_divided(entry):
            continue
        lines, first = None, 0
        for frame in rows("observations", k):
            hits = frame.with_row_index("row").filter(pl.col("point").is_in(list(names - found.keys())))
            for name, row in hits.unique("point", maintain_order=True).select("point", "row").iter_rows():
                lines = lines or lines_of(entry, Place(document, ("observations", k), source))
                found[name] = (lines.file, lines.of(first + row))
            first += frame.height
    return found


def undeclared_in_order(project: Project, rows: Rows) -> list[str]:
    """Names of these points as the rows name them."""
    known = declared(project, rows)
    found: dict[str, None] = {}
    for k, entry in enumerate(project.observations):
        for frame in rows("observations", k) if is_divided(entry) else ():
            found.update(dict.fromkeys(undeclared_names(frame.select("point"), known)["point"].to_list()))
    return list(found)
