"""Field books of comma-separated records: Nikon RAW, Topcon GTS-7 and GTS-6, Sokkia SCR."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable
from itertools import accumulate, pairwise
from pathlib import Path

from mor.errors import counted
from mor.formats.draft import Draft, parse_number
from mor.formats.fieldbook.book import FieldBook, InstrumentSetUp, Sight, may_be_sexagesimal, records, sexagesimal
from mor.project.document import Document
from mor.units import LENGTH_UNITS


def _optional(text: str) -> float | None:
    return parse_number(text) if text.strip() else None


def _cells(text: str, count: int) -> list[str]:
    cells = [cell.strip() for cell in text.split(",")]
    return cells + [""] * (count - len(cells))


def read_nikon(path: Path) -> Document:
    """The project of a Nikon or Ruide RAW file (version 2). Raises :class:`InputError` with every mistake found.

    CO comments with the units; UP, MP and MC given coordinates, CC and RE computed ones; ST station, backsight,
    instrument height, azimuth and circle reading of the backsight; CP control point, F1 F2 a sight in either face, SS
    side shot, SO point staked out: name, target height, slope, horizontal circle, zenith. The sights of a resection,
    which a comment begins, come before their station. ``Zero VA`` says where the vertical circle is 0: Zenith, Horizon
    (it counts upwards, 180° and more in face 2) or Compass (elevations of ±90° in both faces; Nikon, *DTM-322 manual*).

    The older list of a DTM-300 is read by :func:`_read_dtm300`.
    """
    draft = Draft(str(path))
    reader = _Nikon(FieldBook(draft))
    book = reader.book
    lines = list(records(path, draft))
    if lines and _DTM300.match(lines[0][1]):
        _read_dtm300(lines, book)
        book.finish(path.stem)
        return draft.finish()
    for line, text in lines:
        with draft.at(line):
            reader.record(text, line)
    reader.name_by_codes()
    for set_up, sight in reader.backsights:
        book.backsight(set_up, sight, turned=True)
    if _NO_ANGLES in book.skipped:
        for set_up in book.set_ups:
            for sight in set_up.sights:
                book.leave_out(_NO_ANGLES, sight.line)
            set_up.sights = []
    book.finish(path.stem)
    return draft.finish()


_NO_ANGLES = "all sights: angles of some of them are none in the unit that the head says"
_CIRCLE_SET = re.compile(r"^TI +(?:HOLD|Hz=0)")
"""Comments of a Trimble M3 when its circle was set."""
_INSTRUMENT_HEIGHT = re.compile(r"\bih\s+([\d.]+)\s*m\b")
_LETTERED = re.compile(r"[^\W\d_]+[-_ ]?(\d+)")
_BEFORE_HEIGHT = {"F1": 0, "F2": 0, "SS": 0, "SO": 1, "CP": 1}
"""Cells between the name and the target height, by record."""


class _Nikon:
    """The units of the head, and the stationing that is under way."""

    def __init__(self, book: FieldBook) -> None:
        self.book = book
        self.state = {"angle units": "DDDMMSS", "coord order": "NEZ", "dist units": "Metres", "zero va": "Zenith"}
        self.height = 0.0
        """Height of the target, which holds until another one is recorded."""
        self.resection = 0
        """Line where a resection began that no station record ended yet."""
        self.backsights: list[tuple[InstrumentSetUp, Sight]] = []
        self.codes: dict[int, str] = {}
        """Codes of the sights by their lines."""

    def name_by_codes(self) -> None:
        """Name the sights to stations by their codes if the names of all sights are running numbers.

        A code is letters and the name of the station. Other sights whose number is the name of a station are to other
        points.
        """
        stations = {set_up.station for set_up in self.book.set_ups}
        names = [sight.target for set_up in self.book.set_ups for sight in set_up.sights]
        named = {line: match[1] for line, code in self.codes.items() if (match := _LETTERED.fullmatch(code))}
        named = {line: name for line, name in named.items() if name in stations}
        running = all(map(str.isdecimal, names)) and all(int(a) < int(b) for a, b in pairwise(names))
        if not running or len(set(named.values())) < 2 or stations.isdisjoint(names):
            return
        for set_up in self.book.set_ups:
            set_up.sights = [
                s._replace(target=named.get(s.line) or (f"{s.target} (2)" if s.target in stations else s.target))
                for s in set_up.sights
            ]
        words = (
            f"{counted(len(named), 'sight')} to stations, which their codes name: the names of sights are running "
            "numbers; points whose number is the name of a station are called NAME (2)"
        )
        self.book.draft.note(words, min(named))

    def record(self, text: str, line: int) -> None:
        kind, *rest = _cells(text, 9)
        if kind == "CO":
            self._comment(text[3:], line)
        elif kind in ("UP", "MP", "MC", "CC", "RE"):
            first, second, up = map(self._length, rest[2:5])
            north_first = not self.state["coord order"].upper().startswith("E")
            place = (second, first) if north_first else (first, second)
            add = self.book.point if kind in ("UP", "MP", "MC") else self.book.computed_point
            add(rest[0], *place, up, line)
        elif kind == "ST":
            self._station(rest, line)
        elif kind in _BEFORE_HEIGHT:
            self._sight(kind, rest, line)
        elif text.strip():
            self.book.leave_out(f"records {kind}", line)

    def _length(self, text: str) -> float | None:
        unit = self.state["dist units"].lower()
        metres = 1.0 if unit.startswith("met") else LENGTH_UNITS["us-ft"] if "us" in unit else 0.3048
        value = _optional(text)
        return None if value is None else value * metres

    def _angle(self, text: str) -> float | None:
        if not text:
            return None
        return parse_number(text) if self._decimal() else sexagesimal(text)

    def _zenith(self, text: str, kind: str) -> float | None:
        value, zero = self._angle(text), self.state["zero va"].lower()
        if value is None or zero.startswith("z"):
            return value
        full = self.book.full
        zenith = (full / 4 - value) % full
        return full - zenith if kind == "F2" and zero.startswith("c") else zenith

    def _decimal(self) -> bool:
        return self.book.angle == "gon" or "dec" in self.state["angle units"].lower()

    def _comment(self, text: str, line: int) -> None:
        key, sign, value = text.partition(":")
        known = key.strip().lower()
        height = _INSTRUMENT_HEIGHT.search(text)
        if sign and known in self.state:
            self.state[known] = value.strip()
            self.book.angle = "gon" if "gon" in self.state["angle units"].lower() else "deg"
            return
        current = self.book.set_ups[-1] if self.book.set_ups else None
        if height and (current is None or current.unnamed):
            self.book.instrument_height(parse_number(height[1]), line)
        elif _CIRCLE_SET.search(text) and current is not None and current.unnamed and current.used:
            self.book.set_up("", line, current.height)
        if "resection" in text.lower():
            self.book.forget_waiting("sights of a resection that was started again")
            self.resection = line
        self.book.leave_out("comments", line)

    def _station(self, rest: list[str], line: int) -> None:
        set_up = self.book.set_up(rest[0], line, self._length(rest[4]) or 0.0, resection=self.resection)
        try:
            azimuth, circle = map(self._angle, rest[5:7]) if rest[2] else (None, None)
        except ValueError:
            azimuth = circle = None
        if circle is not None and not self.resection:
            self.backsights.append((set_up, Sight(rest[2], line, circle, face=1)))
            set_up.orientation = None if azimuth is None else azimuth - circle
        self.resection = 0

    def _sight(self, kind: str, rest: list[str], line: int) -> None:
        shift = _BEFORE_HEIGHT[kind]
        name, height, slope, circle, zenith = (rest[0], *rest[1 + shift : 5 + shift])
        self.height = self._length(height) or 0.0 if height else self.height
        if not name:
            self.book.leave_out("sights without a point", line)
            return
        try:
            angles = self._angle(circle), self._zenith(zenith, kind)
        except ValueError:
            self.book.leave_out(_NO_ANGLES, line)
            return
        self.codes[line] = rest[6 + shift] if len(rest) > 6 + shift else ""
        sight = Sight(
            name,
            line,
            *angles,
            self._length(slope) or None,
            height=self.height,
            face=2 if kind == "F2" else 0,
        )
        if self.resection and kind in ("F1", "F2", "CP"):
            self.book.wait(sight)
        else:
            self.book.sight(sight)


_DTM300 = re.compile(r"\s*[01]\s*,\s*[0-3]\s*,\s*[MFN][DGM]\s*,")
_STATION_300 = re.compile(r"(.+?)-+([\d.]*)")


def _read_dtm300(lines: list[tuple[int, str]], book: FieldBook) -> None:
    """Read a list of a Nikon DTM-300: state (1, or 0 if deleted), type, units (metres, US feet or feet; D, G or M).

    Type 0 is a sight: name, slope distance, circle, zenith angle, target height. Types 1, 2 and 3 are coordinates that
    are computed, keyed in and uploaded: east, north, height. A name ``7-1.52`` of type 2 is station 7 with the height
    of the instrument; it is positive behind ``7--``, too. Angles are degrees, minutes and seconds (D), gon (G) or mils
    of 6400 (M). Source: GeoEasy, which reads it.
    """
    with_place = 0
    metres_by_unit = {"M": 1.0, "F": LENGTH_UNITS["us-ft"], "N": 0.3048}
    for line, text in lines:
        cells = _cells(text, 8)
        with book.draft.at(line):
            if not _DTM300.match(text):
                raise ValueError(
                    f"found {text.strip()[:20]!r}, expected a state (0, 1), a type (0 to 3) and units (MD)"
                )
            state, type_, units, name = cells[:4]
            if state != "1":
                book.leave_out("records that were deleted", line)
                continue
            metres = metres_by_unit[units[0]]
            if type_ == "0":
                if not any(set_up.sights for set_up in book.set_ups):
                    book.angle = "deg" if units[1] == "D" else "gon"
                factor = book.full / {"D": 360.0, "G": 400.0, "M": 6400.0}[units[1]]
                circle, zenith = (
                    (sexagesimal(cell) if units[1] == "D" else parse_number(cell)) * factor if cell else None
                    for cell in cells[5:7]
                )
                slope, height = metres * (_optional(cells[4]) or 0.0) or None, metres * (_optional(cells[7]) or 0.0)
                book.sight(Sight(name, line, circle, zenith, slope, height=height))
                continue
            east, north, up = (None if value is None else metres * value for value in map(_optional, cells[4:7]))
            given = (east, north, up)
            station = _STATION_300.fullmatch(name) if type_ == "2" else None
            if any(given):
                with_place = with_place or line
            if station is not None:
                height = metres * (_optional(station[2]) or 0.0)
                if "--" in name and height:
                    words = f"station {station[1]}: the height of the instrument behind -- is taken as positive"
                    book.draft.note(words, line)
                book.set_up(station[1], line, height, None if given == (None, None, None) else given)
            elif type_ == "1":
                book.computed_point(name, *given, line)
            else:
                book.point(name, *given, line)
    if with_place:
        words = "coordinates are taken as east, north and height; the file does not say their order"
        book.draft.note(words, with_place)


def read_topcon(path: Path) -> Document:
    """The project of a Topcon GTS-7 or GTS-6 file. Raises :class:`InputError` with every mistake found.

    GTS-7: STN station and instrument height; BKB backsight with its azimuth and circle reading; BS, FS and SS target
    and its height; then HV circle and zenith, SD with the slope distance, HD circle, horizontal distance and difference
    of height. XYZ is taken as east, north and height of the point that the record before names, with a note.

    GTS-6: one stream of ``_'station_(code_)height``, then ``_+target_``, a measurement and ``_*code_,height`` for each
    sight (Topcon Link, "GTS-6 Raw Format").
    """
    draft = Draft(str(path))
    book = FieldBook(draft)
    lines = list(records(path, draft))
    if lines and re.match(r"_'[^_]*_\(", lines[0][1]):
        _read_gts6(lines, book)
    else:
        reader = _Topcon(book, lines)
        for line, text in lines:
            with draft.at(line):
                kind, rest = _keyed(text)
                reader.record(kind, _cells(rest, 3), line)
        first = next((line for line, text in lines if _keyed(text)[0] == "XYZ"), 0)
        if first:
            draft.note(
                "coordinates (XYZ) are taken as east, north and height; the file does not say their order", first
            )
    book.finish(path.stem)
    return draft.finish()


def _keyed(text: str) -> tuple[str, str]:
    """Key of a record, which instruments pad to 8 letters, and the rest."""
    kind, *rest = text.split(maxsplit=1)
    return kind, rest[0] if rest else ""


class _Topcon:
    """Units of a GTS-7 file, the target, and the point that coordinates belong to."""

    def __init__(self, book: FieldBook, lines: list[tuple[int, str]]) -> None:
        self.book, self.metres = book, 1.0
        self.target: list[str] = []
        self.add: Callable[..., None] = book.computed_point
        self.point = ""
        pairs = [_keyed(text) for _, text in lines]
        angles = [cell for kind, rest in pairs if kind in ("HV", "SD") for cell in _cells(rest, 2)[:2]]
        book.angle = "deg" if may_be_sexagesimal(angles) else "gon"

    def record(self, kind: str, cells: list[str], line: int) -> None:
        book = self.book
        if kind == "UNITS":
            self.metres = 1.0 if cells[0].upper().startswith("M") else 0.3048
            book.angle = "gon" if cells[1].upper().startswith("G") else "deg"
        elif kind == "STN":
            book.set_up(cells[0], line, (_optional(cells[1]) or 0.0) * self.metres)
            self.target, self.point, self.add = [], cells[0], book.station_point
        elif kind == "BKB" and book.set_ups:
            book.set_ups[-1].orientation = self.book.parsed(cells[1]) - self.book.parsed(cells[2])
            self.point, self.add = cells[0], book.point
        elif kind in ("BS", "SS", "FS", "OBS"):
            self.target, self.point, self.add = cells, cells[0], book.computed_point
        elif kind in ("HV", "SD", "HD") and self.target:
            self._sight(kind, cells, line)
        elif kind == "XYZ" and self.point:
            self.add(self.point, *(parse_number(cell) * self.metres for cell in cells[:3]), line)
        else:
            book.leave_out(f"records {kind}", line)

    def _sight(self, kind: str, cells: list[str], line: int) -> None:
        length = None if kind == "HV" else parse_number(cells[1 if kind == "HD" else 2]) * self.metres or None
        slope, plan = (None, length) if kind == "HD" else (length, None)
        zenith = None if kind == "HD" else self.book.parsed(cells[1])
        height = (_optional(self.target[1]) or 0.0) * self.metres
        self.book.sight(Sight(self.target[0], line, self.book.parsed(cells[0]), zenith, slope, plan, height))
        if kind == "HD":
            self.book.leave_out("differences of height (HD)", line)


_GTS6_RECORD = re.compile(r"_(['+*])(.*?)(?=_['+*]|$)")
_GTS6_READINGS = re.compile(
    r"[?W](?P<slope>[+-]\d{8,9})[mf](?P<zenith>\d{7,8})(?P<circle>[+-]\d{7,8})[dg]"
    r"|<(?P<zenith_alone>\d{7,8})(?P<circle_alone>[+-]\d{7,8})[dg]"
)


def _read_gts6(lines: list[tuple[int, str]], book: FieldBook) -> None:
    """Lengths have 8 digits for mm or 9 for 0.1 mm, angles 7 (dddmmss) or 8 (dddmmsst); a line may end anywhere."""
    tails = [text[-4:] for _, text in lines[:-1]]  # numbers and checksums of a transfer, or what stands for them
    # Equal ends are marks only if what stands before them differs: the stream itself may repeat with the lines.
    same = len(set(tails)) == 1 and tails[0].isdecimal() and len({text[-5:-4] for _, text in lines[:-1]}) > 1
    if same or all(tail.isdecimal() and int(tail[0]) == k % 10 for k, tail in enumerate(tails)):
        line, text = lines[-1]
        lines = [(line, text[:-4]) for line, text in lines[:-1]] + [(line, text.removesuffix(tails[0] if same else ""))]
    stream, ends = "".join(text for _, text in lines), list(accumulate(len(text) for _, text in lines))
    metres = 0.3048 if re.search(r"[?W][+-]\d{8,9}f", stream) else 1.0
    book.angle = "gon" if re.search(r"[+-]\d{7,8}g", stream) else "deg"
    open_sight: Sight | None = None
    for record in _GTS6_RECORD.finditer(stream):
        kind, cells = record[1], record[2].split("_")
        line = lines[bisect_right(ends, record.start())][0]
        with book.draft.at(line):
            if kind == "*" and open_sight is not None:
                open_sight = open_sight._replace(height=metres * (_optional(cells[-1].strip(" ,")) or 0.0))
            if open_sight is not None:
                book.sight(open_sight)
                open_sight = None
            readings = _GTS6_READINGS.search(record[2]) if kind == "+" else None
            if kind == "'":
                book.set_up(cells[0], line, metres * (_optional(cells[-1].strip(" ()")) or 0.0))
            elif readings is not None:
                slope, zenith, circle = (readings[name] for name in ("slope", "zenith", "circle"))
                length = None if slope is None else metres * int(slope) / (1e3 if len(slope) == 9 else 1e4)
                circle = _gts6_angle(circle or readings["circle_alone"], book)
                zenith = _gts6_angle(zenith or readings["zenith_alone"], book)
                open_sight = Sight(cells[0], line, circle, zenith, length or None)
            elif kind == "+":
                book.leave_out("sights without readings", line)
    if open_sight is not None:
        book.sight(open_sight)


def _gts6_angle(text: str, book: FieldBook) -> float:
    digits = text.lstrip("+-")
    sign = "-" if text.startswith("-") else ""
    return book.parsed(f"{sign}{digits[:3]}.{digits[3:]}")


def read_sokkia_scr(path: Path) -> Document:
    """The project of a Sokkia SCR file. Raises :class:`InputError` with every mistake found.

    M instrument, its height and its coordinates; then name, kind, code, mark, height of the target, a field that is not
    used, and slope, zenith, circle (Ea), zenith, circle (Ee), or east, north, height, slope, zenith, circle (Eh).
    """
    draft = Draft(str(path))
    book = FieldBook(draft)
    for line, text in records(path, draft):
        cells = _cells(text, 12)
        with draft.at(line):
            if cells[0] == "M":
                book.set_up("", line, _optional(cells[4]) or 0.0)
                east, north, up = map(_optional, cells[7:10])
                book.station_point(book.set_ups[-1].station, east, north, up, line)
            elif cells[1] in ("Ea", "Ee", "Eh"):
                first = {"Ea": 6, "Ee": 5, "Eh": 9}[cells[1]]
                slope = None if cells[1] == "Ee" else parse_number(cells[first]) or None
                zenith, circle = map(sexagesimal, cells[first + 1 : first + 3])
                book.sight(Sight(cells[0], line, circle, zenith, slope, height=_optional(cells[4]) or 0.0))
                if cells[1] == "Eh":
                    east, north, up = map(_optional, cells[6:9])
                    book.computed_point(cells[0], east, north, up, line)
            elif text.strip():
                book.leave_out(f"records {cells[1]}", line)
    book.finish(path.stem)
    return draft.finish()
