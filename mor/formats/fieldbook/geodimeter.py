"""Geodimeter ARE and JOB: a number and a value a line.

2 station, 62 reference object, 5 point, 3 instrument height, 6 target height, 4 code, 23 units; 7 horizontal and 8
zenith reading, 17 and 18 in face two, 24 and 25 in face one, 9 slope, 11 horizontal distance, 37 north, 38 east, 39
height (Geodimeter, "Labels"). 7 and 8 are the means of both faces if 24 and 25 are there. Coordinates of a point with
readings are computed; those of a station, a reference object and of a point without readings are given.

The first digit of 23 tells the unit of angles (1 gon, 2 degrees, minutes and seconds, 3 decimal degrees). Without it
angles are ddd.mmss if every one of them may be, gon otherwise.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

from mor.formats.draft import Draft, number
from mor.formats.fieldbook.book import FieldBook, Sight, records, sexagesimal
from mor.project.file.nodes import Document

_ANGLES = ("7", "8", "17", "18", "24", "25")
_BEGIN = ("2", "5", "62")
"""Labels of what follows: a station, a point, a reference object."""
Entry = tuple[str, str, int]
"""Label, value, line."""


def read_geodimeter(path: Path) -> Document:
    """The project of an ARE or JOB file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    book = FieldBook(draft)
    entries: list[Entry] = []
    for line, text in records(path, draft):
        label, sign, value = text.partition("=")
        if text.strip().upper() == "END":
            continue
        if text.strip() and not (sign and label.strip().isdecimal()):
            draft.problem(f"found {text.strip()!r}, expected a label and a value as in 5=P1", line)
        elif text.strip():
            entries.append((label.strip(), value.strip(), line))
    read = _angle_unit(entries, book)
    begin = [k for k, (label, _, _) in enumerate(entries) if label in _BEGIN]
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
    """Set the unit of angles and return True for degrees, minutes and seconds."""
    units = next((value for label, value, _ in entries if label == "23"), "")
    angles = [value for label, value, _ in entries if label in _ANGLES]
    try:
        largest = max((sexagesimal(value) for value in angles), default=0.0)
    except ValueError:
        largest = 400.0
    if units[:1] in ("1", "3"):
        book.angle = "gon" if units[0] == "1" else "deg"
        return False
    if largest <= 360.0:
        if angles and units[:1] != "2":
            book.draft.note(
                "angles are taken as degrees, minutes and seconds, as all of them may be", entries[0][2]
            )
        return True
    book.angle = "gon"
    book.draft.note("angles are taken as gon", entries[0][2])
    return False


_LENGTHS = ("3", "6", "9", "11", "37", "38", "39")
_NOTES = {"0": "notes", "4": "codes", "23": "units"}


def _thing(entries: list[Entry], book: FieldBook, dms: bool, height: float) -> float:
    """A station, reference object or point with all that follows it; returns the target height from here on."""
    values = {label: (value, line) for label, value, line in entries}
    kind, name, line = entries[0]
    numbers = {label: number(values[label][0]) for label in _LENGTHS if label in values}
    angles = {
        label: sexagesimal(values[label][0]) if dms else number(values[label][0])
        for label in _ANGLES
        if label in values
    }
    if kind == "2":
        book.set_up(name, line, numbers.get("3", 0.0))
    elif "3" in numbers:
        book.instrument_height(numbers["3"], line)
    height = numbers.get("6", height)
    first = ("24", "25") if {"24", "25"} & angles.keys() else ("7", "8")
    faces = (first, ("17", "18"))
    sights = []
    for face, (circle, zenith) in enumerate(faces, start=1):
        lengths = (numbers.get("9") or None, numbers.get("11") or None) if face == 1 else (None, None)
        found = (angles.get(circle), angles.get(zenith), *lengths)
        if kind == "5" and any(value is not None for value in found):
            at = values.get(circle, ("", line))[1]
            slope = found[2]
            plan = None if slope is not None else found[3]
            sights.append(Sight(name, at, found[0], found[1], slope, plan, height, face))
    if {"37", "38", "39"} & numbers.keys():
        add = book.computed_point if sights else book.station_point if kind == "2" else book.point
        add(name, numbers.get("38"), numbers.get("37"), numbers.get("39"), line)
    for sight in sights:
        book.sight(sight)
    used = {*_BEGIN, *_LENGTHS, *(label for pair in faces for label in pair)}
    for label, (_, at) in values.items():
        if label not in used:
            book.leave_out(_NOTES.get(label, f"label {label}"), at)
    return height
