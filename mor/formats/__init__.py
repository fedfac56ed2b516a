"""Foreign file formats: every reader turns a file into the plain data of a project file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mor.errors import InputError, Problem, nearest
from mor.formats.gkf import read_gkf
from mor.formats.krumm import read_krumm
from mor.project.nodes import Document

Reader = Callable[[Path], Document]

READERS: dict[str, Reader] = {
    ".gkf": read_gkf,
    ".dat": read_krumm,
}
"""Reader of each suffix."""


def is_foreign(path: Path) -> bool:
    """True for a path that one of the readers takes."""
    return path.suffix.lower() in READERS


def read_foreign(path: Path) -> Document:
    """The project that a foreign file describes. Raises :class:`InputError` with every mistake found."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        words = f"unknown format {path.suffix!r}{nearest(path.suffix, READERS)} (known: {', '.join(READERS)})"
        raise InputError([Problem(words, str(path))])
    if not path.exists():
        raise InputError([Problem("this file does not exist", str(path))])
    return reader(path)


__all__ = ["READERS", "is_foreign", "read_foreign"]
