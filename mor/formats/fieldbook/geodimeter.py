"""Geodimeter ARE and JOB: a number and a value a line.

2 station, 3 instrument height, 4 code, 5 point, 6 target height, 7 horizontal and 8 zenith reading in face one, 17 and
18 in face two, 9 slope, 11 horizontal distance, 37 north, 38 east, 39 height (Geodimeter, "Labels"). Angles are
ddd.mmss where every one of them may be, gon otherwise.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

from mor.formats.draft import Draft, number
from mor.formats.fieldbook.book import FieldBook, Sight, sexagesimal
from mor.formats.text import read_lines
from mor.project.file.nodes import Document

_ANGLES = ("7", "8", "17", "18")
Entry = tuple[str, str, int]
"""Label, value, line."""


def read_geodimeter(path: Path) -> Document:
    """The project of an ARE or JOB file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    book = FieldBook(draft)
    entries: list[Entry] = []
    for line, text in enumerate(read_lines(path, draft), start=1):
        label, sign, value = text.partition("=")
        if text.strip() and not (sign and label.strip().isdecimal()):
            draft.problem(f"found {text.strip()!r}, expected a label and a value as in 5=P1", line)
        elif text.strip():
            entries.append((label.strip(), value.strip(), line))
    read = _angle_unit(entries, book)
    begin = [k for k, (label, _, _) in enumerate(entries) if label in ("2", "5")]
    for label, _, line in entries[: begin[0] if begin else len(entries)]:
        book.leave_out(f"label {label} before the first point", line)
    height = 0.0
    for first, end in pairwise([*begin, len(entries)]):
        try:
            height = _thing(entries[first:end], book, read, height)
        except ValueError as error:
            draft.problem(str(error), entries[first][2])
    book.finish(path.stem)
    return draft.finish()


def _angle_unit(entries: list[Entry], book: FieldBook) -> bool:
    """True for degrees, minutes and seconds, which no other unit looks like throughout."""
    angles = [value for label, value, _ in entries if label in _ANGLES]
    try:
        largest = max((sexagesimal(value) for value in angles), default=0.0)
    except ValueError:
        largest = 400.0
    if largest <= 360.0:
        if angles:
            book.draft.note(
                "angles are taken as degrees, minutes and seconds, as all of them may be", entries[0][2]
            )
        return True
    book.angle = "gon"
    book.draft.note("angles are taken as gon", entries[0][2])
    return False


def _thing(entries: list[Entry], book: FieldBook, dms: bool, height: float) -> float:
    """A station or a point with all that follows it; returns the height of the target from here on."""
    values = {label: (value, line) for label, value, line in entries}
    kind, name, line = entries[0]
    numbers = {
        label: number(values[label][0])
        for label in ("3", "6", "9", "11", "37", "38", "39")
        if label in values
    }
    if kind == "2":
        book.set_up(name, line, numbers.get("3", 0.0))
    height = numbers.get("6", height)
    if "37" in numbers or "38" in numbers or "39" in numbers:
        book.point(name, numbers.get("38"), numbers.get("37"), numbers.get("39"), line)
    angles = {
        label: sexagesimal(values[label][0]) if dms else number(values[label][0])
        for label in _ANGLES
        if label in values
    }
    for face, (circle, zenith) in enumerate((("7", "8"), ("17", "18")), start=1):
        first = face == 1
        lengths = (numbers.get("9"), numbers.get("11")) if first else (None, None)
        found = (angles.get(circle), angles.get(zenith), *lengths)
        if kind == "5" and any(value is not None for value in found):
            at = values.get(circle, ("", line))[1]
            book.sight(Sight(name, at, *found, height=height, face=face))
    for label, (_, at) in values.items():
        if label not in ("2", "3", "5", "6", "9", "11", "37", "38", "39", *_ANGLES):
            book.leave_out(f"label {label}", at)
    return height
