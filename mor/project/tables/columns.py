"""What a table may contain, what was read from it, and where it stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.arrays import BoolArray, FloatArray, IntArray, SmallIntArray
from mor.errors import Problem
from mor.observations.names import Names, coded
from mor.project.file.nodes import Document
from mor.project.file.nodes import Path as NodePath


class Column(NamedTuple):
    """A column a table may have. ``parse`` turns one text into an internal number; ``None`` for identifiers."""

    name: str
    parse: Callable[[str, str], float] | None = None
    factor: Callable[[str], float] | None = None
    """Internal units per given unit, for columns of plain numbers; raises ``ValueError``."""
    required: bool = False


class Source(NamedTuple):
    """Named columns as they were found, each all texts or already numbers in the unit of the column; null is empty."""

    names: list[str]
    """Names of the columns in their order; one may be given twice."""
    columns: dict[str, pl.Series]
    lines: SmallIntArray
    file: str


@dataclass(frozen=True)
class Rows:
    """Columns read: identifiers as texts, numbers as floats in internal units, NaN if empty."""

    count: int
    texts: dict[str, pl.Series]
    numbers: dict[str, FloatArray]
    lines: SmallIntArray
    file: str

    def text(self, name: str) -> list[str]:
        """Identifiers of a column, for tables of few rows; empty if the column is missing."""
        column: list[str] = self.series(name).to_list()
        return column

    def series(self, name: str) -> pl.Series:
        """Identifiers of a column as they are kept."""
        if name in self.texts:
            return self.texts[name]
        return pl.repeat("", self.count, dtype=pl.String, eager=True)

    def names(self, name: str) -> Names:
        """Identifiers of a column, each different one kept once."""
        return coded(self.series(name))

    def number(self, name: str) -> FloatArray:
        """Numbers of a column, NaN if it is missing."""
        return self.numbers[name] if name in self.numbers else np.full(self.count, np.nan)

    def take(self, chosen: IntArray) -> Rows:
        """Some of the rows."""
        texts = {name: cells.gather(chosen) for name, cells in self.texts.items()}
        numbers = {name: cells[chosen] for name, cells in self.numbers.items()}
        return Rows(len(chosen), texts, numbers, self.lines[chosen], self.file)


@dataclass(frozen=True)
class Place:
    """Where a table stands in the project: its path in the document, and the folder of the project."""

    document: Document
    path: NodePath
    folder: Path

    def problem(self, message: str, key: str | None = None) -> Problem:
        """A problem at this table, or at one of its keys."""
        path = (*self.path, key) if key else self.path
        return Problem(message, self.document.file_of(path), self.document.line(path))


MOST_TOLD = 100
"""Mistakes of one kind in one table that are told one by one; the rest is counted."""


def tell_rows(
    problems: list[Problem], wrong: BoolArray, rows: Rows | Source, words: Callable[[int], str] | str
) -> None:
    """Tell what is wrong with rows (n,): each with its line, of very many the first and how many more there are."""
    found = np.flatnonzero(wrong)
    for row in found[:MOST_TOLD].tolist():
        said = words if isinstance(words, str) else words(row)
        problems.append(Problem(said, rows.file, int(rows.lines[row])))
    if len(found) > MOST_TOLD:
        first = words if isinstance(words, str) else words(int(found[MOST_TOLD]))
        more = f"{len(found) - MOST_TOLD} more rows like these, the next one: {first}"
        problems.append(Problem(more, rows.file, int(rows.lines[found[MOST_TOLD]])))
