"""Foreign file formats: every reader turns a file, or a folder of files, into the plain data of a project file."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from pkgutil import resolve_name

from mor.errors import InputError, Message, nearest
from mor.formats.catalogue import FORMATS
from mor.formats.draft import Writer, Written
from mor.formats.recognition import explain_unknown, format_of, is_stem
from mor.input_files import standard_input
from mor.project.document import Document

Reader = Callable[[Path], Document]


def is_foreign(path: Path) -> bool:
    """True for a path that one of the readers takes."""
    key = format_of(path)
    return key is not None and FORMATS[key].read is not None


def read_foreign(path: Path, key: str = "", beside: bool = False) -> Document:
    """The project that a foreign file or folder describes; ``key`` names its format, else its content tells it.

    ``beside``: the file is put together with others. Raises :class:`InputError` with every mistake found.
    """
    if standard_input(path) is None and not path.exists() and not is_stem(path):
        raise InputError([Message(f"this file does not exist{_suffix_hint(path)}", str(path))])
    key = key or format_of(path) or ""
    form = FORMATS.get(key)
    if form is None or form.read is None:
        raise InputError([Message(_unknown(path, key), str(path))])
    code = form.beside if beside and form.beside is not None else form.read
    read: Reader = resolve_name(f"{__name__}.{code}")
    document = read(path)
    if not form.untried:
        return document
    return replace(document, notes=(Message(form.untried, str(path)), *document.notes))


def read_together(paths: Sequence[Path], keys: Sequence[str]) -> Document:
    """The project that foreign files describe together; ``keys`` name the formats of the first ones.

    Raises :class:`InputError` with every mistake found, and for project files of mor's own.
    """
    from mor.formats.combination import combined

    own = [path for path in paths if path.suffix.lower() in (".yaml", ".yml")]
    if own:
        words = "a project file is not put together with other files: name their tables in it"
        raise InputError([Message(words, str(path)) for path in own])
    by_path = (*keys, *[""] * len(paths))
    return combined([read_foreign(path, key, True) for path, key in zip(paths, by_path, strict=False)])


def write_foreign(document: Document, folder: Path, target: Path, key: str) -> Written:
    """Files of a project in a foreign format. Raises :class:`InputError` for what the format cannot say."""
    form = FORMATS.get(key)
    if form is None or form.write is None:
        writable = {name: form for name, form in FORMATS.items() if form.write is not None}
        words = f"{key!r} is not an output format{nearest(key, writable)} (known: {', '.join(writable)})"
        raise InputError([Message(words)])
    if document.data.get("motions"):
        words = f"the points of this project move; {key} has points that stand still"
        raise InputError([Message(words, document.file, document.line(("motions",)))])
    write: Writer = resolve_name(f"{__name__}.{form.write}")
    written = write(document, folder, target)
    _refuse_control_characters(written.files)
    return written


_CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u2028\u2029\ufffe\uffff]")
"""What XML 1.0 has no place for, and what ends a line in a text besides a line feed."""


def _refuse_control_characters(files: Mapping[Path, bytes]) -> None:
    """Raise :class:`InputError` if a name brought a control character into a text file."""
    for path, content in files.items():
        if path.suffix == ".bin":
            continue
        text = content.decode("utf-8", errors="replace")
        found = _CONTROL.search(text)
        if found is not None:
            line = text.count("\n", 0, found.start()) + 1
            words = f"a name has the control character {found[0]!r}, which this format cannot hold; rename it"
            raise InputError([Message(words, str(path), line)])


def format_to_write(target: Path) -> str:
    """Key of the format that the suffix of a target means; empty if it means none."""
    last = target.suffix.lower()
    return next((k for k, f in FORMATS.items() if f.write is not None and last and last in f.suffixes), "")


def _suffix_hint(path: Path) -> str:
    known = [suffix for form in FORMATS.values() for suffix in form.suffixes]
    return nearest(path.suffix, known) if path.suffix and path.suffix not in known else ""


def _unknown(path: Path, key: str) -> str:
    readable = ", ".join(name for name, form in FORMATS.items() if form.read is not None)
    if key:
        if key in FORMATS:
            return f"the format {key!r} is written only, not read (known: {readable})"
        return f"unknown format {key!r}{nearest(key, FORMATS)} (known: {readable})"
    if path.suffix in (".yaml", ".yml"):
        return "this is a project file already; mor adjust takes it as it is"
    if path.is_dir():
        folders = ", ".join(sorted(name for name, form in FORMATS.items() if form.folder))
        return (
            "this is a folder without a project file, expected a project file, or a folder in one of the "
            f"formats {folders}"
        )
    return explain_unknown(path)


__all__ = ["FORMATS", "format_of", "format_to_write", "is_foreign", "read_foreign", "read_together", "write_foreign"]
