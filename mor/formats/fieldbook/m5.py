"""Zeiss and Trimble M5: an address, a point or text, and three values with their units, in columns between bars.

SD slope distance, HD horizontal distance, Hz circle, V1 zenith angle, Y east, X north, Z height, th and ih heights of
target and instrument (Trimble, "M5 data format").

A stationing (TI … STAT) is recorded as its sights, then the station (PI1 S name), then the turn of the circle (Om) and
the instrument height; the sights that follow read the turned circle. Coordinates of a point that was sighted are
computed.
"""

from __future__ import annotations

import re
from pathlib import Path

from mor.formats.draft import Draft, number
from mor.formats.fieldbook.book import FieldBook, Sight, records, sexagesimal
from mor.project.file.nodes import Document

_VALUE = re.compile(r"^(\S+?)_?\s+(-?[\d.]+)\s*(\S*)$")
_KNOWN = ("SD", "HD", "Hz", "V1", "Y", "X", "Z", "th", "ih")


def read_m5(path: Path) -> Document:
    """The project of an M5 file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    reader = _Reader(FieldBook(draft, stations_follow=True))
    for line, text in records(path, draft):
        cells = text.split("|")
        if not text.strip():
            continue
        if text.split()[0].upper() == "END" and len(cells) == 1:
            continue
        if len(cells) < 4 or not cells[0].startswith("For"):
            draft.problem(f"found {text[:20]!r}, expected For M5|Adr …|…", line)
            continue
        try:
            reader.record(cells[2], cells[3:6], line)
        except ValueError as error:
            draft.problem(str(error), line)
    reader.book.finish(path.stem)
    return draft.finish()


class _Reader:
    """The heights of target and instrument, and whether a stationing is under way."""

    def __init__(self, book: FieldBook) -> None:
        self.book = book
        self.target, self.instrument = 0.0, 0.0
        self.stationing = False
        self.sighted: set[str] = set()

    def record(self, what: str, cells: list[str], line: int) -> None:
        """One line."""
        values = self._values(cells, line)
        kind, *words = what.split()
        if kind.startswith("TI"):
            self._text(words, values, line)
        elif kind.startswith("PI"):
            self._point(words, values, line)
        else:
            self.book.leave_out(f"records {kind}", line)

    def _values(self, cells: list[str], line: int) -> dict[str, tuple[float, str]]:
        values = {}
        for cell in cells:
            match = _VALUE.match(cell.strip())
            if match is None:
                if cell.strip():
                    self.book.leave_out(f"value {cell.split()[0]}", line)
                continue
            name, text, unit = match[1], match[2], match[3]
            if unit == "DMS":
                values[name] = sexagesimal(text), "deg"
            elif unit.lower() in ("gon", "deg", "m"):
                values[name] = number(text), unit.lower()
            elif name in _KNOWN:
                raise ValueError(f"found {name} in {unit!r}, expected m, gon, deg or DMS")
            else:
                self.book.leave_out(f"value {name}", line)
        return values

    def _text(self, words: list[str], values: dict[str, tuple[float, str]], line: int) -> None:
        if "STAT" in words:
            self.book.forget_waiting("sights of a stationing that was begun anew")
            self.stationing = True
        self.target = values.get("th", (self.target, ""))[0]
        if "ih" in values:
            self.instrument = values["ih"][0]
            if not self.stationing:
                self.book.instrument_height(self.instrument, line)
        if not {"th", "ih"} & set(values):
            self.book.leave_out("texts of the program", line)

    def _point(self, words: list[str], values: dict[str, tuple[float, str]], line: int) -> None:
        if not words:
            raise ValueError("found no name of a point")
        name = words[-1]
        if {"Y", "X"} & set(values):
            if "S" in words[:-1]:
                self._station(name, values, line)
            elif name in self.sighted:
                self.book.computed_point(name, *_place(values), line)
            else:
                self.book.point(name, *_place(values), line)
        elif {"Hz", "V1", "SD", "HD"} & set(values):
            self._sight(name, values, line)
        else:
            self.book.leave_out("points without readings or coordinates", line)

    def _station(self, name: str, values: dict[str, tuple[float, str]], line: int) -> None:
        self.book.set_up(name, line, self.instrument, _place(values))
        self.stationing = False

    def _sight(self, name: str, values: dict[str, tuple[float, str]], line: int) -> None:
        for key in ("Hz", "V1"):
            if key in values:
                self.book.angle = "gon" if values[key][1] == "gon" else "deg"
        slope = values.get("SD", (None,))[0]
        sight = Sight(
            name,
            line,
            values.get("Hz", (None,))[0],
            values.get("V1", (None,))[0],
            slope or None,
            values.get("HD", (None,))[0] if "SD" not in values else None,
            height=self.target,
        )
        self.sighted.add(name)
        if self.stationing:
            self.book.wait(sight)
        else:
            self.book.sight(sight)


def _place(values: dict[str, tuple[float, str]]) -> tuple[float | None, float | None, float | None]:
    """East, north, height."""
    east, north, up = (values[axis][0] if axis in values else None for axis in "YXZ")
    return east, north, up
