"""Foreign file formats: every reader turns a file, or a folder of files, into the plain data of a project file."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from mor.errors import InputError, Problem, nearest
from mor.formats.aicon.files import is_stem
from mor.project.file.nodes import Document

Reader = Callable[[Path], Document]

_AICON = ("mor.formats.aicon.reader", "read_aicon")
READERS: dict[str, tuple[str, str]] = {
    ".gkf": ("mor.formats.gkf.reader", "read_gkf"),
    ".dat": ("mor.formats.textbook.reader", "read_krumm"),
    **dict.fromkeys((".ior", ".eor", ".obc", ".phc", ".scale"), _AICON),
    ".txt": ("mor.formats.photomodeler", "read_photomodeler"),
}
"""Module and name of the reader of each suffix, loaded when it is needed.

A folder, and the stem of the flat files, is read as a project of AICON.
"""


def is_foreign(path: Path) -> bool:
    """True for a path that one of the readers takes."""
    return _place_of_reader(path) is not None


def read_foreign(path: Path) -> Document:
    """The project that a foreign file or folder describes. Raises :class:`InputError` with every mistake found."""
    place = _place_of_reader(path)
    if place is None and not path.suffix and not path.exists():
        raise InputError([Problem("this file does not exist", str(path))])
    if place is None and path.suffix in (".yaml", ".yml"):
        raise InputError([Problem("this is a project file already; mor adjust takes it as it is", str(path))])
    if place is None:
        words = f"unknown format {path.suffix!r}{nearest(path.suffix, READERS)} (known: {', '.join(READERS)})"
        raise InputError([Problem(words, str(path))])
    if not path.exists() and not is_stem(path):
        raise InputError([Problem("this file does not exist", str(path))])
    module, name = place
    read: Reader = getattr(import_module(module), name)
    return read(path)


def _place_of_reader(path: Path) -> tuple[str, str] | None:
    if path.is_dir() or is_stem(path):
        return _AICON
    suffixes = [suffix.lower() for suffix in path.suffixes if suffix.lower() != ".gz"]
    return READERS.get(suffixes[-1]) if suffixes else None


__all__ = ["READERS", "is_foreign", "read_foreign"]
