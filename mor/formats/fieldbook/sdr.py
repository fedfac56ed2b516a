"""Sokkia SDR33: records of a type, an origin and fields of 16 letters (SDR20: of 4 and 10).

Types: 00 head with the units, 01 instrument, 02 station, 03 target height, 06 scale, 07 back bearing, 08 coordinates,
09 observation (F1, F2: face), 10 job, 13 note (Sokkia, "SDR file format").
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

from mor.formats.draft import Draft, number
from mor.formats.fieldbook.book import FieldBook, Sight
from mor.formats.text import read_lines
from mor.project.file.nodes import Document

_LEFT_OUT = {
    "01": "instrument records",
    "06": "scale records",
    "07": "back bearings: the reading stands among the observations, too",
    "10": "job records",
    "13": "notes",
}
_REDUCED = "observations reduced by the instrument (MC)"


def read_sdr(path: Path) -> Document:
    """The project of an SDR33 file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    reader = _Reader(FieldBook(draft))
    for line, text in enumerate(read_lines(path, draft), start=1):
        if text.strip():
            try:
                reader.record(text, line)
            except ValueError as error:
                draft.problem(str(error), line)
    reader.book.finish(path.stem)
    return draft.finish()


class _Reader:
    """Units, the order of coordinates, width of the names, and the height of the target."""

    def __init__(self, book: FieldBook) -> None:
        self.book = book
        self.width, self.number_width = 16, 16
        self.metres, self.east_first = 1.0, False
        self.height = 0.0

    def record(self, text: str, line: int) -> None:
        """One record."""
        kind, origin = text[:2], text[2:4]
        if kind == "00":
            self._head(text, line)
        elif kind == "02":
            name, *place, height = self._fields(text, 1, 4)
            east, north, up = self._place(place)
            self.book.set_up(name, line, self._length(height) or 0.0)
            self.book.point(name, east, north, up, line)
        elif kind == "03":
            self.height = self._length(text[4 : 4 + self.number_width]) or 0.0
        elif kind == "08":
            name, *place = self._fields(text, 1, 3)
            self.book.point(name, *self._place(place), line)
        elif kind == "09" and origin in ("F1", "F2"):
            self._sight(text, origin, line)
        elif kind == "09":
            self.book.leave_out(_REDUCED, line)
        else:
            self.book.leave_out(_LEFT_OUT.get(kind, f"records {kind}"), line)

    def _head(self, text: str, line: int) -> None:
        """Name and version, date, and a digit each: angles, lengths, pressure, temperature, order of coordinates."""
        digits = text.split()[-1]
        if not digits.isdecimal() or len(digits) < 5:
            raise ValueError(f"found {digits!r} at the end, expected the digits of the units")
        if "SDR33" not in text:
            self.width, self.number_width = 4, 10
        if digits[0] not in "12":
            raise ValueError(f"found angles of kind {digits[0]}, expected 1 (degrees) or 2 (gon)")
        self.book.angle = "deg" if digits[0] == "1" else "gon"
        self.metres = 1.0 if digits[1] == "1" else 0.3048
        self.east_first = digits[4] == "2"

    def _fields(self, text: str, names: int, numbers: int) -> list[str]:
        ends = [4 + self.width * k for k in range(names + 1)]
        ends += [ends[-1] + self.number_width * (k + 1) for k in range(numbers)]
        return [text[a:b].strip() for a, b in pairwise(ends)]

    def _length(self, text: str) -> float | None:
        return number(text.strip()) * self.metres if text.strip() else None

    def _place(self, fields: list[str]) -> tuple[float | None, float | None, float | None]:
        first, second, up = (self._length(text) for text in fields[:3])
        return (first, second, up) if self.east_first else (second, first, up)

    def _sight(self, text: str, origin: str, line: int) -> None:
        station, target, slope, zenith, horizontal = self._fields(text, 2, 3)
        current = self.book.set_ups[-1].station if self.book.set_ups else ""
        if station != current:
            self.book.set_up(station, line)
        self.book.sight(
            Sight(
                target,
                line,
                number(horizontal) if horizontal else None,
                number(zenith) if zenith else None,
                (self._length(slope) or None),
                height=self.height,
                face=2 if origin == "F2" else 1,
            )
        )
