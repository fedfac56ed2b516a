"""Foreign file formats: every reader turns a file, or a folder of files, into the plain data of a project file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mor.errors import InputError, Problem, nearest
from mor.formats.aicon.files import is_stem
from mor.formats.aicon.reader import read_aicon
from mor.formats.gkf.reader import read_gkf
from mor.formats.photomodeler import read_photomodeler
from mor.formats.textbook.reader import read_krumm
from mor.project.file.nodes import Document

Reader = Callable[[Path], Document]

READERS: dict[str, Reader] = {
    ".gkf": read_gkf,
    ".dat": read_krumm,
    **dict.fromkeys((".ior", ".eor", ".obc", ".phc", ".scale"), read_aicon),
    ".txt": read_photomodeler,
}
"""Reader of each suffix; a folder, and the stem of the flat files, is read as a project of AICON."""


def is_foreign(path: Path) -> bool:
    """True for a path that one of the readers takes."""
    return _reader(path) is not None


def read_foreign(path: Path) -> Document:
    """The project that a foreign file or folder describes. Raises :class:`InputError` with every mistake found."""
    reader = _reader(path)
    if reader is None and not path.suffix and not path.exists():
        raise InputError([Problem("this file does not exist", str(path))])
    if reader is None and path.suffix in (".yaml", ".yml"):
        raise InputError([Problem("this is a project file already; mor adjust takes it as it is", str(path))])
    if reader is None:
        words = f"unknown format {path.suffix!r}{nearest(path.suffix, READERS)} (known: {', '.join(READERS)})"
        raise InputError([Problem(words, str(path))])
    if not path.exists() and not is_stem(path):
        raise InputError([Problem("this file does not exist", str(path))])
    return reader(path)


def _reader(path: Path) -> Reader | None:
    if path.is_dir() or is_stem(path):
        return read_aicon
    suffixes = [suffix.lower() for suffix in path.suffixes if suffix.lower() != ".gz"]
    return READERS.get(suffixes[-1]) if suffixes else None


__all__ = ["READERS", "is_foreign", "read_foreign"]
