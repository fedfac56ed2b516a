"""Data files: what the commands say of the observations that follow, and the observations themselves."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.errors import nearest
from mor.formats.draft import Draft, Row
from mor.formats.snap.errors import Error, VectorError, error_of, vector_error_of
from mor.formats.snap.lines import Words, angle, lines_of
from mor.formats.snap.projections import projection_of
from mor.formats.snap.stations import Stations
from mor.formats.snap.vectors import NUMBERS, Member, Set, put_sets, put_singles, set_of


class Kind(NamedTuple):
    """A kind of data: its type in a project and the column of its value."""

    type: str
    value: str
    angular: str = ""
    """``line`` or, with a hemisphere, the letters of both."""
    default: str = ""
    """The command that says its error."""
    point: bool = False


KINDS = {
    "HA": Kind("directions", "horizontal", "line", "ha"),
    "AZ": Kind("azimuth", "azimuth", "line", "az"),
    "SD": Kind("distance", "distance", default="ds"),
    "ED": Kind("ellipsoid_arc", "distance", default="ds"),
    "MD": Kind("mean_sea_level_distance", "distance", default="ds"),
    "HD": Kind("height_reduced_distance", "distance", default="ds"),
    "DR": Kind("distance", "distance", default="ds"),
    "ZD": Kind("zenith_angle", "zenith_angle", "line", "zd"),
    "LV": Kind("height_difference", "dz", default="lv"),
    "LT": Kind("geodetic_position", "latitude", "NS", "lt", point=True),
    "LN": Kind("geodetic_position", "longitude", "EW", "ln", point=True),
    "OH": Kind("orthometric_height", "height", default="oh", point=True),
    "EH": Kind("ellipsoidal_height", "height", default="eh", point=True),
    "PB": Kind("projected_bearing", "bearing", "line", "az"),
    "GB": Kind("gnss_vector", ""),
    "GX": Kind("gnss_position", "", point=True),
}
"""By SNAP's letters."""
_ALSO = {"GPS": "GB"}
_SETS = ("HA", "DR")
_HEIGHTS = ("distance", "zenith_angle", "height_difference")
_RAISED = ("orthometric_height", "ellipsoidal_height")
_FIELDS = ("value", "error", "id", "date", "time")
_CODES = ("distance_scale_error", "refraction_coefficient", "bearing_orientation_error")
_COMMENTS = ("date", "time", "note", "classify", "bearing_orientation_error")
DEFAULT = "DEFAULT"


class Item(NamedTuple):
    """One observation of a line: its kind and what stands there of it, in this order."""

    code: str
    fields: tuple[str, ...]


@dataclass
class Data:
    """Content of all data files, and the state set by commands of the current one."""

    draft: Draft
    stations: Stations
    names: dict[str, tuple[int, str]] = field(default_factory=dict)
    """Stations that are observed, with the line and the file that names them first."""
    tables: dict[tuple[str, str, str], list[Row]] = field(default_factory=dict)
    """Rows by letters, instrument and file."""
    singles: dict[tuple[str, str], list[Set]] = field(default_factory=dict)
    """Vectors and positions that are in no set, by letters and file."""
    matrices: dict[tuple[str, str], list[Set]] = field(default_factory=dict)
    """Sets with a matrix, by letters and file."""
    left_out: dict[str, tuple[int, int, str]] = field(default_factory=dict)
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
    items: list[Item] = field(default_factory=list)
    grouped: bool = False
    heights: bool = True
    header: tuple[str, float] | None = None
    members: list[Member] = field(default_factory=list)
    covariances: list[float] | None = None
    """Numbers behind #end_set; ``None`` before it."""

    def skip(self, what: str) -> None:
        """Something of this line is left out."""
        count, line, file = self.left_out.get(what, (0, self.line, str(self.path)))
        self.left_out[what] = (count + 1, line, file)

    def station(self, name: str) -> str:
        """The station as its file spells it. Raises ``ValueError``."""
        known = {known.upper(): known for known in self.stations.by_name}
        if name.upper() not in known:
            similar = nearest(name, self.stations.by_name)
            raise ValueError(f"station {name!r} is not in {self.stations.path.name}{similar}")
        self.names.setdefault(known[name.upper()], (self.line, str(self.path)))
        return known[name.upper()]

    def length(self, names: list[str]) -> tuple[float, float]:
        """Slope distance and its level part between two stations by their coordinates."""
        ends = self.stations.geocentric(names)
        east, north, up = self.stations.axes(names[:1]) @ (ends[1] - ends[0])
        return float(np.linalg.norm([east, north, up])), float(np.hypot(east, north))


def read_data(path: Path, data: Data) -> None:
    """Read one data file. Mistakes are told in the draft."""
    data.path, data.form, data.vector_form, data.refraction = path, "dms", "full", DEFAULT
    data.errors, data.vector_errors, data.classes, data.items = {}, {}, set(), []
    data.header, data.members, data.covariances, data.projection = None, [], None, ""
    for number, line in enumerate(lines_of(path, data.draft)):
        data.line = line.number
        try:
            if number == 0:
                continue  # the title
            if not line.words:
                data.header = None
            elif line.words[0].startswith("#"):
                words = [line.words[0][1:], *line.words[1:]]
                _command(data, Words(words if words[0] else words[1:]))
            elif data.covariances is not None:
                numbers = Words(line.words)
                while numbers:
                    data.covariances.append(numbers.number("a covariance"))
            else:
                _observations(data, Words(line.words))
        except ValueError as error:
            data.draft.problem(str(error), line.number, str(path))
    _end_of_set(data)


def _command(data: Data, words: Words) -> None:
    name = words.take("a command").lower()
    if name == "end_set":
        data.covariances = []
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
    elif name in ("gps_enu_error", "gx_enu_error"):
        data.vector_errors["GB" if name[1] == "p" else "GX"] = vector_error_of(words)
    elif name == "refraction_coefficient":
        data.refraction = words.take("a code").upper()
    elif name == "projection":
        data.projection = projection_of(words.take("the name of a projection"))
    elif name == "reference_frame":
        data.skip(f"reference frame {words.take('a code')}: vectors are taken in the frame of the stations")
    elif name.endswith("_error") and name[:-6] in {kind.default for kind in KINDS.values()}:
        data.errors[name[:-6]] = error_of(words)
    elif name not in _COMMENTS:
        raise ValueError(f"command #{name} is not followed")


def _data(data: Data, words: Words) -> None:
    """``#data sd error ha no_heights``: what stands on the lines that follow."""
    items: list[tuple[str, list[str]]] = []
    data.grouped, data.heights, data.header = False, True, None
    while words:
        word = words.take("a data type")
        code = _ALSO.get(word.upper(), word.upper())
        if word.lower() in ("grouped", "no_heights"):
            data.grouped |= word.lower() == "grouped"
            data.heights &= word.lower() != "no_heights"
        elif code in KINDS:
            items.append((code, []))
        elif word.lower() == "classification" and items:
            items[-1][1].append(words.take("the name of a classification").lower())
        elif items and word.lower() in (*_FIELDS, *_CODES, *data.classes):
            items[-1][1].append(word.lower())
        else:
            raise ValueError(f"found {word!r}, expected a data type ({', '.join(KINDS)}) or one of its items")
    if not items:
        raise ValueError("found no data type behind #data")
    data.items = [Item(code, tuple(f if "value" in f else ["value", *f])) for code, f in items]
    if len({KINDS[item.code].point for item in data.items}) > 1:
        data.items = []
        raise ValueError("data of points and of lines are mixed")
    data.grouped |= any(item.code in _SETS for item in data.items)


def _observations(data: Data, words: Words) -> None:
    """A line: its stations and what was observed."""
    if not data.items:
        raise ValueError("observations before a #data command that says what they are")
    rejected = words.skip("*")
    first = (data.station(words.take("a station")), _height(data, words))
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
        ends.append((data.station(words.take("a station")), _height(data, words)))
    if len({name for name, _ in ends}) < len(ends):
        raise ValueError(f"both ends are {ends[0][0]!r}")
    for item in data.items:
        if not words.skip("-"):
            _item(data, item, ends, words, rejected)
    if words:
        raise ValueError(f"found {words.peek()!r} behind the observations")


def _height(data: Data, words: Words) -> float:
    return words.number("a height above the station") if data.heights and words else 0.0


def _item(data: Data, item: Item, ends: list[tuple[str, float]], words: Words, rejected: bool) -> None:
    kind = KINDS[item.code]
    vector = item.code in ("GB", "GX")
    value: float | list[float] = 0.0
    sigma: list[float] | None = None
    refraction = data.refraction
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
            words.take(entry)
    if vector:
        found = Member([name for name, _ in ends], [h for _, h in ends], value, sigma, rejected, data.line)  # type: ignore[arg-type]
        data.members.append(found)
        if rejected:
            data.skip("rejected observations (*)")
        if not data.grouped:
            _end_of_set(data)
        return
    assert isinstance(value, float)
    _scalar(data, item.code, ends, value, sigma, rejected, refraction)


def _value(data: Data, kind: Kind, words: Words) -> float:
    if not kind.angular:
        return words.number("a value")
    return angle(words, data.form, "" if kind.angular == "line" else kind.angular)


def _scalar(
    data: Data,
    code: str,
    ends: list[tuple[str, float]],
    value: float,
    sigma: list[float] | None,
    rejected: bool,
    refraction: str,
) -> None:
    kind = KINDS[code]
    names = [name for name, _ in ends]
    if rejected:
        data.skip("rejected observations (*)")
        return
    error = _sigma(data, kind, names, value, sigma)
    if error <= 0.0:
        raise ValueError(f"found the error {error:g}, expected one above 0")
    if kind.type in _RAISED:
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
    data.tables.setdefault((code, instrument, str(data.path)), []).append(Row(cells, data.line))


def _sigma(data: Data, kind: Kind, names: list[str], value: float, sigma: list[float] | None) -> float:
    """σ in metres or arc seconds."""
    if sigma is not None:
        return sigma[0] * (3600.0 if kind.angular and data.form == "deg" else 1.0)
    if kind.default not in data.errors:
        raise ValueError(f"nothing says the error: #{kind.default}_error, or error in #data")
    error = data.errors[kind.default]
    if not kind.angular:
        return error.of_length(value if kind.value == "distance" else 0.0)
    return error.of_angle(*data.length(names)) if len(names) > 1 else error.seconds


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
    if found is not None and data.grouped:
        data.matrices.setdefault((code, str(data.path)), []).append(found)
    elif found is not None:
        data.singles.setdefault((code, str(data.path)), []).append(found)


def put_observations(data: Data) -> None:
    """Put the rows that were read into tables."""
    for (_, file), sets in data.matrices.items():
        put_sets(data.draft, sets, file)
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
