"""Lines of SNAP files: stations, vectors, observations."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.errors import InputError, Message, nearest
from mor.formats.draft import Draft, Line, Row, parse_number, read_lines
from mor.formats.snap.delimited import Definition, Record, angle_words, date_by, form_of, records
from mor.project.reference_system import ReferenceSystem, reference_system
from mor.types import FloatArray

# ---- Lines of SNAP's files, and the words on them.
#
# Source: the help of SNAP, *Station coordinate file format*, *Observation file format*, *The #data command*.


_QUOTED = re.compile(r"(?:[^\s\"']|\"[^\"]*\"|'[^']*'|[\"'])+")
"""A word of a command; blanks may stand between quotes."""


def lines_of(path: Path, draft: Draft, quoted: bool = False) -> list[Line]:
    """Lines without comments (!), with those that ``&`` continues in one. Raises :class:`InputError`.

    ``quoted``: blanks between quotes belong to a word.
    """
    if not path.is_file():
        raise InputError([Message("this file does not exist", str(path))])
    result: list[Line] = []
    words: list[str] = []
    first = 0
    for line, text in enumerate(read_lines(path, draft), start=1):
        bare, comment = _without_comment(text), "!" in text
        given = _QUOTED.findall(bare) if quoted else bare.split()
        if comment and not given and not words:
            continue
        first = first or line
        words += given
        if words and words[-1] == "&":
            words.pop()
            continue
        result.append(Line(words, first))
        words, first = [], 0
    return [*result, Line(words, first)] if words else result


def _without_comment(text: str) -> str:
    for k, letter in enumerate(text):
        if letter == "!" and (k == 0 or text[k - 1].isspace()):
            return text[:k]
    return text


class WordReader:
    """Words of a line, taken one after the other."""

    def __init__(self, words: list[str]) -> None:
        self._words, self._at = words, 0

    def __bool__(self) -> bool:
        return self._at < len(self._words)

    def peek(self) -> str:
        """The next word; nothing at the end."""
        return self._words[self._at] if self else ""

    def take(self, what: str) -> str:
        """The next word. Raises ``ValueError`` at the end of the line."""
        if not self:
            raise ValueError(f"the line ends where {what} is expected")
        self._at += 1
        return self._words[self._at - 1]

    def number(self, what: str) -> float:
        """The next word as a number. Raises ``ValueError``."""
        return parse_number(self.take(what))

    def rest(self) -> str:
        """All that is left of the line."""
        rest = " ".join(self._words[self._at :])
        self._at = len(self._words)
        return rest

    def skip(self, word: str) -> bool:
        """Pass over a word where it is the next one; True if it was."""
        if self.peek().lower() != word:
            return False
        self._at += 1
        return True


def angle(words: WordReader, form: str, hemispheres: str = "") -> float:
    """Degrees of an angle in the form ``dms``, ``hp`` (d.mmss) or ``deg``; of a place with its hemisphere.

    ``hemispheres`` are the letters of the positive and the negative one; plain degrees may go without. Raises
    ``ValueError``.
    """
    text = words.take("an angle")
    negative, value = text.startswith("-"), abs(parse_number(text))
    if form == "dms":
        value = _sexagesimal(value, words.number("minutes of an angle"), words.number("seconds of an angle"))
    elif form == "hp":
        whole, _, rest = text.lstrip("+-").partition(".")
        rest = rest.ljust(4, "0")
        seconds = float(f"{rest[2:4]}.{rest[4:] or '0'}")
        value = _sexagesimal(float(whole or 0), float(rest[:2]), seconds)
    if hemispheres and words.peek().upper() in tuple(hemispheres):
        if negative:
            raise ValueError(f"found {text!r} with a hemisphere, expected no sign before it")
        negative = words.take("a hemisphere").upper() == hemispheres[1]
    elif hemispheres and form != "deg":
        raise ValueError(f"found {words.peek()!r}, expected {hemispheres[0]} or {hemispheres[1]}")
    return -value if negative else value


def _sexagesimal(degrees: float, minutes: float, seconds: float) -> float:
    if not (0.0 <= minutes < 60.0 and 0.0 <= seconds < 60.0) or degrees != int(degrees):
        raise ValueError(f"found the angle {degrees:g} {minutes:g} {seconds:g}, expected degrees, minutes, seconds")
    return degrees + minutes / 60.0 + seconds / 3600.0


# ---- σ of observations that come from commands (#ds_error 20 mm 10 ppm), not from their lines.


class Error(NamedTuple):
    """Parts of a σ that are added as squares."""

    seconds: float = 0.0
    metres: float = 0.0
    """Of a length; of an angle the error of centring across the sight."""
    ppm: float = 0.0
    level: float = 0.0
    """Of zenith distances: the error of centring along the level, m."""
    vertical: float = 0.0

    def of_length(self, length: float) -> float:
        """σ of a length."""
        return float(np.hypot(self.metres, 1e-6 * self.ppm * length))

    def of_angle(self, length: float, level: float) -> float:
        """σ of an angle, arc seconds, over a slope distance and its level part."""
        if not length:
            return self.seconds
        across = np.hypot(self.metres / max(level, 1e-3), self.vertical * level / length**2)
        raised = self.level * np.sqrt(max(length**2 - level**2, 0.0)) / length**2
        return float(np.hypot(self.seconds, np.degrees(np.hypot(across, raised)) * 3600.0))


def error_of(words: WordReader) -> Error:
    """The σ that a command says: numbers with their units. Raises ``ValueError``."""
    found = dict.fromkeys(Error._fields, 0.0)
    seconds = {"sec": 1.0, "secs": 1.0, "seconds": 1.0, "min": 60.0, "deg": 3600.0, "degrees": 3600.0}
    metres = {"mm": 1e-3, "m": 1.0}
    while words:
        value, unit = words.number("a number"), words.take("a unit").lower()
        if value < 0.0:
            raise ValueError(f"found {value:g}, expected an error of 0 or more")
        if unit in seconds:
            found["seconds"] = value * seconds[unit]
        elif unit in metres:
            found["metres"] = float(np.hypot(found["metres"], value * metres[unit]))
        elif unit == "mmrkm" and words.skip("sqrt"):  # per root of the length of a levelling line in km
            length = words.number("the length of a levelling line")
            if length < 0.0:
                raise ValueError(f"found the length {length:g}, expected 0 or more")
            found["metres"] = float(np.hypot(found["metres"], 1e-3 * value * np.sqrt(1e-3 * length)))
        elif unit in ("mmh", "mmv"):
            found["level" if unit == "mmh" else "vertical"] = value * 1e-3
        elif unit == "ppm":
            found["ppm"] = value
        else:
            raise ValueError(f"found the unit {unit!r}, expected sec, mm, m, ppm, mmh or mmv")
    return Error(**found)


class VectorError(NamedTuple):
    """Errors east, north, up of vectors and positions."""

    metres: tuple[float, ...] = (0.0, 0.0, 0.0)
    ppm: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Of the length of a vector."""
    common: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Roots of the covariances (m) of two positions of a set (mmr)."""
    common_ppm: tuple[float, ...] = (0.0, 0.0, 0.0)
    """The part of these roots that grows with the distance (ppmr)."""

    def variances(self, length: float) -> FloatArray:
        """(3,) east, north, up."""
        return np.asarray(np.array(self.metres) ** 2 + (1e-6 * length * np.array(self.ppm)) ** 2)

    def covariances(self, distance: float) -> FloatArray:
        """(3,) east, north, up, of two positions at this distance."""
        return VectorError(self.common, self.common_ppm).variances(distance)


def vector_error_of(words: WordReader, code: str) -> VectorError:
    """Errors of ``20 30 50 mm 10 25 100 ppm`` of a data type. Raises ``ValueError``."""
    found: dict[str, tuple[float, ...]] = {}
    # Fields of an error, and their factors, by data type and unit.
    units = {
        "GB": {"mm": ("metres", 1e-3), "m": ("metres", 1.0), "ppm": ("ppm", 1.0)},
        "GX": {"mm": ("metres", 1e-3), "m": ("metres", 1.0), "mmr": ("common", 1e-3), "ppmr": ("common_ppm", 1.0)},
    }[code]
    while words:
        values = [words.number("errors east, north and up") for _ in range(3)]
        unit = words.take("a unit").lower()
        if min(values) < 0.0:
            raise ValueError("found a negative error, expected 0 or more")
        if unit not in units:
            raise ValueError(f"found the unit {unit!r}, expected {', '.join(units)}")
        name, factor = units[unit]
        found[name] = tuple(factor * value for value in values)
    return VectorError(**found)


# ---- Station coordinate files: places in the coordinate system of the adjustment, with geoid heights and deflections.

_CIRCUITS = (
    *("EDEN", "PLEN", "POVE", "HAWK", "TARA", "TUHI", "WANG", "WAIR", "WELL", "COLL", "NELS", "KARA", "BULL", "GREY"),
    *("AMUR", "MARL", "HOKI", "OKAR", "JACK", "PLEA", "GAWL", "TIMA", "LIND", "NICH", "YORK", "OBSE", "TAIE", "BLUF"),
)
"""Letters of the meridional circuits of New Zealand; their EPSG codes count from 27205 (of 1949) and 2105 (of 2000)."""
PROJECTIONS = {
    "NZMG": "EPSG:27200",
    "NZTM": "EPSG:2193",
    **{f"{name}TM1949": f"EPSG:{code}" for code, name in enumerate(_CIRCUITS, 27205)},
    **{f"{name}TM2000": f"EPSG:{code}" for code, name in enumerate(_CIRCUITS, 2105)},
}
SYSTEMS = {
    "NZGD1949": "EPSG:4272",
    "NZGD2000": "EPSG:4167",
    "WGS84": "EPSG:4326",
    "ITRF96": "EPSG:8995",
    "ITRF97": "EPSG:8996",
    "ITRF2000": "EPSG:8997",
    "ITRF2005": "EPSG:8998",
    "ITRF2008": "EPSG:8999",
    "ITRF2014": "EPSG:9000",
    "ITRF2020": "EPSG:9990",
    **PROJECTIONS,
}
"""EPSG codes of SNAP's coordinate systems."""


def projection_of(name: str) -> str:
    """EPSG code of a projection. Raises ``ValueError``."""
    if name.upper() not in PROJECTIONS:
        raise ValueError(f"projection {name!r} is not known{nearest(name.upper(), PROJECTIONS)}")
    return PROJECTIONS[name.upper()]


class SnapStation(NamedTuple):
    """A station as it was given; angles in degrees, deflections in arc seconds."""

    place: tuple[float, float, float]
    N: float
    deflection: tuple[float, float]
    line: int
    classes: dict[str, str]
    """Its order and classifications, by their names in lower case."""
    path: Path
    """File that its coordinates are from."""


class StationFile(NamedTuple):
    """All stations of a file."""

    path: Path
    title: str
    code: str
    crs: str
    system: ReferenceSystem
    orthometric: bool
    geoid: bool
    deflections: bool
    by_name: dict[str, SnapStation]
    spelt: dict[str, str]
    """Names by their capitals."""
    recoded: set[str]
    """Codes that recodes give, in capitals: names in lists, even if no observation has them."""

    def geocentric(self, names: list[str]) -> FloatArray:
        """(n, 3) of stations by their coordinates."""
        given = np.array([self.by_name[name].place for name in names])
        if self.system.kind == "geographic":
            given[:, :2] = np.radians(given[:, :2])
        geodetic = self.system.to_geodetic(given)
        if self.orthometric:
            geodetic[:, 2] += [self.by_name[name].N for name in names]
        return self.system.ellipsoid.geocentric(geodetic)

    def axes(self, names: list[str]) -> FloatArray:
        """(3, 3) east, north, up at the middle of stations."""
        from mor.model.earth import east_north_up

        middle = self.geocentric(names).mean(axis=0)
        latitude, longitude, _ = self.system.ellipsoid.geodetic(middle[None])[0]
        return east_north_up(latitude, longitude)


def read_stations(path: Path, draft: Draft, form: Definition | None) -> StationFile:
    """Stations of a coordinate file, of a delimited one by its definition. Raises :class:`InputError`."""
    lines = [line for line in lines_of(path, draft) if line.words] if form is None else _divided(path, form, draft)
    if len(lines) < 2:
        raise InputError([Message("expected a title, a coordinate system and stations", str(path), len(lines) or 1)])
    code = lines[1].words[0]
    crs, frame = _system(code, path, lines[1].number)
    given = [word.lower() for word in lines[2].words] if len(lines) > 2 else []
    known_options = {
        *("orthometric_heights", "ellipsoidal_heights", "degrees"),
        *("deflections", "geoid_heights", "geoid", "station_orders"),
        *("no_deflections", "no_geoid_heights", "no_geoid", "no_station_orders"),
    }
    has_options = bool(given) and (given[0] == "options" or given[0] in known_options)
    options = given[given[0] == "options" :] if has_options else ["geoid"]
    classes = [
        "order" if word == "station_orders" else word[2:]
        for word in options
        if word == "station_orders" or word.startswith("c=")
    ]
    vertical = "/" in code
    geocentric = code.partition("(")[0].partition("@")[0].upper().endswith("_XYZ")
    orthometric = "ellipsoidal_heights" not in options and not geocentric
    geoid, deflections = (bool({"geoid", word} & set(options)) for word in ("geoid_heights", "deflections"))
    if vertical and not geoid:
        words = f"{code}: the geoid of {code.partition('/')[2]} is not in this file; add geoid_heights to it"
        raise InputError([Message(words, str(path), lines[1].number)])
    found = StationFile(
        path, " ".join(lines[0].words), code, crs, reference_system(crs), orthometric, geoid, deflections, {}, {}, set()
    )
    if frame:
        draft.note(f"coordinate system {code}: coordinates are taken as {frame}", lines[1].number, str(path))
    angles = "xyz" if geocentric else "deg" if "degrees" in options else "dms"
    for line in lines[2 + has_options :]:
        with draft.at(line.number, str(path)):
            _read(found, line, angles, classes)
    if not geoid:
        draft.note("there are no geoid heights: the geoid is taken as the ellipsoid", 1, str(path))
    return found


def _divided(path: Path, form: Definition, draft: Draft) -> list[Line]:
    """Stations of a delimited file as lines of a coordinate file."""
    found = list(records(path, form, [form.station], draft))
    if not found:
        raise InputError([Message("there are no stations", str(path))])
    systems = {record.values.get("coordinate_system", "") for record in found}
    heights = {record.values.get("height_type", "").lower() or "orthometric" for record in found}
    for what, values in (("coordinate system", systems), ("type of heights", heights)):
        if len(values) > 1:
            words = f"found more than one {what}: {', '.join(sorted(values))}"
            raise InputError([Message(words, str(path), found[0].line)])
    code = systems.pop()
    crs, _ = _system(code, path, found[0].line)
    given = {name for record in found for name, value in record.values.items() if value}
    classes = list(dict.fromkeys(name for record in found for name in record.classes))
    options = ["options", "degrees", f"{heights.pop()}_heights", *(f"c={name}" for name in classes)]
    optional = []
    # Columns behind a height that an option announces, in their order.
    more_columns = {"deflections": ["deflection_north", "deflection_east"], "geoid_heights": ["geoid_undulation"]}
    for option, columns in more_columns.items():
        if given & set(columns):
            options.append(option)
            optional += columns
    geographic = reference_system(crs).kind == "geographic" and not code.upper().endswith("_XYZ")
    names = ("latitude", "longitude") if geographic else ("longitude", "latitude")
    lines = [Line([path.stem], 1), Line([code], 1), Line(options, 1)]
    for number, texts, own in found:
        with draft.at(number, str(path)):
            angles = form_of(texts.get("angle_format", ""))
            place = [texts.get(name, "") for name in names]
            if "" in (texts.get("code", ""), *place, texts.get("height", "")):
                raise ValueError("expected a code, two coordinates and a height")
            if geographic:
                ends = zip(place, ("NS", "EW"), strict=True)
                place = [repr(angle(WordReader(angle_words(text, two)), angles, two)) for text, two in ends]
            row = [texts["code"], *place, texts["height"], *(texts.get(name) or "0" for name in optional)]
            lines.append(Line([*row, *(own.get(name, "-") for name in classes)], number))
    return lines


def merge_stations(stations: StationFile, path: Path, parts: set[str], draft: Draft, form: Definition | None) -> None:
    """Take ``coordinates``, ``classes``, ``existing_classes`` or new ``stations`` over from another file.

    Raises ``ValueError`` if its coordinates are of another system; :class:`InputError`.
    """
    other = read_stations(path, draft, form)
    own, given = ((one.crs, one.orthometric, one.geoid) for one in (stations, other))
    if own != given and parts & {"coordinates", "stations"}:
        words = f"{path.name}: coordinates in {other.code} cannot be merged with those in {stations.code}"
        raise ValueError(f"{words}; convert them, with the same kind of heights")
    known = stations.spelt
    names = {key for one in stations.by_name.values() for key in one.classes}
    for name, new in other.by_name.items():
        old = stations.by_name.get(known.get(name.upper(), ""))
        classes = {key: value for key, value in new.classes.items() if "classes" in parts or key in names}
        if old is None and "stations" in parts:
            stations.by_name[name], known[name.upper()] = new._replace(classes=classes), name
        elif old is not None:
            merged = new if "coordinates" in parts else old
            classes = {**old.classes, **classes} if parts & {"classes", "existing_classes"} else old.classes
            stations.by_name[known[name.upper()]] = merged._replace(classes=classes)


def _system(code: str, path: Path, line: int) -> tuple[str, str]:
    """EPSG code of a coordinate system, and what a version or an epoch of it was read as, if there is one.

    ``NZGD2000(20160701)`` is a version of the deformation model, ``ITRF2008@20150601`` an epoch: neither changes
    coordinates that are used at one time.
    """
    plain, _, version = code.partition("/")[0].upper().replace("(", "@").partition("@")
    name = plain.removesuffix("_XYZ")
    known = next((system for system in SYSTEMS if name == system or name.startswith(f"{system}_2")), "")
    if not known:
        known = ", ".join(system for system in SYSTEMS if not system[:-4].endswith("TM"))
        words = (
            f"coordinate system {code!r} is not supported{nearest(plain, SYSTEMS)} "
            f"(known: {known} and the meridional circuits, such as WELLTM2000)"
        )
        raise InputError([Message(words, str(path), line)])
    return SYSTEMS[known], f"{known} of one epoch" if version else ""


def _read(found: StationFile, line: Line, form: str, classes: list[str]) -> None:
    words = WordReader(line.words)
    name = words.take("a station")
    if name.upper() in found.spelt:
        raise ValueError(f"station {name!r} is there twice")
    if form == "xyz":
        geocentric = [words.number("a geocentric coordinate") for _ in range(3)]
        latitude, longitude, height = found.system.ellipsoid.geodetic(np.array([geocentric]))[0].tolist()
        place = [float(np.degrees(latitude)), float(np.degrees(longitude))]
    elif found.system.kind == "geographic":
        place = [angle(words, form, "NS"), angle(words, form, "EW")]
        if abs(place[0]) > 90.0:
            raise ValueError(f"station {name!r}: found the latitude {place[0]:g}, expected -90 to 90")
    else:
        place = [words.number("a coordinate"), words.number("a coordinate")]
    if form != "xyz":
        height = words.number("a height")
    deflection = (0.0, 0.0)
    if found.deflections:
        deflection = (words.number("a deflection north"), words.number("a deflection east"))
    N = words.number("a geoid height") if found.geoid else 0.0
    values = {key: words.take(f"{key} of station {name!r}") for key in classes}
    found.spelt[name.upper()] = name
    found.by_name[name] = SnapStation((place[0], place[1], height), N, deflection, line.number, values, found.path)


# ---- Lists of stations, selections of observations and recodes: words of a command file.
#
# Source: the help of SNAP, *Station lists*, *The reject_observations command*, *The recode command*.

_MISSING = ("ignore_missing", "warn_missing", "fail_missing")
Chosen = Callable[[str], bool]
"""Whether a station is on a list."""


def station_list(words: WordReader, stations: StationFile, end: str = "") -> Chosen:
    """Stations that a list means, up to the word ``end``. Raises ``ValueError``."""
    parts: list[list[set[str]]] = [[set()]]
    strict = True
    while words and not (end and words.skip(end)):
        word = words.take("a station")
        if word.lower() in _MISSING:
            strict = word.lower() == "fail_missing"
        elif word.lower() == "except":
            parts.append([set()])
        elif word.lower() == "and":
            parts[-1].append(set())
        elif word.lower() != "or":
            parts[-1][-1] |= _stations_of(word, words, stations, strict)
    whole = [set.intersection(*part) for part in parts]
    chosen = whole[0].difference(*whole[1:])
    return lambda name: name.upper() in chosen


def _stations_of(word: str, words: WordReader, stations: StationFile, strict: bool) -> set[str]:
    names = {name.upper() for name in stations.by_name}
    code = word.removeprefix("\\").upper()
    if code in names | stations.recoded:
        return {code}
    if word.lower() == "all":
        return names
    if word.lower() in ("inside", "outside"):
        code = words.take(f"a coordinate system behind {word}")
        file = words.take(f"the file of an area behind {word} {code}").strip("\"'")
        within = _stations_in_area(code, file, stations)
        return within if word.lower() == "inside" else names - within
    if word[0] == "@" and word.partition("=")[1] == "":
        return _stations_in_file(word[1:], stations, strict)
    key, equals, value = word.lstrip("@").partition("=")
    if equals:
        values = [one.upper() for one in value.split("/")]
        rows = stations.by_name.items()
        return {name.upper() for name, one in rows if one.classes.get(key.lower(), "").upper() in values}
    if "*" in code or "?" in code:
        return {name for name in names if _fits(name, code)}
    first, hyphen, last = code.partition("-")
    if hyphen and first and last:
        return {name for name in names if _rank(first) <= _rank(name) <= _rank(last)}
    if strict:
        raise ValueError(f"station {word!r} is not in {stations.path.name}{nearest(word, stations.by_name)}")
    return set()


def _stations_in_area(code: str, file: str, stations: StationFile) -> set[str]:
    """Stations in an odd number of rings ``(x1 y1, x2 y2, …)`` of a file. Raises ``ValueError``."""
    path = stations.path.parent / file
    path = path if path.is_file() else path.with_suffix(".wkt")
    if not path.is_file():
        raise ValueError(f"file {file!r} does not exist")
    system = reference_system(_system(code, stations.path, 1)[0])
    if system.ellipsoid != stations.system.ellipsoid:
        raise ValueError(f"the area in {code} is on another ellipsoid than the stations in {stations.code}")
    geographic = system.kind == "geographic"
    geodetic = stations.system.ellipsoid.geodetic(stations.geocentric(list(stations.by_name)))
    points = np.degrees(geodetic[:, [1, 0]]) if geographic else system.from_geodetic(geodetic)[:, :2]
    inside = np.zeros(len(points), bool)
    for ring in re.findall(r"\(([^()]+)\)", " ".join(read_lines(path, Draft(str(path))))):
        corners = np.array([[parse_number(one) for one in corner.split()[:2]] for corner in ring.split(",")])
        if geographic:
            points[:, 0] += 360.0 * np.round((corners[:, 0].mean() - points[:, 0]) / 360.0)
        for (x1, y1), (x2, y2) in itertools.pairwise(corners):
            crossed = (y1 > points[:, 1]) != (y2 > points[:, 1])
            rise = (y2 - y1) or 1.0
            inside ^= crossed & (points[:, 0] < x1 + (points[:, 1] - y1) * (x2 - x1) / rise)
    return {name.upper() for name, found in zip(stations.by_name, inside, strict=True) if found}


def _stations_in_file(file: str, stations: StationFile, strict: bool) -> set[str]:
    path = stations.path.parent / file
    path = path if path.is_file() else path.with_suffix(".stl")
    found: set[str] = set()
    for line in lines_of(path, Draft(str(path))):
        words = WordReader(line.words if strict else ["ignore_missing", *line.words])
        chosen = station_list(words, stations)
        found |= {name.upper() for name in stations.by_name if chosen(name)}
    return found


def _fits(text: str, pattern: str) -> bool:
    return fnmatchcase(text, pattern.replace("[", "[[]"))


def _rank(code: str) -> list[tuple[int, str]]:
    """Order of codes in a range: numbers in them count by their value, C_11 comes before C_100."""
    return [(int(number or -1), text) for number, text in re.findall(r"(\d+)|(\D+)", code)]


def date_of(text: str) -> datetime | None:
    """The date, nothing for ``unknown``. Raises ``ValueError``."""
    if text.lower() == "unknown":
        return None
    plain = re.sub(r"[\s/]+", "-", text.strip())
    dates = ("%Y-%m-%d", "%Y-%b-%d", "%d-%b-%Y", "%d-%B-%Y", "%d%b%Y", "%d-%m-%Y", "%Y%m%d")
    times = ("", "%H%M%S", "-%H:%M:%S", "T%H:%M:%S", "-%H:%M", "T%H:%M")
    for form in (date + time for date in dates for time in times):
        try:
            return datetime.strptime(plain, form)
        except ValueError:
            continue
    try:
        return datetime.strptime(plain, "%Y")
    except ValueError:
        raise ValueError(f"found the date {text!r}, expected one such as 2008-01-13, 13 Jan 2008 or unknown") from None


class Period(NamedTuple):
    """A range of dates; observations without a date are in none that has an end."""

    since: datetime | None = None
    until: datetime | None = None

    def holds(self, date: datetime | None) -> bool:
        """Return whether an observation of this date is in the range."""
        if self.since is None and self.until is None:
            return True
        return date is not None and (self.since or date) <= date and not (self.until and date >= self.until)


def period_of(words: WordReader) -> Period:
    """``before``, ``after`` or ``between`` with their dates; all dates without these words. Raises ``ValueError``."""
    if words.skip("before"):
        return Period(None, date_of(words.take("a date")))
    if words.skip("after"):
        return Period(date_of(words.take("a date")), None)
    if words.skip("between"):
        since = date_of(words.take("a date"))
        words.skip("and")
        return Period(since, date_of(words.take("a date")))
    return Period()


class Selection(NamedTuple):
    """Observations that a command leaves out, or whose errors it changes; conditions hold together."""

    factor: float
    """Of σ: 0 for those that are left out. Of a translation 1 or 0."""
    classes: list[tuple[str, list[str]]]
    """Values by the name of a classification, ``data_type`` and ``data_file`` among them; patterns in capitals."""
    period: Period = Period()
    undated: bool = False
    stations: Chosen | None = None
    all_ends: bool = False
    """True if all ends of an observation are among ``stations``, else one suffices."""
    kind: str = ""
    """``by_set``, ``offset_error``, ``centroid_error`` or ``translation``; else a factor of single observations."""
    errors: tuple[float, float] = (0.0, 0.0)
    """σ (m) of an offset or a centroid, horizontal and vertical."""

    def holds(self, code: str, names: list[str], path: Path, date: datetime | None, given: dict[str, str]) -> bool:
        """Return whether an observation is selected, by its type, stations, file, date and classifications."""
        known = {**given, "data_type": code, "data_file": path.name}
        for key, patterns in self.classes:
            if not any(_fits(known.get(key, "").upper(), pattern) for pattern in patterns):
                return False
        if self.undated and date is not None:
            return False
        if not self.period.holds(date):
            return False
        return self.stations is None or (all if self.all_ends else any)(map(self.stations, names))


def selection_of(words: WordReader, factor: float, stations: StationFile) -> Selection:
    """The observations that the rest of a command selects. Raises ``ValueError``."""
    found = Selection(factor, [])
    while words:
        word = words.peek().lower()
        if word in ("before", "after"):
            found = found._replace(period=period_of(words))
            continue
        words.take("a criterion")
        if word in ("using_stations", "between_stations"):
            chosen = station_list(words, stations, "end_stations")
            found = found._replace(stations=chosen, all_ends=word[0] == "b")
        elif word == "date_unknown":
            found = found._replace(undated=True)
        elif "=" in word:
            key, _, value = word.lstrip("@").partition("=")
            found.classes.append((key, _values(key, value)))
        elif word not in (*_MISSING, "all_observations"):
            raise ValueError(f"found {word!r}, expected a criterion such as data_type=SD, before or using_stations")
    return found


def _values(key: str, value: str) -> list[str]:
    plain = value.strip("\"'")
    if plain != value:
        return [plain.upper().replace("*", "[*]").replace("?", "[?]")]
    if key == "data_file":
        return [plain.rpartition("/")[2].upper()]
    values = plain.upper().split("/")
    return [_known_code(one) for one in values] if key == "data_type" else values


class Recode(NamedTuple):
    """A code that stands for another station: none for a station whose observations are left out."""

    code: str
    new: str
    period: Period
    sigma: tuple[float, float] | None = None
    """σ (m), horizontal and vertical, of the two stations being one, if they are tied to each other."""

    @property
    def narrowness(self) -> float:
        """Order among those that hold: the range that ends first, or begins last, comes first."""
        until, since = self.period.until, self.period.since
        ends = [until.toordinal()] if until else []
        return min([*ends, -since.toordinal()] if since else ends, default=float("inf"))


def recodes_of(path: Path) -> list[Recode]:
    """Recodes of a file with the columns codefrom, codeto, datefrom and dateto. Raises :class:`InputError`."""
    draft = Draft(str(path))
    if not path.is_file():
        raise InputError([Message("this file does not exist", str(path))])
    found: list[Recode] = []
    for number, text in enumerate(read_lines(path, draft), start=1):
        code, new, since, until, *_ = [*(cell.strip().strip('"') for cell in text.split(",")), "", "", "", ""]
        if code.lower() == "codefrom" or not text.strip(" ,"):
            continue
        with draft.at(number, str(path)):
            period = Period(date_of(since) if since else None, date_of(until) if until else None)
            if not code or not new:
                raise ValueError(f"found {text.strip()!r}, expected codefrom,codeto,datefrom,dateto")
            found.append(Recode(code.upper(), new, period))
    if draft.problems:
        raise InputError(draft.problems)
    return found


# ---- GNSS vectors and positions with their covariances: alone, or in sets with one matrix.

NUMBERS = {
    "full": (6, 0, 1),
    "correlation": (6, 3, 1),
    "diagonal": (3, 3, 0),
    "enu": (3, 3, 0),
    "enu_correlation": (6, 6, 0),
}
"""Types of errors: how many numbers follow a vector alone, one in a set; whether a matrix follows the set."""


class Member(NamedTuple):
    """A vector or a position."""

    names: list[str]
    heights: list[float]
    value: list[float]
    sigma: list[float] | None
    """As its line has them; with a fourth one, −1, where they are east, north, up in place of what a command says."""
    factor: float
    """Of its σ; 0 if it is left out."""
    line: int
    held: list[Selection]
    """Commands that select it."""


class Set(NamedTuple):
    """Rows of vectors or positions, and their covariance matrix."""

    rows: list[Row]
    Q: FloatArray


def set_of(
    stations: StationFile, members: list[Member], form: str, error: VectorError | None, numbers: list[float] | None
) -> Set | None:
    """The members that are not rejected with their covariance matrix. Raises ``ValueError``."""
    kept = np.flatnonzero([member.factor > 0.0 for member in members])
    if not len(kept):
        return None
    factors = np.repeat([member.factor for member in members], 3)
    Q = _covariance(stations, members, form, error, numbers) * np.outer(factors, factors)
    places = (3 * kept[:, None] + np.arange(3)).ravel()
    members = [members[k] for k in kept]
    Q = Q[np.ix_(places, places)] * _product(_distinct(members, "by_set")) ** 2
    Q += _offsets(stations, members)
    if not np.isfinite(Q).all() or np.linalg.eigvalsh(Q)[0] <= 0.0:
        raise ValueError("the covariance matrix is not positive definite")
    vector = len(members[0].names) == 2
    if not vector and any(member.heights[0] for member in members):
        raise ValueError("heights of antennas above observed positions (GX) are not supported")
    rows = [Row([*m.names, *map(repr, m.value), *(map(repr, m.heights) if vector else [])], m.line) for m in members]
    return Set(rows, 0.5 * (Q + Q.T))  # products with axes are not symmetric in their last digit


def _product(selections: list[Selection]) -> float:
    return float(np.prod([one.factor for one in selections]))


def _distinct(members: list[Member], kind: str) -> list[Selection]:
    return list({id(one): one for m in members for one in m.held if one.kind == kind}.values())


def _offsets(stations: StationFile, members: list[Member]) -> FloatArray:
    """Covariances of common errors: of the equipment at a station, and of the centroid of a set of positions.

    Vectors of a set begin at one station: a station is an end of all of them on the same side.
    """
    Q = np.zeros((3 * len(members), 3 * len(members)))
    vectors = len(members[0].names) == 2
    for one in [] if vectors else _distinct(members, "centroid_error"):
        Q += _common(stations, [m.names[0] for m in members], one, np.ones(len(members)))
    for one in _distinct(members, "offset_error"):
        for name in sorted({name for m in members for name in m.names}):
            if one.stations is None or one.stations(name):
                ends = [float(name in m.names and any(held is one for held in m.held)) for m in members]
                Q += _common(stations, [name], one, np.array(ends))
    return Q


def _common(stations: StationFile, names: list[str], one: Selection, ends: FloatArray) -> FloatArray:
    axes = stations.axes(sorted(set(names)))
    horizontal, vertical = np.square(one.errors)
    E = axes.T @ np.diag([horizontal, horizontal, vertical]) @ axes
    return np.asarray(np.kron(np.outer(ends, ends), E), np.float64)


def is_translated(members: list[Member]) -> bool:
    """True if a translation of the set is an unknown: the last command for any of its members says so."""
    last = [[one.factor for one in m.held if one.kind == "translation"][-1:] for m in members if m.factor]
    return [1.0] in last


def put_singles(draft: Draft, singles: list[Set], file: str) -> None:
    """Vectors or positions that are in no set, with their covariances in columns."""
    names = _columns(len(singles[0].rows[0].cells))
    values = [name for name in names if name in ("x", "y", "z", "dx", "dy", "dz")]
    pairs = [f"cov_{values[i]}_{values[j]}" for i in range(3) for j in range(i, 3)]
    rows = [
        Row([*one.rows[0].cells, *(repr(float(one.Q[i, j])) for i in range(3) for j in range(i, 3))], one.rows[0].line)
        for one in singles
    ]
    draft.table("observations", [*names, *pairs], rows, file, type=_type(names))


def _columns(count: int) -> list[str]:
    vector = ["from", "to", "dx", "dy", "dz", "from_height", "to_height"]
    return vector if count == len(vector) else ["point", "x", "y", "z"]


def _type(columns: list[str]) -> str:
    return "gnss_vector" if columns[0] == "from" else "gnss_position"


def _covariance(
    stations: StationFile, members: list[Member], form: str, error: VectorError | None, numbers: list[float] | None
) -> FloatArray:
    if not form:
        return _of_command(stations, members, error)
    if numbers is not None and NUMBERS[form][2]:
        return _of_set(members, form, numbers)
    Q = np.zeros((3 * len(members), 3 * len(members)))
    for k, member in enumerate(members):
        if not member.factor:
            continue
        given = member.sigma or []
        if form == "full":
            block = _symmetric(given)
        else:
            C = np.eye(3)
            if form[-11:] == "correlation":
                C[[1, 2, 2], [0, 0, 1]] = C[[0, 0, 1], [1, 2, 2]] = given[3:]
            block = C * np.outer(given[:3], given[:3])
        if form[:3] == "enu" or given[3:] == [-1.0]:
            axes = stations.axes(member.names)
            block = axes.T @ block @ axes
        Q[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = block
    return Q


def _symmetric(lower: list[float]) -> FloatArray:
    block = np.zeros((3, 3))
    for (i, j), value in zip([(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)], lower, strict=False):
        block[i, j] = block[j, i] = value
    return block


def _of_set(members: list[Member], form: str, numbers: list[float]) -> FloatArray:
    """The matrix behind a set: its lower triangle, of correlations without the diagonal."""
    size = 3 * len(members)
    below = 0 if form == "full" else -1
    rows, columns = np.tril_indices(size, below)
    if len(numbers) != len(rows):
        raise ValueError(f"found {len(numbers)} numbers behind #end_set, expected {len(rows)}")
    Q = np.zeros((size, size))
    Q[rows, columns] = Q[columns, rows] = numbers
    if form == "full":
        return Q
    np.fill_diagonal(Q, 1.0)
    sigma = np.concatenate([member.sigma or [0.0] * 3 for member in members])
    return np.asarray(Q * np.outer(sigma, sigma))


def _of_command(stations: StationFile, members: list[Member], error: VectorError | None) -> FloatArray:
    """Covariances of ``#gps_enu_error``: of members of a set such that vectors between them have its errors, too.

    Positions (``#gx_enu_error``) have the covariances that the command gives, in the axes of the later one.
    """
    vectors = len(members[0].names) == 2
    if error is None:
        if all(member.sigma for member in members):
            error = VectorError()
        else:
            command = "#gps_enu_error" if vectors else "#gx_enu_error"
            raise ValueError(f"nothing says the errors: {command}, or error in #data")
    names = sorted({name for member in members for name in member.names if name})
    middle = stations.axes(names)
    values = np.array([member.value for member in members])
    size = len(members)
    Q = np.zeros((3 * size, 3 * size))
    own = [
        np.square(member.sigma[:3]) if member.sigma else error.variances(float(np.linalg.norm(value)) * vectors)
        for member, value in zip(members, values, strict=True)
    ]
    for i in range(size):
        for j in range(size):
            distance = float(np.linalg.norm(values[i] - values[j]))
            later = members[max(i, j)].names
            axes = stations.axes(later) if not vectors and all(later) else middle
            if i == j:
                variances = own[i]
            elif vectors:
                variances = 0.5 * (own[i] + own[j] - error.variances(distance))
            else:
                variances = error.covariances(distance)
            Q[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = axes.T @ np.diag(variances) @ axes
    return Q


# ---- Data files: what the commands say of the observations that follow, and the observations themselves.


class DataKind(NamedTuple):
    """A kind of data: its type in a project and the column of its value."""

    type: str
    value: str
    angular: str = ""
    """``line`` or, with a hemisphere, the letters of both."""
    default: str = ""
    """The command that says its error."""
    point: bool = False


KINDS = {
    "HA": DataKind("directions", "horizontal", "line", "ha"),
    "AZ": DataKind("azimuth", "azimuth", "line", "az"),
    "SD": DataKind("distance", "distance", default="ds"),
    "ED": DataKind("ellipsoid_arc", "distance", default="ds"),
    "MD": DataKind("mean_sea_level_distance", "distance", default="ds"),
    "HD": DataKind("height_reduced_distance", "distance", default="ds"),
    "DR": DataKind("distance", "distance", default="ds"),
    "ZD": DataKind("zenith_angle", "zenith_angle", "line", "zd"),
    "LV": DataKind("height_difference", "dz", default="lv"),
    "LT": DataKind("geodetic_position", "latitude", "NS", "lt", point=True),
    "LN": DataKind("geodetic_position", "longitude", "EW", "ln", point=True),
    "OH": DataKind("orthometric_height", "height", default="oh", point=True),
    "EH": DataKind("ellipsoidal_height", "height", default="eh", point=True),
    "PB": DataKind("projected_bearing", "bearing", "line", "az"),
    "GB": DataKind("gnss_vector", ""),
    "GX": DataKind("gnss_position", "", point=True),
}
"""By SNAP's letters."""
_SETS = ("HA", "DR")
_HEIGHTS = ("distance", "zenith_angle", "height_difference")
DEFAULT = "DEFAULT"


def _code(word: str) -> str:
    """SNAP's letters of a data type; GPS are vectors."""
    return "GB" if word.upper() == "GPS" else word.upper()


def _known_code(word: str) -> str:
    if _code(word) not in KINDS:
        raise ValueError(f"found the data type {word!r}, expected one of {', '.join(KINDS)}")
    return _code(word)


class LineObservation(NamedTuple):
    """One observation of a line: its kind and what stands there of it, in this order."""

    code: str
    fields: tuple[str, ...]


def _recode_of(recodes: list[Recode], code: str, date: datetime | None) -> Recode | None:
    """The narrowest recode that holds, the last of equal ones; ``*`` stands for all others."""
    for wanted in (code, "*"):
        own = [one for one in reversed(recodes) if one.code == wanted and one.period.holds(date)]
        if own:
            return min(own, key=lambda one: one.narrowness)
    return None


@dataclass
class Data:
    """Content of all data files, and the state set by commands of the current one."""

    draft: Draft
    stations: StationFile
    names: dict[str, tuple[int, str]] = field(default_factory=dict)
    """Stations that are observed, with the line and the file that names them first."""
    tables: dict[tuple[str, str, str], list[Row]] = field(default_factory=dict)
    """Rows by letters, instrument and file."""
    singles: dict[tuple[str, str], list[Set]] = field(default_factory=dict)
    """Vectors and positions that are in no set, by letters and file."""
    matrices: dict[tuple[str, str], list[Set]] = field(default_factory=dict)
    """Sets with a matrix, by letters and file."""
    translated: list[tuple[Set, str]] = field(default_factory=list)
    """Positions whose common translation is an unknown, with their file."""
    in_sets: dict[tuple[str, int], list[tuple[Row, list[Selection]]]] = field(default_factory=dict)
    """Rows of HA and DR by their set, with the commands that select them."""
    left_out: dict[str, tuple[int, int, str]] = field(default_factory=dict)
    selections: list[Selection] = field(default_factory=list)
    recodes: list[Recode] = field(default_factory=list)
    own_recodes: list[Recode] = field(default_factory=list)
    """Of the current file; they come before those of all files."""
    scale: float = 1.0
    """Factor of all σ of the current file."""
    excluded: set[str] = field(default_factory=set)
    """Stations whose observations are left out, in capitals."""
    missing: set[str] = field(default_factory=set)
    """Stations that may be missing, in capitals, ``*`` for all: their observations are left out."""
    date: datetime | None = None
    given: dict[str, dict[str, str]] = field(default_factory=dict)
    """Classifications of the observations that follow, by their type, from #classify."""
    refractions: set[str] = field(default_factory=set)
    sets: int = 0
    path: Path = Path()
    line: int = 0
    form: str = "dms"
    errors: dict[str, Error] = field(default_factory=dict)
    vector_errors: dict[str, VectorError] = field(default_factory=dict)
    vector_form: str = "full"
    classes: set[str] = field(default_factory=set)
    refraction: str = DEFAULT
    projection: str = ""
    """EPSG code of the projection that bearings are of."""
    items: list[LineObservation] = field(default_factory=list)
    prefix: list[str] = field(default_factory=list)
    """Date and classifications of a whole line, before its observations."""
    grouped: bool = False
    heights: bool = True
    header: tuple[str, float] | None = None
    members: list[Member] = field(default_factory=list)
    covariances: list[float] | None = None
    """Numbers behind #end_set; ``None`` before it."""

    def begin(self, path: Path, scale: float, recodes: Path | None) -> None:
        """Forget what commands of the file before said."""
        self.scale, self.own_recodes = scale, recodes_of(recodes) if recodes else []
        self.path, self.form, self.vector_form, self.refraction = path, "dms", "full", DEFAULT
        self.errors, self.vector_errors, self.classes, self.items = {}, {}, set(), []
        self.date, self.given = None, {}
        self.header, self.members, self.covariances, self.projection = None, [], None, ""

    def skip(self, what: str) -> None:
        """Something of this line is left out."""
        count, line, file = self.left_out.get(what, (0, self.line, str(self.path)))
        self.left_out[what] = (count + 1, line, file)

    def station(self, name: str, date: datetime | None) -> str:
        """The station as its file spells it; empty if its observations are left out. Raises ``ValueError``."""
        known = self.stations.spelt
        code = name.upper()
        for recodes in (self.own_recodes, self.recodes):
            recode = _recode_of(recodes, code, date)
            if recode is None:
                continue
            if recode.new.startswith("*"):
                self.skip("observations of stations that are recoded to *")
                return ""
            if recode.new.upper() not in known and code in known:  # a new mark starts where the old one is
                self.stations.by_name[recode.new] = self.stations.by_name[known[code]]
                known[recode.new.upper()] = recode.new
            code = recode.new.upper()
        if code in self.excluded:
            self.skip("observations of stations that are rejected or ignored")
            return ""
        if code not in known:
            if self.missing & {code, "*"}:
                self.skip(f"observations of stations that are not in {self.stations.path.name}")
                return ""
            similar = nearest(name, self.stations.by_name)
            raise ValueError(f"station {name!r} is not in {self.stations.path.name}{similar}")
        return known[code]

    def selected(self, code: str, names: list[str], given: dict[str, str], date: datetime | None) -> list[Selection]:
        """Commands that select an observation."""
        known = {**self.given.get(code, {}), **given}
        return [one for one in self.selections if one.holds(code, names, self.path, date, known)]

    def factor(self, code: str, held: list[Selection]) -> float:
        """Factor of the σ of an observation without those of its whole set; 0 if it is left out."""
        alone = ("",) if code in (*_SETS, "GB", "GX") else ("", "by_set")
        factor = self.scale * _product([one for one in held if one.kind in alone])
        if not factor:
            self.skip("observations that commands reject or ignore")
        return factor

    def use(self, names: list[str]) -> None:
        """Note the stations of an observation that is used."""
        for name in names:
            self.names.setdefault(name, (self.line, str(self.path)))

    def length(self, names: list[str]) -> tuple[float, float]:
        """Slope distance and its level part between two stations by their coordinates."""
        ends = self.stations.geocentric(names)
        east, north, up = self.stations.axes(names[:1]) @ (ends[1] - ends[0])
        return float(np.linalg.norm([east, north, up])), float(np.hypot(east, north))


def read_data(path: Path, data: Data, scale: float, recodes: Path | None) -> None:
    """Read one data file, with a factor of its σ and the file of its recodes. Mistakes are told in the draft."""
    data.begin(path, scale, recodes)
    for number, line in enumerate(lines_of(path, data.draft)):
        data.line = line.number
        with data.draft.at(line.number, str(path)):
            if number == 0:
                continue  # the title
            if not line.words:
                data.header = None
            elif line.words[0].startswith("#"):
                words = [line.words[0][1:], *line.words[1:]]
                _command(data, WordReader(words if words[0] else words[1:]))
            elif data.covariances is not None:
                numbers = WordReader(line.words)
                while numbers:
                    data.covariances.append(numbers.number("a covariance"))
                if len(data.covariances) >= _count(data):
                    _end_of_set(data)
            else:
                _observations(data, WordReader(line.words))
    _end_of_set(data)


def read_delimited(path: Path, data: Data, form: Definition, scale: float, recodes: Path | None) -> None:
    """Read one delimited data file by its definition, like :func:`read_data`."""
    data.begin(path, scale, recodes)
    last = ("", "", "")
    for record in records(path, form, form.observations, data.draft):
        data.line, values = record.line, record.values
        try:
            code = _known_code(values.get("type", "").upper())
            own = (code, values.get("set_id", ""), values.get("instrument_station", ""))
            new, last = own != last or not own[1], own
            _delimited(data, code, record, scale, new)
        except ValueError as error:
            data.draft.problem(str(error), record.line, str(path))
            last = ("", "", "")


def _delimited(data: Data, code: str, record: Record, scale: float, new_set: bool) -> None:
    """An observation of a delimited file, as the line of a data file would say it."""
    kind, values = KINDS[code], record.values
    data.form = form_of(values.get("angle_format", ""))
    data.date = date_by(values.get("datetime", ""), values.get("datetime_format", "YMDhms"))
    data.given = {code: record.classes}
    text = values.get("error_factor") or "1"
    factor = parse_number(text)
    if not factor > 0.0:
        raise ValueError(f"found the factor {factor:g}, expected one above 0")
    data.scale = scale * factor
    data.refraction = (values.get("refraction_coefficient") or DEFAULT).upper()
    data.grouped = code in _SETS
    if code == "PB":
        data.projection = projection_of(values.get("projection", ""))
    if values.get("reference_frame"):
        data.skip(f"reference frame {values['reference_frame']}: vectors are taken in the frame of the stations")
    numbers = _errors_of(data, code, values)
    data.items = [LineObservation(code, ("value", "error") if numbers else ("value",))]
    station = [values.get("instrument_station", ""), values.get("instrument_height") or "0"]
    target = [values.get("target_station", ""), values.get("target_height") or "0"]
    data.heights = True
    ends = station if kind.point else [*station, *target]
    if "" in ends:
        raise ValueError("expected the names of the stations")
    if data.grouped:
        if new_set:
            _observations(data, WordReader(station))
        ends = target
    rejected = ["*"] * (values.get("rejected", "").upper() == "Y")
    value = angle_words(values.get("value", ""), kind.angular.replace("line", ""))
    _observations(data, WordReader([*rejected, *ends, *value, *numbers]))


def _errors_of(data: Data, code: str, values: dict[str, str]) -> list[str]:
    """Numbers of the error; none where it is calculated, which the state of the file then says."""
    kind, text = KINDS[code], values.get("error", "")
    by_kind = {"ZD": "zenith_distance", "LV": "height_difference", "GB": "vector", "GX": "vector"}
    what = by_kind.get(code, "angle" if kind.angular else "distance")
    form = values.get(f"{what}_error_type", "").lower()
    numbers = text.split()
    if form == "calculated":
        words = WordReader(re.sub(r"(\d)([a-z])", r"\1 \2", text.lower()).split())
        if what == "vector":
            data.vector_errors[code] = vector_error_of(words, code)
        else:
            data.errors[kind.default] = error_of(words)
        return []
    if what == "vector":
        data.vector_form = form or "full"
        if data.vector_form not in NUMBERS:
            raise ValueError(f"found {form!r}, expected {', '.join(NUMBERS)} or calculated")
    elif form not in ("", "value", "error"):
        raise ValueError(f"found {form!r}, expected value or calculated")
    unit = values.get("angle_error_units", "").lower() or "default"
    if unit not in ("default", "degrees", "seconds"):
        raise ValueError(f"found the unit {unit!r}, expected degrees or seconds")
    if kind.angular and unit != "default":
        factor = (3600.0 if unit == "degrees" else 1.0) / (3600.0 if data.form == "deg" else 1.0)
        numbers = [repr(parse_number(number) * factor) for number in numbers]
    if not numbers:
        raise ValueError("nothing says the error")
    return numbers


def _command(data: Data, words: WordReader) -> None:
    name = words.take("a command").lower()
    if name == "end_set":
        data.covariances = []
        if not _count(data):
            _end_of_set(data)
        return
    _end_of_set(data)
    if name == "data":
        _data(data, words)
    elif name in ("dms_angles", "hp_angles", "deg_angles"):
        data.form = name.partition("_")[0]
    elif name == "classification":
        data.classes.add(words.take("the name of a classification").lower())
    elif name == "gps_error_type":
        form = words.take("a type of errors").lower()
        if form not in NUMBERS:
            raise ValueError(f"found {form!r}, expected {', '.join(NUMBERS)}")
        data.vector_form = form
    elif name in ("gps_enu_error", "gb_enu_error", "gx_enu_error"):
        code = "GX" if name[1] == "x" else "GB"
        data.vector_errors[code] = vector_error_of(words, code)
    elif name == "refraction_coefficient":
        data.refraction = words.take("a code").upper()
    elif name == "projection":
        data.projection = projection_of(words.take("the name of a projection"))
    elif name == "reference_frame":
        data.skip(f"reference frame {words.take('a code')}: vectors are taken in the frame of the stations")
    elif name.endswith("_error") and name[:-6] in {kind.default for kind in KINDS.values()}:
        data.errors[name[:-6]] = error_of(words)
    elif name == "date":
        data.date = date_of(words.rest())
    elif name == "classify":
        key = words.take("the name of a classification")
        codes = [_code(one) for one in key.split("/")]
        if set(codes) <= set(KINDS):
            key = words.take("the name of a classification")
        else:
            codes = list(KINDS)
        value = words.rest()
        for code in codes:
            data.given.setdefault(code, {})[key.lower()] = value
    elif name not in ("time", "note", "bearing_orientation_error"):
        raise ValueError(f"command #{name} is not supported")


def _data(data: Data, words: WordReader) -> None:
    """``#data sd error ha no_heights``: what stands on the lines that follow."""
    items: list[tuple[str, list[str]]] = []
    data.grouped, data.heights, data.header, data.prefix = False, True, None, []
    codes = ("distance_scale_error", "refraction_coefficient", "bearing_orientation_error")
    while words:
        word = words.take("a data type")
        code = _code(word)
        if word.lower() in ("grouped", "no_heights"):
            data.grouped |= word.lower() == "grouped"
            data.heights &= word.lower() != "no_heights"
        elif code in KINDS:
            items.append((code, []))
        elif word.lower() == "classification" and items:
            items[-1][1].append(words.take("the name of a classification").lower())
        elif not items and word.lower() in ("date", *data.classes):
            data.prefix.append(word.lower())
        elif items and word.lower() in ("value", "error", "id", "date", "time", *codes, *data.classes):
            items[-1][1].append(word.lower())
        else:
            raise ValueError(f"found {word!r}, expected a data type ({', '.join(KINDS)}) or one of its items")
    if not items:
        raise ValueError("found no data type behind #data")
    data.items = [LineObservation(code, tuple(f if "value" in f else ["value", *f])) for code, f in items]
    if len({KINDS[item.code].point for item in data.items}) > 1:
        data.items = []
        raise ValueError("data of points and of lines are mixed")
    data.grouped |= any(item.code in _SETS for item in data.items)


def _observations(data: Data, words: WordReader) -> None:
    """A line: its stations and what was observed."""
    if not data.items:
        raise ValueError("observations before a #data command that says what they are")
    rejected = words.skip("*")
    first = (words.take("a station"), _height(data, words))
    point = KINDS[data.items[0].code].point
    ends = [first]
    if not point and data.grouped:
        if not words and not rejected:
            data.header = first
            data.sets += 1
            _end_of_set(data)
            return
        if data.header is None:
            raise ValueError("expected the station of the instrument on a line of its own before its targets")
        ends = [data.header, first]
    elif not point:
        ends.append((words.take("a station"), _height(data, words)))
    before = {entry: words.take(entry) for entry in data.prefix}
    for item in data.items:
        if not words.skip("-"):
            _item(data, item, ends, words, rejected, before)
    if words:
        raise ValueError(f"found {words.peek()!r} behind the observations")


def _height(data: Data, words: WordReader) -> float:
    return words.number("a height above the station") if data.heights and words else 0.0


def _item(
    data: Data,
    item: LineObservation,
    ends: list[tuple[str, float]],
    words: WordReader,
    rejected: bool,
    before: dict[str, str],
) -> None:
    kind = KINDS[item.code]
    vector = item.code in ("GB", "GX")
    value: float | list[float] = 0.0
    sigma: list[float] | None = None
    refraction = data.refraction
    given = dict(before)
    for entry in item.fields:
        if entry == "value":
            rejected |= words.skip("*")
            value = [words.number("a coordinate") for _ in range(3)] if vector else _value(data, kind, words)
            if words.skip("error"):
                sigma = [words.number("an error") for _ in range(3 if vector else 1)]
                sigma = [*sigma, -1.0] if vector else sigma
        elif entry == "error":
            count = NUMBERS[data.vector_form][data.grouped] if vector else 1
            sigma = [words.number("an error") for _ in range(count)]
        elif entry == "refraction_coefficient":
            refraction = words.take("a code").upper()
        else:
            given[entry] = words.take(entry)
    date = date_of(given["date"]) if "date" in given else data.date
    names = [data.station(name, date) for name, _ in ends]
    if len(names) > len(set(names)) and "" not in names:
        raise ValueError(f"both ends are {names[0]!r}")
    ends = [(name, height) for name, (_, height) in zip(names, ends, strict=True)]
    if rejected:
        data.skip("rejected observations (*)")
    rejected |= "" in names
    held = [] if rejected else data.selected(item.code, names, given, date)
    factor = 0.0 if rejected else data.factor(item.code, held)
    rejected = not factor
    if not rejected:
        data.use(names)
    if vector:
        found = Member(names, [h for _, h in ends], value, sigma, factor, data.line, held)  # type: ignore[arg-type]
        data.members.append(found)
        if not data.grouped:
            _end_of_set(data)
        return
    assert isinstance(value, float)
    if not rejected:
        row = _scalar(data, item.code, ends, value, sigma, factor, refraction)
        if item.code in _SETS:
            data.in_sets.setdefault((item.code, data.sets), []).append((row, held))


def _value(data: Data, kind: DataKind, words: WordReader) -> float:
    if not kind.angular:
        return words.number("a value")
    return angle(words, data.form, "" if kind.angular == "line" else kind.angular)


def _scalar(
    data: Data,
    code: str,
    ends: list[tuple[str, float]],
    value: float,
    sigma: list[float] | None,
    factor: float,
    refraction: str,
) -> Row:
    kind = KINDS[code]
    names = [name for name, _ in ends]
    error = factor * _sigma(data, kind, names, value, sigma)
    if error <= 0.0:
        raise ValueError(f"found the error {error:g}, expected one above 0")
    if kind.type in ("orthometric_height", "ellipsoidal_height"):
        value -= ends[0][1]
    instrument = ""
    if code == "DR":
        instrument = f"distance ratio {data.sets}"
    elif code == "ZD":
        instrument = f"refraction {refraction}"
        data.refractions.add(refraction)
    elif code == "PB":
        if not data.projection:
            raise ValueError("nothing says which projection the bearing is of: #projection before it")
        instrument = data.projection
    cells: list[str | None] = [*names]
    if code in ("LT", "LN"):
        cells += [repr(value), None] if code == "LT" else [None, repr(value)]
        cells += [repr(error), None] if code == "LT" else [None, repr(error)]
    else:
        cells += [repr(value), repr(error)]
    if code == "HA":
        cells.append(str(data.sets))
    if kind.type in _HEIGHTS:
        cells += [repr(height) for _, height in ends]
    row = Row(cells, data.line)
    data.tables.setdefault((code, instrument, str(data.path)), []).append(row)
    return row


def _sigma(data: Data, kind: DataKind, names: list[str], value: float, sigma: list[float] | None) -> float:
    """σ in metres or arc seconds."""
    if sigma is not None:
        return sigma[0] * (3600.0 if kind.angular and data.form == "deg" else 1.0)
    if kind.default not in data.errors:
        raise ValueError(f"nothing says the error: #{kind.default}_error, or error in #data")
    error = data.errors[kind.default]
    if not kind.angular:
        return error.of_length(value if kind.value == "distance" else 0.0)
    if len(names) == 1:
        return error.seconds
    length, level = data.length(names)
    if kind.value == "zenith_angle":  # SNAP takes the slope from the observation
        level = length * abs(float(np.sin(np.radians(value))))
    return error.of_angle(length, level)


def _count(data: Data) -> int:
    """How many numbers follow a set: a lower triangle, of correlations without the diagonal."""
    size = 3 * len(data.members)
    explicit = any("error" in item.fields for item in data.items)
    if not explicit or not NUMBERS[data.vector_form][2]:
        return 0
    return size * (size + (1 if data.vector_form == "full" else -1)) // 2


def _end_of_set(data: Data) -> None:
    """Put the vectors or positions that were read since into a table with their covariances."""
    members, numbers = data.members, data.covariances
    data.members, data.covariances = [], None
    if not members:
        return
    code = "GX" if len(members[0].names) == 1 else "GB"
    explicit = any("error" in item.fields for item in data.items if item.code == code)
    form = data.vector_form if explicit else ""
    try:
        if form and NUMBERS[form][2] and data.grouped and numbers is None:
            raise ValueError("the set has no covariances: #end_set and the numbers are missing")
        found = set_of(data.stations, members, form, data.vector_errors.get(code), numbers)
    except ValueError as error:
        data.draft.problem(str(error), members[0].line, str(data.path))
        return
    if found is not None and code == "GX" and is_translated(members):
        data.translated.append((found, str(data.path)))
    elif found is not None and data.grouped:
        data.matrices.setdefault((code, str(data.path)), []).append(found)
    elif found is not None:
        data.singles.setdefault((code, str(data.path)), []).append(found)


def tie_recoded(data: Data) -> None:
    """Tie stations that recodes with an error (hv_error) split, by vectors of length 0 between those in use.

    The steps of a station from one date to the next are independent: variances of steps in a row add up.
    Recodes to the same code at the same date are one step with the larger errors, none if one of them has none.
    """
    known = {name.upper(): name for name in data.names}
    for code in dict.fromkeys(recode.code for recode in data.recodes):
        own = [recode for recode in data.recodes if recode.code == code]
        for after in (False, True):
            steps: dict[Period, Recode] = {}
            for one in own:
                if bool(one.period.since) == after and bool(one.period.until) != after:
                    steps[one.period] = _one_step(one, steps.get(one.period, one))
            last, variances = known.get(code), np.zeros(3)
            for step in sorted(steps.values(), key=lambda one: one.narrowness, reverse=True):
                name = known.get(step.new.upper())
                if name == last and step.sigma is not None and name is not None:
                    data.draft.problem(f"station {code!r} is recoded to {name!r} at two dates with an error")
                    continue
                if step.sigma is None:
                    last = None
                if last is not None and step.sigma is not None:
                    horizontal, vertical = step.sigma
                    variances += np.square([horizontal, horizontal, vertical])
                    if name is None:
                        continue
                    axes = data.stations.axes([last])
                    row = Row([last, name, *["0.0"] * 5], 1)
                    tie = Set([row], axes.T @ np.diag(variances) @ axes)
                    data.singles.setdefault(("GB", str(data.stations.path)), []).append(tie)
                last, variances = name, np.zeros(3)


def _one_step(one: Recode, other: Recode) -> Recode:
    if one.new.upper() != other.new.upper():
        return one
    if one.sigma is None or other.sigma is None:
        return one._replace(sigma=None)
    return one._replace(sigma=(max(one.sigma[0], other.sigma[0]), max(one.sigma[1], other.sigma[1])))


def put_observations(data: Data) -> None:
    """Put the rows that were read into tables."""
    # Where a row of them has its σ.
    column_of_sigma = 3
    for members in data.in_sets.values():
        held = {id(one): one for _, selections in members for one in selections if one.kind == "by_set"}
        factor = _product(list(held.values()))
        for row, _ in members if held else []:
            row.cells[column_of_sigma] = repr(float(row.cells[column_of_sigma] or 0.0) * factor)
    for number, (one, file) in enumerate(data.translated, start=1):
        columns = _columns(len(one.rows[0].cells))
        keys = {"covariance": one.Q.tolist(), "instrument": f"translation {number}"}
        data.draft.table("observations", columns, one.rows, file, type=_type(columns), **keys)
    for (_, file), sets in data.matrices.items():
        names = _columns(len(sets[0].rows[0].cells))
        data.draft.correlated(names, sets, _type(names), file)
    for (_, file), singles in data.singles.items():
        put_singles(data.draft, singles, file)
    for (code, instrument, file), rows in data.tables.items():
        kind = KINDS[code]
        columns = ["from", "to"] if not kind.point else ["point"]
        columns = ["station", "to"] if code == "HA" else columns
        if code in ("LT", "LN"):
            columns += ["latitude", "longitude", "sigma_latitude", "sigma_longitude"]
        else:
            columns += [kind.value, "sigma"]
        columns += ["set"] if code == "HA" else []
        columns += ["from_height", "to_height"] if kind.type in _HEIGHTS else []
        units = {name: "arcsec" for name in columns if name.startswith("sigma") and kind.angular}
        data.draft.table(
            "observations",
            columns,
            rows,
            file,
            type=kind.type,
            units=units or None,
            **({"projection" if code == "PB" else "instrument": instrument} if instrument else {}),
        )
