"""A field book: set-ups, sights and points as an instrument wrote them, and the project they make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from mor.counting import counted
from mor.formats.draft import Draft, Row

SIGMA_ANGLE = "3 arcsec"
SIGMA_DISTANCE, PPM = "2 mm", "2"
SIGMA_CONTROL = "0.01"
"""σ of readings: no field book says any."""
_SPANS = 12
"""Spans of lines that a note lists."""


class Sight(NamedTuple):
    """Readings to a target; angles in the unit of the book, lengths in metres, ``None`` where there is none."""

    target: str
    line: int
    horizontal: float | None = None
    zenith: float | None = None
    slope: float | None = None
    horizontal_distance: float | None = None
    height: float = 0.0
    face: int = 0
    """1 or 2, 0 where only the zenith angle tells."""
    bearing: float | None = None


@dataclass
class SetUp:
    """An instrument over a point."""

    station: str
    line: int
    height: float = 0.0
    sights: list[Sight] = field(default_factory=list)


@dataclass
class FieldBook:
    """What a reader collects."""

    draft: Draft
    angle: str = "deg"
    """deg or gon."""
    set_ups: list[SetUp] = field(default_factory=list)
    points: dict[str, tuple[float | None, float | None, float | None, int]] = field(default_factory=dict)
    """East, north, height and line of the points whose coordinates the book has."""
    skipped: dict[str, list[int]] = field(default_factory=dict)

    def set_up(self, station: str, line: int, height: float = 0.0) -> SetUp:
        """Begin a set-up."""
        self.set_ups.append(SetUp(station, line, height))
        return self.set_ups[-1]

    def sight(self, sight: Sight) -> None:
        """Readings at the last set-up; a name is made up where the book names no station."""
        if not self.set_ups:
            self.draft.note("readings without a station before them: it is called station 1", sight.line)
            self.set_up("station 1", sight.line)
        self.set_ups[-1].sights.append(sight)

    def point(
        self, name: str, east: float | None, north: float | None, height: float | None, line: int
    ) -> None:
        """Coordinates; where a point comes again the first ones count, and others are told. All 0 is none."""
        if not any((east, north, height)):
            self.leave_out("coordinates that are all 0", line)
            return
        known = self.points.setdefault(name, (east, north, height, line))
        if known[:3] != (east, north, height):
            self.leave_out("other coordinates of a point that has some", line)

    def leave_out(self, what: str, line: int) -> None:
        """A record that is not read."""
        self.skipped.setdefault(what, []).append(line)

    def finish(self, title: str) -> None:
        """Put everything into the draft."""
        draft = self.draft
        for what, lines in self.skipped.items():
            draft.note(f"not read: {what} ({counted(len(lines), 'record')}, lines {_spans(lines)})", lines[0])
        draft.put("title", title)
        draft.put("units", {"length": "m", "angle": self.angle})
        draft.put("axes", {"xy": "en", "angles": "clockwise", "bearings_from": "north"})
        for set_up in self.set_ups:
            alone = [sight for sight in set_up.sights if sight.target == set_up.station]
            for sight in alone:
                draft.note(f"a sight from {set_up.station!r} to itself is not read", sight.line)
            set_up.sights = [sight for sight in set_up.sights if sight.target != set_up.station]
        occupied = [set_up for set_up in self.set_ups if set_up.sights]
        _put_points(self, occupied)
        if occupied:
            _put_sights(self, occupied)
            _put_curvature(self, occupied)
            draft.put("settings", {"undetermined": "leave_out"})
        else:
            draft.note("there are no readings: the points are all there is")
        if not draft.data.get("points"):
            draft.problem("there is neither a point nor a reading")


def _put_points(book: FieldBook, occupied: Sequence[SetUp]) -> None:
    draft = book.draft
    stations = {set_up.station for set_up in occupied}
    sighted = {sight.target for set_up in occupied for sight in set_up.sights}
    taking_part = [name for name in book.points if name in stations | sighted]
    control = len(taking_part) >= 2 or not occupied
    sigma = SIGMA_CONTROL if control and occupied else None
    known = [
        Row(
            [
                name,
                *(None if v is None else repr(v) for v in place),
                *(None if v is None else sigma for v in place),
            ],
            line,
        )
        for name, (*place, line) in book.points.items()
    ]
    if known:
        columns = ("id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
        draft.table("points", columns, known)
    if sigma:
        words = f"coordinates of the book are observed with σ = {sigma} m: it says none"
        draft.note(words, known[0].line)
    elif known and occupied:
        draft.note(
            "coordinates of the book are start values: one point of a network is no datum", known[0].line
        )
    if not sigma:
        draft.put("datum", "free")
    first: dict[str, int] = {}
    for set_up in occupied:
        first.setdefault(set_up.station, set_up.line)
        for sight in set_up.sights:
            first.setdefault(sight.target, sight.line)
    others = [Row([name], line) for name, line in first.items() if name not in book.points]
    if others:
        draft.table("points", ("id",), others)


_COLUMNS = {
    "zenith_directions": ("station", "set", "to", "horizontal", "zenith", "to_height", "face"),
    "directions": ("station", "set", "to", "horizontal", "face"),
    "zenith_angle": ("from", "to", "zenith_angle", "from_height", "to_height", "face"),
    "distance": ("from", "to", "distance", "from_height", "to_height"),
    "horizontal_distance": ("from", "to", "distance"),
    "bearing": ("from", "to", "bearing"),
}
"""Columns of the observations that sights become, by type."""


def _put_sights(book: FieldBook, occupied: Sequence[SetUp]) -> None:
    """Stations, and the readings of each kind with their sets and faces."""
    draft = book.draft
    names = _station_names(occupied)
    stations = [
        Row([name, s.station, repr(s.height)], s.line) for name, s in zip(names, occupied, strict=True)
    ]
    draft.table("stations", ("id", "point", "height"), stations)
    tables: dict[str, list[Row]] = {type_: [] for type_ in _COLUMNS}
    sets, circle = 0, 360.0 if book.angle == "deg" else 400.0
    for name, set_up in zip(names, occupied, strict=True):
        numbers = rounds(set_up.sights, circle)
        sets += max(numbers, default=0)
        for sight, number in zip(set_up.sights, numbers, strict=True):
            for type_, values in _readings(set_up, name, sight, number, circle).items():
                cells = [None if v is None else str(v) for v in values]
                tables[type_].append(Row(cells, sight.line))
    for type_, rows in tables.items():
        far = "distance" in type_
        sigma = {"sigma": SIGMA_DISTANCE if far else SIGMA_ANGLE}
        if rows:
            draft.table(
                "observations", _COLUMNS[type_], rows, type=type_, values=sigma, ppm=PPM if far else None
            )
    words = f"{counted(len(occupied), 'set-up')}, {counted(sets, 'set')} of readings; σ = {SIGMA_ANGLE} for angles"
    draft.note(
        f"{words}, {SIGMA_DISTANCE} and {PPM} ppm for distances: no field book says any", occupied[0].line
    )


def _put_curvature(book: FieldBook, occupied: Sequence[SetUp]) -> None:
    """Model the curvature of the earth if there are zenith angles: instruments record them as they are read."""
    sights = [sight for set_up in occupied for sight in set_up.sights if sight.zenith is not None]
    if sights:
        book.draft.put("curvature", "true")
        words = (
            "zenith angles of a field book are not corrected for the curvature of the earth: curvature: true; "
            "refraction is left out, instruments: {ts: {refraction: 0.13}} models it"
        )
        book.draft.note(words, sights[0].line)


def _readings(
    set_up: SetUp, station: str, sight: Sight, number: int, circle: float
) -> dict[str, tuple[float | str | int | None, ...]]:
    """Rows by type that a sight becomes, in the order of the columns."""
    found: dict[str, tuple[float | str | int | None, ...]] = {}
    at = (station, None if number <= 1 else number, sight.target)
    ends, heights = (set_up.station, sight.target), (set_up.height, sight.height)
    face = face_of(sight, circle)
    if sight.horizontal is not None and sight.zenith is not None:
        found["zenith_directions"] = (*at, sight.horizontal, sight.zenith, sight.height, face)
    elif sight.horizontal is not None:
        found["directions"] = (*at, sight.horizontal, face)
    elif sight.zenith is not None:
        found["zenith_angle"] = (*ends, sight.zenith, *heights, face)
    if sight.slope is not None:
        found["distance"] = (*ends, sight.slope, *heights)
    if sight.horizontal_distance is not None:
        found["horizontal_distance"] = (*ends, sight.horizontal_distance)
    if sight.bearing is not None:
        found["bearing"] = (*ends, sight.bearing)
    return found


def _station_names(set_ups: Sequence[SetUp]) -> list[str]:
    """The point; where an instrument stands over it again, or the name is taken, with a number."""
    seen: dict[str, int] = {}
    names = []
    for set_up in set_ups:
        seen[set_up.station] = seen.get(set_up.station, 0) + 1
        number = seen[set_up.station]
        names.append(set_up.station if number == 1 else f"{set_up.station} set-up {number}")
    return names


def face_of(sight: Sight, circle: float) -> int:
    """Face of a sight: as said, or by its zenith angle."""
    if sight.face:
        return sight.face
    return 2 if sight.zenith is not None and sight.zenith % circle > circle / 2.0 else 1


def rounds(sights: Sequence[Sight], circle: float) -> list[int]:
    """Number of the set, from 1, of each sight: a new one begins where a target is sighted again in the same face.

    A last sight back to the first target, which closes a set, belongs to it.
    """
    numbers: list[int] = []
    seen: set[tuple[str, int]] = set()
    number = 1
    for k, sight in enumerate(sights):
        key = sight.target, face_of(sight, circle)
        if key in seen:
            rest = {(s.target, face_of(s, circle)) for s in sights[k:]}
            if len({target for target, _ in rest}) > 1:
                number, seen = number + 1, set()
        seen.add(key)
        numbers.append(number)
    return numbers


def _spans(lines: Sequence[int]) -> str:
    """Line numbers with runs written together: 3, 5–9."""
    spans: list[list[int]] = []
    for line in sorted(set(lines)):
        if spans and line == spans[-1][1] + 1:
            spans[-1][1] = line
        else:
            spans.append([line, line])
    said = [str(a) if a == b else f"{a}–{b}" for a, b in spans[:_SPANS]]
    return ", ".join(said) + (f" and more up to {lines[-1]}" if len(spans) > _SPANS else "")


def sexagesimal(text: str) -> float:
    """Degrees of ddd.mmss…, as instruments write degrees, minutes and seconds. Raises ``ValueError``."""
    bare = text.strip()
    sign = -1.0 if bare.startswith("-") else 1.0
    whole, _, fraction = bare.lstrip("+-").partition(".")
    if not (whole + fraction).isdecimal() or not (whole + fraction).isascii() or len(bare) > 20:
        raise ValueError(f"found {text!r}, expected degrees, minutes and seconds as ddd.mmss")
    fraction = fraction.ljust(4, "0")
    minutes, seconds = int(fraction[:2]), float(f"{fraction[2:4]}.{fraction[4:] or '0'}")
    if minutes >= 60 or seconds >= 60.0:
        raise ValueError(f"found {text!r}, expected less than 60 minutes and seconds in ddd.mmss")
    return sign * (int(whole or "0") + minutes / 60.0 + seconds / 3600.0)
