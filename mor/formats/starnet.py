"""STAR*NET files: read and written."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import radians, sin
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mor.errors import InputError, Message, counted
from mor.formats.content import Content, ContentTable, content_of, not_carried, points
from mor.formats.draft import Draft, Row, Written, geocentric, parse_number
from mor.formats.draft import read_lines as text_lines
from mor.formats.networks import (
    ObservationTable,
    circle_in_face_one,
    groups,
    heights_of,
    places,
    stations,
    tilted_stations,
    zenith_in_face_one,
)
from mor.formats.recognition import PROJECT_FILE
from mor.model.observation_types import PLAIN_TYPES
from mor.project.document import Document
from mor.types import FloatArray
from mor.units import ANGLE_UNITS

# ---- Lines of a STAR*NET input file: continued, without comments, with their code, and the values in them.

_HEIGHTS = re.compile(r"^(-?(?:\d+\.?\d*|\.\d+))/(-?(?:\d+\.?\d*|\.\d+))$")
_DMS = re.compile(r"^([-+]?)(\d+)[-@:](\d+)(?:[-@:](\d+(?:\.\d*)?))?$")
_QUADRANT = re.compile(r"^([NS])(.+?)([EW])$", re.IGNORECASE)
STATUSES = ("!", "*", "&")
"""Fixed, free, the default: in place of a σ."""


class DataLine(NamedTuple):
    """Code and words of a line, with instrument and target height where the line has them."""

    code: str
    words: list[str]
    heights: tuple[float, float] | None
    number: int


def read_lines(lines: list[str]) -> Iterator[DataLine]:
    """Every line that says something; # begins a comment, ' or -- a description.

    A last & continues where the next line begins with no code; else it is the default σ.
    """
    begun, first = "", 0
    bare = [re.split(r"#|(?:^|(?<=\s))(?:'|--)", text, maxsplit=1)[0].strip() for text in lines]
    for k, text in enumerate(bare, start=1):
        first = first if begun else k
        if text.endswith(" &") and k < len(bare) and bare[k] and not _CODE.match(bare[k]):
            begun += text[:-1]
            continue
        words, begun = (begun + text).split(), ""
        if words:
            heights = None
            kept: list[str] = []
            for word in words[1:]:
                match = _HEIGHTS.match(word)
                if match and words[0][:1] != ".":
                    heights = parse_number(match[1]), parse_number(match[2])
                else:
                    kept += word if set(word) <= set(STATUSES) else [word]
            yield DataLine(words[0].upper(), kept, heights, first)


_CODE = re.compile(r"(?:\.[A-Za-z0-9]+|[A-Za-z]{1,2}|[A-Za-z]\d)(?:\s|$)")


def degrees(text: str) -> float:
    """Degrees of d-m-s, of packed d.mmss, or of a quadrant bearing. Raises ``ValueError``."""
    quadrant = _QUADRANT.match(text)
    if quadrant:
        angle = degrees(quadrant[2])
        north, east = quadrant[1].upper() == "N", quadrant[3].upper() == "E"
        return (angle if east else 360.0 - angle) if north else (180.0 - angle if east else 180.0 + angle)
    match = _DMS.match(text)
    if match is None:
        from mor.formats.fieldbook.book import sexagesimal

        return sexagesimal(text)
    minutes, seconds = float(match[3]), float(match[4] or 0.0)
    if minutes >= 60.0 or seconds > 60.0:
        raise ValueError(f"found {text!r}, expected less than 60 minutes and seconds")
    value = float(match[2]) + minutes / 60.0 + seconds / 3600.0
    return -value if match[1] == "-" else value


# ---- A STAR*NET network in the making: its options, points and observations, and the σ that lines do not give.


@dataclass(frozen=True, eq=False)
class Instrument:
    """σ of observations that have none, and of centring: what the project options say, else what mor assumes."""

    sigma: dict[str, float] = field(
        default_factory=lambda: (
            {"angle": 4.0, "direction": 4.0, "bearing": 4.0, "zenith": 10.0}
            | {"distance": 0.002, "height": 0.015, "level": 0.002}
        )
    )
    """Seconds of arc; m; m of an elevation difference; m on the square root of a kilometre."""
    ppm: float = 0.0
    """Of a distance, added to its σ."""
    centring: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Instrument, target, and both in height, m."""

    def keys(self, type_: str) -> dict[str, Any]:
        """The keys of a table of observations with σ of centring."""
        instrument, target, up = self.centring
        if type_ == "height_difference" or not any(self.centring):
            return {}
        found = {"instrument": instrument, "target": target}
        if type_ in ("distance", "zenith_angle"):
            found |= {"instrument_height": up, "target_height": up}
        return {"centring": {name: f"{value!r} m" for name, value in found.items() if value}}


FIXED = {"angle": 0.01, "direction": 0.01, "bearing": 0.01, "zenith": 0.01, "distance": 1e-5, "height": 1e-5}
"""σ in place of !: seconds of arc, m."""
COLUMNS = {
    "distance": ("from", "to", "distance", "sigma", "from_height", "to_height"),
    "horizontal_distance": ("from", "to", "distance", "sigma"),
    "zenith_angle": ("from", "to", "zenith_angle", "sigma", "from_height", "to_height"),
    "height_difference": ("from", "to", "dz", "sigma"),
    "bearing": ("from", "to", "bearing", "sigma"),
    "angle": ("at", "from", "to", "angle", "sigma"),
    "directions": ("station", "set", "to", "horizontal", "sigma"),
}
Values = tuple[str | float | None, ...]


@dataclass
class Vector:
    """A GNSS vector in geocentric axes (m), with its covariances by ``xx yy zz`` and ``xy xz yz``."""

    ends: list[str]
    difference: list[float]
    line: int
    factors: tuple[float, float]
    by_correlation: bool
    file: str = ""
    variances: list[float] = field(default_factory=list)
    covariances: list[float] = field(default_factory=lambda: [0.0] * 3)

    def matrix(self, axes: FloatArray) -> FloatArray:
        """Covariances (3, 3) with the factors in the horizon whose ``axes`` are east, north and up."""
        diagonal = np.square(self.variances) if self.by_correlation else np.array(self.variances)
        matrix = np.diag(diagonal)
        for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), self.covariances, strict=True):
            scale = np.sqrt(diagonal[i] * diagonal[j]) if self.by_correlation else 1.0
            matrix[i, j] = matrix[j, i] = value * scale
        scales = axes.T @ np.diag([self.factors[0], *self.factors]) @ axes
        return np.asarray(scales @ matrix @ scales)


@dataclass
class StarNetContext:
    """Content read so far, and the options in force."""

    draft: Draft
    plane: bool = False
    """Lines are in the format of the plane."""
    reduced: bool = False
    """Lines are in the format of space, and are reduced to the plane."""
    flat: bool = False
    """The project options say that the adjustment is one in the plane."""
    delta: bool = False
    """Horizontal distances and elevation differences in place of slope distances and zenith angles."""
    east_first: bool = False
    from_first: bool = False
    metres: float = 1.0
    gon: bool = False
    separator: str = "-"
    """What stands between names."""
    defaults: int = 0
    is_default: bool = False
    """True if the last σ was that of the instrument: only then centring adds to it."""
    instrument: Instrument = field(default_factory=Instrument)
    library: dict[str, Instrument] = field(default_factory=dict)
    """Instruments of the project options, by their names in capitals."""
    tables: dict[tuple[str, Instrument | None, str], list[Row]] = field(default_factory=dict)
    """Rows by type, the instrument that their σ are of, and file."""
    observed: set[str] = field(default_factory=set)
    side_shots: list[tuple[DataLine, str, dict[str, Any]]] = field(default_factory=list)
    """Lines SS with their file and the options in force."""
    file: str = ""
    """The data file that is read, of a project of several ones."""
    known: bool = False
    """True if the project options are known."""
    crs: str = ""
    """The projection of the coordinates, if the project options name one."""
    undulation: float = 0.0
    """Geoid height (m)."""
    deflection: tuple[str, str] = ("0", "0")
    """North and east (seconds)."""
    refraction: float = 0.0
    points: dict[str, tuple[list[str | None], list[str | None], int]] = field(default_factory=dict)
    """Coordinates and σ (0: fixed, empty: free) of each point, with the line."""
    station: str = ""
    sets: dict[str, int] = field(default_factory=dict)
    traverse: list[DataLine] = field(default_factory=list)
    skipped: dict[str, list[tuple[int, str]]] = field(default_factory=dict)
    """Lines that are not read, with their files."""
    origin: dict[str, tuple[object, str]] = field(default_factory=dict)
    """Points as they are put last, and in which file."""
    vectors: list[Vector] = field(default_factory=list)
    by_correlation: bool = False
    """G2 and G3 are σ and correlations, else variances and covariances."""
    factors: tuple[float, float] = (1.0, 1.0)
    """Of σ of vectors, horizontal and vertical."""
    positive_west: bool = False
    geodetic: dict[str, int] = field(default_factory=dict)
    """Points with latitude, longitude and height, and their lines."""

    def add(self, type_: str, values: Values, line: int) -> None:
        """A row of observations, none where its σ is that of a free one."""
        if "*" in values:
            self.skip("free observations (*)", line)
            return
        cells = [None if v is None else v if isinstance(v, str) else repr(float(v)) for v in values]
        instrument = self.instrument if self.is_default and any(self.instrument.centring) else None
        self.tables.setdefault((type_, instrument, self.file), []).append(Row(cells, line))
        names = ("from", "to", "at", "station")
        for name in (str(v) for v, column in zip(values, COLUMNS[type_], strict=True) if column in names):
            self.points.setdefault(name, ([None] * 3, [None] * 3, line))
            self.observed.add(name)

    def resume(self, file: str, options: dict[str, Any]) -> None:
        """Go on in a file with the options that hold there."""
        self.file = file
        for name, value in options.items():
            setattr(self, name, value)

    def skip(self, what: str, line: int) -> None:
        """A line that is not read."""
        self.skipped.setdefault(what, []).append((line, self.file))

    def note_points(self) -> None:
        """Points that are new or changed are of this file."""
        for name, point in self.points.items():
            if name not in self.origin or self.origin[name][0] is not point:
                self.origin[name] = (point, self.file)

    def put_points(self, columns: Sequence[str], rows: list[Row], **keys: Any) -> None:
        """Add tables of points, one for each file."""
        for file in dict.fromkeys(self.origin[str(row.cells[0])][1] for row in rows):
            own = [row for row in rows if self.origin[str(row.cells[0])][1] == file]
            self.draft.table("points", columns, own, file, **keys)

    def angle(self, text: str) -> float:
        """An angle in degrees."""
        return parse_number(text) * 0.9 if self.gon else degrees(text)

    def length(self, text: str) -> float:
        """A length in metres."""
        return parse_number(text) * self.metres

    def sigma(self, words: Sequence[str], place: int, kind: str, length: float = 0.0) -> str | float:
        """σ of an angle (degrees) or a ``length`` (m) at a place among the words behind the values."""
        word = words[place] if place < len(words) else "&"
        self.is_default = word == "&"
        angular = kind in ("angle", "direction", "bearing", "zenith")
        if word == "*":
            return "*"
        if word == "!":
            return FIXED[kind] / (3600.0 if angular else 1.0)
        if word != "&":
            value = parse_number(word)
            if value <= 0.0:
                raise ValueError(f"found the σ {word}, expected a number above 0, !, * or &")
            return value * (9e-5 if self.gon else 1.0 / 3600.0) if angular else value * self.metres
        self.defaults += 1
        sigma = self.instrument.sigma[kind]
        return sigma / 3600.0 if angular else sigma + self.instrument.ppm * 1e-6 * abs(length)


# ---- Lines of STAR*NET with measured values: what each code adds to the network.


def names_of(word: str, count: int, network: StarNetContext) -> list[str]:
    """Names that stand in one word. Raises ``ValueError``."""
    names = word.split(network.separator)
    if len(names) != count or not all(names):
        raise ValueError(f"found {word!r}, expected {count} names with {network.separator} between them")
    if len(set(names)) < len(names):
        raise ValueError(f"found {word!r}, expected different points")
    return names


def at_from_to(word: str, network: StarNetContext) -> list[str]:
    """Names of an angle, the station first, whatever the order in force."""
    names = names_of(word, 3, network)
    return [names[1], names[0], names[2]] if network.from_first else names


def need(line: DataLine, count: int, form: str) -> None:
    """Raise ``ValueError`` where a line has too few words."""
    if len(line.words) == 1 < count:
        raise ValueError(f"found no measured values, as in a pre-analysis; expected {form}")
    if len(line.words) < count:
        raise ValueError(f"found {len(line.words)} words, expected {form}")


def heights(line: DataLine, network: StarNetContext) -> tuple[float, float]:
    """Heights of instrument and target, m."""
    a, b = line.heights or (0.0, 0.0)
    return a * network.metres, b * network.metres


def bearing(line: DataLine, network: StarNetContext) -> None:
    """A bearing."""
    need(line, 2, "from-to, bearing, σ")
    ends = names_of(line.words[0], 2, network)
    network.add("bearing", (*ends, network.angle(line.words[1]), network.sigma(line.words, 2, "bearing")), line.number)


def angle(line: DataLine, network: StarNetContext) -> None:
    """A horizontal angle."""
    need(line, 2, "at-from-to, angle, σ")
    names = at_from_to(line.words[0], network)
    network.add("angle", (*names, network.angle(line.words[1]), network.sigma(line.words, 2, "angle")), line.number)


def distance(line: DataLine, network: StarNetContext) -> None:
    """A distance: horizontal in the plane and with .DELTA ON, else along the slope."""
    need(line, 2, "from-to, distance, σ")
    put_distance(names_of(line.words[0], 2, network), line.words[1], 2, line, network)


def put_distance(
    ends: list[str], word: str, place: int, line: DataLine, network: StarNetContext, zenith: str = ""
) -> None:
    """A distance, its σ at a place among the words of the line; reduced to the plane with the zenith angle."""
    length = network.length(word)
    if zenith and not network.delta and (network.plane or network.reduced):
        length *= abs(sin(radians(network.angle(zenith))))
    elif network.reduced and not network.delta:
        network.skip("distances along the slope without a zenith angle in the plane", line.number)
        return
    sigma = network.sigma(line.words, place, "distance", length)
    if network.plane or network.delta or network.reduced:
        network.add("horizontal_distance", (*ends, length, sigma), line.number)
    else:
        network.add("distance", (*ends, length, sigma, *heights(line, network)), line.number)


def put_vertical(
    ends: list[str], word: str, words: list[str], place: int, line: DataLine, network: StarNetContext
) -> None:
    """A zenith angle, or with .DELTA ON an elevation difference between the marks."""
    if network.plane or network.reduced:
        network.skip("zenith angles and height differences in the plane", line.number)
    elif network.delta:
        own, target = heights(line, network)
        dz = network.length(word) + own - target
        network.add("height_difference", (*ends, dz, network.sigma(words, place, "height")), line.number)
    else:
        sigma, zenith = network.sigma(words, place, "zenith"), network.angle(word)
        zenith = 360.0 - zenith if zenith > 180.0 else zenith  # face two
        network.add("zenith_angle", (*ends, zenith, sigma, *heights(line, network)), line.number)


def vertical(line: DataLine, network: StarNetContext) -> None:
    """A zenith angle or an elevation difference."""
    need(line, 2, "from-to, zenith angle, σ")
    put_vertical(names_of(line.words[0], 2, network), line.words[1], line.words, 2, line, network)


def put_both(ends: list[str], first: int, place: int, line: DataLine, network: StarNetContext) -> None:
    """A distance and, in space, what goes with it in height; their σ stand from a place on."""
    zenith = "" if network.plane else line.words[first + 1]
    put_distance(ends, line.words[first], place, line, network, zenith)
    if zenith:
        put_vertical(ends, zenith, line.words, place + 1, line, network)


def distance_and_vertical(line: DataLine, network: StarNetContext) -> None:
    """A distance and what goes with it in height."""
    need(line, 3, "from-to, distance, zenith angle, σ")
    ends = names_of(line.words[0], 2, network)
    put_distance(ends, line.words[1], 3, line, network, line.words[2])
    put_vertical(ends, line.words[2], line.words, 4, line, network)


def measured(line: DataLine, network: StarNetContext) -> None:
    """All to a point: angle, distance and, in space, zenith angle, with their σ in this order."""
    values = 3 if network.plane else 4
    need(line, values, "at-from-to, angle, distance, zenith angle, σ")
    given, words = line.words[0].split(network.separator), line.words
    at, back = (given[1:2], given[:1]) if network.from_first else (given[:1], given[1:2])
    if len(given) == 3 and given[2:] == back:
        ends = names_of(network.separator.join((*at, *back)), 2, network)
        network.skip(f"angles of {line.code} from a backsight to itself", line.number)
    else:
        names = at_from_to(line.words[0], network)
        network.add("angle", (*names, network.angle(words[1]), network.sigma(words, values, "angle")), line.number)
        ends = [names[0], names[2]]
    put_both(ends, 2, values + 1, line, network)


def bearing_measured(line: DataLine, network: StarNetContext) -> None:
    """All to a point, by its bearing."""
    values = 3 if network.plane else 4
    need(line, values, "from-to, bearing, distance, zenith angle, σ")
    ends, words = names_of(line.words[0], 2, network), line.words
    network.add("bearing", (*ends, network.angle(words[1]), network.sigma(words, values, "bearing")), line.number)
    put_both(ends, 2, values + 1, line, network)


def levelled(line: DataLine, network: StarNetContext) -> None:
    """Elevation difference and the length of the line: σ = 2 mm √km, unless the third value is a σ behind &."""
    need(line, 2, "from-to, elevation difference, length of the line, σ")
    words = line.words
    ends, dz = names_of(words[0], 2, network), network.length(words[1])
    if len(words) > 3:
        sigma: str | float = network.sigma(words, 3, "height")
    elif len(words) > 2 and words[2] not in STATUSES:
        length = network.length(words[2])
        if length <= 0.0:
            raise ValueError(f"found the length {words[2]}, expected a number above 0")
        network.defaults += 1
        network.is_default = True
        sigma = network.instrument.sigma["level"] * (length / 1000.0) ** 0.5
    else:
        sigma = network.sigma(words, 2, "height")
    network.add("height_difference", (*ends, dz, sigma), line.number)


# ---- GNSS vectors G1, G2, G3, and positions on the ellipsoid P, PH.


def vector(line: DataLine, network: StarNetContext) -> None:
    """G1 begins a vector, G2 and G3 are its variances and covariances, or σ and correlations."""
    if line.code == "G1":
        need(line, 4, "from-to, dx, dy, dz")
        ends = names_of(line.words[0], 2, network)
        difference = [parse_number(word) for word in line.words[1:4]]
        found = Vector(ends, difference, line.number, network.factors, network.by_correlation, network.file)
        network.vectors.append(found)
        for name in ends:
            network.points.setdefault(name, ([None] * 3, [None] * 3, line.number))
        return
    need(line, 3, "three numbers")
    if not network.vectors:
        raise ValueError("expected G1 before it")
    numbers = [parse_number(word) for word in line.words[:3]]
    if line.code == "G2":
        network.vectors[-1].variances = numbers
    else:
        network.vectors[-1].covariances = numbers


def _geodetic(line: DataLine, network: StarNetContext) -> None:
    """P, PH: latitude, longitude (with N S E W, or signed) and height; σ north, east and up."""
    need(line, 3, "name, latitude, longitude, height, and their σ")
    name, *rest = line.words
    angles = []
    for word, negative in ((rest.pop(0), "S"), (rest.pop(0), "W")):
        letter = next((sign for sign in "NSEW" if sign in word.upper()), "")
        angle = degrees(re.sub("[NSEW]", "", word, flags=re.IGNORECASE))
        west = negative == "W" and not letter and network.positive_west
        angles.append(-angle if letter == negative or west else angle)
    height = network.length(rest.pop(0)) if rest and rest[0] not in STATUSES else None
    marks = [_status(word, network) for word in rest[:3]] + [None] * 3
    texts = [repr(angles[0]), repr(angles[1]), None if height is None else repr(height)]
    network.points[name] = (texts, marks[:3], line.number)
    network.geodetic[name] = line.number


# ---- Sets of directions and traverses of STAR*NET.


def begin_set(line: DataLine, network: StarNetContext) -> None:
    """DB: directions from here on belong to a new set at this station."""
    need(line, 1, "the station of the set")
    network.station = line.words[0]
    network.sets[network.station] = network.sets.get(network.station, 0) + 1


def direction(line: DataLine, network: StarNetContext) -> None:
    """A direction, and with DM the distance and zenith angle as well."""
    if not network.station:
        raise ValueError("expected DB with the station of the set before it")
    full = line.code == "DM"
    values = (3 if network.plane else 4) if full else 2
    need(line, values, "point, direction, distance, zenith angle, σ" if full else "point, direction, σ")
    number_ = network.sets[network.station]
    at = (network.station, None if number_ == 1 else str(number_), line.words[0])
    if line.words[0] == network.station:
        raise ValueError(f"found the station {network.station!r} itself as target")
    words = line.words
    reading = network.angle(words[1])
    if full and values == 4 and not network.delta and network.angle(words[3]) > 180.0:  # face two
        reading = (reading + 180.0) % 360.0
    network.add("directions", (*at, reading, network.sigma(words, values, "direction")), line.number)
    if full:
        ends = [network.station, words[0]]
        put_both(ends, 2, values + 1, line, network)


def end_set(line: DataLine, network: StarNetContext) -> None:
    """DE: the set is complete."""
    network.station = ""


def traverse(line: DataLine, network: StarNetContext) -> None:
    """TB with a backsight or its bearing, T for each station with what is measured to the next one, TE with the end."""
    if line.code == "TB":
        need(line, 1, "the backsight, or its bearing")
        network.traverse = [line]
        return
    if not network.traverse:
        raise ValueError("expected TB before it")
    need(line, 1, "the station")
    if len(network.traverse) > 1:
        _leg(network.traverse, line.words[0], network)
    network.traverse = [*network.traverse[-1:], line] if len(network.traverse) > 1 else [*network.traverse, line]
    if line.code == "TE":
        if len(line.words) > 2:
            names = (line.words[0], network.traverse[-2].words[0], line.words[2])
            network.add("angle", (*names, network.angle(line.words[1]), network.sigma([], 0, "angle")), line.number)
        network.traverse = []


def _leg(lines: list[DataLine], target: str, network: StarNetContext) -> None:
    """Observation of a T line: the backsight is the station before it, or that of TB."""
    before, line = lines[-2], lines[-1]
    values = 3 if network.plane else 4
    need(line, values, "station, angle, distance, zenith angle, σ")
    words = line.words
    at, turned = words[0], network.angle(words[1])
    back = before.words[0]
    sigma = network.sigma(words, values, "angle")
    if before.code == "TB" and (
        "-" in back or (back[:1].upper() in "NS" and back[-1:].upper() in "EW" and any(c.isdigit() for c in back))
    ):
        network.add("bearing", (at, target, (network.angle(back) + turned) % 360.0, sigma), line.number)
    else:
        network.add("angle", (at, back, target, turned, sigma), line.number)
    put_both([at, target], 2, values + 1, line, network)


# ---- Project files of STAR*NET (.snproj): sections of keys and values, with σ of instruments and the data files.
#
# Source: project files beside the listings that STAR*NET 13 wrote of them. A data file with an odd number is switched
# on; σ of levels is in m on the square root of a metre. STAR*NET's coefficient of refraction is half of mor's.

_STD_ERR = {"angle": "angle", "direction": "direction", "azimuth": "bearing", "zenith": "zenith"}
_STD_ERR |= {"distance": "distance", "delta_elev": "height"}


def _read_project(lines: list[str], network: StarNetContext) -> list[str]:
    """Take the options of a project file; return the names of its data files. Raises ``ValueError``."""
    section, files, options = "", list[str](), dict[str, str]()
    instruments: list[dict[str, str]] = [{}]
    for text in lines:
        key, _, value = text.partition("#")[0].strip().partition(" ")
        if key.startswith("["):
            section = key
        elif section == "[DataFileList]" and key.isdecimal():
            files += [value.strip().strip('"')] if int(key) % 2 else []
        elif section == "[Adjustment]":
            options[key] = value.strip()
        elif section in ("[Instrument]", "[InstrumentLibrary]"):
            instruments += [{}] if key == "instrument_name" else []
            instruments[-1][key] = value.strip()
    network.known, network.flat = True, options.get("adjustment_type") == "2D"
    units = options.get("linear_units", "Meters")
    length = units.upper().replace("INTERNATIONAL", "")
    lengths = {"METERS": 1.0, "FEET": 0.3048, "FEETUS": 1200.0 / 3937.0}
    if length not in lengths:
        raise ValueError(f"found the linear units {units!r}, expected one of {', '.join(lengths)}")
    network.metres = lengths[length]
    network.gon = options.get("angle_output_units", "DMS").upper().startswith("G")
    network.east_first = options.get("coordinate_order") == "EN"
    network.from_first = options.get("angle_station_order", "").upper() == "FROM-AT-TO"
    network.delta = options.get("3D_input_mode", "").upper().startswith("HORIZ")
    network.positive_west = options.get("longitude_convention") == "0"
    network.refraction = 2.0 * parse_number(options.get("index_of_refraction", "0"))
    network.undulation = parse_number(options.get("geoid_height", "0"))
    network.deflection = (options.get("vert_defl_north", "0"), options.get("vert_defl_east", "0"))
    if options.get("local_or_grid_adjustment") == "1":
        name = options.get("coordinate_system_name", "")
        grids = {"NEWBRUNSWICK83": "EPSG:2953", **{f"UTM83-{zone}": f"EPSG:{26900 + zone}" for zone in range(1, 24)}}
        network.crs = grids.get(name.upper().replace("/CSRS", "").removesuffix("N"), "")
        if not network.crs:
            raise ValueError(f"found the coordinate system {name!r}, expected a zone of UTM83, or a local system")
    for found in instruments:
        name = found.get("instrument_name", "")
        sigma = dict(network.library.get("", Instrument()).sigma)
        sigma |= {
            kind: parse_number(found[f"{key}_std_err"]) for key, kind in _STD_ERR.items() if f"{key}_std_err" in found
        }
        sigma["level"] = parse_number(found.get("level_std_err", "0")) * 1000.0**0.5 or sigma["level"]
        centring = [
            parse_number(found.get(f"{key}_centering_error", "0")) for key in ("instrument", "target", "vertical")
        ]
        ppm = parse_number(found.get("edm_ppm", "0"))
        network.library[name.upper()] = Instrument(sigma, ppm, (centring[0], centring[1], centring[2]))
    network.instrument = network.library[""]
    return files


# ---- A STAR*NET input file (``.dat``) as a project: plane or local spatial networks.
#
# Codes C E B A D V DV M BM L SS, sets DB DN DM DE, traverses TB T TE, and GNSS vectors G1 G2 G3 between points with
# geocentric (C) or geodetic (P PH) coordinates, or in a projection that a project file names; others are left out and
# told. Source: MicroSurvey, *STAR*NET Reference Manual*, chapter 5; Carlson, *SurvNet*, for files of vectors with
# geocentric coordinates.


def read_starnet(path: Path) -> Document:
    """The project of a STAR*NET input or project file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    text = text_lines(path, draft)
    network = StarNetContext(draft)
    files = {"": text}
    if PROJECT_FILE.match("\n".join(text)):
        try:
            names = _read_project(text, network)
        except ValueError as error:
            draft.problem(str(error))
            raise InputError(draft.problems) from None
        places = [path.parent / name.replace("\\", "/") for name in names]
        files = {str(place): text_lines(place, draft) for place in places}
        if not files:
            draft.problem("the project has no data files that are switched on ([DataFileList])")
    lines = {file: list(read_lines(text)) for file, text in files.items()}
    network.plane = _is_plane([line for some in lines.values() for line in some], network)
    # Options of the project that hold again where another data file begins.
    restored = (
        *("plane", "reduced", "delta", "east_first", "from_first"),
        *("metres", "gon", "separator", "instrument", "positive_west"),
    )
    start = {name: getattr(network, name) for name in restored}
    for file, some in lines.items():
        network.resume(file, start)
        for line in some:
            if line.code == "SS":
                options = {name: getattr(network, name) for name in restored}
                network.side_shots.append((line, file, options))
            else:
                _tried(_read_line, line, network)
        network.note_points()
    for line, file, options in network.side_shots:
        network.resume(file, options)
        _tried(_side_shot, line, network)
        network.note_points()
    on_earth = _put_vectors(network)
    _finish(network, path.stem, on_earth)
    return draft.finish()


def _tried(read: Callable[[DataLine, StarNetContext], None], line: DataLine, network: StarNetContext) -> None:
    with network.draft.at(line.number, network.file, line.code):
        read(line, network)


def _side_shot(line: DataLine, network: StarNetContext) -> None:
    """SS: STAR*NET does not adjust it, so it has no influence on a point with other observations."""
    if line.words and line.words[0].split(network.separator)[-1] in network.observed:
        network.skip("side shots (SS) to points that have other observations", line.number)
    else:
        measured(line, network)


def _read_line(line: DataLine, network: StarNetContext) -> None:
    """One line. Raises ``ValueError``."""
    code = line.code
    if code.startswith("."):
        _option(code[1:], [word.upper() for word in line.words], line.number, network)
    elif code in _CODES:
        _CODES[code](line, network)
    elif code in ("G4", "EH", "CH"):
        network.skip(code, line.number)
    elif code != "G0":
        raise ValueError(f"unknown code, expected one of {', '.join(_CODES)}")


def _is_geocentric(place: Sequence[float] | FloatArray) -> bool:
    """True for coordinates C at the surface of the earth; the third one of others is a height."""
    return len(place) == 3 and abs(place[2]) > 1e4 and 6.3e6 < float(np.linalg.norm(place)) < 6.4e6


def _put_vectors(network: StarNetContext) -> bool:
    """Write GNSS vectors; True for a project on the earth.

    The projection of coordinates stands in STAR*NET's project options: vectors need points whose coordinates are
    geocentric or geodetic.
    """
    if network.crs:
        _put_projected(network)
        return True
    draft, places = network.draft, dict[str, FloatArray]()
    for name, (texts, _, line) in network.points.items():
        if texts[0] is None and texts[1] is None:
            continue
        place = np.array([np.nan if text is None else float(text) for text in texts])
        if name in network.geodetic:
            if texts[2] is None:
                draft.problem(f"P: point {name} has no height", line)
            places[name] = geocentric(np.nan_to_num(place)[None])[0]
        elif _is_geocentric(place):
            places[name] = place
        elif network.geodetic or network.vectors:
            words = "vectors (G1) and positions on the ellipsoid (P): the projection of the other points is unknown"
            for line in [*network.geodetic.values(), *(one.line for one in network.vectors)]:
                network.skip(words, line)
            network.points = {k: v for k, v in network.points.items() if k not in network.geodetic}
            return False
    if not (network.vectors or network.geodetic):
        return False
    if not places:
        draft.problem("GNSS vectors need a point with geocentric (C) or geodetic (P, PH) coordinates")
        return False
    draft.put("world", {"crs": "EPSG:4978"})
    _put_places(network, places)
    _put_clusters(network, np.mean(list(places.values()), axis=0))
    return True


def _put_clusters(network: StarNetContext, place: FloatArray) -> None:
    """Write GNSS vectors, their factors horizontal and vertical at a geocentric place."""
    axes, clusters = horizon_axes(place), []
    for one in network.vectors:
        if len(one.variances) < 3 or min(one.variances) <= 0.0:
            words = f"G1: vector {'-'.join(one.ends)} has no G2 with three numbers above 0"
            network.draft.problem(words, one.line, one.file)
            continue
        clusters.append(([Row([*one.ends, *map(repr, one.difference)], one.line)], one.matrix(axes)))
    if clusters:
        file = network.vectors[0].file
        network.draft.correlated(("from", "to", "dx", "dy", "dz"), clusters, "gnss_vector", file)


def _put_projected(network: StarNetContext) -> None:
    """Write points in the projection of the project options, with its geoid height and deflection."""
    from mor.project.reference_system import reference_system

    draft, system = network.draft, reference_system(network.crs)
    draft.put("world", {"crs": network.crs, "heights": "orthometric"})
    held: dict[bool, list[Row]] = {True: [], False: []}
    known, levelled = [], list[Row]()
    for name, (texts, sigma, line) in network.points.items():
        cells = list(texts)
        if name in network.geodetic and texts[2] is not None:
            latitude, longitude, height = (float(str(text)) for text in texts)
            place = system.from_geodetic(np.array([[np.radians(latitude), np.radians(longitude), height]]))[0]
            cells = [repr(float(value)) for value in place - [0.0, 0.0, network.undulation]]
            sigma = [sigma[1], sigma[0], sigma[2]]
        if cells[2] is not None and None in cells[:2]:  # E without C
            if sigma[2] is not None:
                levelled.append(Row([name, cells[2], repr(float(sigma[2]) or FIXED["height"])], line))
            cells = [None] * 3
        if None not in cells:
            known.append([float(str(cell)) for cell in cells])
        fixed = None not in cells and sigma == ["0"] * 3
        own = [
            None if s is None or fixed or t is None else repr(float(s) or 1e-6)
            for s, t in zip(sigma, cells, strict=True)
        ]
        held[fixed].append(Row([name, *cells, repr(network.undulation), *network.deflection, *own], line))
    columns = ("id", "east", "north", "height", "geoid", "deflection_north", "deflection_east")
    sigmas = ("sigma_east", "sigma_north", "sigma_up")
    units = {"deflection_north": "arcsec", "deflection_east": "arcsec"}
    for fixed, rows in held.items():
        if rows:
            network.put_points((*columns, *sigmas), rows, units=units, fixed=["x", "y", "z"] if fixed else None)
    if levelled:
        draft.table("observations", ("point", "height", "sigma"), levelled, type="orthometric_height")
    if not known:
        draft.problem("no point has coordinates (C or P)")
        return
    _put_clusters(network, system.ellipsoid.geocentric(system.to_geodetic(np.array(known)))[0])


def horizon_axes(place: FloatArray) -> FloatArray:
    """(3, 3) unit vectors east, north and up at a geocentric place (3,)."""
    from mor.model.earth import east_north_up
    from mor.project.reference_system import reference_system

    latitude, longitude, _ = reference_system("EPSG:4978").ellipsoid.geodetic(place[None])[0]
    return east_north_up(latitude, longitude)


def _put_places(network: StarNetContext, places: dict[str, FloatArray]) -> None:
    """Points on the earth: held, or observed with σ north, east and up (P) or along the geocentric axes (C)."""
    draft = network.draft
    held: dict[bool, list[Row]] = {True: [], False: []}
    observed = []
    for name, (_, sigma, line) in network.points.items():
        place = places.get(name)
        cells = [None] * 3 if place is None else [repr(float(value)) for value in place]
        fixed = place is not None and all(s == "0" for s in sigma)
        own: list[str | None] = [None if s is None else repr(float(s) or 1e-6) for s in sigma]
        if fixed or name not in network.geodetic:
            if not fixed and any(own):
                values = [value if s else None for value, s in zip(cells, own, strict=True)]
                observed.append(Row([name, *values, *own], line))
            own = [None] * 3
        held[fixed].append(Row([name, *cells, *own], line))
    columns = ("id", "x", "y", "z", "sigma_north", "sigma_east", "sigma_up")
    for fixed, rows in held.items():
        if rows:
            network.put_points(columns, rows, fixed=["x", "y", "z"] if fixed else None)
    if observed:
        columns = ("point", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
        draft.table("observations", columns, observed, type="gnss_position")
    if not held[True] and not observed and not any(row.cells[4:] != [None] * 3 for row in held[False]):
        draft.put("datum", "free")
    if network.geodetic:
        draft.note(
            "heights of P are taken as ellipsoidal; longitudes without E or W are positive east unless .LONG says POS"
        )


def _is_plane(lines: Sequence[DataLine], network: StarNetContext) -> bool:
    """True if the lines before the first .2D or .3D are those of a plane network, without zenith angles and heights.

    A name with two coordinates has at most two σ behind them; more words, or a third number alone, are a height. Where
    a line M has only an angle and a distance, none has a zenith angle.
    """
    if network.known:
        return network.flat
    first = next((k for k, line in enumerate(lines) if line.code in (".2D", ".3D")), len(lines))
    if first < len(lines) and all(line.code[0] == "." for line in lines[:first]):
        return lines[first].code == ".2D"
    lines = lines[:first]
    if min((_count(line) for line in lines if line.code == "M"), default=0) > 3:
        return False
    return not any(
        line.code in ("V", "DV", "E", "L", "G1", "P", "PH")
        or (line.code == "C" and (len(line.words) > 5 or len(line.words) == _count(line) == 4))
        for line in lines
    )


def _count(line: DataLine) -> int:
    return len([word for word in line.words if word not in STATUSES])


def _option(name: str, words: list[str], line: int, network: StarNetContext) -> None:
    if name == "UNITS":
        for word in words:
            if word in ("METERS", "METRES", "FEET", "USFEET", "FEETUS"):
                network.metres = {"F": 0.3048, "U": 1200.0 / 3937.0, "M": 1.0}[word[0]]
                network.metres = 1200.0 / 3937.0 if word == "FEETUS" else network.metres
            elif word in ("GONS", "DMS"):
                network.gon = word == "GONS"
            else:
                raise ValueError(f"found the unit {word}, expected METERS, FEET, USFEET, DMS or GONS")
    elif name == "ORDER":
        for word in words:
            if word in ("EN", "NE"):
                network.east_first = word == "EN"
            elif word in ("ATFROMTO", "FROMATTO"):
                network.from_first = word == "FROMATTO"
            else:
                raise ValueError(f"found {word}, expected NE, EN, ATFROMTO or FROMATTO")
    elif name == "DELTA":
        network.delta = words[:1] == ["ON"]
    elif name == "GPS" and words[:1] == ["WEIGHT"] and words[1:] and words[1][:3] in ("COV", "STD"):
        network.by_correlation = words[1].startswith("STD")
    elif name == "GPS" and words[:1] == ["FACTOR"] and len(words) in (2, 4):
        network.factors = (parse_number(words[1]), parse_number(words[-1]))
    elif name == "LONG":
        network.positive_west = words[:1] == ["POS"]
    elif name == "DATA":
        network.skip("lines after .DATA OFF are read all the same", line)
    elif name in ("SEP", "SEPARATOR") and words:
        network.separator = words[0][:1]
    elif name == "INST" and words[:1] and words[0] in network.library:
        network.instrument = network.library[words[0]]
    elif name in ("2D", "3D") or name[:2] == "3R":  # the format of the lines behind it, not the kind of adjustment
        network.plane = name == "2D"
        network.reduced = name != "2D" and (name != "3D" or network.flat)
    elif name != "1D":
        network.skip(f".{name}", line)


def _coordinates(line: DataLine, network: StarNetContext) -> None:
    need(line, 3, "name, north, east, elevation, and their σ")
    name, *rest = line.words
    values: list[float] = []
    while rest and rest[0] not in STATUSES and len(values) < (2 if network.plane else 3):
        values.append(network.length(rest.pop(0)))
    if len(values) < 2:
        raise ValueError("found no north and east")
    marks = [_status(word, network) for word in rest[: len(values)]]
    marks += [None] * (3 - len(marks))
    first, second = (0, 1) if network.east_first or _is_geocentric(values) else (1, 0)
    texts = [repr(values[first]), repr(values[second]), repr(values[2]) if len(values) > 2 else None]
    if name in network.points and len(values) < 3:  # its elevation stands in a line of its own
        (*_, texts[2]), (*_, marks[2]), _ = network.points[name]
    network.points[name] = (texts, [marks[first], marks[second], marks[2]], line.number)


def _status(word: str, network: StarNetContext) -> str | None:
    if word == "!":
        return "0"
    if word in ("*", "&"):
        return None
    value = network.length(word)
    if value < 0.0:
        raise ValueError(f"found the σ {word}, expected 0 or more, ! or *")
    return repr(value)


def _elevation(line: DataLine, network: StarNetContext) -> None:
    need(line, 2, "name, elevation and its σ")
    texts, sigma, _ = network.points.get(line.words[0], ([None] * 3, [None] * 3, 0))
    mark = _status(line.words[2], network) if len(line.words) > 2 else None
    place = [*texts[:2], repr(network.length(line.words[1]))]
    network.points[line.words[0]] = (place, [*sigma[:2], mark], line.number)


_CODES: dict[str, Callable[[DataLine, StarNetContext], None]] = {
    "C": _coordinates,
    "E": _elevation,
    **dict.fromkeys(("G1", "G2", "G3"), vector),
    **dict.fromkeys(("P", "PH"), _geodetic),
    "B": bearing,
    "A": angle,
    "D": distance,
    "V": vertical,
    "DV": distance_and_vertical,
    "M": measured,
    "SS": measured,
    "BM": bearing_measured,
    "L": levelled,
    "DB": begin_set,
    "DN": direction,
    "DM": direction,
    "DE": end_set,
    **dict.fromkeys(("TB", "T", "TE"), traverse),
}
"""What reads the lines of each code."""


def _finish(network: StarNetContext, title: str, on_earth: bool) -> None:
    draft = network.draft
    draft.put("title", title)
    draft.put("units", {"length": "m", "angle": "deg"})
    draft.put("axes", {"xy": "en", "angles": "clockwise", "bearings_from": "north"})
    if not on_earth and _dimensions(network) == "xyz":
        _hold_heights(network)
    rows = [
        Row([name, *texts, *(s if t is not None else None for s, t in zip(sigma, texts, strict=True))], line)
        for name, (texts, sigma, line) in network.points.items()
    ]
    if not on_earth and rows:
        columns = ("id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
        network.put_points(columns, rows)
    if network.crs and network.refraction:
        draft.put("instruments", {"starnet": {"refraction": repr(network.refraction)}})
    on_grid = {"bearing": "projected_bearing", "horizontal_distance": "height_reduced_distance"} if network.crs else {}
    for (type_, instrument, file), found in network.tables.items():
        if on_earth and type_ == "bearing" and not network.crs:
            for row in found:
                network.skip("B, BM: bearings in an unknown projection", row.line)
            continue
        keys = instrument.keys(type_) if instrument else {}
        if network.crs and network.refraction and type_ == "zenith_angle":
            keys["instrument"] = "starnet"
        draft.table("observations", COLUMNS[type_], found, file, type=on_grid.get(type_, type_), **keys)
    if not network.tables and not rows:
        draft.problem("there are no points and no observations")
    if not on_earth:
        draft.put("settings", {"dimensions": _dimensions(network)})
    for what, lines in sorted(network.skipped.items(), key=lambda one: -len(one[1])):
        draft.note(f"not read: {what} ({counted(len(lines), 'line')})", *lines[0])
    if network.defaults and not network.known:
        words = (
            f"{counted(network.defaults, 'observation')} without σ: 4″ for angles, 10″ for zenith angles, 2 mm for "
            "distances, 15 mm for height differences, 2 mm √km for levelling; the project options of STAR*NET stand "
            "in another file"
        )
        draft.note(words)


def _hold_heights(network: StarNetContext) -> None:
    """Hold the heights of points that only lines in the plane (.2D) observe: STAR*NET leaves them undetermined."""
    seen = {
        cell
        for (type_, _, _), rows in network.tables.items()
        if type_ in ("distance", "zenith_angle", "height_difference")
        for row in rows
        for cell in row.cells[:2]
    }
    flat = [name for name in network.observed - seen if network.points[name][1][2] is None]
    for name in flat:
        (*place, height), (*sigma, _), line = network.points[name]
        network.points[name] = ([*place, height or "0"], [*sigma, "0"], line)
        network.origin[name] = (network.points[name], network.origin[name][1])
    if flat:
        network.draft.note(
            f"{counted(len(flat), 'point')} without an observation of the height: their heights are held"
        )


def _dimensions(network: StarNetContext) -> str:
    types = {type_ for type_, _, _ in network.tables}
    heights = {"height_difference", "zenith_angle", "distance"} & types
    flat = {"angle", "bearing", "directions", "horizontal_distance"} & types
    if not network.tables and not network.plane:
        return "xyz"
    return "xyz" if heights and (flat or "distance" in types) else "z" if heights else "xy"


# ---- A network as a STAR*NET input file: metres, d-m-s, x east, with all the digits a round trip needs.
#
# Source: MicroSurvey, *STAR*NET Reference Manual*, chapter 5.

_TYPES = (
    *("distance", "horizontal_distance", "directions", "zenith_directions", "angle"),
    *("bearing", "zenith_angle", "vertical_direction", "height_difference"),
)
"""Types that STAR*NET has."""
_SECOND = ANGLE_UNITS["arcsec"]


def write_starnet(document: Document, folder: Path, target: Path) -> Written:
    """The network; what STAR*NET has no place for is noted. Raises :class:`InputError` for what it cannot say."""
    content = content_of(document, folder)
    found, tables = points(content), groups(content, _TYPES)
    separator = _separator(found, content)
    problems = tilted_stations(content, "STAR*NET")
    for group in tables:
        if group.covariance is not None or group.entry.cluster:
            words = f"observations {group.entry.name or group.entry.type}: STAR*NET has no correlations"
            problems.append(Message(words, group.rows.file))
    if problems:
        raise InputError(problems)
    dimensions = content.project.settings.dimensions
    lines = [f"# {content.project.title}".rstrip(), ".UNITS METERS DMS", ".ORDER EN ATFROMTO"]
    lines += [
        {"xyz": ".3D", "xy": ".2D", "z": ".1D"}[dimensions],
        *([f".SEPARATOR {separator}"] if separator != "-" else []),
    ]
    written, guessed = _points(found, content)
    lines += written
    known = stations(content)
    for group in tables:
        lines += _set_lines(group, known, content, separator)
        lines += _single_lines(group, known, content, separator)
    if not written and not any(group.rows.count for group in tables):
        words = "STAR*NET has networks: this project has no point with coordinates and no terrestrial observation"
        raise InputError([Message(words, document.file)])
    return Written({target: ("\n".join(lines) + "\n").encode()}, _notes(content, target, guessed))


def _notes(content: Content, target: Path, guessed: int) -> list[Message]:
    notes = not_carried(content, _TYPES, ("stations",), "STAR*NET")
    entries = content.project.observations
    if content.project.images or content.project.cameras:
        notes.append(Message("STAR*NET has no images", str(target)))
    if any(e.instrument or e.centring for e in entries):
        words = "scales, offsets, refraction and σ of centring belong to STAR*NET's project options, not to this file"
        notes.append(Message(words, str(target)))
    if any(e.ppm for e in entries):
        notes.append(Message("σ that grow with the distance are written as they are at the observed one", str(target)))
    if content.project.datum != "fixed":
        words = "STAR*NET has no inner constraints: hold coordinates (!) there, or the network stays without a datum"
        notes.append(Message(words, str(target)))
    if content.project.settings.dimensions == "z":
        notes.append(Message("plan coordinates of a levelling network are not written", str(target)))
    if guessed:
        words = f"points without a height: {guessed}, written with the mean of the others as start value"
        notes.append(Message(words, str(target)))
    return notes


def _separator(found: ContentTable, content: Content) -> str:
    """Separator of names: - or a sign that is in none of them. Raises :class:`InputError`."""
    names = [*found.ids]
    for group in groups(content, _TYPES):
        for reference in PLAIN_TYPES[group.entry.type].references:
            names += group.rows.text(reference.name)
    signs = set("".join(names))
    odd = [name for name in dict.fromkeys(names) if set(name) & set(" \t#'\"") or name[:1] in ".&"]
    # Signs that may stand between the names of a line: the first one, or what .SEPARATOR says.
    separators = "-,:;|_~^+="
    free = [sign for sign in separators if sign not in signs]
    if odd or not free:
        words = f"point {odd[0]!r}: names in STAR*NET have no blanks, # ' \" and no . or & in front" if odd else ""
        raise InputError([Message(words or f"every one of {separators} is in a name", content.document.file)])
    return free[0]


def _points(found: ContentTable, content: Content) -> tuple[list[str], int]:
    """Lines of points, and of how many the height is no more than a mean."""
    values, sigma, free = places(found, content)
    dimensions = content.project.settings.dimensions
    finite = np.isfinite(values)
    some = values[finite[:, 2], 2]
    mean = float(some.mean()) if len(some) else 0.0
    lines, guessed = [], 0
    for k, name in enumerate(found.ids):
        marks = ["!" if not f else plain(s) if np.isfinite(s) else "*" for f, s in zip(free[k], sigma[k], strict=True)]
        if dimensions != "z" and finite[k, :2].all():
            height = [plain(values[k, 2]) if finite[k, 2] else plain(mean)] if dimensions == "xyz" else []
            guessed += dimensions == "xyz" and not finite[k, 2]
            number = 2 + len(height)
            lines.append(" ".join(["C", name, *map(plain, values[k, :2]), *height, *marks[:number]]))
        elif dimensions != "xy" and finite[k, 2]:
            lines.append(f"E {name} {plain(values[k, 2])} {marks[2]}")
    return lines, guessed


def _names(group: ObservationTable, row: int) -> dict[str, str]:
    return {r.name: group.rows.text(r.name)[row] for r in PLAIN_TYPES[group.entry.type].references}


def _set_lines(
    group: ObservationTable, known: dict[str, tuple[str, float]], content: Content, separator: str
) -> Iterator[str]:
    """Directions, set by set; zenith angles of the same readings behind them."""
    if "directions" not in group.entry.type:
        return
    face = np.nan_to_num(group.rows.number("face"), nan=1.0)
    horizontal = circle_in_face_one(group.values[:, 0], face) * content.edge.sense
    sets: dict[tuple[str, str], list[str]] = {}
    vertical = []
    for row in range(group.rows.count):
        names = _names(group, row)
        station = known.get(names["station"], (names["station"], 0.0))[0]
        if np.isfinite(horizontal[row]):
            line = f"DN {names['to']} {dms(horizontal[row])} {seconds(group.sigma[row, 0])}"
            sets.setdefault((names["station"], group.rows.text("set")[row]), [f"DB {station}"]).append(line)
        if group.values.shape[1] > 1 and np.isfinite(group.values[row, 1]):
            zenith = float(zenith_in_face_one(group.values[row, 1], face[row]))
            ends = f"{station}{separator}{names['to']}"
            heights = _heights(heights_of(group, names, row, known, content.edge.metres))
            vertical.append(f"V {ends} {dms(zenith)} {seconds(group.sigma[row, 1])}{heights}")
    for lines in sets.values():
        yield from (*lines, "DE")
    yield from vertical


def _single_lines(
    group: ObservationTable, known: dict[str, tuple[str, float]], content: Content, separator: str
) -> Iterator[str]:
    """Observations that stand by themselves."""
    type_, edge = group.entry.type, content.edge
    if "directions" in type_:
        return
    horizontal = type_ == "horizontal_distance" and content.project.settings.dimensions == "xyz"
    if horizontal:
        yield ".DELTA ON"
    face = np.nan_to_num(group.rows.number("face"), nan=1.0)
    for row in range(group.rows.count):
        names, value, sigma = _names(group, row), group.values[row, 0], group.sigma[row, 0]
        if not np.isfinite(value):
            continue
        ends = separator.join(names.values())
        heights = _heights(heights_of(group, names, row, known, edge.metres))
        if type_ == "angle":
            yield f"A {ends} {dms(value * edge.sense)} {seconds(sigma)}"
        elif type_ == "bearing":
            yield f"B {ends} {dms(value * edge.sense + edge.zero_azimuth)} {seconds(sigma)}"
        elif type_ == "height_difference":
            yield f"L {ends} {plain(value * edge.metres)} & {plain(sigma * edge.metres)}"
        elif type_ in ("zenith_angle", "vertical_direction"):
            zenith = zenith_in_face_one(value, face[row]) if type_ == "zenith_angle" else np.pi / 2 - value
            yield f"V {ends} {dms(float(zenith))} {seconds(sigma)}{heights}"
        else:
            own = "" if horizontal else heights
            yield f"D {ends} {plain(value * edge.metres)} {plain(sigma * edge.metres)}{own}"
    if horizontal:
        yield ".DELTA OFF"


def _heights(pair: tuple[float, float]) -> str:
    return f" {plain(pair[0])}/{plain(pair[1])}" if any(pair) else ""


def plain(value: float) -> str:
    """A number with all its digits and without an exponent."""
    return np.format_float_positional(value, trim="-")


def seconds(sigma: float) -> str:
    """A σ (rad) in seconds of arc."""
    return plain(sigma / _SECOND)


def dms(angle: float) -> str:
    """An angle (rad) as d-m-s within the circle, seconds with nine decimals (5e-15 rad)."""
    parts = round(float(angle) / _SECOND * 1e9) % (1_296_000 * 10**9)
    degrees_, rest = divmod(parts, 3600 * 10**9)
    minutes, rest = divmod(rest, 60 * 10**9)
    return f"{degrees_}-{minutes:02d}-{rest // 10**9:02d}.{rest % 10**9:09d}"
