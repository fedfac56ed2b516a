"""Field books of data recorders: Geodimeter, IDX, M5, RW5, SDR, FBK."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from itertools import pairwise, takewhile, zip_longest
from math import atan2, cos, hypot, sin, tau
from pathlib import Path

from mor.formats.draft import Draft, parse_number
from mor.formats.fieldbook.book import (
    COMPUTED,
    GNSS,
    FieldBook,
    InstrumentSetUp,
    Place,
    Sight,
    may_be_sexagesimal,
    records,
    sexagesimal,
)
from mor.project.document import Document
from mor.project.levelling import REPEATED, StaffReading
from mor.units import LENGTH_UNITS

# ---- Geodimeter ARE and JOB: a number and a value a line.
#
# 2 station, 62 reference object, 21 circle reading there, 5 point, 3 instrument height, 6 target height, 4
# code, 23 units; 7 horizontal and 8 zenith reading, 17 and 18 in face two, 24 and 25 in face one, 9 slope, 11
# horizontal distance, 37 north, 38 east, 39 height (Geodimeter, "Labels"). 7 and 8 are the means of both faces
# if 24 and 25 are there. Coordinates of a point with readings are computed, and those of a station or a
# reference object that was sighted before; others are given.
#
# The first digit of 23 tells the unit of angles (1 gon, 2 degrees, minutes and seconds, 3 decimal degrees).
# Without it angles are ddd.mmss if every one of them may be, gon otherwise.

_ANGLES = ("7", "8", "17", "18", "21", "24", "25")
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
    backsights: list[tuple[InstrumentSetUp, Sight]] = []
    for first, end in pairwise([*begin, len(entries)]):
        with draft.at(entries[first][2]):
            height = _thing(entries[first:end], book, read, height, backsights)
    for set_up, sight in backsights:
        book.backsight(set_up, sight)
    book.finish(path.stem)
    return draft.finish()


def _angle_unit(entries: list[Entry], book: FieldBook) -> bool:
    """Set the unit of angles and return True for degrees, minutes and seconds."""
    units = next((value for label, value, _ in entries if label == "23"), "")
    angles = [value for label, value, _ in entries if label in _ANGLES]
    if units[:1] in ("1", "3"):
        book.angle = "gon" if units[0] == "1" else "deg"
        return False
    if may_be_sexagesimal(angles):
        if angles and units[:1] != "2":
            book.draft.note("angles are taken as degrees, minutes and seconds, as all of them may be", entries[0][2])
        return True
    book.angle = "gon"
    book.draft.note("angles are taken as gon", entries[0][2])
    return False


def _thing(
    entries: list[Entry], book: FieldBook, dms: bool, height: float, backsights: list[tuple[InstrumentSetUp, Sight]]
) -> float:
    """A station, reference object or point with all that follows it; returns the target height from here on."""
    values = {label: (value, line) for label, value, line in entries}
    kind, name, line = entries[0]
    labels = ("3", "6", "9", "11", "37", "38", "39")
    numbers = {label: parse_number(values[label][0]) for label in labels if label in values}
    angles = {
        label: sexagesimal(values[label][0]) if dms else parse_number(values[label][0])
        for label in _ANGLES
        if label in values
    }
    if kind == "2":
        book.set_up(name, line, numbers.get("3", 0.0))
    elif "3" in numbers:
        book.instrument_height(numbers["3"], line)
    height = numbers.get("6", height)
    if kind == "62" and "21" in angles and book.set_ups:
        backsights.append((book.set_ups[-1], Sight(name, values["21"][1], angles["21"], face=1)))
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
        add = book.computed_point if sights else book.station_point if kind in ("2", "62") else book.point
        add(name, numbers.get("38"), numbers.get("37"), numbers.get("39"), line)
    for sight in sights:
        book.sight(sight)
    used = {*_BEGIN, *labels, "21", *(label for pair in faces for label in pair)}
    for label, (_, at) in values.items():
        if label not in used:
            book.leave_out({"0": "notes", "4": "codes", "23": "units"}.get(label, f"label {label}"), at)
    return height


# ---- Leica IDX: sections of POINTS, SETUP and SLOPE; the header says the units.

_IGNORED = ("VERSION", "SYSTEM", "UNITS", "TEMP", "PRESS", "TIME", "PROJECT", "NAME", "OPERATOR", "CREATION_DATE")


def read_idx(path: Path) -> Document:
    """The project of an IDX file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    reader = _SectionReader(FieldBook(draft))
    for line, text in records(path, draft):
        with draft.at(line):
            reader.line(text.strip(), line)
    reader.book.finish(reader.title or path.stem)
    return draft.finish()


class _SectionReader:
    """The section the reading is in, and the columns its head declares."""

    def __init__(self, book: FieldBook) -> None:
        self.book, self.title = book, ""
        self.section, self.columns = "", [""]
        self.sexagesimal, self.metres = True, 1.0

    def line(self, text: str, line: int) -> None:
        word, _, rest = text.partition("\t") if "\t" in text else text.partition(" ")
        head = word.split("(")[0].upper()
        if not text:
            return
        if "(" in text and text.endswith(")") and "," in text:
            self.section = head
            self.columns = [name.strip().upper() for name in text[text.index("(") + 1 : -1].split(",")]
        elif head == "END":
            self.section = ""
        elif text.endswith(";") and self.section in ("POINTS", "SLOPE", "THEMINFO", "ANNOTATIONS", "CONFIGS"):
            self._row(next(csv.reader([text[:-1].replace("\t", " ")], skipinitialspace=True)), line)
        else:
            self._key(head, rest.strip().rstrip(";").strip().strip('"'), line)

    def _key(self, head: str, value: str, line: int) -> None:
        if head == "ANGULAR":
            self._angles(value.upper())
        elif head == "LINEAR":
            if value.upper() not in ("METRE", "METER", "FEET", "FOOT"):
                raise ValueError(f"found the unit {value!r} of lengths, expected METRE or FEET")
            self.metres = 0.3048 if value.upper().startswith("F") else 1.0
        elif head == "NAME" and not self.title:
            self.title = value
        elif head == "STN_ID":
            self.book.set_up(value, line)
        elif head == "INST_HT":
            if self.book.set_ups:
                self.book.set_ups[-1].height = parse_number(value) * self.metres
        elif head in ("STN_NO", "HEADER", "DATABASE", "THEODOLITE", "SETUP", *_IGNORED):
            return
        else:
            row = "rows before the head of their section" if head[:1].isdigit() else f"{head} records"
            self.book.leave_out(f"{self.section} records" if self.section else row, line)

    def _angles(self, value: str) -> None:
        if value not in ("DMS", "GON", "DEG", "DD"):
            raise ValueError(f"found the unit {value!r} of angles, expected DMS, GON or DEG")
        self.sexagesimal = value == "DMS"
        self.book.angle = "gon" if value == "GON" else "deg"

    def _row(self, cells: list[str], line: int) -> None:
        values = dict(zip(self.columns, (cell.strip() for cell in cells), strict=False))
        if self.section == "POINTS":
            place = [values.get(name, "") for name in ("EAST", "NORTH", "ELEVATION")]
            if any(place):
                east, north, up = (parse_number(text) * self.metres if text else None for text in place)
                # Coordinates of other classes (MEAS, AVGE, EST) were computed from readings.
                given = values.get("CLASS", "") in ("", "FIX", "FIXED", "CTRL", "CONTROL", "REF", "NONE")
                add = self.book.point if given else self.book.computed_point
                add(values.get("POINTID", ""), east, north, up, line)
        elif self.section == "SLOPE":
            self._slope(values, line)
        else:
            self.book.leave_out(f"{self.section} records", line)

    def _slope(self, values: dict[str, str], line: int) -> None:
        needed = ("TGTNO", "TGTID", "CFGNO", "HZ", "VZ", "SDIST", "REFHT")
        missing = [name for name in needed if name not in values]
        if missing:
            raise ValueError(f"found no {', '.join(missing)}, expected {', '.join(needed)}")
        angle = sexagesimal if self.sexagesimal else parse_number
        slope = parse_number(values["SDIST"]) * self.metres
        sight = Sight(
            values["TGTID"],
            line,
            angle(values["HZ"]),
            angle(values["VZ"]),
            slope or None,
            height=parse_number(values["REFHT"] or "0") * self.metres,
        )
        self.book.sight(sight)


# ---- Zeiss and Trimble M5: an address, a point or text, and three values with their units, in columns between bars.
#
# SD (Zeiss: D) slope distance, HD (E) horizontal distance, Hz circle, V1 zenith angle, Y east, X north, Z height,
# th and ih heights of target and instrument (Trimble, "M5 data format"). Distances contain the prism constant PC and
# the addition constant A, so those values and others are only counted.
#
# A stationing (TI … STAT) is recorded as its sights, then the station (PI1 S name), before or behind it the angle by
# which the circle is turned (Om), and the instrument height. The sights that follow read the turned circle, which are
# azimuths. Coordinates of a point that was sighted are computed.
#
# Tv, Tr and Tl say how far the target of the next sight is before the point, to the right or to the left of it.

_VALUE = re.compile(r"^(\S+?)_?\s+(-?[\d.]+)\s*(\S*)$")
_KNOWN = ("SD", "HD", "Hz", "V1", "Y", "X", "Z", "th", "ih", "Om", "Tv", "Tr", "Tl", "Rb", "Rf", "Rz")
_ALIASES = {"D": "SD", "E": "HD", "Lr": "Rb", "Lv": "Rf", "Lz": "Rz", "L": "R"}
"""Names of Zeiss instruments."""
_LEVELLED = {"Rb", "Rf", "Rz", "Lr", "Lv", "Lz", "HD", "E", "Z"}
_M5_UNITS = {"gon": "gon", "grd": "gon", "grad": "gon", "deg": "deg", "m": "m"}


def read_m5(path: Path) -> Document:
    """The project of an M5 file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    reader = _M5Reader(FieldBook(draft, stations_follow=True))
    for line, text in records(path, draft):
        cells = text.split("|")
        if text.startswith("!"):
            reader.book.leave_out("comments", line)
            continue
        if text.split()[0].upper() == "END" and len(cells) == 1:
            continue
        if len(cells) == 1 and (rec := _REC.match(text)):
            cells = reader.columns(rec, line)
        if len(cells) < 4 or not cells[0].startswith("For"):
            draft.problem(f"found {text[:20]!r}, expected For M5|Adr …|…", line)
            continue
        with draft.at(line):
            reader.record(cells[2], cells[3:6], line)
    reader.book.finish(path.stem)
    return draft.finish()


_REC = re.compile(r"\s*\d+\s+(\S.*?)((?:\s+[A-Z][a-zD0]?\s+-?\d+\.\d+){0,3})\s*$")
"""A record of a level in the form REC 500: address, point or text, values without units."""


class _M5Reader:
    """The heights of target and instrument, and whether a stationing is under way."""

    def __init__(self, book: FieldBook) -> None:
        self.book = book
        self.target, self.instrument = 0.0, 0.0
        self.stationing, self.rec = False, False
        self.has_height = False
        """True if a height of the target was recorded since the stationing began."""
        self.sighted: set[str] = set()
        self.turn: float | None = None
        """What the circle is turned by at the end of the stationing."""
        self.beside: tuple[str, float, float] = ("", 0.0, 0.0)
        """A point, and how far it is behind and to the right of the target of the next sight to it."""

    def record(self, what: str, cells: list[str], line: int) -> None:
        kind, *words = what.split()
        if kind.startswith("KD") and kind != "KD1":
            self.book.leave_out("sums of levelling lines", line)
            return
        values = self._values(cells, line)
        if kind in ("KD1", "KN1"):
            self._level(what, values, line)
        elif kind == "TO":
            if words and words[0].lower().startswith("start"):
                self.book.levelling.begin()
            elif [word.lower() for word in words[:2]] == ["station", "repeated"]:
                self.book.levelling.repeat()
            self.book.leave_out("texts of the program", line)
        elif kind.startswith("TI"):
            self._text(words, values, line)
        elif kind.startswith("PI"):
            self._point(words, values, line)
        else:
            self.book.leave_out(f"records {kind}", line)

    def columns(self, rec: re.Match[str], line: int) -> list[str]:
        """Columns of a record of the form REC 500 as those of M5: sums and texts have other kinds than points."""
        if not self.rec:
            self.book.draft.note("lengths of the form REC 500 are taken as metres: it says no unit", line)
            self.rec = True
        values = re.findall(r"(\S+)\s+(\S+)", rec[2])
        kind = "TO" if not values else "KD1" if {name for name, _ in values} <= _LEVELLED else "KD2"
        what = rec[1] if kind == "TO" else rec[1].split()[0]
        return ["For REC", "", f"{kind} {what}", *(f"{name} {value} m" for name, value in values), "", ""]

    def _values(self, cells: list[str], line: int) -> dict[str, tuple[float, str]]:
        values = {}
        for cell in cells:
            match = _VALUE.match(cell.strip())
            if match is None:
                if cell.strip():
                    self.book.leave_out(f"value {cell.split()[0]}", line)
                continue
            name, text, unit = _ALIASES.get(match[1], match[1]), match[2], match[3].lower()
            if name not in _KNOWN:
                self.book.leave_out(f"value {name}", line)
            elif unit == "dms":
                values[name] = sexagesimal(text), "deg"
            elif unit in _M5_UNITS:
                values[name] = parse_number(text), _M5_UNITS[unit]
            elif unit == "ft":
                values[name] = parse_number(text) * 0.3048, "m"
            else:
                raise ValueError(f"found {name} in {unit!r}, expected m, ft, gon, deg or DMS")
        return values

    def _level(self, what: str, values: dict[str, tuple[float, str]], line: int) -> None:
        """A record of a level: a staff reading, or the height of a point."""
        # From a width of 27 on the field of a level has columns.
        name = what[4:12].strip() if len(what) >= 27 else "".join(what.split()[1:2])
        if "####" in what:
            self.book.leave_out(REPEATED, line)
            return
        distance = values.get("HD", (None,))[0]
        levelling = self.book.levelling
        sights = {"Rb": levelling.sight_back, "Rf": levelling.sight_forward, "Rz": levelling.sight_between}
        read = [key for key in sights if key in values]
        for key in read:
            sights[key](StaffReading(name, values[key][0], distance, line))
        if not read and "Z" in values:
            self.book.level_height(name, values["Z"][0], line)
        elif not read:
            self.book.leave_out("staff readings outside a line", line)

    def _text(self, words: list[str], values: dict[str, tuple[float, str]], line: int) -> None:
        if "STAT" in words:
            self.book.forget_waiting("sights of a stationing that was started again")
            self.stationing, self.has_height, self.turn = True, False, None
        if "Om" in values:
            self.turn = values["Om"][0]
            if not self.stationing:
                self._turn()
        elif not self._heights(values, line):
            self.book.leave_out("texts of the program", line)

    def _heights(self, values: dict[str, tuple[float, str]], line: int) -> bool:
        """Take the heights of target and instrument over, and return whether there are some."""
        self.target = values.get("th", (self.target, ""))[0]
        self.has_height |= "th" in values
        if "ih" in values:
            self.instrument = values["ih"][0]
            if not self.stationing:
                self.book.instrument_height(self.instrument, line)
        return not {"th", "ih"}.isdisjoint(values)

    def _point(self, words: list[str], values: dict[str, tuple[float, str]], line: int) -> None:
        if not words:
            raise ValueError("found no name of a point")
        name = words[-1]
        has_heights = self._heights(values, line)
        if beside := {"Tv", "Tr", "Tl"} & values.keys():
            behind, right, left = (values.get(key, (0.0, ""))[0] for key in ("Tv", "Tr", "Tl"))
            self.beside = (name, behind, left - right)
        if {"Y", "X"} & set(values):
            if "S" in words[:-1]:
                self._station(name, values, line)
            elif name in self.sighted:
                self.book.computed_point(name, *_place(values), line)
            else:
                self.book.point(name, *_place(values), line)
        elif {"Hz", "V1", "SD", "HD"} & set(values):
            self._sight(name, values, line)
        elif not has_heights and not beside:
            self.book.leave_out("points without readings or coordinates", line)

    def _station(self, name: str, values: dict[str, tuple[float, str]], line: int) -> None:
        self.book.set_up(name, line, self.instrument, _place(values))
        self.stationing = False
        self._turn()

    def _turn(self) -> None:
        """Note that the circle of the open set-up is turned: its readings are azimuths from then on."""
        if self.turn is not None and self.book.set_ups and not self.book.set_ups[-1].used:
            self.book.set_ups[-1].turn, self.book.set_ups[-1].orientation = self.turn, 0.0
            self.turn = None

    def _sight(self, name: str, values: dict[str, tuple[float, str]], line: int) -> None:
        for key in ("Hz", "V1"):
            if key in values:
                self.book.angle = "gon" if values[key][1] == "gon" else "deg"
        slope = values.get("SD", (None,))[0]
        if self.stationing and not slope and not self.has_height and {"Hz", "V1"} <= values.keys():
            del values["V1"]  # the heights of the new station follow
            self.book.leave_out("zenith angles of a stationing before the heights of the station", line)
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
        if self.beside[0] == name:
            centred = _centred(sight, *self.beside[1:], self.book.full)
            self.beside = ("", 0.0, 0.0)
            if centred is None:
                self.book.leave_out(
                    "sights without a distance and zenith angle to a target beside the point (Tv, Tr, Tl)", line
                )
                return
            sight = centred
        if self.stationing:
            self.book.wait(sight)
        else:
            self.book.sight(sight)


def _centred(sight: Sight, behind: float, right: float, circle: float) -> Sight | None:
    """The readings that a point has which is behind and to the right of the target; ``None`` without its distance."""
    if sight.horizontal is None:
        return None
    if sight.slope is not None and sight.zenith is not None:
        plan = sight.slope * sin(sight.zenith * tau / circle)
        face = -1.0 if plan < 0.0 else 1.0
        rise = sight.slope * cos(sight.zenith * tau / circle)
        length = hypot(abs(plan) + behind, right)
        zenith = face * atan2(length, rise) * circle / tau % circle
        turn = atan2(right, abs(plan) + behind) * circle / tau
        return sight._replace(horizontal=(sight.horizontal + turn) % circle, zenith=zenith, slope=hypot(length, rise))
    if sight.horizontal_distance is not None and sight.zenith is None:
        length = sight.horizontal_distance + behind
        turn = atan2(right, length) * circle / tau
        return sight._replace(horizontal=(sight.horizontal + turn) % circle, horizontal_distance=hypot(length, right))
    return None


def _place(values: dict[str, tuple[float, str]]) -> Place:
    east, north, up = (values[axis][0] if axis in values else None for axis in "YXZ")
    return east, north, up


# ---- Carlson RW5 and TDS raw data: set-ups, sights, sets in both faces, coordinates.
#
# ``AR`` is the reading of the circle, whose reading at the backsight is ``BC``: a backsight that no record
# measures is a sight with that reading. SP and OC coordinates are given unless an earlier set-up sighted the
# point; those of GNSS points stand in the comment --GS that follows a GPS record, their precision in --HRMS or
# --HSDV. Lines that begin with -- are comments, also those that repeat other records: means, checks and computed
# coordinates. Source: Carlson, *SurvCE RW5 Format*.

_SIGHTS = {"SS": 0, "TR": 0, "FS": 0, "BD": 1, "FD": 1, "BR": 2, "FR": 2}
"""Faces of the sights; 0 where the zenith angle tells."""
_CELL = re.compile(r"([NE](?=\s*[-.\d])|[A-Z]{2})\s*(.*)")
_USED = {
    "JB": ("NM",),
    "MO": ("UN", "AU", "SF", "EO", "AD", "EC"),
    **dict.fromkeys(("OC", "SP"), ("OP", "PN", "N", "E", "EL")),
    "BK": ("OP", "BP", "BS", "BC"),
    "LS": ("HI", "HR"),
    **dict.fromkeys(_SIGHTS, ("OP", "FP", "AR", "AL", "AZ", "DR", "DL", "ZE", "VA", "CE", "SD", "HD")),
}
"""Keys of the values that are read, by record, besides the date DT and the time TM."""
_RW5_ANGLE = re.compile(r",(?:A[RLZ]|D[RL]|ZE|BS|BC)\s*(\d+\.\d*[1-9])")
_RMS = re.compile(r"--H(?:RMS|SDV):\s*(\d*\.\d+),.*?\bV(?:RMS|SDV):\s*(\d*\.\d+)")


def read_rw5(path: Path) -> Document:
    """The project of an RW5 file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    reader = _RW5Reader(FieldBook(draft))
    lines = list(records(path, draft))
    angles = {angle for _, text in lines for angle in _RW5_ANGLE.findall(text)}
    # Of ten angles in gon with decimals one would not be read as degrees, minutes and seconds.
    reader.may_be_gon = len(angles) < 10 or not may_be_sexagesimal(angles)
    for line, text in lines:
        kind, _, rest = text.partition(",")
        with draft.at(line):
            reader.record(kind.strip(), rest, line)
    reader.close()
    if not reader.mode:
        draft.note("no MO record tells the units: lengths are taken as metres, angles as degrees, minutes, seconds")
    reader.book.finish(reader.title or path.stem)
    return draft.finish()


class _RW5Reader:
    """State of an RW5 file; each value holds until another record changes it."""

    def __init__(self, book: FieldBook) -> None:
        self.book = book
        self.title = ""
        self.metres = 1.0
        self.mode = False
        """True once a record told the units."""
        self.may_be_gon = True
        """False if the digits of all angles are degrees, minutes and seconds."""
        self.station, self.height, self.target = "", 0.0, 0.0
        self.backsight: tuple[str, float, int] = ("", 0.0, 0)
        """Point, reading of the circle and line of the last BK."""
        self.azimuth: float | None = None
        """Azimuth of the last BK."""
        self.begun = False
        self.gnss = False
        """True in the comments of a GPS record."""
        self.gnss_point = ""
        """Point of the last comment --GS, whose precision follows."""

    def record(self, kind: str, text: str, line: int) -> None:
        # Values by their keys; what follows ``--`` is a note.
        parts = [cell.strip() for cell in text.partition(",--")[0].split(",")]
        cells = {match[1]: match[2].strip() for match in map(_CELL.match, parts) if match}
        if kind in _USED and not all(map(_CELL.match, filter(None, parts))):
            self.book.leave_out("comments", line)
        for key in cells:
            if key not in (*_USED.get(kind, cells), "DT", "TM"):
                self.book.leave_out(f"value {key}", line)
        if kind == "--GS" and self.gnss:
            self._gnss_point(cells, line)
        elif self.gnss_point and (rms := _RMS.match(f"{kind},{text}")):
            self.book.precision[self.gnss_point] = float(rms[1]) * self.metres, float(rms[2]) * self.metres
        elif kind == "JB":
            self.title = cells.get("NM", "")
        elif kind == "MO" or (kind == "--MO" and not self.mode):
            self.mode = True
            self._mode(cells, line)
        elif kind in ("OC", "SP"):
            self._point(kind, cells, line)
        elif kind == "BK":
            self.close()
            self.station = cells.get("OP") or self.station
            self.backsight = (cells.get("BP", ""), self.book.parsed(cells.get("BC") or "0"), line)
            self.azimuth = self.book.parsed(cells["BS"]) if cells.get("BS") else None
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
            what = "comments" if kind.startswith("--") else GNSS if gnss else f"records {kind[:4]}"
            self.book.leave_out(what, line)

    def close(self) -> None:
        """End a set-up: where its backsight was not measured, it was read when the circle was set."""
        point, circle, line = self.backsight
        if self.begun and point and point != self.station:
            self.book.backsight(self.book.set_ups[-1], Sight(point, line, circle, face=1))
            if self.azimuth is not None:
                self.book.set_ups[-1].orientation = self.azimuth - circle
        self.begun = False

    def _gnss_point(self, cells: dict[str, str], line: int) -> None:
        self.gnss = False
        try:
            east, north, height = (self._length(cells, key) for key in ("E", "N", "EL"))
        except ValueError:
            self.book.leave_out("comments", line)
            return
        self.gnss_point = cells.get("PN", "")
        if self.gnss_point:
            self.book.point(self.gnss_point, east, north, height, line)

    def _mode(self, cells: dict[str, str], line: int) -> None:
        unit = parse_number(cells.get("UN") or "1")
        metres_by_unit = {0: 0.3048, 1: 1.0, 2: LENGTH_UNITS["us-ft"]}
        if unit not in metres_by_unit:
            raise ValueError(f"found UN{cells['UN']}, expected 0 (feet), 1 (metres) or 2 (US survey feet)")
        self.metres = metres_by_unit[int(unit)]
        is_gon = parse_number(cells.get("AU") or "0") == 1
        self.book.angle = "gon" if is_gon and self.may_be_gon else "deg"
        if is_gon and not self.may_be_gon:
            self.book.draft.note(
                "the job says gon, but no angle has 60 or more in the digits of minutes or seconds: they are taken as "
                "degrees, minutes and seconds",
                line,
            )
        scale, offset = parse_number(cells.get("SF") or "1"), parse_number(cells.get("EO") or "0")
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
            self.station, self.backsight, self.azimuth = name, ("", 0.0, 0), None
        east, north, height = (self._length(cells, key) for key in ("E", "N", "EL"))
        self.book.station_point(name, east, north, height, line)

    def _length(self, cells: dict[str, str], key: str, default: float | None = None) -> float | None:
        text = cells.get(key, "")
        return parse_number(text) * self.metres if text else default

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
        if slope is None and cells.get("SD") and zenith == self.book.full / 4:
            zenith = None  # a backsight that was not measured has the distance 0 and the zenith angle 90°
        if "CE" in cells:
            self.book.leave_out("differences of height (CE)", line)
        if circle is None and zenith is None and slope is None and horizontal is None:
            self.book.leave_out("sights without readings", line)
            return
        face = _SIGHTS[kind]
        self.book.sight(Sight(target, line, circle, zenith, slope, horizontal, self.target, face))

    def _circle(self, cells: dict[str, str]) -> float | None:
        """Reading of the circle; angles to the left, deflections and azimuths are turned into it."""
        full = self.book.full
        start = self.backsight[1]
        turns = {
            "AR": (0.0, 1.0),
            "AL": (start, -1.0),
            "DR": (start + full / 2, 1.0),
            "DL": (start + full / 2, -1.0),
            "AZ": (start - (self.azimuth or 0.0), 1.0),
        }
        for key, (zero, sign) in turns.items():
            if cells.get(key):
                return (zero + sign * self.book.parsed(cells[key])) % full
        return None

    def _zenith(self, cells: dict[str, str]) -> float | None:
        if cells.get("ZE"):
            return self.book.parsed(cells["ZE"])
        if cells.get("VA"):
            return self.book.full / 4 - self.book.parsed(cells["VA"])
        return None


# ---- Sokkia SDR33: records of a type, an origin and fields of 16 letters (SDR20: of 4 and 10).
#
# Types: 00 head with the units, 01 instrument, 02 station, 03 target height, 06 scale, 07 back bearing, 08
# coordinates, 09 observation (F1, F2: face), 10 job, 11 reduced observation, 13 note (Sokkia, "SDR file
# format").
#
# The origin tells raw from derived: KI coordinates were keyed in, CO copied from another job; all others (TP
# topography, RS resection, TR traverse, SO setting out, …) were computed. 09F1 and 09F2 are readings, 09MC
# and 11 are reduced. Spectra instruments write the readings of a resection as notes 13F1 and 13F2 before the
# station that follows from them.

_FROM_HORIZON = re.compile(r".{49}[13]2(?:[ -]|\d+\.|$)")
"""Record of an instrument whose vertical angles count from the horizon: 2 in column 51, where 1 is the zenith."""


def read_sdr(path: Path) -> Document:
    """The project of an SDR33 or SDL file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    reader = _SDRReader(FieldBook(draft))
    lines = list(records(path, draft))
    if lines and lines[0][1].startswith("SDL"):
        _read_sdl(lines, reader.book)
        lines = []
    for line, text in lines:
        if text.strip():
            with draft.at(line):
                reader.record(text, line)
    reader.book.finish(path.stem)
    return draft.finish()


def _read_sdl(lines: Sequence[tuple[int, str]], book: FieldBook) -> None:
    """Readings of an SDL level: number, point, two flags, 1 back or 2 forward, distance, staff reading, height.

    A sight forward before another one is an intermediate sight. A reading back at the height of the sight before it is
    to the same point, whatever its name; at another height it begins a line. Only the first height is given.
    """
    book.leave_out("job records", lines[0][0])
    point, height = "", float("nan")
    rows = [(line, [cell.strip() for cell in text.split(",")]) for line, text in lines[1:]]
    for (line, cells), (_, after) in zip_longest(rows, rows[1:], fillvalue=(0, [])):
        with book.draft.at(line):
            if len(cells) < 8 or cells[4] not in ("1", "2"):
                raise ValueError(f"found {','.join(cells)!r}, expected number, point, 0, 0, 1 or 2, and three numbers")
            distance, value, level = map(parse_number, cells[5:8])
            reading = StaffReading(cells[1], value, distance or None, line)
            if cells[4] == "1" and level == height:
                book.levelling.sight_back(reading._replace(point=point))
            elif cells[4] == "1":
                book.levelling.begin()
                (book.computed_point if point else book.point)(cells[1], None, None, level, line)
                book.levelling.sight_back(reading)
            else:
                book.leave_out(COMPUTED, line)
                is_between = len(after) > 4 and after[4] == "2"
                (book.levelling.sight_between if is_between else book.levelling.sight_forward)(reading)
            point, height = cells[1], level


class _SDRReader:
    """Units, the order of coordinates, width of the names, and the height of the target."""

    def __init__(self, book: FieldBook) -> None:
        self.book = book
        self.width, self.number_width = 16, 16
        self.metres, self.east_first = 1.0, False
        self.elevations = False
        """True if vertical angles count from the horizon upwards, 180° and more in face 2."""
        self.height = 0.0
        self.resection = 0
        """Line where a resection began that no station record ended yet."""

    def record(self, text: str, line: int) -> None:
        kind, origin = text[:2], text[2:4]
        if text.strip() == "0000":
            return
        if kind == "00":
            self._head(text, line)
        elif kind == "02":
            self._station(text, line)
        elif kind == "03":
            self.height = self._length(text[4 : 4 + self.number_width]) or 0.0
        elif kind == "08":
            name, *place = self._fields(text, 1, 3)
            add = self.book.point if origin in ("KI", "CO") else self.book.computed_point
            add(name, *self._place(place), line)
        elif kind in ("09", "13") and origin in ("F1", "F2"):
            self._sight(text, line)
        elif kind == "09":
            self.book.leave_out("observations reduced by the instrument (MC)", line)
        else:
            if kind == "01":
                self.elevations = bool(_FROM_HORIZON.match(text))
            if kind == "07":
                self._orientation(text)
            if kind == "13" and "resection" in text.lower():
                self.book.forget_waiting("sights of a resection that was started again")
                self.resection = line
            names = {
                "01": "instrument records",
                "06": "scale records",
                "07": "back bearings: the reading stands among the observations, too",
                "10": "job records",
                "11": "reduced observations",
                "13": "notes",
            }
            self.book.leave_out(names.get(kind, f"records {kind}"), line)

    def _station(self, text: str, line: int) -> None:
        name, *place, height = self._fields(text, 1, 4)
        self.book.set_up(name, line, self._length(height) or 0.0, self._place(place), resection=self.resection)
        self.resection = 0

    def _orientation(self, text: str) -> None:
        """Azimuth of the backsight and the circle reading to it."""
        station, _, azimuth, circle = self._fields(text, 2, 2)
        if azimuth and circle and self.book.set_ups and self.book.set_ups[-1].station == station:
            self.book.set_ups[-1].orientation = parse_number(azimuth) - parse_number(circle)

    def _head(self, text: str, line: int) -> None:
        """Name and version, date, and a digit each: angles, lengths, pressure, temperature, order of coordinates."""
        digits = text[40:46].strip()
        if not digits.isdecimal() or len(digits) < 5:
            digits = text.rstrip()[-6:]
        if not digits.isdecimal() or len(digits) < 5:
            raise ValueError(f"found {digits!r} in columns 41 to 46, expected the digits of the units")
        if "SDR33" not in text:
            self.width, self.number_width = 4, 10
        if digits[0] not in "12":
            raise ValueError(f"found angles of kind {digits[0]}, expected 1 (degrees) or 2 (gon)")
        metres_by_unit = {"1": 1.0, "2": 0.3048, "3": LENGTH_UNITS["us-ft"]}
        if digits[1] not in metres_by_unit:
            raise ValueError(f"found lengths of kind {digits[1]}, expected 1 (metres), 2 or 3 (feet)")
        self.book.angle = "deg" if digits[0] == "1" else "gon"
        self.metres = metres_by_unit[digits[1]]
        self.east_first = digits[4] == "2"

    def _fields(self, text: str, names: int, numbers: int) -> list[str]:
        ends = [4 + self.width * k for k in range(names + 1)]
        ends += [ends[-1] + self.number_width * (k + 1) for k in range(numbers)]
        return [text[a:b].strip() for a, b in pairwise(ends)]

    def _length(self, text: str) -> float | None:
        return parse_number(text.strip()) * self.metres if text.strip() else None

    def _place(self, fields: list[str]) -> Place:
        first, second, up = (self._length(text) for text in fields[:3])
        return (first, second, up) if self.east_first else (second, first, up)

    def _sight(self, text: str, line: int) -> None:
        station, target, slope, vertical, horizontal = self._fields(text, 2, 3)
        zenith = parse_number(vertical) if vertical else None
        if zenith is not None and self.elevations:
            full = self.book.full
            zenith = (full / 4 - zenith) % full
        sight = Sight(
            target,
            line,
            parse_number(horizontal) if horizontal else None,
            zenith,
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


# ---- FBK: the survey command language of Autodesk, a command a line.
#
# UNIT lengths and angles; NEZ, NE given coordinates; STN station and instrument height; BS backsight and the
# circle reading there; PRISM target height; AD, F1, F2 (and FC1, FC2): point, circle reading and slope distance
# with the vertical angle (VA), else the horizontal distance. Source: Autodesk, *Survey command language*.

_WORDS = re.compile(r'"[^"]*"|[^\s"]+')
_FBK_SIGHTS = {"AD": 0, "F1": 1, "F2": 2, "FC1": 1, "FC2": 2}
"""Faces of the sights; 0 where the zenith angle tells."""


def read_fbk(path: Path) -> Document:
    """The project of an FBK file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    reader = _FbkReader(FieldBook(draft))
    for line, text in records(path, draft):
        with draft.at(line):
            reader.command([word.strip('"') for word in _WORDS.findall(text)], line)
    reader.close()
    reader.book.finish(path.stem)
    return draft.finish()


class _FbkReader:
    """Units, target height and backsight, until another command changes them."""

    def __init__(self, book: FieldBook) -> None:
        self.book = book
        self.metres, self.decimal, self.left, self.vertical = 1.0, False, False, "ZENITH"
        self.target = 0.0
        self.backsight: Sight | None = None

    def command(self, words: list[str], line: int) -> None:
        name, *rest = [word.upper() for word in words] or ["!"]
        if name.startswith("!"):
            self.book.leave_out("comments", line)
        elif name in ("UNIT", "UNITS"):
            self._units(rest)
        elif name in ("HORIZ", "VERT") and rest[:1] == ["ANGLE"]:
            if name == "HORIZ":
                self.left = rest[1:] == ["LEFT"]
            else:
                self.vertical = rest[1] if len(rest) > 1 else "ZENITH"
        elif name in ("NEZ", "NE") and len(rest) >= 3:
            north, east, *up = (parse_number(word) * self.metres for word in rest[1 : 4 if name == "NEZ" else 3])
            self.book.point(words[1], east, north, up[0] if up else None, line)
        elif name == "STN" and rest:
            self.close()
            self.book.set_up(words[1], line, parse_number(rest[1]) * self.metres if len(rest) > 1 else 0.0)
        elif name == "BS" and rest:
            self.close()
            self.backsight = Sight(words[1], line, self._angle(rest[1]) if len(rest) > 1 else 0.0, face=1)
        elif name == "PRISM" and rest:
            self.target = parse_number(rest[0]) * self.metres
        elif name in _FBK_SIGHTS:
            self._sight(name, words[1:], line)
        else:
            self.book.leave_out(f"commands {name}", line)

    def close(self) -> None:
        """End a set-up: where its backsight was not measured, it was read when the circle was set."""
        if self.backsight is not None and self.book.set_ups and self.book.set_ups[-1].used:
            self.book.backsight(self.book.set_ups[-1], self.backsight)
        self.backsight = None

    def _units(self, rest: list[str]) -> None:
        for word in takewhile(lambda word: word[:1] != "!", rest):
            if word.startswith(("MET", "FOOT", "FEET", "USFOOT", "USFEET")):
                self.metres = {"M": 1.0, "U": LENGTH_UNITS["us-ft"]}.get(word[0], 0.3048)
            elif word in ("DMS", "DEC", "DECDEG", "DECDMS", "GRAD", "GRADS"):
                self.book.angle = "gon" if word.startswith("GRAD") else "deg"
                self.decimal = word in ("DEC", "DECDEG", "GRAD", "GRADS")
            else:
                raise ValueError(f"found the unit {word!r}, expected METER, FOOT, DMS, DECDEG or GRADS")

    def _angle(self, text: str) -> float:
        return parse_number(text) if self.decimal else sexagesimal(text)

    def _sight(self, name: str, rest: list[str], line: int) -> None:
        spatial = bool(rest) and rest[0].upper() == "VA"
        if not spatial and rest and rest[0].isalpha() and rest[0].isupper() and len(rest[0]) == 2:
            self.book.leave_out(f"commands {name} {rest[0]}", line)
            return
        point, *numbers = rest[spatial : 5 if spatial else 3]
        if len(numbers) < 2 + spatial:
            raise ValueError(f"found {len(numbers)} values in {name}, expected an angle and a distance")
        full = self.book.full
        circle, length = self._angle(numbers[0]), parse_number(numbers[1]) * self.metres
        start = self.backsight.horizontal if self.backsight is not None else 0.0
        circle = ((start or 0.0) - circle) % full if self.left else circle
        zenith = self._angle(numbers[2]) if spatial else None
        if zenith is not None and self.vertical.startswith("HOR"):
            zenith = full / 4 - zenith
        elif zenith is not None and self.vertical.startswith("NAD"):
            zenith = full / 2 - zenith
        slope, plan = (length or None, None) if spatial else (None, length or None)
        self.book.sight(Sight(point, line, circle, zenith, slope, plan, self.target, _FBK_SIGHTS[name]))
