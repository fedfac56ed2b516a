"""Leica GSI-8 and GSI-16: words of an index, information and a value; a block of words describes a point or a code.

Word index: 11 point, 21 horizontal circle, 22 zenith, 31 slope, 32 horizontal distance, 33 height difference, 41 code,
42 to 49 and 71 to 79 information, 51 ppm and prism constant, 58 prism constant, 81 82 83 east, north, height of the
target, 84 85 86 of the station, 87 height of the target, 88 of the instrument; 25 is what the circle was turned by when
the station was recorded (Leica, "GSI ONLINE", 2002).

Levels write 331 to 336 staff readings with the distance in 32, 83 height, 571 to 574 sums; a code block with ``?``
begins a line. A block 505 to 514 ends it: 509 is its benchmark with the height 510, and the last point 512, if that is
a number and has nearly the same height 513, is this benchmark again.

A block begins with word 11 or 41; a line has one or several. Instruments record a station before or after its sights:
after a resection or a backsight the station follows. Blocks of readings have 81 to 83 if the station was known.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from mor.formats.draft import Draft, parse_number
from mor.formats.fieldbook.book import AGREES, FieldBook, Place, PointRecord, Sight, records, sexagesimal
from mor.project.document import Document
from mor.project.levelling import StaffReading

_WORD = re.compile(r"^(\d\d)([\d.]{0,4})([+-])(.+)$")
_LENGTHS = {"0": 1e-3, "1": 1e-3 * 0.3048, "6": 1e-4, "7": 1e-4 * 0.3048, "8": 1e-5}
"""Metres per last digit, by the unit of a word."""
_NAMES = {
    "32": "horizontal distance",
    "33": "height difference",
    "41": "code block",
    "51": "ppm and prism constant",
    "58": "prism constant",
}

Words = dict[str, tuple[str, str]]
"""Information and signed value by word index."""


class _GsiBlock(NamedTuple):
    words: Words
    line: int

    @property
    def code(self) -> str:
        return _plain(self.words["41"][1]) if "41" in self.words else ""

    @property
    def level(self) -> str:
        """Kind of a staff reading: the third digit of the words 330 to 336, empty for other blocks."""
        return self.words.get("33", ("....", ""))[0][0].strip(".")

    @property
    def readings(self) -> bool:
        return not self.level and bool({"21", "22", "31"} & set(self.words))


def read_gsi(path: Path) -> Document:
    """The project of a GSI file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    book = FieldBook(draft, stations_follow=True)
    blocks = [block for line, text in records(path, draft) for block in _blocks(text, line, draft)]
    reader = _GsiReader(book, blocks)
    for block in blocks:
        with draft.at(block.line):
            reader.block(block)
    book.finish(path.stem)
    return draft.finish()


def _blocks(text: str, line: int, draft: Draft) -> Iterator[_GsiBlock]:
    """The blocks of a line; lines that begin with ! are comments."""
    if text.startswith("!"):
        return
    words: Words = {}
    for word in text.replace("*", " ").split():
        match = _WORD.match(word)
        last = next(reversed(words), "")
        if match is None and last and (last[0] in "14" or not words[last][1][1:].isdecimal()):
            words[last] = words[last][0], f"{words[last][1]} {word}"  # a name or a text with a blank
            continue
        if match is None:
            draft.problem(f"found {word!r}, expected words like 21.322+12345600", line)
            return
        if match[1] in ("11", "41") and words:
            yield _GsiBlock(words, line)
            words = {}
        index = match[1] + match[2][:1] if match[1] in ("50", "51") and match[2][:1].isdigit() else match[1]
        words[index] = match[2].rjust(4, "."), match[3] + match[4]
    if words:
        yield _GsiBlock(words, line)


def _plain(value: str) -> str:
    """A name or a code without its sign and leading zeros."""
    return value[1:].lstrip("0") or "0"


def _millimetres(value: str) -> float | None:
    return int(value) * 1e-3 if value[1:].isdecimal() and value[1:].isascii() else None


def _station_codes(blocks: list[_GsiBlock]) -> set[str]:
    """Codes whose blocks open set-ups: all of them have a point and an instrument height.

    A code of unknown meaning counts if its stations are targets, too. It also counts if it is the only one before all
    readings, and two or more readings follow each of its blocks.
    """
    targets = {_plain(block.words["11"][1]) for block in blocks if "11" in block.words and block.readings}
    recorded = any({"84", "88"} & set(block.words) and not block.readings for block in blocks)
    found: dict[str, list[bool]] = {}
    heights: dict[str, list[float]] = {}
    places: dict[str, list[int]] = {}
    # Programs of many offices share 2 and 21: 42 point, 43 instrument height (mm), 44 target height.
    named, readings = {"2", "21"}, 0
    for block in blocks:
        readings += block.readings
        if not block.code or not targets:
            continue
        height = _millimetres(block.words["43"][1]) if "43" in block.words else None
        named_station = "42" in block.words and _plain(block.words["42"][1]) != "0"
        fits = named_station and height is not None and 0.0 <= height < 3.0  # metres above a point
        found.setdefault(block.code, []).append(fits)
        heights.setdefault(block.code, []).append(height or 0.0)
        places.setdefault(block.code, []).append(readings)
        if fits and _plain(block.words["42"][1]) in targets:
            named.add(block.code)
    if recorded:
        return set()
    fitting = {code for code, fits in found.items() if all(fits)}
    first = {
        code
        for code in fitting
        if places[code][0] == 0
        and min(heights[code]) > 0.5  # metres: an instrument on a tripod is higher
        and all(after - before > 1 for before, after in pairwise((*places[code], readings)))
    }
    return fitting & named or (first if len(first) == 1 else set())


class _GsiReader:
    """The code blocks that open set-ups, the station that blocks of readings repeat, and the target height."""

    def __init__(self, book: FieldBook, blocks: list[_GsiBlock]) -> None:
        self.book = book
        self.codes = _station_codes(blocks)
        self.heights_in_codes = not any("87" in block.words for block in blocks)
        self.levels = any(block.level for block in blocks)
        self.target = 0.0
        """Height of the target, which holds until another one is recorded."""
        self.station: tuple[float | None, ...] = ()
        """Coordinates of the open set-up as its last record has them."""
        self.sighted = ""
        if self.codes:
            first = next(block for block in blocks if block.code in self.codes)
            words = ", ".join(sorted(self.codes))
            book.draft.note(
                f"code blocks {words} open set-ups: 42 is the station, 43 the instrument height", first.line
            )

    def block(self, block: _GsiBlock) -> None:
        words, line = block
        if self.levels and "?" in words.get("41", ("", ""))[1]:
            self.book.levelling.begin()
        elif block.code:
            self._code(block)
        elif {"509", "512"} <= set(words):
            heights = [_length(words, name, line, self.book) for name in ("510", "513")]
            self.book.levelling.close_at(_plain(words["512"][1]), _plain(words["509"][1]), *heights)
        elif "11" not in words:
            self.book.leave_out(_NAMES.get(next(iter(words)), f"word {next(iter(words))}"), line)
        elif block.level:
            self._staff(_plain(words["11"][1]), block)
        elif self.levels and not block.readings:
            height = _length(words, "83", line, self.book)
            if height is None:
                self.book.leave_out("level blocks without a reading", line)
            else:
                self.book.level_height(_plain(words["11"][1]), height, line)
        else:
            name = _plain(words["11"][1])
            if block.readings:
                self._sight(name, words, line)
            else:
                self._station_record(name, words, line)
            self._coordinates(name, block)
            read = ("11", "21", "22", "25", "31", "81", "82", "83", "84", "85", "86", "87", "88")
            for index in words:
                if index not in read and not (index == "32" and "31" not in words):
                    self.book.leave_out(_NAMES.get(index, f"word {index}"), line)

    def _staff(self, name: str, block: _GsiBlock) -> None:
        """A staff reading: 331 and 335 are back, 332 and 336 forward, 333 an intermediate sight."""
        words, line = block
        value = _length(words, "33", line, self.book)
        levelling = self.book.levelling
        sight = {
            **dict.fromkeys("15", levelling.sight_back),
            **dict.fromkeys("26", levelling.sight_forward),
            "3": levelling.sight_between,
        }.get(block.level)
        if sight is None or value is None:
            self.book.leave_out("staff readings outside a line", line)
        else:
            sight(StaffReading(name, value, _length(words, "32", line, self.book), line))

    def _code(self, block: _GsiBlock) -> None:
        words, line = block
        if block.code in self.codes:
            height = _millimetres(words["43"][1]) or 0.0
            self.book.set_up(_plain(words["42"][1]), line, height)
            self.station = ()
            if "44" in words:
                self.target = _millimetres(words["44"][1]) or 0.0
        elif block.code == "3" and self.codes and self.heights_in_codes and "42" in words:  # a new target height, mm
            self.target = _millimetres(words["42"][1]) or 0.0
        else:
            self.book.leave_out(_NAMES["41"], line)

    def _place(self, words: Words, line: int, first: int) -> Place:
        east, north, up = (_length(words, str(index), line, self.book) for index in range(first, first + 3))
        return east, north, up

    def _station_record(self, name: str, words: Words, line: int) -> None:
        """A block without readings that has coordinates of the station, or an instrument height, opens a set-up."""
        located = {"84", "85"} <= set(words)
        if not located and "88" not in words:
            return
        place = self._place(words, line, 84) if located else None
        height = _length(words, "88", line, self.book) or 0.0
        self._target_height(words, line)
        set_up = self.book.set_up(name, line, height, place, claims=True)
        if "25" in words:
            set_up.turn = _angle(words, "25", self.book)
        self.station, self.sighted = place or (), ""

    def _target_height(self, words: Words, line: int) -> None:
        height = _length(words, "87", line, self.book)
        self.target = self.target if height is None else height

    def _sight(self, name: str, words: Words, line: int) -> None:
        if {"84", "85"} <= set(words):
            self._repeated_station(self._place(words, line, 84), line)
        height = _length(words, "88", line, self.book)
        if height is not None:
            self.book.instrument_height(height, line)
        self._target_height(words, line)
        slope = _length(words, "31", line, self.book)
        sight = Sight(
            name,
            line,
            _angle(words, "21", self.book),
            _angle(words, "22", self.book),
            slope or None,
            None if "31" in words else _length(words, "32", line, self.book) or None,
            self.target,
        )
        self.book.sight(sight)
        self.sighted = name
        if not {"81", "82"} & set(words):
            self.book.unlocated.add(line)
        else:
            self._correct_unit(self._place(words, line, 81), self.book.polar(sight))

    def _correct_unit(self, target: Place, polar: tuple[float, float] | None) -> None:
        """Divide coordinates of the station by 10 or 100 if only then the computed ones of a target fit the distance.

        Format files may write another number of decimals than the unit that they write says.
        """
        station = self.book.set_ups[-1].station if self.book.set_ups else ""
        place = self.book.points.get(station)
        if place is None or polar is None or None in (*place[:2], *target[:2]) or not any(target):
            return
        plan, end = complex(place.east or 0.0, place.north or 0.0), complex(target[0] or 0.0, target[1] or 0.0)
        for factor in (1.0, 10.0, 100.0):
            if abs(abs(plan / factor - end) - polar[0]) < AGREES:
                break
        else:
            return
        if factor > 1.0:
            self.book.points[station] = place._replace(east=plan.real / factor, north=plan.imag / factor)
            self.book.draft.note(
                f"the coordinates of {station!r} are {factor:g} times those from which the instrument computed its "
                "targets: they are divided by it",
                place.line,
            )

    def _repeated_station(self, place: tuple[float | None, ...], line: int) -> None:
        """Coordinates of the station in a block of readings: others than those of the open set-up open one."""
        if place == self.station or not any(place):
            return
        known = [name for name, point in self.book.points.items() if point[:3] == place]
        if self.station or not self.book.set_ups:
            name = known[0] if known else f"station {1 + len(self.book.set_ups)}"
            self.book.set_up(name, line, place=(place[0], place[1], place[2]))
        self.station = place

    def _coordinates(self, name: str, block: _GsiBlock) -> None:
        """Coordinates in a block of readings, or right after it, are computed; others are given."""
        if not {"81", "82", "83"} & set(block.words):
            return
        place = PointRecord(*self._place(block.words, block.line, 81), block.line)
        if block.readings or self.sighted == name:
            self.book.computed_point(name, *place)
        else:
            self.book.point(name, *place)
        self.sighted = name if block.readings else ""


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
    if unit == ".":  # a word without a unit has that of the other lengths of its block
        unit = next((info[3] for other, (info, _) in words.items() if other[0] in "38" and info[3] in _LENGTHS), ".")
    if unit not in _LENGTHS:
        raise ValueError(f"word {index}: found unit {unit!r}, expected a unit of lengths ({', '.join(_LENGTHS)})")
    text = words[index][1]
    if "." in text and unit in "068":  # some format files write millimetres with a decimal point
        return parse_number(text) / 1e3
    digits = _digits(words, index)
    if digits is None:
        book.leave_out(f"word {index} that is not a number", line)
        return None
    if unit in "068":
        return digits / {"0": 1e3, "6": 1e4, "8": 1e5}[unit]
    return digits * _LENGTHS[unit]


def _angle(words: Words, index: str, book: FieldBook) -> float | None:
    if index not in words:
        return None
    unit, (whole, point, part) = words[index][0][3], words[index][1].partition(".")
    if point and unit == "4":  # seconds with a decimal point
        _choose_unit(book, "deg")
        return sexagesimal(f"{whole[:-4]}.{whole[-4:]}{part}")
    digits = _digits(words, index)
    if digits is None:
        raise ValueError(f"word {index}: found {words[index][1]!r}, expected digits")
    if unit not in "2345":
        raise ValueError(f"word {index}: found unit {unit!r}, expected a unit of angles (2 gon, 3 deg, 4 dms, 5 mil)")
    _choose_unit(book, "gon" if unit == "2" else "deg")
    if unit == "4":
        return sexagesimal(f"{'-' * (digits < 0)}{abs(digits) // 100000}.{abs(digits) % 100000:05d}")
    degrees = digits / 1e5 if unit in "23" else digits / 1e4 * 360.0 / 6400.0
    if book.angle == ("gon" if unit == "2" else "deg"):
        return degrees
    return degrees * 0.9 if book.angle == "deg" else degrees / 0.9


def _choose_unit(book: FieldBook, unit: str) -> None:
    if not book.waiting and not any(set_up.sights for set_up in book.set_ups):
        book.angle = unit
