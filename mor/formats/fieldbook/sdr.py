"""Sokkia SDR33: records of a type, an origin and fields of 16 letters (SDR20: of 4 and 10).

Types: 00 head with the units, 01 instrument, 02 station, 03 target height, 06 scale, 07 back bearing, 08 coordinates,
09 observation (F1, F2: face), 10 job, 11 reduced observation, 13 note (Sokkia, "SDR file format").

The origin tells raw from derived: KI coordinates were keyed in, CO copied from another job; all others (TP topography,
RS resection, TR traverse, SO setting out, …) were computed. 09F1 and 09F2 are readings, 09MC and 11 are reduced.
Spectra instruments write the readings of a resection as notes 13F1 and 13F2 before the station that follows from them.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

from mor.formats.draft import Draft, number
from mor.formats.fieldbook.book import FieldBook, Sight, records
from mor.project.file.nodes import Document

_LEFT_OUT = {
    "01": "instrument records",
    "06": "scale records",
    "07": "back bearings: the reading stands among the observations, too",
    "10": "job records",
    "11": "reduced observations",
    "13": "notes",
}
_REDUCED = "observations reduced by the instrument (MC)"
_GIVEN = ("KI", "CO")
"""Origins of coordinates that were not computed from readings."""
_END = "0000"
_UNITS = slice(40, 46)
"""Columns of the digits of the units in the head."""
_METRES = {"1": 1.0, "2": 0.3048, "3": 1200.0 / 3937.0}


def read_sdr(path: Path) -> Document:
    """The project of an SDR33 file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    reader = _Reader(FieldBook(draft))
    for line, text in records(path, draft):
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
        self.resection = 0
        """Line where a resection began that no station record ended yet."""

    def record(self, text: str, line: int) -> None:
        """One record."""
        kind, origin = text[:2], text[2:4]
        if text.strip() == _END:
            return
        if kind == "00":
            self._head(text, line)
        elif kind == "02":
            self._station(text, line)
        elif kind == "03":
            self.height = self._length(text[4 : 4 + self.number_width]) or 0.0
        elif kind == "08":
            name, *place = self._fields(text, 1, 3)
            add = self.book.point if origin in _GIVEN else self.book.computed_point
            add(name, *self._place(place), line)
        elif kind in ("09", "13") and origin in ("F1", "F2"):
            self._sight(text, line)
        elif kind == "09":
            self.book.leave_out(_REDUCED, line)
        else:
            if kind == "13" and "resection" in text.lower():
                self.book.forget_waiting("sights of a resection that was begun anew")
                self.resection = line
            self.book.leave_out(_LEFT_OUT.get(kind, f"records {kind}"), line)

    def _station(self, text: str, line: int) -> None:
        name, *place, height = self._fields(text, 1, 4)
        self.book.set_up(
            name, line, self._length(height) or 0.0, self._place(place), resection=self.resection
        )
        self.resection = 0

    def _head(self, text: str, line: int) -> None:
        """Name and version, date, and a digit each: angles, lengths, pressure, temperature, order of coordinates."""
        digits = text[_UNITS].strip()
        if not digits.isdecimal() or len(digits) < 5:
            digits = text.rstrip()[-6:]
        if not digits.isdecimal() or len(digits) < 5:
            raise ValueError(f"found {digits!r} in columns 41 to 46, expected the digits of the units")
        if "SDR33" not in text:
            self.width, self.number_width = 4, 10
        if digits[0] not in "12":
            raise ValueError(f"found angles of kind {digits[0]}, expected 1 (degrees) or 2 (gon)")
        if digits[1] not in _METRES:
            raise ValueError(f"found lengths of kind {digits[1]}, expected 1 (metres), 2 or 3 (feet)")
        self.book.angle = "deg" if digits[0] == "1" else "gon"
        self.metres = _METRES[digits[1]]
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

    def _sight(self, text: str, line: int) -> None:
        station, target, slope, zenith, horizontal = self._fields(text, 2, 3)
        sight = Sight(
            target,
            line,
            number(horizontal) if horizontal else None,
            number(zenith) if zenith else None,
            self._length(slope) or None,
            height=self.height,
            face=2 if text[2:4] == "F2" else 1,
        )
        if text[:2] == "13":
            self.book.wait(sight)
            return
        current = self.book.set_ups[-1].station if self.book.set_ups else ""
        if station != current:
            self.book.set_up(station, line)
        self.book.sight(sight)
