"""Leica GSI-8 and GSI-16: words of an index, information and a value; a line is a block.

Word index: 11 point or code block, 21 horizontal circle, 22 zenith, 31 slope, 32 horizontal, 33 height difference, 41
code, 42 … 49 and 71 … 79 information, 51 ppm and prism constant, 58 prism constant, 81 82 83 east, north, height of the
target, 84 85 86 of the station, 87 height of the target, 88 of the instrument (Leica, "GSI ONLINE", 2002).
"""

from __future__ import annotations

import re
from pathlib import Path

from mor.formats.draft import Draft
from mor.formats.fieldbook.book import FieldBook, Sight, sexagesimal
from mor.formats.text import read_lines
from mor.project.file.nodes import Document

_WORD = re.compile(r"^(\d\d)([\d.]{4})([+-])(.+)$")
_LENGTHS = {"0": 1e-3, "1": 1e-3 * 0.3048, "6": 1e-4, "7": 1e-4 * 0.3048, "8": 1e-5}
"""Metres per last digit, by the unit of a word."""
_NAMES = {
    "32": "horizontal distance",
    "33": "height difference",
    "41": "code block",
    "51": "ppm and prism constant",
    "58": "prism constant",
}


def read_gsi(path: Path) -> Document:
    """The project of a GSI file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    book = FieldBook(draft)
    for line, text in enumerate(read_lines(path, draft), start=1):
        words = _words(text, line, draft)
        if words:
            _block(words, line, book)
    book.finish(path.stem)
    return draft.finish()


Words = dict[str, tuple[str, str]]
"""Information and signed value by word index."""


def _words(text: str, line: int, draft: Draft) -> Words:
    words: Words = {}
    for word in text.replace("*", " ").split():
        match = _WORD.match(word)
        if match is None:
            draft.problem(f"found {word!r}, expected words like 21.322+12345600", line)
            return {}
        words[match[1]] = match[2], match[3] + match[4]
    return words


def _name(words: Words) -> str:
    """Name of the point of a block, without leading zeros."""
    text = words["11"][1][1:]
    return text.lstrip("0") or "0"


def _block(words: Words, line: int, book: FieldBook) -> None:
    if "11" not in words:
        book.leave_out(_NAMES.get(next(iter(words)), f"word {next(iter(words))}"), line)
        return
    name = _name(words)
    try:
        _station(name, words, line, book)
        _target(name, words, line, book)
    except ValueError as error:
        book.draft.problem(str(error), line)
        return
    for index in words:
        if index not in _READ:
            book.leave_out(_NAMES.get(index, f"word {index}"), line)


_READ = ("11", "21", "22", "31", "81", "82", "83", "84", "85", "86", "87", "88")


def _station(name: str, words: Words, line: int, book: FieldBook) -> None:
    """A block with the coordinates of the station, or its instrument height without readings, begins a set-up."""
    if "21" in words:
        return
    if {"84", "85"} <= set(words) or "88" in words:
        book.set_up(name, line, _length(words, "88", line, book) or 0.0)
    if {"84", "85"} <= set(words):
        east, north, height = (_length(words, index, line, book) for index in ("84", "85", "86"))
        book.point(name, east, north, height, line)


def _target(name: str, words: Words, line: int, book: FieldBook) -> None:
    if "21" in words or "22" in words or "31" in words:
        hz, zenith = (_angle(words, index, book) for index in ("21", "22"))
        slope = _length(words, "31", line, book)
        height = _length(words, "87", line, book) or 0.0
        book.sight(Sight(name, line, hz, zenith, slope or None, height=height))
    if {"81", "82"} <= set(words):
        east, north, up = (_length(words, index, line, book) for index in ("81", "82", "83"))
        if "21" in words:
            book.leave_out("coordinates that the instrument computed from its readings", line)
        else:
            book.point(name, east, north, up, line)


def _digits(words: Words, index: str) -> int | None:
    text = words[index][1]
    digits = text[1:]
    if not digits.isdecimal() or not digits.isascii():
        return None
    return int(digits) * (-1 if text[0] == "-" else 1)


def _length(words: Words, index: str, line: int, book: FieldBook) -> float | None:
    if index not in words:
        return None
    unit = words[index][0][3]
    if unit not in _LENGTHS:
        raise ValueError(
            f"word {index}: found unit {unit!r}, expected a unit of lengths ({', '.join(_LENGTHS)})"
        )
    digits = _digits(words, index)
    if digits is None:
        book.leave_out(f"word {index} that is no number", line)
        return None
    if unit in "068":
        return digits / {"0": 1e3, "6": 1e4, "8": 1e5}[unit]
    return digits * _LENGTHS[unit]


def _angle(words: Words, index: str, book: FieldBook) -> float | None:
    if index not in words:
        return None
    unit, digits = words[index][0][3], _digits(words, index)
    if digits is None:
        raise ValueError(f"word {index}: found {words[index][1]!r}, expected digits")
    if unit not in "2345":
        raise ValueError(
            f"word {index}: found unit {unit!r}, expected a unit of angles (2 gon, 3 deg, 4 dms, 5 mil)"
        )
    _choose_unit(book, "gon" if unit == "2" else "deg")
    if unit == "4":
        return sexagesimal(f"{digits // 100000}.{digits % 100000:05d}")
    value = digits / 1e5
    degrees = value if unit in "23" else value * 360.0 / 6400.0
    return degrees if book.angle == ("gon" if unit == "2" else "deg") else _other(degrees, book.angle)


def _choose_unit(book: FieldBook, unit: str) -> None:
    if not any(set_up.sights for set_up in book.set_ups):
        book.angle = unit


def _other(value: float, unit: str) -> float:
    return value * 0.9 if unit == "deg" else value / 0.9
