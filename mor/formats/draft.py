"""A project in the making: the plain data of a project file, put together from the lines of another file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.errors import InputError, Problem
from mor.project.file.nodes import Document, Path

if TYPE_CHECKING:
    import polars as pl


class Row(NamedTuple):
    """Cells of a table row, and the line they come from."""

    cells: list[str | None]
    line: int


@dataclass
class Draft:
    """Sections, tables and settings of a project, each with the line it comes from."""

    file: str
    data: dict[str, Any] = field(default_factory=lambda: {"mor": "1"})
    lines: dict[Path, int] = field(default_factory=dict)
    files: dict[Path, str] = field(default_factory=dict)
    """Files of the tables that do not come from ``file``."""
    frames: dict[str, pl.DataFrame] = field(default_factory=dict)
    """Tables with many rows, by the names that stand for them."""
    problems: list[Problem] = field(default_factory=list)
    notes: list[Problem] = field(default_factory=list)
    """What was left out, and why."""

    def problem(self, message: str, line: int = 0, file: str = "") -> None:
        """A mistake at a line of the file, or of another file that belongs to it."""
        self.problems.append(Problem(message, file or self.file, line))

    def note(self, message: str, line: int = 0, file: str = "") -> None:
        """Something the reader did of its own accord, to be told to the user."""
        self.notes.append(Problem(message, file or self.file, line))

    def put(self, key: str, value: Any, line: int = 0) -> None:
        """A key at the top of the project."""
        self.data[key] = value
        if line:
            self.lines[key,] = line

    def table(
        self, section: str, columns: Sequence[str], rows: Sequence[Row], file: str = "", **keys: Any
    ) -> Path:
        """Add a table to a section; columns without any value are left out. Returns its path."""
        tables = self.data.setdefault(section, [])
        path: Path = (section, len(tables))
        used = [k for k in range(len(columns)) if any(row.cells[k] is not None for row in rows)]
        keys = {key: value for key, value in keys.items() if value is not None and value != []}
        cells = [[row.cells[k] for k in used] for row in rows]
        tables.append({**keys, "columns": [columns[k] for k in used], "rows": cells})
        self.lines[path] = rows[0].line
        for i, row in enumerate(rows):
            self.lines[*path, "rows", i] = row.line
        if file:
            self.files[path] = file
        return path

    def correlated(
        self,
        columns: Sequence[str],
        clusters: Sequence[tuple[Sequence[Row], FloatArray]],
        type_: str,
        file: str = "",
    ) -> None:
        """Add observations of one type in clusters, rows with their covariance matrix each, as one table."""
        if len(clusters) == 1:
            rows, matrix = clusters[0]
            self.table("observations", columns, rows, file, type=type_, covariance=matrix.tolist())
            return
        named = [
            Row([*row.cells, str(number)], row.line)
            for number, (rows, _) in enumerate(clusters, start=1)
            for row in rows
        ]
        covariance = [line for _, matrix in clusters for line in matrix.tolist()]
        self.table("observations", (*columns, "cluster"), named, file, type=type_, covariance=covariance)

    def frame(self, section: str, name: str, frame: pl.DataFrame, **keys: Any) -> None:
        """Add a table with many rows to a section; ``name`` is what stands for it."""
        self.frames[name] = frame
        self.data.setdefault(section, []).append({"file": name, **keys})

    def finish(self) -> Document:
        """The finished document. Raises :class:`InputError` with every mistake found."""
        if self.problems:
            raise InputError(sorted(self.problems, key=lambda problem: (problem.file, problem.line)))
        return Document(self.data, self.lines, self.file, self.files, tuple(self.notes), frames=self.frames)


LARGEST = 1e30
"""Numbers beyond it are none of a measurement, and their squares leave the range of floating point."""


def usable(values: FloatArray | Sequence[float]) -> bool:
    """Return True if all of them are numbers up to 1e30."""
    with np.errstate(invalid="ignore"):
        return bool((np.abs(values) <= LARGEST).all())


def number(text: str) -> float:
    """A number up to 1e30. Raises ``ValueError`` with words."""
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"found {text!r}, expected a number") from None
    if not isfinite(value) or "_" in text:
        raise ValueError(f"found {text!r}, expected a number")
    if abs(value) > LARGEST:
        raise ValueError(f"found {text!r}, a number beyond {LARGEST:g}")
    return value
