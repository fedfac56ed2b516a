"""Read DynAdjust files: DNA text and DynaML."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mor.errors import InputError, Message, counted
from mor.formats.draft import LARGEST, Draft, Element, Row, parse_number, parse_xml, read_lines
from mor.formats.fieldbook.book import sexagesimal
from mor.input_files import PROJECT, read_bytes
from mor.model.earth import east_north_up
from mor.project.document import Document
from mor.project.reference_system import (
    ARCSEC,
    GridError,
    ReferenceSystem,
    ReferenceSystemError,
    reference_system,
    values_at,
)
from mor.types import FloatArray
from mor.units import parse_dms

# ---- Lines of DynAdjust's files, and what is collected of them.
#
# Source: *DynAdjust User's Guide*, appendix on DNA file formats: columns of 20 characters for names, values
# behind column 62, angles in degrees, minutes and seconds, their σ in seconds.

NAMES = (slice(2, 22), slice(22, 42), slice(42, 62))
VALUES = 62
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_NO_VALUE = re.compile(r"(?<=\s)(?:\d\d?\.\d\d?\.\d{4}|[A-Za-z]\w*)(?=\s|$)")
"""Frames and epochs behind the values of a measurement."""
OFF = "measurements that are switched off (*)"


def measured_words(text: str, least: int) -> list[str]:
    """Numbers of a measurement of one line, ``least`` or more; frame, epoch and the identifiers of a database go.

    Identifiers of measurement and cluster are whole numbers behind the values, which have a decimal point.
    """
    words = NUMBER.findall(_NO_VALUE.sub(" ", text))
    while len(words) > least and words[-1].isdecimal():
        words.pop()
    return words


class Frame(NamedTuple):
    """A reference frame and an epoch (dd.mm.yyyy), each empty if a file does not say it."""

    name: str
    epoch: str


class Cluster(NamedTuple):
    """A baseline (G), or a cluster of baselines (X) or positions (Y, in XYZ, LLH or, above the ellipsoid, LLh)."""

    code: str
    form: str
    rows: list[Row]
    Q: FloatArray
    """(3n, 3n), m², its lower triangle; of LLH in radians and metres."""
    scales: list[float]
    """Those of the whole matrix and of its parts in latitude, longitude and height."""
    frame: Frame


@dataclass
class Collected:
    """Measurements read from DNA or DynaML."""

    draft: Draft
    frame: Frame
    """That of measurements that do not say theirs."""
    geoid: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    """N (m), ξ, η (arc seconds) by station."""
    names: dict[str, int] = field(default_factory=dict)
    """Stations with the line that names them first."""
    left_out: dict[str, list[int]] = field(default_factory=dict)
    """Lines of the measurements that are not read, by what they are."""
    sets: int = 0
    """Sets of directions so far."""
    tables: dict[str, list[Row]] = field(default_factory=dict)
    """Rows of the measurements that are in no cluster, by their letters."""
    clusters: dict[tuple[str, tuple[str, ...]], list[tuple[list[Row], FloatArray]]] = field(default_factory=dict)
    """Rows and covariance matrix of each cluster, by type and columns."""
    read: list[Cluster] = field(default_factory=list)
    """Baselines and clusters, until the places of the stations are known."""

    def skip(self, what: str, line: int) -> None:
        """The measurement at a line is not read."""
        self.left_out.setdefault(what, []).append(line)

    def known(self, names: list[str], line: int) -> list[str]:
        """Names of a measurement, noted. Raises ``ValueError`` where one is empty or there twice."""
        if not all(names) or len(set(names)) < len(names):
            raise ValueError(f"found the stations {', '.join(map(repr, names))}, expected {len(names)} different names")
        for name in names:
            self.names.setdefault(name, line)
        return names


@dataclass
class MeasurementFile(Collected):
    """Lines of a measurement file, and what is read of them."""

    lines: list[str] = field(default_factory=list)
    at: int = 1

    def numbers(self) -> list[float]:
        """Numbers of the next line. Raises ``ValueError`` where it has none."""
        text = self.lines[self.at] if self.at < len(self.lines) else ""
        if text[:1].strip():
            raise ValueError("the measurement is not complete: expected its values and covariances")
        self.at += 1
        # Column of the identifiers of a database, behind the values of a line.
        words = NUMBER.findall(text[VALUES:142])
        values = list(map(float, words))
        return values if all(-LARGEST <= value <= LARGEST for value in values) else list(map(parse_number, words))

    def stations_of(self, text: str, count: int) -> list[str]:
        """Names of a line. Raises ``ValueError`` where there are not so many different ones."""
        return self.known([text[place].strip() for place in NAMES[:count]], self.at + 1)


def beside(path: Path, end: str, name: str = "") -> Path:
    """The file of a pair, or of another name, in the case of letters that is there."""
    places = [path.with_name(f"{name or path.stem}{form}") for form in (end, end.upper())]
    return next((place for place in places if place.is_file()), places[0])


def marked_lines(path: Path, draft: Draft) -> list[str]:
    """Lines of a station or measurement file. Raises :class:`InputError` if it is none."""
    if not path.is_file():
        raise InputError([Message("this file does not exist; DynAdjust has a pair of .stn and .msr", str(path))])
    lines = read_lines(path, draft)
    words = (lines[0] if lines else "").split()
    version = words[1].partition(".")[0] if len(words) > 1 else ""
    mark = "!#=DNA"
    if not lines or not lines[0].startswith(mark) or version not in ("3", "300", "301"):
        said = lines[0][:30] if lines else ""
        raise InputError([Message(f"found {said!r}, expected {mark} 3 in the first line", str(path), 1)])
    return lines


def read_geoid(path: Path, draft: Draft) -> dict[str, tuple[float, float, float]]:
    """N, ξ, η of the stations in the file ``.geo`` beside the pair; nothing if there is none."""
    found: dict[str, tuple[float, float, float]] = {}
    if not path.is_file():
        return found
    for line, text in enumerate(read_lines(path, draft), start=1):
        name, words = text[:20].strip(), text[20:].split()
        if not text.strip() or text.startswith("#"):
            continue
        try:
            N, xi, eta = (parse_number(word) for word in words)
        except ValueError:
            draft.problem(f"found {text.strip()!r}, expected a station, N, ξ and η", line, str(path))
            continue
        found[name] = (N, xi, eta)
    return found


# ---- Measurements of one line: angles, azimuths, distances, heights, height differences.


class MeasurementKind(NamedTuple):
    """A kind of measurement: its type in a project, the columns of its names, that of its value."""

    type: str
    names: tuple[str, ...]
    value: str
    angle: bool = False
    heights: bool = False
    """True if heights of instrument and target may follow."""


_LINE = ("from", "to")
KINDS = {
    "A": MeasurementKind("angle", ("at", "from", "to"), "angle", angle=True),
    "B": MeasurementKind("azimuth", _LINE, "azimuth", angle=True),
    "C": MeasurementKind("ellipsoid_chord", _LINE, "distance"),
    "E": MeasurementKind("ellipsoid_arc", _LINE, "distance"),
    "H": MeasurementKind("orthometric_height", ("point",), "height"),
    "K": MeasurementKind("astronomic_azimuth", _LINE, "azimuth", angle=True),
    "L": MeasurementKind("height_difference", _LINE, "dz"),
    "M": MeasurementKind("mean_sea_level_distance", _LINE, "distance"),
    "R": MeasurementKind("ellipsoidal_height", ("point",), "height"),
    "S": MeasurementKind("distance", _LINE, "distance", heights=True),
    "V": MeasurementKind("zenith_angle", _LINE, "zenith_angle", angle=True, heights=True),
    "Z": MeasurementKind("vertical_direction", _LINE, "vertical_direction", angle=True, heights=True),
}
COORDINATES = {
    code: MeasurementKind("geodetic_position", ("point",), name, angle=True)
    for code, name in zip("PQIJ", ("latitude", "longitude") * 2, strict=True)
}
"""Geodetic (P, Q) and astronomic (I, J) latitudes and longitudes, alone."""
SINGLE = {**KINDS, **COORDINATES}


def read_line(found: MeasurementFile, code: str) -> None:
    """One measurement. Raises ``ValueError`` with words."""
    kind, text = SINGLE[code], found.lines[found.at]
    names = found.stations_of(text, len(kind.names))
    packed = code in COORDINATES and len(measured_words(text[VALUES:], 2)) == 2
    count = 4 if kind.angle and not packed else 2
    words = measured_words(text[VALUES:], count)
    if len(words) != count and not (kind.heights and len(words) == count + 2):
        raise ValueError(f"found {len(words)} numbers, expected {'an angle' if kind.angle else 'a value'} and its σ")
    if text[1:2] == "*":
        found.skip(OFF, found.at + 1)
        return
    value = _sexagesimal(words[0]) if packed else words[0]
    value = sexagesimal_words(text[VALUES:], words) if count == 4 else value
    heights = words[count:] if len(words) > count else [None, None]
    cells = [*names, value, words[count - 1], *(heights if kind.heights else [])]
    found.tables.setdefault(code, []).append(Row(cells, found.at + 1))


def sexagesimal_words(text: str, words: list[str]) -> str:
    """d-m-s of the first three words of a text. Raises ``ValueError``."""
    degrees, minutes, seconds = (parse_number(word) for word in words[:3])
    if not (0.0 <= minutes < 60.0 and 0.0 <= seconds < 60.0 and degrees == int(degrees)):
        raise ValueError(f"found the angle {' '.join(words[:3])}, expected degrees, minutes, seconds")
    sign = "-" if text.strip().startswith("-") else ""
    return f"{sign}{abs(int(degrees))}-{int(minutes)}-{seconds!r}"


# ---- Sets of directions (D): the station with its first target, then every other target of the set.
#
# Source: *DynAdjust User's Guide*, appendices on DNA and DynaML, and what DynAdjust itself writes: a line or
# an element for each target; the number of the set counts those behind the first.


class SetDirection(NamedTuple):
    """A target of a set: its direction as d-m-s, its σ in seconds."""

    target: str
    value: str
    sigma: str
    line: int
    off: bool = False


def read_directions(found: MeasurementFile) -> None:
    """A set of a DNA file. Raises ``ValueError`` with words."""
    text = found.lines[found.at]
    station, target = (text[place].strip() for place in NAMES[:2])
    said, off = text[NAMES[2]].strip(), text[1:2] == "*"
    sights = [_sight(found, target)]
    while _goes_on(found, found.at + 1):
        found.at += 1
        text = found.lines[found.at]
        sights.append(_sight(found, text[NAMES[2]].strip()))
    put_set(found, station, sights, said, off)


def _goes_on(found: MeasurementFile, at: int) -> bool:
    """Return True if a line is one of the set before it: its station is left out."""
    text = found.lines[at] if at < len(found.lines) else ""
    return text[:1] in ("D", " ") and not text[2:42].strip() and bool(text[NAMES[2]].strip())


def _sight(found: MeasurementFile, target: str) -> SetDirection:
    text = found.lines[found.at][VALUES:]
    words = measured_words(text, 4)
    if len(words) != 4:
        raise ValueError(f"found {len(words)} numbers, expected an angle and its σ")
    off = found.lines[found.at][1:2] == "*"
    parse_number(words[3])
    return SetDirection(target, sexagesimal_words(text, words), words[3], found.at + 1, off)


def put_set(found: Collected, station: str, sights: list[SetDirection], said: str, off: bool) -> None:
    """Put a set into the draft. ``said``: number of targets behind the first; ``off``: all of it is switched off.

    Raises ``ValueError`` where there are not so many.
    """
    used = [sight for sight in sights if not sight.off]
    if said not in (str(len(sights) - 1), str(len(used) - 1)):
        raise ValueError(f"found {len(sights) - 1} directions behind the first, expected {said or 'how many'}")
    if off:
        found.skip(OFF, sights[0].line)
        return
    for sight in sights:
        if sight.off:
            found.skip(OFF, sight.line)
        else:
            found.known([station, sight.target], sight.line)
    found.sets += 1
    rows = [Row([station, s.target, s.value, s.sigma, str(found.sets)], s.line) for s in used]
    found.tables.setdefault("D", []).extend(rows)


def put_directions(found: Collected) -> None:
    """Put the sets that were read into a table."""
    rows = found.tables.pop("D", [])
    columns = ("station", "to", "horizontal", "sigma", "set")
    if rows:
        found.draft.table("observations", columns, rows, type="directions", units={"sigma": "arcsec"})


# ---- GNSS baselines and positions with their covariances: alone, or in clusters with one matrix.

COUNTED = 10_000
"""Most baselines or positions of one cluster: its covariance matrix is full."""
VECTOR = ("dx", "dy", "dz")
PAIRS = (("dx", "dx"), ("dx", "dy"), ("dx", "dz"), ("dy", "dy"), ("dy", "dz"), ("dz", "dz"))
VECTORS = "vectors"
"""Where the baselines that are in no cluster are collected."""


def read_cluster(found: MeasurementFile, code: str) -> None:
    """A baseline, or a cluster of baselines or positions with one covariance matrix."""
    first, text = found.at + 1, found.lines[found.at]
    off = text[1:2] == "*"
    count = 1
    if code in "XY":
        word = text[NAMES[2]].strip()
        if not word.isdecimal() or not 0 < int(word) <= COUNTED:
            raise ValueError(f"found {word!r}, expected the number of members of the cluster")
        count = int(word)
    scales = scales_of([parse_number(word) for word in NUMBER.findall(text[VALUES : VALUES + 40])])
    form = _form_of(code, text[NAMES[1]].strip())
    rows: list[Row] = []
    Q = np.zeros((3 * count, 3 * count))
    for k in range(count):
        text = found.lines[found.at] if found.at < len(found.lines) else ""
        if text[:1] != code:
            raise ValueError(f"expected {count} members of the cluster that begins in line {first}, found {k}")
        names, line = found.stations_of(text, 2 if code in "GX" else 1), found.at + 1
        found.at += 1
        behind = count - k - 1
        values = []
        a = 3 * k
        for row in range(3):
            numbers = found.numbers()
            if len(numbers) != row + 2:
                found.at -= 1
                raise ValueError(f"found {len(numbers)} numbers, expected a value and {row + 1} covariances")
            values.append(repr(numbers[0]))
            Q[a + row, a : a + row + 1] = numbers[1:]
        for other in range(behind):
            b = 3 * (k + 1 + other)
            for row in range(3):
                numbers = found.numbers()
                if len(numbers) != 3:
                    found.at -= 1
                    raise ValueError(f"found {len(numbers)} numbers, expected 3 covariances")
                Q[b : b + 3, a + row] = numbers
        rows.append(Row([*names, *values], line))
    if off:
        found.skip(OFF, found.at)
        return
    frame = frame_among(found.lines[first - 1][VALUES:].split()[4:], found.frame)
    found.read.append(Cluster(code, form, rows, Q, scales, frame))


def _form_of(code: str, text: str) -> str:
    """Form of a cluster: GNSS, XYZ, LLH or LLh. Raises ``ValueError``."""
    form = "GNSS" if code in "GX" else text if text == "LLh" else text.upper()
    if form not in ("GNSS", "XYZ", "LLH", "LLh"):
        raise ValueError(f"found positions in {form!r}, expected XYZ or LLH")
    return form


def scales_of(scales: list[float]) -> list[float]:
    """Scales of a matrix and of its parts in latitude, longitude, height. Raises ``ValueError``."""
    if len(scales) != 4 or min(scales) <= 0.0:
        said = " ".join(f"{scale:g}" for scale in scales)
        raise ValueError(f"found {said!r}, expected four scales above 0")
    return scales


def put_clusters(found: Collected, stations: list[StationRecord], own: Frame) -> None:
    """Put the baselines and clusters into the draft: in the frame of the file, and scaled."""
    by_name = {station.name: station for station in stations}
    frames: dict[bool, dict[str, int]] = {True: {}, False: {}}
    for cluster in found.read:
        row = cluster.rows[0]
        with found.draft.at(row.line, name=f"station {row.cells[0]!r}"):
            names = [str(row.cells[0]) for row in cluster.rows]
            if not set(names) <= set(by_name):  # put_stations tells it
                continue
            places = np.array([_geodetic(by_name[name], own.name, found) for name in names])
            if cluster.form in ("LLH", "LLh"):
                cluster = cluster._replace(rows=[_in_degrees(row, cluster.form, found) for row in cluster.rows])
            name = cluster.frame.name
            if cluster.frame != own and (name != own.name or name not in _STATIC):
                year = _year_of_change(cluster.frame, own)
                frames[bool(year)].setdefault(" ".join(cluster.frame).strip(), row.line)
                cluster = _transformed(cluster, places, name, own.name, year) if year else cluster
            _put_cluster(found, cluster, places)
    for transformed, told in frames.items():
        if told:
            many = f"measurements in {counted(len(told), 'frame and epoch', 'frames and epochs')} ({', '.join(told)})"
            how = f"{many} are transformed to {own.name}"
            as_is = f"{many} are taken as they are, without transformations"
            found.draft.note(how if transformed else as_is, min(told.values()))


def _geodetic(station: StationRecord, frame: str, found: Collected) -> list[float]:
    """Latitude, longitude (radians) and height above the ellipsoid of a station."""
    N = found.geoid[station.name][0] if station.name in found.geoid else 0.0
    latitude, longitude, height = map(float, _place(station, frame, N))
    return [float(np.radians(latitude)), float(np.radians(longitude)), height + N]


def _in_degrees(row: Row, form: str, found: Collected) -> Row:
    """A position in degrees, with the height above the ellipsoid."""
    name, latitude, longitude, height = map(str, row.cells)
    N = found.geoid[name][0] if name in found.geoid and form == "LLH" else 0.0
    degrees = (repr(sexagesimal(word)) for word in (latitude, longitude))
    return Row([name, *degrees, repr(float(height) + N)], row.line)


def _put_cluster(found: Collected, cluster: Cluster, places: FloatArray) -> None:
    """Put a cluster into the draft, its matrix scaled along north, east and up at the places of its rows."""
    rows, geodetic = cluster.rows, cluster.form in ("LLH", "LLh")
    whole = (np.tril(cluster.Q) + np.tril(cluster.Q, -1).T) * cluster.scales[0]
    if cluster.scales[1:] != [1.0, 1.0, 1.0]:
        scaled = np.zeros_like(whole)
        for k in range(len(rows)):
            axes = np.eye(3) if geodetic else east_north_up(*places[k : k + 1, :2].T)[0][[1, 0, 2]]
            own = slice(3 * k, 3 * k + 3)
            scaled[own, own] = axes.T @ np.diag(np.sqrt(cluster.scales[1:])) @ axes
        whole = scaled @ whole @ scaled.T
    if not np.isfinite(whole).all() or np.linalg.eigvalsh(whole)[0] <= 0.0:
        found.draft.problem("the covariance matrix is not positive definite", rows[0].line)
    elif geodetic:
        # Covariances in radians and metres.
        units = np.tile([np.degrees(1.0), np.degrees(1.0), 1.0], len(rows))
        key = ("geodetic_position", ("point", "latitude", "longitude", "height"))
        found.clusters.setdefault(key, []).append((rows, whole * np.outer(units, units)))
    else:
        _put_geocentric(found, cluster.code, rows, whole)


def _put_geocentric(found: Collected, code: str, rows: list[Row], Q: FloatArray) -> None:
    if code == "G":
        covariances = [repr(float(Q[VECTOR.index(a), VECTOR.index(b)])) for a, b in PAIRS]
        found.tables.setdefault(VECTORS, []).append(Row([*rows[0].cells, *covariances], rows[0].line))
        return
    names = ("from", "to", *VECTOR) if code == "X" else ("point", "x", "y", "z")
    type_ = "gnss_vector" if code == "X" else "gnss_position"
    found.clusters.setdefault((type_, names), []).append((rows, Q))


def put_vectors(found: Collected) -> None:
    """Put clusters of one kind into a table, and the baselines that are in no cluster."""
    for (type_, columns), clusters in found.clusters.items():
        found.draft.correlated(columns, clusters, type_)
    rows = found.tables.pop(VECTORS, [])
    if rows:
        columns = ("from", "to", *VECTOR, *(f"cov_{a}_{b}" for a, b in PAIRS))
        found.draft.table("observations", columns, rows, type="gnss_vector")


# ---- Frames and epochs: GNSS measurements are transformed into the frame of the file, as DynAdjust does it.
#
# PROJ has the transformations of EPSG, with their rates. Between two epochs of frames that do not move with a plate,
# only a model of its motion could transform.

_STATIC = ("GDA94", "GDA2020")
"""Frames that move with the plate."""
_DEFAULT = Frame("GDA2020", "01.01.2020")
"""DynAdjust's own."""


def frame_among(words: Iterable[str], default: Frame = Frame("", "")) -> Frame:  # noqa: B008 - it does not change
    """The first name among words, and the first date behind it; what is missing is that of another frame."""
    name, epoch = "", ""
    date_form = re.compile(r"\d\d?\.\d\d?\.\d{4}")
    for word in words:
        date = date_form.match(word)
        if date:
            epoch = epoch or date[0]
        elif word[0].isalpha() and not name:
            name, epoch = re.sub(r"^ITRF(?=[89]\d$)", "ITRF19", word.upper()), ""
    name = name or default.name
    return Frame(name, epoch or (default.epoch if name == default.name else ""))


def _year_of_change(given: Frame, own: Frame) -> float:
    """Year whose transformation leads from a frame to that of the file; 0 if there is none.

    Raises ``ValueError`` if the epoch is no date.
    """
    epochs = {frame.epoch for frame in (given, own) if frame.name not in _STATIC} or {own.epoch or _DEFAULT.epoch}
    if given.name not in SYSTEMS or given.name == own.name or len(epochs) > 1:
        return 0.0
    epoch = epochs.pop()
    try:
        days = datetime.strptime(epoch, "%d.%m.%Y").timetuple()
    except ValueError:
        raise ValueError(f"found the epoch {epoch!r}, expected dd.mm.yyyy") from None
    return days.tm_year + (days.tm_yday - 1) / 365.25


def _transformed(cluster: Cluster, places: FloatArray, source: str, target: str, year: float) -> Cluster:
    """A cluster in another frame; vectors begin at the places of their stations. Raises ``ValueError``."""
    ellipsoid = _system(SYSTEMS[source]).ellipsoid
    values = np.array([[float(str(cell)) for cell in row.cells[-3:]] for row in cluster.rows])
    if cluster.form == "GNSS":
        start = ellipsoid.geocentric(places)
        ends = [_in_frame(ellipsoid.geodetic(end), source, target, year) for end in (start + values, start)]
        values = ellipsoid.geocentric(ends[0]) - ellipsoid.geocentric(ends[1])
    elif cluster.form == "XYZ":
        values = ellipsoid.geocentric(_in_frame(ellipsoid.geodetic(values), source, target, year))
    else:
        to_degrees = np.degrees([1.0, 1.0, np.radians(1.0)])
        values = _in_frame(values / to_degrees, source, target, year) * to_degrees
    rows = [
        Row([*row.cells[:-3], *map(repr, value)], row.line)
        for row, value in zip(cluster.rows, values.tolist(), strict=True)
    ]
    return cluster._replace(rows=rows)


def _in_frame(geodetic: FloatArray, source: str, target: str, year: float) -> FloatArray:
    """Latitude, longitude (radians), height (n, 3) in another frame, all on one ellipsoid. Raises ``ValueError``."""
    latitude, longitude, height = geodetic.T
    years = np.full(len(height), year)
    moved = np.stack(
        _transformer(source, target).transform(longitude, latitude, height, years, radians=True)[:3], axis=1
    )
    if not np.isfinite(moved).all():
        raise ValueError(f"its place cannot be transformed from {source} to {target}")
    return np.asarray(moved[:, [1, 0, 2]])


@cache
def _transformer(source: str, target: str) -> Any:
    from pyproj import Transformer

    start, end = (_system(SYSTEMS[name]).crs.to_3d() for name in (source, target))
    return Transformer.from_crs(start, end, always_xy=True)


# ---- Stations as latitude, longitude and height, with what is known of the geoid at them, held or free.

SYSTEMS = {
    "GDA94": 4283,
    "GDA2020": 7844,
    **{f"ITRF{year}": 7000 + year for year in range(1988, 1995)},
    "ITRF1996": 8995,
    "ITRF1997": 8996,
    "ITRF2000": 8997,
    "ITRF2005": 8998,
    "ITRF2008": 8999,
    "ITRF2014": 9000,
    "ITRF2020": 9990,
}
"""Geographic systems of the frames that DynAdjust's files are in, by EPSG code."""
_HELD = "1e-6"
"""σ (m) of what is held in part: DynAdjust's own."""


class StationRecord(NamedTuple):
    """A station as a file has it: what is held, the kind of its coordinates, their texts, the zone of a map grid."""

    name: str
    held: str
    kind: str
    values: list[str]
    zone: str
    line: int
    off: bool = False


def stations_of_lines(lines: list[str]) -> Iterator[StationRecord]:
    """Stations of a DNA file."""
    for line, text in enumerate(lines[1:], start=2):
        if text.strip():
            values = [text[place].strip() for place in (slice(28, 48), slice(48, 68), slice(68, 88))]
            zone = text[88:90].strip()
            if any(" " in value for value in values):  # columns of other widths
                *values, zone = [*text[27:].split(maxsplit=4), *[""] * 4][:4]
            name, held, kind = text[:20].strip(), text[20:23].upper(), text[24:27]
            yield StationRecord(name, held, _kind_of(kind), values, zone.lstrip("SsNn"), line, text[:1] == "*")


def _kind_of(text: str) -> str:
    """Kind of coordinates: LLH, UTM, XYZ or, with heights above the ellipsoid, LLh."""
    return text if text == "LLh" else text.upper()


def put_stations(path: Path, stations: Iterable[StationRecord], found: Collected, frame: str) -> None:
    """Stations that take part: free, held, or held in some components."""
    draft = found.draft
    tables: dict[str, list[Row]] = {"free": [], "held": [], "in part": []}
    known: dict[str, str] = {}
    for station in stations:
        name = station.name
        if station.off or name not in found.names:
            known.setdefault(name, "")
            continue
        if known.get(name):
            if known[name] == station.held == "FFF":
                words = (
                    f"station {name!r} is there twice; its coordinates are start values, and the first ones are taken"
                )
                draft.note(words, station.line, str(path))
            else:
                draft.problem(f"station {name!r} is there twice", station.line, str(path))
            continue
        known[name] = station.held
        try:
            place = _place(station, frame, found.geoid.get(name, (0.0,))[0])
            sigmas = _sigmas(station.held, station.kind)
        except (ValueError, ReferenceSystemError) as error:
            draft.problem(f"station {name!r}: {error}", station.line, str(path))
            continue
        which = {"CCC": "held", "FFF": "free"}.get(station.held, "in part")
        tables[which].append(Row([name, *place, *_geoid(found, name), *sigmas], station.line))
    for name, line in found.names.items():
        if name not in known:
            draft.problem(f"station {name!r} is not in {path.name}", line)
    _put_tables(draft, path, tables)
    if tables["free"] and not tables["held"] and not tables["in part"] and not _positions(draft):
        draft.put("datum", "free")
        draft.note("no station is held, and no position is observed: the network is free", 1, str(path))


def _positions(draft: Draft) -> bool:
    types = {table["type"] for table in draft.data.get("observations", [])}
    return bool(types & {"gnss_position", "geodetic_position"})


def _put_tables(draft: Draft, path: Path, tables: dict[str, list[Row]]) -> None:
    columns = (
        *("id", "latitude", "longitude", "height", "geoid"),
        *("deflection_north", "deflection_east", "sigma_east", "sigma_north", "sigma_up"),
    )
    units = {"latitude": "deg", "longitude": "deg"}
    for which, rows in tables.items():
        if not rows:
            continue
        own = dict(units)
        if any(row.cells[5] is not None for row in rows):
            own |= dict.fromkeys(columns[5:7], "arcsec")
        fixed = ["x", "y", "z"] if which == "held" else []
        draft.table("points", columns, rows, str(path), units=own, fixed=fixed)
    if tables["in part"]:
        words = f"stations that are held in part are observed with σ {_HELD} m, as DynAdjust does it"
        draft.note(words, tables["in part"][0].line, str(path))


def _geoid(found: Collected, name: str) -> list[str | None]:
    if not found.geoid:
        return ["0.0", None, None]
    if name not in found.geoid:
        found.draft.problem(f"station {name!r} is not in the file of geoid heights", found.names[name])
        return [None] * 3
    return [repr(value) for value in found.geoid[name]]


def _sigmas(held: str, kind: str) -> list[str | None]:
    """σ east, north, up of what is held in part. Raises ``ValueError``."""
    if len(held) != 3 or set(held) - set("CF"):
        raise ValueError(f"found the constraints {held!r}, expected three letters C or F")
    if held in ("CCC", "FFF"):
        return [None] * 3
    if kind == "XYZ":
        raise ValueError(f"{held} in XYZ holds a geocentric axis; only CCC and FFF are supported")
    order = (0, 1, 2) if kind == "UTM" else (1, 0, 2)
    return [_HELD if held[k] == "C" else None for k in order]


def _place(station: StationRecord, frame: str, N: float) -> list[str]:
    """Latitude, longitude (degrees) and height as given, of X, Y, Z the one above the geoid."""
    words, kind = station.values, station.kind
    if kind in ("LLH", "LLh"):
        latitude, longitude = (sexagesimal(word) for word in words[:2])
        if abs(latitude) > 90.0:
            raise ValueError(f"found the latitude {latitude:g}, expected it between -90 and 90")
        return [repr(latitude), repr(longitude), repr(parse_number(words[2]) - (N if kind == "LLh" else 0.0))]
    values = np.array([[parse_number(word) for word in words]])
    # EPSG codes of the map grids of these frames, without their zones.
    zones = {"GDA94": 28300, "GDA2020": 7800}
    if kind == "XYZ":
        latitude, longitude, height = _system(SYSTEMS[frame]).ellipsoid.geodetic(values)[0].tolist()
        height -= N
    elif kind == "UTM":
        zone = station.zone
        if not zone.isdecimal() or not 1 <= int(zone) <= 60:
            raise ValueError(f"found the zone {zone!r}, expected a number from 1 to 60")
        if frame not in zones:
            raise ValueError(f"found UTM in {frame}, which has no map grid; expected LLH or XYZ")
        grid = _system(zones[frame] + int(zone))
        latitude, longitude, height = grid.to_geodetic(values)[0].tolist()
    else:
        raise ValueError(f"found coordinates in {kind!r}, expected LLH, UTM or XYZ")
    return [repr(float(np.degrees(latitude))), repr(float(np.degrees(longitude))), repr(height)]


@cache
def _system(code: int) -> ReferenceSystem:
    return reference_system(f"EPSG:{code}")


def frame_of(words: list[str], draft: Draft, line: int = 1, default: Frame | None = None) -> Frame:
    """The frame and the epoch among the words of a head. Raises :class:`InputError` if mor does not know the frame."""
    found = frame_among(word for word in words if word.upper() not in ("STN", "MSR"))
    if not found.name:
        if default is None:
            draft.note(f"found no reference frame: {' '.join(_DEFAULT)} is taken, as DynAdjust does it", line)
        return default or _DEFAULT
    if found.name not in SYSTEMS:
        draft.problem(f"found the reference frame {found.name!r}, expected one of {', '.join(SYSTEMS)}", line)
        raise InputError(draft.problems)
    return found


# ---- DynaML, DynAdjust's XML: the same stations and measurements as in its DNA files, an element each.
#
# Source: *DynAdjust User's Guide*, appendix on DynaML. Angles and latitudes are ddd.mmssss…, σ of angles seconds.

ROOT = "DnaXmlFormat"
STATIONS, MEASURED = "stn.xml", "msr.xml"


def pair_of(path: Path) -> tuple[Path, Path, str]:
    """Files of stations and measurements, by one of them, and what both names have in common; one file may be both."""
    root = root_of(path)
    if list(root.all("DnaStation")) and list(root.all("DnaMeasurement")):
        return path, path, path.stem
    which = list(re.finditer("stn|msr", path.stem, re.IGNORECASE))
    if not which:
        words = (
            f"found the name {path.name!r}, expected one that ends in {STATIONS} or {MEASURED}, as DynaML's pairs do"
        )
        raise InputError([Message(words, str(path))])
    start, end = which[-1].span()
    before, behind = path.name[:start], path.name[end:]
    cases = (str.lower, str.upper, str.capitalize)
    pair = [
        next((place for place in map(path.with_name, names) if place.is_file()), path.with_name(names[0]))
        for names in ([f"{before}{form(kind)}{behind}" for form in cases] for kind in ("stn", "msr"))
    ]
    return pair[0], pair[1], f"{before}{behind.removesuffix(path.suffix)}".strip("._- ")


def root_of(path: Path) -> Element:
    """Root element of a file. Raises :class:`InputError` if it is none of DynaML."""
    if not path.is_file():
        words = f"this file does not exist; DynaML has a pair of …{STATIONS} and …{MEASURED}"
        raise InputError([Message(words, str(path))])
    root = parse_xml(read_bytes(path, PROJECT), str(path))
    if root.name != ROOT:
        raise InputError([Message(f"found <{root.name}>, expected <{ROOT}>", str(path), root.line)])
    return root


def stations_of_xml(root: Element) -> Iterator[StationRecord]:
    """Stations of a DynaML file."""
    for element in root.all("DnaStation"):
        place = next(iter(element.all("StationCoord")), element)
        values = [_text(place, name) for name in ("XAxis", "YAxis", "Height")]
        held, kind = _text(element, "Constraints").upper(), _kind_of(_text(element, "Type"))
        zone = _text(place, "HemisphereZone").lstrip("SsNn")
        yield StationRecord(_text(element, "Name"), held, kind, values, zone, element.line)


def read_measurement(found: Collected, element: Element) -> None:
    """One measurement. Raises ``ValueError`` with words."""
    code = _text(element, "Type").upper()
    if _is_off(element):
        found.skip(OFF, element.line)
    elif code in ("G", "X", "Y"):
        _read_cluster(found, element, code)
    elif code == "D":
        # A set of directions: the first target, then an element for each other.
        sights = [_dynaml_sight(element, _text(element, "Second"))]
        sights += [_dynaml_sight(child, _text(child, "Target")) for child in element.all("Directions")]
        said = _text(element, "Total") or str(len(sights) - 1)
        put_set(found, _text(element, "First"), sights, said, off=False)
    elif code in SINGLE:
        kind = SINGLE[code]
        names = [_text(element, name) for name in ("First", "Second", "Third")[: len(kind.names)]]
        found.known(names, element.line)
        value, sigma = _needed(element, "Value"), _needed(element, "StdDev")
        if kind.angle:
            value = _sexagesimal(value)
        parse_number(sigma)
        heights = [_text(element, name) or None for name in ("InstHeight", "TargHeight")]
        if kind.heights and None in heights and any(heights):
            raise ValueError("found one of InstHeight and TargHeight, expected both or none")
        cells = [*names, value, sigma, *(heights if kind.heights else [])]
        found.tables.setdefault(code, []).append(Row(cells, element.line))
    else:
        known = ", ".join(sorted(["D", "G", "X", "Y", *SINGLE]))
        raise ValueError(f"found the measurement {code!r}, expected one of {known}")


def _dynaml_sight(element: Element, target: str) -> SetDirection:
    value, sigma = _sexagesimal(_needed(element, "Value")), _needed(element, "StdDev")
    parse_number(sigma)
    return SetDirection(target, value, sigma, element.line, _is_off(element))


def _is_off(element: Element) -> bool:
    return any(child.text.strip() not in ("", "0") for child in element.all("Ignore"))


def _sexagesimal(text: str) -> str:
    """ddd.mmssss… as d-m-s, all its digits kept. Raises ``ValueError``."""
    sexagesimal(text)
    whole, _, fraction = text.lstrip("+-").partition(".")
    fraction = fraction.ljust(4, "0")
    seconds = f"{fraction[2:4]}.{fraction[4:]}".rstrip(".")
    return f"{'-' if text.startswith('-') else ''}{whole or '0'}-{fraction[:2]}-{seconds}"


def _read_cluster(found: Collected, element: Element, code: str) -> None:
    """A baseline, or members of a cluster, each after its names, with the covariances with the members behind it."""
    form = _form_of(code, _text(element, "Coords") or "XYZ")
    rows, members = _members(found, element, code)
    count = len(rows)
    said = _text(element, "Total") if code in "XY" else "1"
    if not 0 < count <= COUNTED or (said and said != str(count)):
        raise ValueError(f"found {count} members of the cluster, expected {said or 'at least one'}")
    Q = np.zeros((3 * count, 3 * count))
    for k, member in enumerate(members):
        _covariances(member, Q, k)
    scales = scales_of([parse_number(_text(element, name) or "1") for name in ("Vscale", "Pscale", "Lscale", "Hscale")])
    if not isfinite(scales[0] * max(scales[1:]) * float(np.abs(Q).max())):
        raise ValueError("found a covariance that is not a finite number after scaling")
    words = f"{_text(element, 'ReferenceFrame')} {_text(element, 'Epoch')}".split()
    frame = frame_among(words, found.frame)
    found.read.append(Cluster(code, form, rows, Q, scales, frame))


def _members(found: Collected, element: Element, code: str) -> tuple[list[Row], list[Element]]:
    """Names and values of each member, and its element; names stand before the member they belong to."""
    rows, members = [], []
    names = {"First": "", "Second": ""}
    for child in element.children:
        if child.name in names:
            names[child.name] = child.text.strip()
        elif child.name in ("GPSBaseline", "Clusterpoint"):
            own = list(names.values())[: 1 if code == "Y" else 2]
            values = [_needed(child, name) for name in "XYZ"]
            for value in values:
                parse_number(value)
            rows.append(Row([*found.known(own, child.line), *values], child.line))
            members.append(child)
    return rows, members


def _covariances(member: Element, Q: FloatArray, k: int) -> None:
    """Covariances of a member, and with those behind it, into the lower triangle."""
    a, count = 3 * k, len(Q) // 3
    for name in ("XX", "XY", "XZ", "YY", "YZ", "ZZ"):
        i, j = sorted("XYZ".index(letter) for letter in name)
        Q[a + j, a + i] = parse_number(_needed(member, f"Sigma{name}"))
    blocks = [child for child in member.children if child.name in ("GPSCovariance", "PointCovariance")]
    if len(blocks) != count - k - 1:
        words = f"found {len(blocks)} blocks of covariances, expected {count - k - 1}"
        raise ValueError(f"member {k + 1} of the cluster (line {member.line}): {words}")
    for other, block in enumerate(blocks, start=k + 1):
        for row in range(3):
            cells = [parse_number(_needed(block, f"m{row + 1}{column}")) for column in (1, 2, 3)]
            Q[3 * other : 3 * other + 3, a + row] = cells


def _text(element: Element, name: str) -> str:
    return next((child.text.strip() for child in element.all(name)), "")


def _needed(element: Element, name: str) -> str:
    text = _text(element, name)
    if not text:
        raise ValueError(f"found no {name} (line {element.line})")
    return text


# ---- DynAdjust's station and measurement files, DNA 3 and DynaML, as a project on the earth.


def read_dynadjust(path: Path) -> Document:
    """The project of a pair of files ``.stn`` and ``.msr``, by one of them or a project. Raises :class:`InputError`."""
    stations, measured = _pair_of_project(path) or [beside(path, end) for end in (".stn", ".msr")]
    draft = Draft(str(measured))
    if path.suffix.lower() == ".dnaproj":
        draft.note(f"only the files that {path.name} names are read, not its options")
    lines = marked_lines(measured, draft)
    values = [text for text in lines[1:] if text[:1] not in ("*", "G", "X", "Y")]
    if values and not any(NUMBER.search(text[VALUES:]) for text in values):
        draft.problem("found measurements without values, a list for simulations; expected the measured values", 2)
        raise InputError(draft.problems)
    found = MeasurementFile(draft, frame_of(lines[0].split()[2:], draft), lines=lines)
    while found.at < len(found.lines):
        line = found.at + 1
        try:
            _measurement(found)
        except ValueError as error:
            draft.problem(str(error), min(found.at + 1, len(found.lines)))
            found.at = max(found.at, line)
            while _goes_on(found, found.at):
                found.at += 1
    if not stations.is_file():
        stations = _stations_of_another(stations, found)
    lines = marked_lines(stations, draft)
    own = frame_of(lines[0].split()[2:], draft, 1, found.frame)
    return _finish(found, stations, stations_of_lines(lines), own, stations.stem)


def _pair_of_project(path: Path) -> list[Path]:
    """Files of stations and measurements that a project file names; none if it is no project file."""
    if path.suffix.lower() != ".dnaproj":
        return []
    rows = [line.split(maxsplit=1) for line in read_lines(path, Draft(str(path)))]
    files = [path.parent / row[1].strip() for row in rows if len(row) == 2 and row[0] == "stn-msr-file"]
    pair = [[file for file in files if file.suffix.lower() == end] for end in (".stn", ".msr")]
    if [len(kind) for kind in pair] != [1, 1]:
        words = f"found {len(files)} files of stations and measurements (stn-msr-file), expected one .stn and one .msr"
        raise InputError([Message(words, str(path))])
    return [kind[0] for kind in pair]


def _stations_of_another(missing: Path, found: Collected) -> Path:
    """The only file of stations in the folder that has all that are measured, else the one that is missing."""
    names = set(found.names) | {str(row.cells[0]) for cluster in found.read for row in cluster.rows}
    there = []
    for file in sorted(missing.parent.iterdir()):
        if file.suffix.lower() == ".stn" and file.is_file():
            known = {text[:20].strip() for text in read_lines(file, Draft(str(file)))[1:]}
            there += [file] if names <= known else []
    if len(there) > 1:
        there = [file for file in there if missing.name.startswith(file.stem)]
    if len(there) != 1:
        return missing
    found.draft.note(
        f"{missing.name} does not exist: stations are taken from {there[0].name}, which has all of them", 1
    )
    return there[0]


def read_dynaml(path: Path) -> Document:
    """The project of a pair of files ``…stn.xml`` and ``…msr.xml``, by one of them. Raises :class:`InputError`."""
    stations, measured, name = pair_of(path)
    draft = Draft(str(measured))
    root = root_of(measured)
    found = Collected(draft, frame_of(_frame_words(root), draft, root.line))
    for element in root.all("DnaMeasurement"):
        with draft.at(element.line):
            read_measurement(found, element)
    root = root_of(stations)
    own = frame_of(_frame_words(root), draft, root.line, found.frame)
    return _finish(found, stations, stations_of_xml(root), own, name)


def _frame_words(root: Element) -> list[str]:
    return " ".join(root.attributes.get(key, "") for key in ("referenceframe", "epoch")).split()


def _finish(found: Collected, file: Path, given: Iterable[StationRecord], frame: Frame, title: str) -> Document:
    """The project; geoid heights and deflections are those of a file ``.geo`` or a grid ``.gsb`` of this name."""
    stations, draft = list(given), found.draft
    found.geoid = read_geoid(beside(file, ".geo", title), draft) or _of_grid(
        file.with_name(title), stations, frame.name, draft
    )
    draft.put("title", title)
    draft.put("units", {"length": "m", "angle": "dms"})
    heights = "orthometric" if found.geoid else "ellipsoidal"
    draft.put("world", {"crs": f"EPSG:{SYSTEMS[frame.name]}", "heights": heights}, 1)
    put_clusters(found, stations, frame)
    put_vectors(found)
    put_directions(found)
    # Put the rows that were read into tables, one for each kind.
    for code, rows in found.tables.items():
        kind = SINGLE[code]
        rows = [_geodetic_row(row, code, stations, frame.name, found) for row in rows] if code in "IJ" else rows
        sigma = f"sigma_{kind.value}" if code in COORDINATES else "sigma"
        columns = [*kind.names, kind.value, sigma]
        columns += ["from_height", "to_height"] if kind.heights else []
        units = {sigma: "arcsec"} if kind.angle else None
        draft.table("observations", columns, rows, type=kind.type, units=units)
    if not draft.data.get("observations") and not draft.problems and not found.read:
        what = ", ".join(f"{what} ({len(lines)})" for what, lines in found.left_out.items())
        words = f"; not read: {what}" if what else ""
        draft.problem(f"there are no supported observations{words}")
    put_stations(file, stations, found, frame.name)
    for what, lines in found.left_out.items():
        draft.note(f"not read: {what} ({len(lines)})", lines[0])
    if not found.geoid:
        draft.note("there is no file .geo or .gsb beside it: the geoid is taken as the ellipsoid", 1)
    return draft.finish()


def _geodetic_row(row: Row, code: str, stations: list[StationRecord], frame: str, found: Collected) -> Row:
    """A geodetic latitude or longitude, φ = Φ − ξ or λ = Λ − η / cos φ, of an astronomic one."""
    name, value, sigma = map(str, row.cells)
    _, xi, eta = found.geoid.get(name, (0.0, 0.0, 0.0))
    try:
        place = next((float(_place(one, frame, 0.0)[0]) for one in stations if one.name == name), 0.0)
    except ValueError:  # put_stations tells it
        place = 0.0
    less = xi if code == "I" else eta / max(float(np.cos(np.radians(place))), 1e-12)
    return Row([name, repr(parse_dms(value) - less / 3600.0), sigma], row.line)


def _of_grid(
    name: Path, stations: list[StationRecord], frame: str, draft: Draft
) -> dict[str, tuple[float, float, float]]:
    """N, ξ, η of the stations out of the only grid .gsb whose name begins like the files'."""
    grids = [
        file for file in name.parent.iterdir() if file.suffix.lower() == ".gsb" and file.name.startswith(name.name)
    ]
    if len(grids) != 1:
        return {}
    found = {}
    for station in stations:
        try:
            found[station.name] = np.radians(list(map(float, _place(station, frame, 0.0)[:2])))
        except ValueError:  # put_stations tells it
            continue
    try:
        values = values_at(grids[0], np.array(list(found.values())).reshape(-1, 2)) / [1.0, ARCSEC, ARCSEC]
    except GridError as error:
        draft.problem(str(error), file=str(grids[0]))
        return {}
    draft.note(f"geoid heights and deflections are those of {grids[0].name}", 1)
    known = zip(found, values.tolist(), strict=True)
    return {station: (N, xi, eta) for station, (N, xi, eta) in known if isfinite(N)}


def _measurement(found: MeasurementFile) -> None:
    text = found.lines[found.at]
    code = text[:1]
    if code == "*" or not text.strip():
        found.at += 1
        return
    if not code.strip():
        raise ValueError("values without a measurement before them")
    if code in "GXY":
        read_cluster(found, code)
        return
    if code == "D":
        read_directions(found)
    elif code in SINGLE:
        read_line(found, code)
    else:
        known = ", ".join(sorted(["D", "G", "X", "Y", *SINGLE]))
        raise ValueError(f"found the measurement {code!r}, expected one of {known}")
    found.at += 1
