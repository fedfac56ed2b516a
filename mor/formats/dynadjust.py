"""DynAdjust's station and measurement files (DNA 3) as a project in geocentric coordinates: what is Cartesian in them.

GNSS baselines (G, X) and positions (Y in X, Y, Z) with their covariances, slope distances between marks (S without
heights). All else refers to the ellipsoid or the geoid and is left out by name. Source: *DynAdjust User's Guide*,
appendix on DNA file formats: columns of 20 characters for names, values behind column 62.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mor.arrays import FloatArray
from mor.counting import counted
from mor.errors import InputError, Problem
from mor.formats.draft import Draft, Row, number
from mor.formats.fieldbook.book import sexagesimal
from mor.formats.text import read_lines
from mor.formats.wgs84 import geocentric
from mor.project.file.nodes import Document

_MARK = "!#=DNA"
_NAMES = (slice(2, 22), slice(22, 42), slice(42, 62))
_VALUES = 62
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_COUNTED = 10_000
"""Most baselines or positions of one cluster: its covariance matrix is full."""
_OFF = "measurements that are switched off (*)"
_VECTOR = ("dx", "dy", "dz")
_PAIRS = (("dx", "dx"), ("dx", "dy"), ("dx", "dz"), ("dy", "dy"), ("dy", "dz"), ("dz", "dz"))
_KINDS = {
    "A": "horizontal angles",
    "B": "geodetic azimuths",
    "C": "ellipsoid chords",
    "D": "sets of directions",
    "E": "ellipsoid arcs",
    "H": "orthometric heights",
    "I": "astronomic latitudes",
    "J": "astronomic longitudes",
    "K": "astronomic azimuths",
    "L": "levelled height differences",
    "M": "mean sea level arcs",
    "P": "geodetic latitudes",
    "Q": "geodetic longitudes",
    "R": "ellipsoidal heights",
    "S": "slope distances with heights",
    "V": "zenith distances",
    "Y": "positions in latitude, longitude, height",
    "Z": "vertical angles",
}
"""What refers to the ellipsoid or to the plumb line, in DynAdjust's letters."""


@dataclass
class _Measurements:
    """Lines of a measurement file, and what is read of them."""

    lines: list[str]
    draft: Draft
    at: int = 1
    names: dict[str, int] = field(default_factory=dict)
    """Stations with the line that names them first."""
    left_out: dict[str, list[int]] = field(default_factory=dict)
    frames: dict[str, int] = field(default_factory=dict)
    distances: list[Row] = field(default_factory=list)
    baselines: list[Row] = field(default_factory=list)
    """Those that are in no cluster, with their covariances."""

    def skip(self, what: str) -> None:
        self.left_out.setdefault(what, []).append(self.at)

    def numbers(self) -> list[float]:
        """Numbers of the next line. Raises ``ValueError`` where it has none."""
        text = self.lines[self.at] if self.at < len(self.lines) else ""
        if text[:1].strip():
            raise ValueError("the measurement is not complete: expected its values and covariances")
        self.at += 1
        return [number(word) for word in _NUMBER.findall(text[_VALUES:])]


def read_dynadjust(path: Path) -> Document:
    """The project of a pair of files ``.stn`` and ``.msr``, by one of them. Raises :class:`InputError`."""
    stations, measured = (_beside(path, end) for end in (".stn", ".msr"))
    draft = Draft(str(measured))
    found = _Measurements(_lines(measured, draft), draft)
    draft.put("title", path.stem)
    draft.put("units", {"length": "m", "angle": "deg"})
    while found.at < len(found.lines):
        line = found.at + 1
        try:
            _measurement(found)
        except ValueError as error:
            draft.problem(str(error), min(found.at + 1, len(found.lines)))
            found.at = max(found.at, line)
    if found.baselines:
        columns = ("from", "to", *_VECTOR, *(f"cov_{a}_{b}" for a, b in _PAIRS))
        draft.table("observations", columns, found.baselines, type="vector")
    if found.distances:
        draft.table("observations", ("from", "to", "distance", "sigma"), found.distances, type="distance")
    if not draft.data.get("observations"):
        draft.problem("there are no observations that need neither ellipsoid nor geoid")
    _put_stations(stations, found, draft)
    _tell(found, draft)
    return draft.finish()


def _beside(path: Path, end: str) -> Path:
    """The file of a pair, in the case of letters that is there."""
    places = [path.with_suffix(end), path.with_suffix(end.upper())]
    return next((place for place in places if place.is_file()), places[0])


def _lines(path: Path, draft: Draft) -> list[str]:
    if not path.is_file():
        raise InputError(
            [Problem("this file does not exist; DynAdjust has a pair of .stn and .msr", str(path))]
        )
    lines = read_lines(path, draft)
    words = (lines[0] if lines else "").split()
    if not lines or not lines[0].startswith(_MARK) or len(words) < 2 or words[1].split(".")[0] != "3":
        said = lines[0][:30] if lines else ""
        raise InputError([Problem(f"found {said!r}, expected {_MARK} 3 in the first line", str(path), 1)])
    return lines


def _measurement(found: _Measurements) -> None:
    text = found.lines[found.at]
    code = text[:1]
    if code == "*" or not text.strip():
        found.at += 1
        return
    if not code.strip():
        raise ValueError("values without a measurement before them")
    first = text[_NAMES[1]].strip().upper()
    if code in "GX" or (code == "Y" and first == "XYZ"):
        _cluster(found, code)
        return
    if code == "S" and len(_NUMBER.findall(text[_VALUES:])) == 2:
        _distance(found, text)
    elif code in _KINDS:
        found.skip(_KINDS[code])
    else:
        raise ValueError(f"found the measurement {code!r}, expected one of G, X, Y, {', '.join(_KINDS)}")
    found.at += 1
    while (
        found.at < len(found.lines)
        and not found.lines[found.at][:1].strip()
        and found.lines[found.at].strip()
    ):
        found.at += 1


def _distance(found: _Measurements, text: str) -> None:
    ends = _stations_of(text, 2, found)
    value, sigma = _NUMBER.findall(text[_VALUES:])
    if text[1:2] == "*":
        found.skip(_OFF)
    else:
        found.distances.append(Row([*ends, value, sigma], found.at + 1))


def _stations_of(text: str, count: int, found: _Measurements) -> list[str]:
    names = [text[place].strip() for place in _NAMES[:count]]
    if not all(names) or len(set(names)) < count:
        raise ValueError(
            f"found the stations {', '.join(map(repr, names))}, expected {count} different names"
        )
    for name in names:
        found.names.setdefault(name, found.at + 1)
    return names


def _cluster(found: _Measurements, code: str) -> None:
    """A baseline, or a cluster of baselines or positions with one covariance matrix."""
    first, text = found.at + 1, found.lines[found.at]
    off = text[1:2] == "*"
    count = 1
    if code in "XY":
        word = text[_NAMES[2]].strip()
        if not word.isdecimal() or not 0 < int(word) <= _COUNTED:
            raise ValueError(f"found {word!r}, expected the number of members of the cluster")
        count = int(word)
    factor = _factor(text)
    rows: list[Row] = []
    Q = np.zeros((3 * count, 3 * count))
    for k in range(count):
        text = found.lines[found.at] if found.at < len(found.lines) else ""
        if text[:1] != code:
            raise ValueError(
                f"expected {count} members of the cluster that begins in line {first}, found {k}"
            )
        names, line = _stations_of(text, 2 if code in "GX" else 1, found), found.at + 1
        found.at += 1
        rows.append(Row([*names, *_values(found, Q, k, count - k - 1)], line))
    if off:
        found.skip(_OFF)
        return
    words = found.lines[first - 1][_VALUES:].split()
    found.frames.setdefault(" ".join(words[4:6]), first)
    _put_cluster(found, code, rows, (np.tril(Q) + np.tril(Q, -1).T) * factor)


def _values(found: _Measurements, Q: FloatArray, k: int, behind: int) -> list[str]:
    """Three values; their covariances, and those with the members behind, go into the lower triangle of a matrix."""
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
    return values


def _factor(text: str) -> float:
    """Scale of a covariance matrix. Raises ``ValueError`` for scales in latitude, longitude, height."""
    scales = [number(word) for word in _NUMBER.findall(text[_VALUES : _VALUES + 40])]
    if len(scales) != 4 or min(scales) <= 0.0:
        raise ValueError(f"found {text[_VALUES : _VALUES + 40].strip()!r}, expected four scales above 0")
    if any(scale != 1.0 for scale in scales[1:]):
        raise ValueError("scales of the covariances in latitude, longitude and height are not followed")
    return scales[0]


def _put_cluster(found: _Measurements, code: str, rows: list[Row], Q: FloatArray) -> None:
    if np.linalg.eigvalsh(Q)[0] <= 0.0:
        found.draft.problem("the covariance matrix is not positive definite", rows[0].line)
        return
    if code == "G":
        covariances = [repr(float(Q[_VECTOR.index(a), _VECTOR.index(b)])) for a, b in _PAIRS]
        found.baselines.append(Row([*rows[0].cells, *covariances], rows[0].line))
        return
    names = ("from", "to", *_VECTOR) if code == "X" else ("point", "x", "y", "z")
    type_ = "vector" if code == "X" else "coordinates"
    found.draft.table("observations", names, rows, type=type_, covariance=Q.tolist())


def _put_stations(path: Path, found: _Measurements, draft: Draft) -> None:
    """Stations that take part: latitude and longitude as start values; coordinates of held ones where Cartesian."""
    rows: dict[bool, list[Row]] = {True: [], False: []}
    known: set[str] = set()
    for line, text in enumerate(_lines(path, draft)[1:], start=2):
        name, held, kind = text[:20].strip(), text[20:23].upper(), text[24:27].upper()
        if text[:1] == "*" or not text.strip() or name not in found.names:
            known.add(name)
            continue
        if name in known:
            draft.problem(f"station {name!r} is there twice", line, str(path))
            continue
        known.add(name)
        try:
            place = _place(text, kind)
        except ValueError as error:
            draft.problem(f"station {name!r}: {error}", line, str(path))
            continue
        if held not in ("FFF", "CCC") or (held == "CCC" and kind != "XYZ"):
            words = f"{held} in {kind} needs the ellipsoid and the geoid; only X, Y, Z can be held"
            draft.problem(f"station {name!r}: {words}", line, str(path))
            continue
        rows[held == "CCC"].append(Row([name, *place], line))
    for name, line in found.names.items():
        if name not in known:
            draft.problem(f"station {name!r} is not in {path.name}", line)
    for fixed, chosen in rows.items():
        if chosen:
            axes = ["x", "y", "z"] if fixed else []
            draft.table("points", ("id", "x", "y", "z"), chosen, str(path), fixed=axes)


def _place(text: str, kind: str) -> list[str | None]:
    """Geocentric coordinates; none where a projection is between."""
    if kind not in ("XYZ", "LLH"):
        return [None] * 3
    words = [text[place].strip() for place in (slice(28, 48), slice(48, 68), slice(68, 88))]
    if kind == "XYZ":
        return [repr(number(word)) for word in words]
    latitude, longitude = (sexagesimal(word) for word in words[:2])
    if abs(latitude) > 90.0:
        raise ValueError(f"found the latitude {latitude:g}, expected it between -90 and 90")
    place = geocentric(np.array([[latitude, longitude, number(words[2])]]))[0]
    return [repr(float(v)) for v in place]


def _tell(found: _Measurements, draft: Draft) -> None:
    for what, lines in found.left_out.items():
        draft.note(
            f"not read: {what} ({len(lines)}); they need the ellipsoid or the plumb line", lines[0] + 1
        )
    frames = [name for name in found.frames if name]
    if len(frames) > 1:
        words = f"measurements in {counted(len(frames), 'frame and epoch', 'frames and epochs')} ({', '.join(frames)})"
        draft.note(f"{words} are taken as they are, without transformations", found.frames[frames[1]])
    draft.note("x, y, z are geocentric: what the reports call east, north, up are these axes")
