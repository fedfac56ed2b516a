"""Carlson RW5 and TDS raw data: set-ups, sights, sets in both faces, coordinates.

``AR`` is the reading of the circle, whose reading at the backsight is ``BC``: a backsight that no record measures is a
sight with that reading. SP and OC coordinates are given unless an earlier set-up sighted the point; those of GNSS
points stand in the comment --GS that follows a GPS record. Lines that begin with -- are comments, also those that
repeat other records: means, checks and computed coordinates. Source: Carlson, *SurvCE RW5 Format*.
"""

from __future__ import annotations

import re
from pathlib import Path

from mor.formats.draft import Draft, number
from mor.formats.fieldbook.book import FieldBook, Sight, records, sexagesimal
from mor.project.file.nodes import Document

_SIGHTS = {"SS": 0, "TR": 0, "FS": 0, "BD": 1, "FD": 1, "BR": 2, "FR": 2}
"""Faces of the sights; 0 where the zenith angle tells."""
_KEYS = ("OP", "FP", "BP", "PN", "NM", "AR", "AL", "AZ", "DR", "DL", "ZE", "VA", "CE", "SD", "HD", "HI", "HR")
_MORE = ("BS", "BC", "BR", "AD", "UN", "SF", "EC", "EO", "AU", "EL", "DT", "TM", "N", "E")
_CELL = re.compile(rf"({'|'.join((*_KEYS, *_MORE))})\s*(.*)")
_GNSS = (
    "GNSS positions (latitude, longitude); their coordinates in the system of the job are read if it has them"
)
_UNITS = {0: 0.3048, 1: 1.0, 2: 1200.0 / 3937.0}
"""Metres of feet, metres, US survey feet."""


def read_rw5(path: Path) -> Document:
    """The project of an RW5 file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    reader = _Reader(FieldBook(draft))
    for line, text in records(path, draft):
        kind, _, rest = text.partition(",")
        try:
            reader.record(kind.strip(), rest, line)
        except ValueError as error:
            draft.problem(str(error), line)
    reader.close()
    reader.book.finish(reader.title or path.stem)
    return draft.finish()


def _cells(text: str) -> dict[str, str]:
    """Values by their keys; what follows ``--`` is a note."""
    found = {}
    for cell in text.partition(",--")[0].split(","):
        match = _CELL.match(cell.strip())
        if match:
            found[match[1]] = match[2].strip()
    return found


class _Reader:
    """State of an RW5 file; each value holds until another record changes it."""

    def __init__(self, book: FieldBook) -> None:
        self.book = book
        self.title = ""
        self.metres = 1.0
        self.station, self.height, self.target = "", 0.0, 0.0
        self.backsight: tuple[str, float, int] = ("", 0.0, 0)
        """Point, reading of the circle and line of the last BK."""
        self.begun = False
        self.gnss = False
        """True in the comments of a GPS record."""

    def record(self, kind: str, text: str, line: int) -> None:
        """One record."""
        cells = _cells(text)
        if kind == "--GS" and self.gnss:
            self._gnss_point(cells, line)
        elif kind == "JB":
            self.title = cells.get("NM", "")
        elif kind == "MO":
            self._mode(cells, line)
        elif kind in ("OC", "SP"):
            self._point(kind, cells, line)
        elif kind == "BK":
            self.close()
            self.station = cells.get("OP") or self.station
            self.backsight = (cells.get("BP", ""), self._angle(cells.get("BC") or "0"), line)
        elif kind == "LS":
            height = self._length(cells, "HI")
            if height is not None and height != self.height:
                self.close()
                self.height = height
            self.target = self._length(cells, "HR", self.target) or 0.0
        elif kind in _SIGHTS:
            self._sight(kind, cells, line)
        elif kind.strip():
            gnss = kind in ("GPS", "BP")
            self.gnss = kind == "GPS" or (self.gnss and kind.startswith("--"))
            what = "comments" if kind.startswith("--") else _GNSS if gnss else f"records {kind[:4]}"
            self.book.leave_out(what, line)

    def close(self) -> None:
        """End a set-up: where its backsight was not measured, it was read when the circle was set."""
        point, circle, line = self.backsight
        if self.begun and point and point != self.station:
            self.book.backsight(self.book.set_ups[-1], Sight(point, line, circle, face=1))
        self.begun = False

    def _gnss_point(self, cells: dict[str, str], line: int) -> None:
        """Coordinates of a GNSS point in the system of the job."""
        self.gnss = False
        try:
            east, north, height = (self._length(cells, key) for key in ("E", "N", "EL"))
        except ValueError:
            self.book.leave_out("comments", line)
            return
        if cells.get("PN"):
            self.book.point(cells["PN"], east, north, height, line)

    def _mode(self, cells: dict[str, str], line: int) -> None:
        unit = number(cells.get("UN") or "1")
        if unit not in _UNITS:
            raise ValueError(f"found UN{cells['UN']}, expected 0 (feet), 1 (metres) or 2 (US survey feet)")
        self.metres = _UNITS[int(unit)]
        self.book.angle = "gon" if number(cells.get("AU") or "0") == 1 else "deg"
        scale, offset = number(cells.get("SF") or "1"), number(cells.get("EO") or "0")
        if scale != 1.0:
            self.book.draft.note(f"the scale factor {scale:g} of the job is not applied to distances", line)
        if offset:
            self.book.draft.note(f"the EDM offset {offset:g} of the job is not applied to distances", line)

    def _point(self, kind: str, cells: dict[str, str], line: int) -> None:
        name = cells.get("OP") or cells.get("PN") or ""
        if not name:
            raise ValueError(f"found no point in {kind}")
        if kind == "OC":
            self.close()
            self.station, self.backsight = name, ("", 0.0, 0)
        east, north, height = (self._length(cells, key) for key in ("E", "N", "EL"))
        self.book.station_point(name, east, north, height, line)

    def _length(self, cells: dict[str, str], key: str, default: float | None = None) -> float | None:
        text = cells.get(key, "")
        return number(text) * self.metres if text else default

    def _angle(self, text: str) -> float:
        return number(text) if self.book.angle == "gon" else sexagesimal(text)

    def _sight(self, kind: str, cells: dict[str, str], line: int) -> None:
        target, station = cells.get("FP", ""), cells.get("OP") or self.station
        if not target or not station:
            raise ValueError(f"found no {'FP' if not target else 'OP'} in {kind}")
        if self.begun and station != self.station:
            self.close()
        self.station = station
        if not self.begun:
            self.book.set_up(station, line, self.height)
            self.begun = True
        slope, horizontal = (self._length(cells, key) or None for key in ("SD", "HD"))
        circle, zenith = self._circle(cells), self._zenith(cells)
        if "CE" in cells:
            self.book.leave_out("differences of height (CE)", line)
        if circle is None and zenith is None and slope is None and horizontal is None:
            self.book.leave_out("sights without readings", line)
            return
        face = _SIGHTS[kind]
        self.book.sight(Sight(target, line, circle, zenith, slope, horizontal, self.target, face))

    def _circle(self, cells: dict[str, str]) -> float | None:
        """Reading of the circle; angles to the left and deflections are turned into it, azimuths are none."""
        full = 400.0 if self.book.angle == "gon" else 360.0
        start = self.backsight[1]
        turns = {
            "AR": (0.0, 1.0),
            "AL": (start, -1.0),
            "DR": (start + full / 2, 1.0),
            "DL": (start + full / 2, -1.0),
        }
        for key, (zero, sign) in turns.items():
            if cells.get(key):
                return (zero + sign * self._angle(cells[key])) % full
        return None

    def _zenith(self, cells: dict[str, str]) -> float | None:
        if cells.get("ZE"):
            return self._angle(cells["ZE"])
        if cells.get("VA"):
            return (100.0 if self.book.angle == "gon" else 90.0) - self._angle(cells["VA"])
        return None
