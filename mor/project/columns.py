"""What a table may contain, what was read from it, and where it stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mor.errors import Problem
from mor.geometry.arrays import FloatArray, IntArray
from mor.project.nodes import Document
from mor.project.nodes import Path as NodePath


@dataclass(frozen=True)
class Column:
    """A column a table may have. ``parse`` turns one text into an internal number; ``None`` for identifiers."""

    name: str
    parse: Callable[[str, str], float] | None = None
    factor: Callable[[str], float] | None = None
    """Internal units per given unit, for columns of plain numbers; raises ``ValueError``."""
    required: bool = False


@dataclass(frozen=True)
class Rows:
    """Columns read: identifiers as texts, numbers as floats in internal units, NaN where empty."""

    count: int
    texts: dict[str, list[str]]
    numbers: dict[str, FloatArray]
    lines: IntArray
    file: str

    def text(self, name: str, default: str = "") -> list[str]:
        """Identifiers of a column."""
        return self.texts.get(name, [default] * self.count)

    def number(self, name: str) -> FloatArray:
        """Numbers of a column, NaN where it is missing."""
        return self.numbers.get(name, np.full(self.count, np.nan))

    def take(self, chosen: IntArray) -> Rows:
        """Some of the rows."""
        texts = {name: [cells[i] for i in chosen] for name, cells in self.texts.items()}
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
