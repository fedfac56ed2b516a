"""Recognise tables by their columns, and begin a project file from them."""

from __future__ import annotations

import csv
import io
import math
import os
import re
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from importlib.resources import files
from itertools import combinations, pairwise, product, takewhile, zip_longest
from math import isclose
from pathlib import Path
from statistics import median
from types import SimpleNamespace
from typing import Any, NamedTuple

import yaml

from mor.errors import InputError, Message, counted
from mor.input_files import CODE_PAGES, TABLE, as_utf8, decoded, not_utf8, read_bytes
from mor.project.document import LONGEST, guarded, plain
from mor.project.levelling import ALONE, SAME_HEIGHT, Levelling, StaffReading
from mor.project.tables import is_spreadsheet, read_sheets, sheet_rows
from mor.units import ANGLE_UNITS, LENGTH_UNITS, PIXEL

# ---- Recognise tables of measurements and coordinates by the names of their columns, to begin a project from them.

_LISTED = yaml.safe_load(files("mor.project").joinpath("column_names.yaml").read_text(encoding="utf-8"))
_N = SimpleNamespace(**{meaning: "|".join(names.split()) for meaning, names in _LISTED.items()})
"""Names of columns in many languages by their meaning, each list joined by bars."""
_HEIGHTS = {"from_height": _N.from_height, "to_height": _N.to_height}
_SIGHT = {
    "station_height": f"fromheight|{_N.from_height}",
    "to_height": _N.to_height,
    "set": "set|satz|setid|setno|setnr|round|series|obsset|测回",
    "face": "face|facenr|faceno|lage|kreislage",
    "epoch": "epoch|epoche",
}


def _precisions(names: str) -> str:
    pairs = product(names.split("|"), ("sigma", "sig", "std", "stdev", "stddev", "sd", "err", "error"))
    both = [text for name, word in pairs for text in (f"{word}{name}", f"{name}{word}")]
    return "|".join([*both, *(f"s{name}" for name in names.split("|"))])


_BETWEEN = {**_HEIGHTS, "sigma": _N.standard_deviation, "epoch": "epoch|epoche"}
_BEARING_DISTANCE = f"{_N.plan_distance}|distance|length|dist|strecke|distancia|distanza|kenar|d|边长|距离"
"""Names of the distance beside a bearing, which is horizontal: no zenith angle reduces it."""
_ELEVATIONS = {"zenith_directions": ("directions", "vertical"), "zenith_angle": ("vertical_direction",) * 2}
"""Kind and column of vertical circles that read elevations, whose columns have the same names."""
_POINTS = {"x": _N.x, "y": _N.y, "z": _N.z}
_AXES = {"x": "xe", "y": "yn", "z": "zhu"}
_STATED = {
    f"sigma_{ours}": "|".join(f"{word}{name}" for name in names for word in ("s", "std", "stdev", "sd", "sigma"))
    for ours, names in _AXES.items()
} | {"sigma": "std|stdev|accuracy"}
_COVARIANCES = {
    f"cov_d{a}_d{b}": "|".join(
        form.format(one, other)
        for one, other in product(_AXES[a], _AXES[b])
        for form in ("c{}{}", "cov{}{}", "q{}{}", "covd{}d{}")
    )
    for a, b in ("xx", "xy", "xz", "yy", "yz", "zz")
}
_VECTOR = {f"d{ours}": "|".join(f"d{a}|delta{a}" for a in names) for ours, names in _AXES.items()}

_ENDS = {
    "from": "from|von|fra|start|pointa|frompoint|fromstation|fromstn|desde|da|od",
    "to": "to|nach|til|end|pointb|topoint|tostation|tostn|hasta|a|do",
}
"""Names of both ends of a line, which no list of points has."""
_NAMED = re.sub(r"\b(number|numero|no|nr|num|pointno|punktnr|foresight)\|", "", f"{_N.point}|{_N.to}")
"""Names of points with a staff, without those that may be numbers of rows or readings."""
_MIDDLE = tuple(f"{one}{hair}" for one in ("middle", "mid", "centre", "center") for hair in ("hair", "wire", ""))
"""Names of the hair that is the reading, behind the name of the reading."""
_STAFF_HEIGHTS = ("height", "hgt")
"""Names of the height at which a staff is read, behind the name of the reading."""
_CODES = {
    **dict.fromkeys(["b", "bs", "back", "backsight", "rueckblick", "r", "ab"], "back"),
    **dict.fromkeys(["f", "fs", "fore", "foresight", "vorblick", "v", "vb"], "fore"),
    **dict.fromkeys(["i", "is", "intermediate", "zwischenblick", "z", "zs"], "between"),
}
"""Codes of staff readings in a column of their own; others are those of results."""
_STAFF_DISTANCES = {"back_distance": _N.back_distance, "fore_distance": _N.fore_distance}


def _joined(names: str, *ends: object) -> str:
    return "|".join(f"{name}{end}" for name in names.split("|") for end in ends)


_SECOND = {"back2": _joined(_N.back, 2), "fore2": _joined(_N.fore, 2)}
"""Readings of a second instrument on the same points."""

KINDS: Mapping[str, tuple[Mapping[str, str], Mapping[str, str]]] = {
    "image": (
        {
            "image": f"{_N.image}|img|filename|picture|imagefile|photoname",
            "point": f"{_N.point}|id|target",
            "x": "x|u|col|column|px|pixelx|spalte|imx|imagex|ximage|xpixel",
            "y": "y|v|row|line|py|pixely|zeile|imy|imagey|yimage|ypixel",
        },
        {"sigma": "", "sigma_x": "sx", "sigma_y": "sy"},
    ),
    "zenith_directions": (
        {"station": _N.from_, "to": f"{_N.to}|{_N.point}|id", "horizontal": f"{_N.horizontal}|r", "zenith": _N.zenith},
        {
            **_SIGHT,
            "sigma_horizontal": _precisions("hz|ha|dir|direc|direction|horizontal"),
            "sigma_zenith": _precisions("v|zenith|zd"),
            "sigma": "",
        },
    ),
    "directions": (
        {"station": _N.from_, "to": f"{_N.to}|{_N.point}|id", "horizontal": f"{_N.horizontal}|r"},
        {**_SIGHT, "sigma": f"{_precisions('dir|direc|direction|hz|ha')}|{_N.standard_deviation}|md"},
    ),
    "angle": (
        {
            "at": "at|basepoint|station|vertex|occupied|occ|instrument|atpoint|atstation",
            "from": "from|von|backsight|bs|frompoint|fromstation|firstpoint",
            "to": "to|nach|foresight|fs|topoint|tostation|secondpoint",
            "angle": "angle|ang|winkel|angleright|horizontalangle",
        },
        {**_BETWEEN, "at_height": "ih|hi", "sigma": f"{_precisions('angle')}|{_N.standard_deviation}"},
    ),
    "levelling between points": (
        {
            "from": f"{_N.from_}|bspoint|backpoint|backsightstation",
            "to": "to|nach|fspoint|forepoint|foresightstation|foresightpoint",
            "back": _N.back,
            "fore": _N.fore,
        },
        {**_STAFF_DISTANCES, "distance": _N.length},
    ),
    "levelling": (
        {
            "point": f"{_NAMED}|{_N.from_}|{_N.point}|id|remarks|remark|bemerkung",
            "back": _joined(_N.back, *_MIDDLE, "", 1, *_STAFF_HEIGHTS),
            "fore": _joined(_N.fore, *_MIDDLE, "", 1, *_STAFF_HEIGHTS),
        },
        {
            **_SECOND,
            "between": _joined(_N.between, "", *_MIDDLE, *_STAFF_HEIGHTS),
            "distance": _N.length,
            **_STAFF_DISTANCES,
            "height": _POINTS["z"],
        },
    ),
    "levelling by codes": (
        {
            "point": f"{_NAMED}|{_N.point}|id",
            "reading": "height|hoogte|hoehe|reading|staffreading",
            "code": "meastype|measurementtype|meettype|messtyp|messart",
        },
        {"distance": f"{_N.length}|distantie|distanz", "height": "elevation|elevatie|elev|hoehenwert|rl"},
    ),
    "vector": (
        {"from": _N.from_, "to": _N.to, **_VECTOR},
        {
            **_BETWEEN,
            **_COVARIANCES,
            **{f"sigma_d{axis}": f"sd{axis}|md{axis}|{_STATED[f'sigma_{axis}']}" for axis in _AXES},
        },
    ),
    "zenith_angle": ({"from": _N.from_, "to": f"{_N.to}|{_N.point}", "zenith_angle": _N.zenith}, _BETWEEN),
    "bearing": ({"from": _N.from_, "to": _N.to, "bearing": _N.bearing}, _BETWEEN),
    "traverse by legs": (
        {
            "leg": "leg|line|side|fromto|lineid|linename|strecke|seite|vonnach|lado|linea|tramo|alineacion|cote|lato",
            "bearing": _N.bearing,
            "distance": _BEARING_DISTANCE,
        },
        {},
    ),
    "traverse": (
        {"point": f"{_N.from_}|{_N.point}|id|corner", "bearing": _N.bearing, "distance": _BEARING_DISTANCE},
        {},
    ),
    "traverse by angles": (
        {
            "point": f"{_N.from_}|{_N.point}|id|corner",
            "angle": "angle|angles|observedangle|observedangles|interiorangle|interiorangles|includedangle|hzangle"
            "|innenwinkel|brechungswinkel|角|角度|转折角|观测角|内角|左角|anguloobservado|angulointerno|angulointerior",
            "distance": _BEARING_DISTANCE,
        },
        {},
    ),
    "vertical_direction": ({"from": _N.from_, "to": _N.to, "vertical_direction": ""}, _BETWEEN),
    "distance": (
        {"from": _N.from_, "to": f"{_N.to}|{_N.point}", "distance": f"{_N.distance}|s"},
        {**_BETWEEN, "sigma": f"{_precisions('distance|dist')}|sderror|{_N.standard_deviation}|ms"},
    ),
    "height_difference": (
        {
            "from": _N.from_,
            "to": _N.to,
            "dz": "dz|dh|lv|lvvalue|高差|deltah|deltaz|heightdifference|heightdiff|hdiff|hoehenunterschied|denivelee"
            "|desnivel|dislivello|przewyzszenie|roznicawysokosci|yuekseklikfarki|kotfarki|превышение|bedatinggi",
        },
        {
            "sigma": f"{_precisions('dz|dh|hdiff|lv')}|calcerr|{_N.standard_deviation}",
            "length": f"km|lengthkm|skm|l|{_N.length}",
            "epoch": "epoch|epoche",
        },
    ),
    "horizontal_distance": (
        {"from": _N.from_, "to": f"{_N.to}|{_N.point}", "distance": _BEARING_DISTANCE},
        {**_BETWEEN, "sigma": f"{_precisions('distance|dist')}|{_N.standard_deviation}"},
    ),
    "observations by type": (
        {
            "type": "type|kind|obstype|observationtype|measurementtype|typ|art|messart|tipo|obs",
            "value": "value|wert|obs|observed|observation|measurement|reading|messwert|valor|valeur|valore",
        },
        {"unit": "units|einheit|unidad|unite"},
    ),
    "images": (
        {"id": f"id|{_N.image}|name|label|filename", "omega": "", "phi": "", "kappa": ""},
        {**_POINTS, **_STATED, "camera": "kamera"},
    ),
    "images with a camera": ({"id": "id|image|photo|bild|foto", "camera": "kamera"}, {**_POINTS, **_STATED}),
    "stations": ({"id": f"id|{_N.from_}", "orientation": "orientierung"}, {"point": _N.point, "height": "ih|hi"}),
    "stations over points": ({"id": "id|station", "point": _N.point, "height": "ih|hi"}, {"set": ""}),
    "points": ({"id": f"id|{_N.point}|nn|station|target|p", **_POINTS}, _STATED),
    "vector by coordinates": (
        {**_ENDS, **{f"d{axis}": names for axis, names in _POINTS.items()}},
        {f"sigma_d{axis}": _precisions(names) for axis, names in _POINTS.items()},
    ),
    "height_difference by heights": (
        {**_ENDS, "dz": "height|elevation|h"},
        {"sigma": f"{_precisions('height|elevation|h')}|{_N.standard_deviation}", "length": f"km|{_N.length}"},
    ),
    "images with positions": ({"id": _N.image, **_POINTS}, _STATED),
    "points in the plane": (
        {"id": f"id|{_N.point}|nn|station|target|p", "x": _POINTS["x"], "y": _POINTS["y"]},
        _STATED,
    ),
    "points with heights": (
        {"id": f"id|{_N.point}|nn", "z": _POINTS["z"]},
        {"sigma_z": _STATED["sigma_z"], "sigma": _STATED["sigma"]},
    ),
}
"""Columns that a kind of table must have, and those that it may have, with other names for each.

The first kind whose columns are all there is taken. Names are compared in lower case without blanks and signs.
"""
_KNOWN = {re.sub(r"[\W_]", "", ours) for columns in KINDS.values() for part in columns for ours in part} | {
    name for columns in KINDS.values() for part in columns for names in part.values() for name in names.split("|")
}
"""All names of columns."""
_ANOTHER = re.compile(r"\s*(?:\(.*\)|\[.*\]|/(?!\s*(?:lon|lat)).*|;.*)$", re.IGNORECASE)
"""A second name behind the first one of a column: Northing (Y), X/East; not X/Longitude."""
_WITH_UNIT = re.compile(r"(.*?)[\s_]*(?:\[([^\]]*)\]|\(([^)]*)\)|[\s_]in[\s_]([A-Za-zµ]+)|_([A-Za-zµ]+))")
_GEOGRAPHIC = re.compile(r".*latitude|lat|.*longitude|lon|lng|long")
_LINES = ("distance", "horizontal_distance")
"""Kinds of distances: one is computed from the other where a table has both."""
_ALSO = {
    "image": ("points",),
    "zenith_directions": _LINES,
    "directions": (*_LINES, "height_difference"),
    "zenith_angle": _LINES,
    "bearing": ("horizontal_distance", "distance"),
    "distance": ("height_difference",),
}
"""Kinds that a table may hold besides its own, in further columns."""
_READINGS = ("back", "fore", "between", *_STAFF_DISTANCES)
_DISTANCES = ("distance", *_STAFF_DISTANCES)
_BENCHMARK = "benchmark"
"""Part of a levelling book with the point whose height is the first one in it."""
_NO_READING, _SUMS = "rows without readings", "sums of the readings"
_TO_ITSELF = "height differences from a point to itself"
_SIGNED = re.compile(r"(?:vista|visada|lectura|leitura|lecture|reading|v|l)?\s*\(?([-+−])\)?")
"""Readings back and forward that have the signs with which they enter the height."""
_NOTHING = re.compile(r"\s*(?:[-–—]{2,}|\*+|NaN)\s*")
"""What programs write into empty cells; an asterisk is the σ of what is free."""
_PARTS = tuple(
    re.compile(f"(.*?)(?:{words})")
    for words in (
        "degrees?|deg|grados?|graus?|gradi|d|g",
        "minutes?|minutos?|minuti|min|m",
        "seconds?|segundos?|secondi|seg|sec|s",
    )
)
"""Headings of degrees, minutes and seconds in columns of their own, behind a common name."""
_CONTROL = re.compile(
    r"(?:gcp|gcps|(?:fix|fixed|known|given|held|control|kesin|fest|bekannte|gegebene|datum)"
    r"(?:points?|coordinates?|heights?|stations?|punkte?|koordinaten|hoehen|koordinatlar|yuekseklikler|noktalar)"
    r"|gcp(?:s|id|name|label|no)|idgcp|festpunkte?|passpunkte?)"
)
"""Titles of lists of control points, and headings of their names."""
_TOTAL = re.compile(r"sum|total|[σ∑]", re.IGNORECASE)
"""Beginning of the name of a row of sums."""
_SUFFIX = re.compile(r"(?P<name>[^-_]+)[-_](?P<end>[^-_()\[\]]+)(?P<unit>\s*(?:\(.*\)|\[.*\])?)")
_PLACEHOLDER = re.compile(r"column\d+")
"""Name of a column of a spreadsheet that has none."""
_DIGIT, _WORD = re.compile(r"\d"), re.compile(r"\w")
_STAFF = 10.0
"""No staff is as long in metres: larger readings are millimetres."""
_HAIRS = tuple(
    tuple(re.compile(f"(?:hilo|fil|filo)?(?:{name})(?:hair|wire|stadia|reading|faden)?") for name in names)
    for names in (
        ("upper|up|top|u|t", "middle|mid|centre|center|m|c", "lower|low|bottom|bot|l|b"),
        ("oben|ober|o", "mitte|mittel|m", "unten|unter|u"),
        ("superior|superieur|superiore|sup|s", "medio|central|moyen|m|c", "inferior|inferieur|inferiore|inf|i"),
    )
)
"""Names of the upper, middle and lower hair behind that of the reading; only where all three are there."""
_HAIRED_NAMES = {"back": _N.back.split("|"), "fore": _N.fore.split("|"), "between": _N.between.split("|")}
_UNITS = {**LENGTH_UNITS, **ANGLE_UNITS, PIXEL: 1.0}
_WORDS_OF_UNITS = {unit: unit for unit in _UNITS} | {
    word: unit
    for unit, words in {
        "m": "meter|meters|metre|metres|metros|metri|米",
        "km": "kilometer|kilometers|kilometre|kilometres|公里|千米",
        "mm": "millimeter|millimeters|millimetre|millimetres|毫米",
        "ft": "foot|feet",
        "deg": "degree|degrees|grados|graus|gradi|度",
        "rad": "radian|radians",
        "arcsec": "sec|secs|second|seconds",
    }.items()
    for word in words.split("|")
}
_BRACKETED_UNIT = re.compile(rf" ([(\[](?:{'|'.join(map(re.escape, _UNITS))})[)\]])(?= |$)", re.IGNORECASE)
PLACES = ("point", "at", "from", "to", "station")
"""Columns of measurements that name points."""
_TITLES = 20
"""Rows among which the header is looked for."""
_STATION = ("station", "at", "from", "station_height", "at_height", "from_height")
"""Columns that hold for the rows below as well, until another station stands there."""
_Cells = tuple[tuple[str, ...], ...]
_EMPTY, _ZERO = re.compile(""), re.compile(r"(?:0+(?:[.,]0*)?)?")
_NUMBER = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?")
_LEADING = re.compile(r"[-+]?\d+(\.\d*)?")
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+")
_DMS = re.compile(r"[-+]?\d+\s*[-°:\s]\s*\d+\s*[-'′:\s]\s*\d")
_PACKED = re.compile(r"(?P<whole>\d{1,3})(?:\.(?P<rest>\d*))?")
_QUADRANT = re.compile(
    r"(?P<from>[NS])\s*(?P<d>\d+(?:[.,]\d+)?)(?:\s*[-°ºd:\s]\s*(?P<m>\d+(?:[.,]\d+)?))?"
    r"(?:\s*[-'’′m:\s]\s*(?P<s>\d+(?:[.,]\d+)?))?[\s°ºd'’′m\"”″s-]*(?P<to>[EWO])\.?",
    re.IGNORECASE,
)
"""Bearings from north or south towards east or west (O: ouest, oeste)."""
_PARTS_OF_QUADRANT = re.compile(r"ns d(?:eg\w*)? m(?:in\w*)? (?:s(?:ec\w*)? )?(?:ew|we)\b")
"""Headings of a quadrant bearing in columns of its own."""
_VARIANCE = re.compile(
    r"(?:var(?:iance)?(?P<of>[a-z]?)|sigma(?P<behind>[xyz]?)(?:2|²|squared)"
    r"|(?P<before>dist|distance|dir|direction|hz|angle|dh|dz)var(?:iance)?)"
)
"""Headings of variances, perhaps of a coordinate or reading."""
_HELD = re.compile(
    r"(?:is)?(?:fix|fixed|held|known|control|constrained|fasthold|fest|fijo|fixe)(?:1(?:free)?0)?(?P<axis>[xyzenhu]?)"
)
"""Headings of columns that say whether a point, or a coordinate of it, is fixed."""
_OFF = re.compile(
    r"(?:is)?(?:ignored?|reject(?:ed)?|excluded?|disabled?|omit(?:ted)?|skip(?:ped)?|outlier|unused|sluk)"
)
_ON = re.compile(r"(?:is)?(?:used?|active|enabled?|included?|aktiv)")
"""Headings of columns that say which rows are not to be used, and which are."""
_YES = {"true", "yes", "y", "1", "fix", "fixed", "held", "known", "control", "x", "ja", "wahr", "si", "oui", "vrai"}
_NO = {"", "false", "no", "n", "0", "free", "unknown", "new", "nein", "falsch", "non", "faux", "-"}
_LEGEND = re.compile(r"([^\W_]+)\s*[\[(=:]\s*([^\W_]+)")
"""What signs in a column mean, as its heading says: Known[n]/Unknown[u]."""
_ROLE = re.compile("(?:point)?(?:type|status|role|class)")
_ROLES = {"c": "control", "k": "known", "f": "fixed", "u": "unknown", "n": "new", "p": "free"}
"""Letters of known and new points below a heading that says no more."""
_FACES = {"": "", "1": "1", "2": "2"} | {
    word: face
    for face, words in (
        ("1", "l|left|fl|faceleft|cl|i|d|direct|links"),
        ("2", "r|right|fr|faceright|cr|ii|reverse|rechts"),
    )
    for word in words.split("|")
}
"""Faces of an instrument by their names."""
_JOINS = re.compile(r"\s*(?:->|[-–—→/:>]|\bto\b)\s*")
_ANGLES = ("horizontal", "zenith", "angle", "bearing", "zenith_angle", "vertical_direction")
"""Columns that may hold degrees, minutes and seconds."""
_CIRCLES = {"gon": 400.0, "deg": 360.0}
_WAYS = tuple(product(_CIRCLES, (1, -1)))
_AGREES = 0.5
"""Part of the misfit in the other unit or sense that angles in theirs have at most."""
_OF_POINTS = ("id", "x", "y", "z")
_UMLAUTS = str.maketrans(
    {
        "ı": "i",
        "ä": "ae",
        "ö": "oe",
        "ü": "ue",
        "ß": "ss",
        "δ": "d",
        "ω": "omega",
        "φ": "phi",
        "κ": "kappa",
        "σ": "sigma",
    }
)


class Found(NamedTuple):
    """A table that was recognised."""

    path: Path
    kind: str
    columns: Mapping[str, str]
    """Its columns by their names in a project."""
    unused: tuple[str, ...]
    """Columns that neither this kind nor another one in the same table reads."""
    units: Mapping[str, str]
    """Units that the names of columns say."""
    delimiter: str
    decimal_comma: bool
    has_header: bool
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...] = ()
    """Lines of the file that the rows of a levelling book stand in."""
    sheet: str = ""
    """Sheet of a spreadsheet that has several."""
    tidied: bool = False
    """True if the rows are not those of the file: a copy of them is written."""
    notes: tuple[str, ...] = ()
    is_control: bool = False
    """True for points whose coordinates are known: a benchmark, or a list that says so."""
    part: str = ""
    """Kind, if other kinds in the table have readings in other rows."""

    def copy(self, target: Path) -> Path:
        """Path of a copy of the rows beside the project."""
        sheet = re.sub(r"\W+", "_", self.sheet)
        return target.with_name("_".join(filter(None, (target.stem, self.path.stem, sheet, self.part))) + ".csv")

    def texts(self, name: str) -> list[str]:
        """Cells of a column, empty if it is missing."""
        if name not in self.columns:
            return []
        place = self.header.index(self.columns[name])
        return [plain(row[place].strip()) for row in self.rows if len(row) > place]

    def numbers(self, name: str) -> list[float]:
        """Cells of a column that are plain numbers."""
        cells = (cell.replace(",", ".") if self.decimal_comma else cell for cell in self.texts(name))
        return [float(cell) for cell in cells if _NUMBER.fullmatch(cell) and "," not in cell]

    @property
    def has_sigma(self) -> bool:
        """True if the table has standard deviations or covariances."""
        return any(name.startswith(("sigma", "cov_")) for name in self.columns)

    @property
    def has_heights(self) -> bool:
        """True if the table has heights, and not known positions with heights that are not known."""
        return "z" in self.columns and not ("sigma_x" in self.columns and "sigma_z" not in self.columns)


def read_tables(path: Path, names: Sequence[str] = ()) -> list[Found]:
    """Read a table and return what it holds, one entry per kind: a field book may hold directions and distances.

    Of several sheets in a spreadsheet those are returned that hold something known. ``names`` of columns, ``-`` for one
    that is not used, take the place of a header. Raises :class:`InputError` if the columns are those of no kind.
    """
    sheets = [name for name, rows in read_sheets(path).items() if rows] if is_spreadsheet(path) else []
    if len(sheets) < 2:
        return _recognise(path, None, names)
    found, mistakes = list[Found](), list[Message]()
    for name in sheets:
        try:
            found += [table._replace(sheet=name) for table in _recognise(path, name, names)]
        except InputError as error:
            mistakes += [Message(f"sheet {name}: {mistake.message}", str(path)) for mistake in error.problems]
    if not found:
        raise InputError(mistakes)
    return _with_sheets_apart(found)


def _with_sheets_apart(tables: list[Found]) -> list[Found]:
    """The tables with other names of sets where a station has directions in an earlier sheet as well."""
    seen, apart = dict[str, str](), list[Found]()
    for table in tables:
        own = dict.fromkeys(table.texts("station")) if "horizontal" in table.columns else {}
        again = {name for name in own if seen.setdefault(name, table.sheet) != table.sheet}
        if again:
            place = table.header.index(table.columns["station"])
            header = table.header if "set" in table.columns else (*table.header, "set")
            k = header.index(table.columns.get("set", "set"))
            full = [(*row, *[""] * (len(header) - len(row))) for row in table.rows]
            names = [f"{row[k]} {table.sheet}".strip() if _cell(row, place) in again else row[k] for row in full]
            rows = tuple((*row[:k], name, *row[k + 1 :]) for row, name in zip(full, names, strict=True))
            columns = {**table.columns, "set": header[k]}
            words = f"stations that another sheet has too are set up once more: {', '.join(sorted(again))}"
            table = table._replace(header=header, rows=rows, columns=columns, part=table.part or table.kind)
            table = table._replace(tidied=True, notes=(*table.notes, words))
        apart.append(table)
    return apart


def _recognise(path: Path, sheet: str | None, names: Sequence[str]) -> list[Found]:
    cells = _cells(path, sheet, len(names))
    if names:
        cells = _with_header(path, cells, names)
    width = max((k for row in cells.rows for k, cell in enumerate(row, start=1) if cell.strip()), default=0)
    blank = tuple(tuple("" if _NOTHING.fullmatch(cell) else cell for cell in row[:width]) for row in cells.rows)
    named = tuple(row if any(map(_number, row)) else _with_hairs(row) for row in blank)
    blocks = _blocks(_with_whole_angles(named), cells.lines)
    found = [_of_block(path, cells, block, len(blocks) > 1) for block in blocks]
    tables, copies = list[Found](), list[str]()
    for table in (table for tables in found for table in tables):
        copies.append(table.part)
        again = copies.count(table.part)
        tables.append(table._replace(part=f"{table.part}_{again}") if table.part and again > 1 else table)
    return tables


def _with_header(path: Path, cells: _File, names: Sequence[str]) -> _File:
    """The rows below a header of these names, which takes the place of rows without numbers above them."""
    numbers = [any(_NUMBER.fullmatch(cell.strip()) for cell in row) for row in cells.rows]
    start = numbers.index(True) if True in numbers else len(numbers)
    body = cells.rows[start:]
    width = max(map(len, body), default=0)
    if len(names) > width:
        words = f"found {width} columns, expected {len(names)} as --columns names them ({', '.join(names)})"
        raise InputError([Message(words, str(path), cells.lines[start] if body else 0)])
    unused = (f"column{k}" for k in range(1, width + 1))
    header = tuple(own if own not in ("", "-") else other for own, other in zip_longest(names, unused, fillvalue=""))
    lines = (cells.lines[max(start - 1, 0)], *cells.lines[start:])
    return cells._replace(rows=(header, *body), lines=lines, was_joined=True)


class _Block(NamedTuple):
    """Rows with one header, their lines in the file, notes on what is not read, and the title above."""

    rows: _Cells
    lines: tuple[int, ...]
    notes: tuple[str, ...] = ()
    title: str = ""


def _of_block(path: Path, cells: _File, block: _Block, is_one_of_several: bool) -> list[Found]:
    """Tables of every kind in a block."""
    tidy, stated = _tidied(block.rows)
    tidy, off = _without_switched_off(tidy)
    tidy, wires = _with_whole_readings(tidy)
    tidy, packed = _without_packed_angles(tidy)
    tidy, held = _with_sigmas(_without_empty_readings(tidy))
    tidy, zeros = _without_zeros(_with_targets(_with_faces(tidy)))
    tidy, none = _without_zero_readings(tidy)
    tidy, alone = _with_station(tidy)
    is_encoded = cells.encoding in CODE_PAGES
    encoded: tuple[str, ...] = (not_utf8(cells.encoding),) if is_encoded else ()
    encoded += (*block.notes, *off, *wires, *packed, *held, *zeros, *none, *alone)
    parts = _parts(tidy, path)
    return [
        table._replace(
            tidied=table.tidied or is_encoded or cells.was_joined,
            notes=(*encoded, *notes, *table.notes),
            is_control=table.is_control or _is_control(table, block.title),
            part=table.part or (table.kind if len(parts) > 1 or is_one_of_several else ""),
        )
        for rows, notes in parts
        for table in _tables(path, rows, cells, block.lines, stated)
    ]


def _is_control(table: Found, title: str) -> bool:
    names = (title, table.columns.get("id", ""))
    return table.kind == "points" and any(_CONTROL.fullmatch(_normalised(name)) for name in names)


def _tables(path: Path, rows: _Cells, cells: _File, lines: tuple[int, ...], stated: Mapping[str, str]) -> list[Found]:
    """Tables of every kind in the rows. ``lines``: those of the file from the header on."""
    delimiter, above = cells.delimiter, cells.above
    line = lines[0] if lines else 1
    header = tuple(cell.strip() for cell in rows[0]) if rows else ()
    has_header = bool(header) and _is_heading(header)
    if not has_header and len(above) == len(header) and _kinds(_named(above)):
        header = above
    elif not has_header:
        words = (
            "expected a header with the names of the columns in the first line, or --columns TABLE NAMES; only a list "
            "of points (name, x, y, z) may be without"
        )
        if has_two_names(rows):
            words = (
                "the lines are two names and numbers, like observations of JAG3D; expected a header with the names of "
                f"the columns in the first line, or --columns {path.name} from,to,distance"
            )
        if has_two_names(rows) or not _is_list_of_points(_padded(rows)):
            raise InputError([Message(words, str(path), line)])
        rows = _padded(rows)
        header = (*_OF_POINTS, *(f"column{k}" for k in range(5, len(rows[0]) + 1)))
    named = _named(header)
    kinds = _kinds(named)
    _tell_elevations(kinds, header, rows[has_header:])
    places = [cell for cell, text, _ in named if _GEOGRAPHIC.fullmatch(text)]
    if len(places) > 1 and kinds.keys() <= {"points with heights"}:
        words = (
            f"found latitudes and longitudes (columns {', '.join(places)}), expected coordinates in metres; in a "
            "project with world: {crs: EPSG:4326} points have columns latitude, longitude, height"
        )
        raise InputError([Message(words, str(path), line)])
    if {"x", "y", "X", "Y"} <= set(header) and "image" not in kinds:
        words = "x, y beside X, Y: image coordinates need a column with the name of their image"
        raise InputError([Message(words, str(path), line)])
    if not kinds:
        known = [_columns_that_are_known(row) for row in rows[:_TITLES]]
        likely = max(range(len(known)), key=lambda k: (known[k] > 1) * known[k])  # the first row may be a title
        columns = ", ".join(c for c in map(str.strip, rows[likely]) if c and not _PLACEHOLDER.fullmatch(c))
        line = lines[max(0, len(lines) - len(rows)) + likely]
        words = f"unknown kind of table: found the columns {columns}; {_known()}"
        if max(known) < 2 or any(len(rows[likely]) > len(row) for row in rows[likely + 1 : likely + 2]):
            words = (
                "no line has the names of the columns of a known table: write them above the values, or give them by "
                f"--columns TABLE NAMES; {_known()}"
            )
        raise InputError([Message(words, str(path), line)])
    body, nameless = rows[has_header:], 0
    if target := next((columns["to"] for kind, columns in kinds.items() if kind in _SIGMA and "to" in columns), ""):
        place = header.index(target)
        named_rows = tuple(row for row in body if len(row) <= place or row[place].strip())
        body, nameless = named_rows, len(body) - len(named_rows)
    full = {kind: _with_readings(body, kind, columns, header) for kind, columns in kinds.items()}
    kept = {row for rows_of_kind in full.values() for row in rows_of_kind}
    if "image" in full and "points" in full:
        place = header.index(kinds["points"]["id"])
        full["points"] = tuple({_cell(row, place): row for row in reversed(body)}.values())[::-1]
    repeated = 0
    for kind in full:
        if kind.startswith("points") and len(kinds) == 1:
            used_places = [header.index(cell) for cell in kinds[kind].values()]
            by_content = dict[tuple[str, ...], tuple[str, ...]]()
            for row in full[kind]:
                by_content.setdefault(tuple(_cell(row, k) for k in used_places), row)
            once = tuple(by_content.values())
            full[kind], repeated = once, len(full[kind]) - len(once)
    bare = sum(row not in kept for row in body)
    notes: tuple[str, ...] = (f"{_NO_READING}: {counted(bare, 'row')}",) if bare else ()
    notes += (f"points given twice alike: {counted(repeated, 'row')}",) if repeated else ()
    notes += (f"rows without a target: {counted(nameless, 'row')}",) if nameless else ()
    used = {cell for columns in kinds.values() for cell in columns.values()}
    if twice := sorted(cell for cell in used if header.count(cell) > 1):
        raise InputError([Message(f"column {', '.join(map(repr, twice))} is given twice", str(path))])
    if delimiter == " " and has_header:
        _check_width(path, line, header, body, used)
    unused = tuple(cell for cell in header if cell and cell not in used and not _PLACEHOLDER.fullmatch(cell))
    short = delimiter == " " and any(len(row) < len(header) for row in body)
    if short and used.isdisjoint(header[min(map(len, body)) :]):  # remarks that are not there
        full = {kind: tuple((*row, *[""] * (len(header) - len(row))) for row in rows_) for kind, rows_ in full.items()}
    units = {**{cell: unit for cell, _, unit in named if unit}, **stated}
    decimal_comma = delimiter != "," and any(_DECIMAL_COMMA.fullmatch(cell.strip()) for row in rows for cell in row)
    return [
        Found(
            path,
            kind.split(" ")[0],
            columns,
            unused,
            {ours: units[theirs] for ours, theirs in columns.items() if theirs in units},
            delimiter,
            decimal_comma,
            has_header,
            header,
            full[kind],
            lines[len(lines) - len(body) :] if kind.startswith("levelling") else (),
            tidied=rows != cells.rows or bool(notes) or short or full[kind] != body,
            part=kind if len({len(part) for part in full.values()}) > 1 else "",
            notes=notes,
        )
        for kind, columns in kinds.items()
    ]


def _parts(rows: _Cells, path: Path) -> list[tuple[_Cells, tuple[str, ...]]]:
    """Tables in the rows with notes on what is not used: one for each type of observations, or legs of a traverse."""
    header, body = tuple(cell.strip() for cell in rows[0]) if rows else (), rows[1:]
    if by_type := _columns("observations by type", _named(header)):
        tables = _by_type(header, body, by_type)
        if tables:
            return tables
    kind, columns = next(iter(_kinds(_named(header)).items()), ("", {}))
    if kind == "observations by type":
        types = dict.fromkeys(_cell(row, header.index(columns["type"])) for row in body)
        words = f"observations of the types {', '.join(types)}: a type is unknown, or no column names the points"
        raise InputError([Message(words, str(path))])
    if "bearing" in columns and not any(_cell(row, header.index(columns["bearing"])) for row in body):
        others = [named for named in _named(header) if named[0] != columns["bearing"]]
        kind, columns = next(iter(_kinds(others).items()), (kind, columns))
    if "bearing" in columns:
        place = header.index(columns["bearing"])
        if any(_QUADRANT.fullmatch(_cell(row, place)) for row in body):
            head = "bearing [deg]"
            header = tuple(head if k == place else cell for k, cell in enumerate(header))
            columns = {**columns, "bearing": head}
            body = tuple(tuple(_azimuth(cell) if k == place else cell for k, cell in enumerate(row)) for row in body)
    if kind == "traverse by angles":
        return _by_angles(header, body, columns)
    if kind.startswith("traverse"):
        return [_with_both_ends(header, body, columns, path)]
    return [((header, *body) if "bearing" in columns else rows, ())]


def _cell(row: tuple[str, ...], place: int) -> str:
    return row[place].strip() if place < len(row) else ""


def _azimuth(text: str) -> str:
    """Azimuth in decimal degrees of a quadrant bearing such as N 45-30-10 E; other texts stay."""
    match = _QUADRANT.fullmatch(text.strip())
    if match is None:
        return text
    parts = [float((match[name] or "0").replace(",", ".")) for name in "dms"]
    angle = parts[0] + parts[1] / 60.0 + parts[2] / 3600.0
    is_south, is_west = match["from"].upper() == "S", match["to"].upper() in "WO"
    angle = 180.0 - angle if is_south else angle
    return f"{(360.0 - angle if is_west else angle):.9g}"


def _with_both_ends(
    header: tuple[str, ...], body: _Cells, columns: Mapping[str, str], path: Path
) -> tuple[_Cells, tuple[str, ...]]:
    """Legs of a traverse with both points: its name says them (A-B), or it joins the points of consecutive rows."""
    place = header.index(columns.get("leg") or columns["point"])
    bearing, distance = header.index(columns["bearing"]), header.index(columns["distance"])
    # A row with a distance alone is a sum.
    named = [row for row in body if _cell(row, place) and (_cell(row, bearing) or not _cell(row, distance))]
    named = [row for row in named if not _TOTAL.match(_cell(row, place))]
    again = [k for k, row in enumerate(named) if k > 1 and _cell(row, place) == _cell(named[0], place)]
    # A closed traverse that ends where it began may have the first bearing once more there, and remarks below.
    if again and not any(_cell(row, distance) for row in named[again[-1] :]) and "leg" not in columns:
        end = named[again[-1]]
        named = [*named[: again[-1]], (*end[:bearing], "", *end[bearing + 1 :])]
    legs = [row for row in named if _cell(row, bearing)]
    names, notes = [_cell(row, place) for row in named], list[str]()
    if "leg" in columns:
        ends = [_ends(_cell(row, place), path) for row in legs]
    elif named and not _cell(named[0], bearing):
        ends = [both for both, row in zip(zip(["", *names], names, strict=False), named, strict=True) if row in legs]
    else:
        after = [*names[1:], names[0]] if named else []
        if named and _cell(named[-1], bearing):
            notes.append(f"each leg leads to the point of the next row, the last one back to {names[0]}")
        ends = [both for both, row in zip(zip(names, after, strict=True), named, strict=True) if row in legs]
    rows = [(*row[:place], *both, *row[place + 1 :]) for both, row in zip(ends, legs, strict=True)]
    if len(legs) < len(body):
        notes.append(f"{_NO_READING}: {counted(len(body) - len(legs), 'row')}")
    return ((*header[:place], "from", "to", *header[place + 1 :]), *rows), tuple(notes)


def _by_angles(
    header: tuple[str, ...], body: _Cells, columns: Mapping[str, str]
) -> list[tuple[_Cells, tuple[str, ...]]]:
    point, angle, distance = (header.index(columns[name]) for name in ("point", "angle", "distance"))
    named = [row for row in body if _cell(row, point) and not _TOTAL.match(_cell(row, point))]
    if len(named) > 2 and _cell(named[-1], point) == _cell(named[0], point) and not _cell(named[-1], distance):
        named = named[:-1]
    names = [_cell(row, point) for row in named]
    is_closed = len(named) > 2 and bool(_cell(named[-1], distance))
    around = zip([names[-1], *names], names, [*names[1:], names[0]], named, strict=False) if names else ()
    inner = list(around) if is_closed else list(around)[1:-1]
    angles = [(at, start, end, _cell(row, angle)) for start, at, end, row in inner if _cell(row, angle)]
    legs = [
        (names[k], names[(k + 1) % len(names)], _cell(row, distance))
        for k, row in enumerate(named)
        if _cell(row, distance) and (is_closed or k + 1 < len(names))
    ]
    words = ["angles of the traverse are taken as clockwise from the point before to the next one"]
    if is_closed:
        words.append(f"each leg leads to the point of the next row, the last one back to {names[0]}")
    length, unit = "horizontal distance", _name_and_unit(header[distance])[1]
    left = len(body) - len(named)
    words += [f"{_NO_READING}: {counted(left, 'row')}"] if left else []
    return [
        ((("at", "from", "to", "angle"), *angles), tuple(words)),
        ((("from", "to", f"{length} [{unit}]" if unit else length), *legs), ()),
    ]


def _ends(leg: str, path: Path) -> tuple[str, str]:
    """Both points in the name of a leg. Raises :class:`InputError`."""
    parts = list(leg) if len(leg) == 2 and leg.isalpha() else _JOINS.split(leg)
    half = len(parts) // 2
    if len(parts) % 2 or not all(parts):
        raise InputError([Message(f"found the leg {leg!r}, expected both points as in A-B", str(path))])
    return "-".join(parts[:half]), "-".join(parts[half:])


def _by_type(header: tuple[str, ...], body: _Cells, columns: Mapping[str, str]) -> list[tuple[_Cells, tuple[str, ...]]]:
    places = {name: header.index(cell) for name, cell in columns.items()}
    found, rest = list[_Cells](), dict[str, int]()
    for name in dict.fromkeys(_cell(row, places["type"]) for row in body):
        rows = [row for row in body if _cell(row, places["type"]) == name]
        units = {_cell(row, places["unit"]) for row in rows} if "unit" in places else set()
        unit = units.pop() if len(units) == 1 else ""
        value = f"{name} [{unit}]" if unit else name
        head = tuple(value if k == places["value"] else cell for k, cell in enumerate(header))
        left_out = (places["type"], places.get("unit"))
        keep = [k for k in range(len(header)) if k not in left_out and any(_cell(row, k) for row in rows)]
        table = _with_names_apart(tuple(tuple(_cell(row, k) for k in keep) for row in (head, *rows)))
        if _kinds(_named(table[0])):
            found.append(table)
        else:
            rest[name] = len(rows)
    notes = tuple(f"observations of the type {name!r} not used: {counted(n, 'row')}" for name, n in rest.items())
    return [(rows, notes) for rows in found]


def _with_names_apart(rows: _Cells) -> _Cells:
    """Rows with both ends, or the points of an angle, in columns of their own if one cell has them: A-B, A-P-B."""
    for k, sign in product(range(len(rows[0])), "_-/>,"):
        parts = [[name.strip() for name in row[k].split(sign)] for row in rows[1:]]
        names = {2: ("from", "to"), 3: ("from", "at", "to")}.get(len(parts[0]), ())
        header = (*rows[0][:k], *names, *rows[0][k + 1 :])
        if names and all(len(one) == len(names) and all(one) for one in parts) and _kinds(_named(header)):
            return (header, *((*row[:k], *one, *row[k + 1 :]) for row, one in zip(rows[1:], parts, strict=True)))
    return rows


def _with_readings(rows: _Cells, kind: str, columns: Mapping[str, str], header: Sequence[str]) -> _Cells:
    """Rows that have a reading of a kind, and those that are too short; a distance of 0 is none."""
    readings = KINDS[kind][0].keys() - {*PLACES, "image"} if kind in _SIGMA else ()
    places = [header.index(columns[name]) for name in readings]
    nothing = _ZERO if kind in _LINES else _EMPTY
    return tuple(
        row
        for row in rows
        if not places or len(row) < len(header) or not all(nothing.fullmatch(row[k].strip()) for k in places)
    )


class _Book(NamedTuple):
    """A table with levelling books: its lines in ``levelling``, and rows that are not used, by reason."""

    table: Found
    levelling: Levelling
    lines: slice
    second: Levelling
    """Lines of a second instrument."""
    left: dict[str, int]


class _Heights(NamedTuple):
    """Heights that books have by point, with their rows, and points that books before have levelled."""

    listed: dict[str, list[tuple[float, _LevelRow]]]
    reached: set[str]


def levelled(tables: Sequence[Found]) -> list[Found]:
    """Return the tables with height differences and benchmarks for levelling books, each of which is used once.

    A point inside two books is two points unless both have the same height for it: turning points are numbered anew.
    Raises :class:`InputError` for a book that cannot be read.
    """
    joint, read, mistakes = Levelling(), list[Found | _Book](), list[Message]()
    copies = dict[tuple[tuple[str, str, str], ...], int]()
    for table in tables:
        if table.kind != "levelling":
            read.append(table)
            continue
        table = _with_mean_wires(table)
        # Where each row names both points, a name is that of one point.
        levelling, second = Levelling() if "to" in table.columns else joint, Levelling()
        left = dict.fromkeys((_NO_READING, _SUMS, ALONE, _TO_ITSELF), 0)
        try:
            lines = _add(levelling, table, left)
        except InputError as error:
            if not table.sheet:
                raise
            mistakes += error.problems
            continue
        rows = tuple((r.start, r.end, f"{r.value:.6g}") for ln in levelling.lines[lines] for r in ln.all_differences())
        again = copies.setdefault(rows, len(read))
        if rows and again < len(read):
            del levelling.lines[lines]
            first = read[again]
            if isinstance(first, _Book):
                words = f"{f'{table.path.name} {table.sheet}'.strip()} has the same readings: not used once more"
                read[again] = first._replace(table=first.table._replace(notes=(*first.table.notes, words)))
            continue
        if _SECOND.keys() <= table.columns.keys():
            names = {"back": table.columns["back2"], "fore": table.columns["fore2"]}
            _add(second, table._replace(columns={**table.columns, **names}), left)
        read.append(_Book(table, levelling, lines, second, left))
    heights = _Heights({}, set())
    found = [table for one in read for table in (_levelled(one, heights) if isinstance(one, _Book) else (one,))]
    if not found and mistakes:
        raise InputError(mistakes)
    return found


def _add(levelling: Levelling, table: Found, left: dict[str, int]) -> slice:
    """Add the books of a table, and return their lines. ``left`` is counted up."""
    first, alone = len(levelling.lines), len(levelling.alone)
    for book in _books(table):
        levelling.begin()
        if "code" in table.columns:
            _add_by_codes(levelling, book, left)
        else:
            _add_book(levelling, book, left)
    levelling.close()
    if not levelling.lines[-1].all_differences():
        levelling.lines.pop()
    left[ALONE] += len(levelling.alone) - alone
    return slice(first, len(levelling.lines))


def _levelled(book: _Book, heights: _Heights) -> tuple[Found, ...]:
    table, left = book.table, book.left
    renamed = book.levelling.names_of_lines()[0]
    own, lines = renamed[book.lines], book.levelling.lines[book.lines]
    rows = [
        row.with_names(names)
        for part in (lines, book.second.lines)
        for line, names in zip(part, own, strict=False)
        for row in line.all_differences()
    ]
    found = [row for row in rows if row.start != row.end]
    left[_TO_ITSELF] += len(rows) - len(found)
    if not found and table.sheet:
        return ()
    if not found and table.rows:
        raise InputError([Message("no set-up has readings back and forward", str(table.path))])
    names = ["from", "to", "dz", "length"][: 3 + all(row.length is not None for row in found)]
    read = ("back", "fore", "reading")
    values = [abs(value) for ours in read for value in table.numbers(ours)]
    unit = next((table.units[name] for name in read if name in table.units), "")
    units = {"dz": unit or ("mm" if values and median(values) > _STAFF else "")}
    units["length"] = next((table.units[name] for name in _DISTANCES if name in table.units), "")
    cells = [(row.start, row.end, f"{row.value:.9g}", f"{row.length or 0.0:.9g}")[: len(names)] for row in found]
    notes: tuple[str, ...] = (*table.notes, f"{counted(len(found), 'height difference')} from the staff readings")
    if len(lines) > 1:
        notes += (f"{len(lines)} levelling books below each other",)
    elsewhere = [
        {names.get(name, name) for name in line.inside() | line.ends()}
        for line, names in zip(book.levelling.lines, renamed, strict=True)
    ]
    everywhere = [name for one in elsewhere for name in one]
    shared = {name for one in elsewhere[book.lines] for name in one if everywhere.count(name) > 1}
    if shared:
        notes += (f"points that several books have are the same points: {', '.join(sorted(shared))}",)
    if others := sorted({name for one in own for name in one}):
        notes += (f"points of the same name in other books are other points: {', '.join(others)}",)
    written = table._replace(delimiter=",", decimal_comma=False, has_header=True, tidied=True)
    measured, benchmark = {name for row in found for name in (row.start, row.end)}, tuple[Found, ...]()
    known = {name: height for name, height in _benchmarks(table, heights).items() if name in measured}
    heights.reached.update(measured)
    suffix = table.part.removeprefix("levelling") if table.part.startswith("levelling") else ""
    if known:
        given = [row.height() for row in _level_rows(table) if row.has_height()]
        below = counted(sum(map(bool, given)) - sum(bool(float(height)) for height in known.values()), "height")
        notes += (f"the height of {', '.join(known)} is taken over; {below} below not used: they are computed",)
        unit = table.units.get("height", "")
        control = written._replace(
            kind="points",
            columns={"id": "id", "z": "z"},
            unused=(),
            units={"z": unit} if unit else {},
            header=("id", "z"),
            rows=tuple(known.items()),
            notes=(),
            is_control=True,
            part=f"{_BENCHMARK}{suffix}",
        )
        benchmark = (control,)
    differences = written._replace(
        kind="height_difference",
        columns=dict(zip(names, names, strict=True)),
        unused=(*table.unused, *(table.columns[n] for n in _DISTANCES if n in table.columns and "length" not in names)),
        units={name: unit for name, unit in units.items() if unit and name in names},
        header=tuple(names),
        rows=tuple(cells),
        notes=(*notes, *(f"{what}: {counted(n, 'row')}" for what, n in left.items() if n)),
        part=f"height_difference{suffix}" if benchmark or table.part else "",
    )
    return differences, *benchmark


def _level_rows(table: Found) -> list[_LevelRow]:
    return [_LevelRow(table, line, cells) for line, cells in zip(table.lines, table.rows, strict=True)]


def _books(table: Found) -> list[list[_LevelRow]]:
    """Rows of levelling books below each other: each has the header again, unless it goes on at the last point."""
    books, last = [list[_LevelRow]()], ""
    rows = _level_rows(table)
    for k, row in enumerate(rows):
        if _repeats(row.cells, table.header, table.columns.values()):
            first = next((below for below in rows[k:] if below.has_readings()), None)
            is_page = first is not None and (
                first.number("back") is None or first.number("fore") is not None or first.text("point") == last
            )
            if not is_page and "to" not in table.columns:
                books.append([])
        else:
            books[-1].append(row)
            last = (row.text("point") if row.has_readings() else "") or last
    return books


def _benchmarks(table: Found, heights: _Heights) -> dict[str, str]:
    """First heights in books, by point, that no book before has levelled.

    Raises :class:`InputError` if books begin at one point with two heights.
    """
    found = dict[str, str]()
    tolerance = _DECIMETRE / LENGTH_UNITS.get(table.units.get("height", "m"), 1.0)
    for book in _books(table):
        known = [row for row in book if row.has_height()]
        for row in known[:1]:
            name, height = row.text("point"), row.height()
            before = heights.listed.get(name, [])
            if before and min(abs(height - other) for other, _ in before) > tolerance:
                other, first = before[0]
                place = (
                    f"{first.table.path.name}:{first.row}" if first.table.sheet == table.sheet else first.table.sheet
                )
                words = (
                    f"the books that begin here and in {place} give point {name} the heights {height:g} and {other:g}: "
                    "put books of different points into files of their own"
                )
                raise InputError([Message(words, str(table.path), row.row)])
            if not before and name not in heights.reached:
                found[name] = row.text("height").replace(",", ".")
        for row in known[:1] + [row for row in known[1:] if row.height()]:
            heights.listed.setdefault(row.text("point"), []).append((row.height(), row))
    return found


def _add_by_codes(levelling: Levelling, rows: Sequence[_LevelRow], left: dict[str, int]) -> None:
    """Add readings whose side a code says; a row with another code has the result of a set-up."""
    for row in rows:
        name, side, value, height = row.text("point"), row.side(), row.number("reading"), row.number("height")
        if not side and row.text("code") and _DIGIT.search("".join(row.cells)):
            levelling.result(name, height)
            continue
        if not side or value is None:
            left[_NO_READING] += 1
            continue
        reading = StaffReading(name or f"line {row.row}", value, row.number("distance"), row.row)
        if side == "back":
            levelling.sight_back(reading)
        elif side == "fore":
            levelling.sight_forward(reading)
        else:
            levelling.sight_between(reading)
        levelling.record(name, height)


def _add_book(levelling: Levelling, rows: Sequence[_LevelRow], left: dict[str, int]) -> None:
    """Add a levelling book: a reading forward ends a set-up, one back begins the next."""
    full = [row for row in rows if row.has_readings()]
    left[_NO_READING] += len(rows) - len(full)
    for row in rows:
        if row.has_height():
            levelling.record(row.text("point"), row.height())
    if _is_read_twice(full):
        for one, other in zip(full[::2], full[1::2], strict=True):
            for row in (one, other):
                back, fore, _, behind, ahead = map(row.number, _READINGS)
                levelling.sight_back(StaffReading(one.text("point"), back or 0.0, behind, row.row))
                levelling.sight_forward(StaffReading(other.text("point"), fore or 0.0, ahead, row.row))
            levelling.close()
        return
    distances = [value for row in full if (value := row.number("distance")) is not None]
    is_chainage = distances == sorted(set(distances))
    total = 0.0
    for row, after in zip_longest(full, full[1:]):
        back, fore, between, behind, ahead = map(row.number, _READINGS)
        if behind is None and ahead is None and not is_chainage and (back is None or fore is None):
            behind = ahead = row.number("distance")
        elif "to" in row.table.columns and behind is None and ahead is None:
            behind = ahead = (row.number("distance") or 0.0) / 2.0 or None
        if "to" in row.table.columns and back is not None and fore is not None:
            levelling.sight_back(StaffReading(row.text("from"), back, behind, row.row))
            levelling.sight_forward(StaffReading(row.text("to"), fore, ahead, row.row))
            levelling.close()
            continue
        is_last = after is None or (after.number("back") is not None and after.number("fore") is None)
        if is_last and back is not None and fore is not None and isclose(back, total, abs_tol=1e-6):
            left[_SUMS] += 1
            total = 0.0
            continue
        total += back or 0.0
        if row is full[0] and back is not None and fore is not None:
            words = "found readings back and forward in the first row; expected a row for each point, first one back"
            raise InputError([Message(words, str(row.table.path), row.row)])
        name = row.text("point")
        if back is None and after and after.number("fore") is not None and not (after.text("point") == name != ""):
            fore, between = None, fore if between is None else between  # no reading back from this point follows
        if between is not None:
            levelling.sight_between(StaffReading(name or f"line {row.row}", between, ahead, row.row))
        if fore is not None:
            levelling.sight_forward(StaffReading(name, fore, ahead, row.row))
        if back is not None:
            levelling.sight_back(StaffReading(name, back, behind, row.row))


def _is_read_twice(rows: Sequence[_LevelRow]) -> bool:
    """Return whether rows have the readings of set-ups twice: one row with the point behind, one with that ahead."""
    read = [(row.number("back"), row.number("fore")) for row in rows]
    if (
        len(rows) % 2
        or not rows
        or any(back is None or fore is None for back, fore in read)
        or "to" in rows[0].table.columns
    ):
        return False
    steps = [(back or 0.0) - (fore or 0.0) for back, fore in read]
    unit = 1000.0 if max(abs(back or 0.0) for back, _ in read) > _STAFF else 1.0
    names = [row.text("point") for row in rows]
    return all(one != other for one, other in zip(names[::2], names[1::2], strict=True)) and all(
        abs(one - other) < SAME_HEIGHT * unit for one, other in zip(steps[::2], steps[1::2], strict=True)
    )


def _with_mean_wires(table: Found) -> Found:
    """One row for each point of a book with three wires in rows below each other: their mean, and the distance.

    The first row of a point names it; their mean may stand in a row below them. The middle wire is the mean of the
    outer ones, and the distance is 100 times what they differ by.
    """
    groups = list[list[_LevelRow]]()
    for row in _level_rows(table):
        if row.text("point"):
            groups.append([])
        if groups and row.has_readings():
            groups[-1].append(row)
    full = [rows for rows in groups if rows]
    read = [
        {name: [v for row in rows if (v := row.number(name)) is not None] for name in _READINGS[:3]} for rows in full
    ]
    sides = [one for three in read for name, one in three.items() if one and name != "between"]
    several = [one for one in sides if len(one) > 2]
    if len(full) < 2 or 2 * len(several) <= len(sides) or 3 * sum(map(_are_wires, several)) <= 2 * len(several):
        return table
    # Names without three readings are those of sums and of other words below the book.
    left = [len(max(three["back"], three["fore"], three["between"], key=len)) < 3 for three in read]
    words = ", ".join(rows[0].text("point") for rows, is_left in zip(full, left, strict=True) if is_left)
    full = [rows for rows, is_left in zip(full, left, strict=True) if not is_left]
    read = [three for three, is_left in zip(read, left, strict=True) if not is_left]
    # A column between in which no wires stand has intervals.
    has_between = all(not three["between"] or _are_wires(three["between"]) for three in read)
    names = [name for name in _READINGS[: 3 if has_between else 2] if name in table.columns]
    header, ends, off = ("point", *names, "back_distance", "fore_distance"), ("back", "fore"), list[str]()
    means = []
    for rows, three in zip(full, read, strict=True):
        ahead = three["fore"] or (three["between"] if has_between else [])
        if not all(_are_wires(three[name]) for name in names if three[name]):
            off.append(f"{rows[0].text('point')} ({rows[0].row})")
        means.append(
            (
                rows[0].text("point"),
                *(f"{_of_wires(three[name]):.9g}" if three[name] else "" for name in names),
                *(f"{100.0 * (one[0] - one[2]):.9g}" if len(one) > 2 else "" for one in (three["back"], ahead)),
            )
        )
    unit = table.units.get(ends[0], "mm" if median(table.numbers(ends[0])) > _STAFF else "")
    units = dict.fromkeys((*names, "back_distance", "fore_distance"), unit) if unit else {}
    return table._replace(
        columns=dict(zip(header, header, strict=True)),
        units=units,
        header=header,
        rows=tuple(means),
        lines=tuple(rows[0].row for rows in full),
        decimal_comma=False,
        notes=(
            *table.notes,
            f"three wires at {counted(len(means), 'point')}: their mean, and 100 times their interval",
            *((f"names without three wires left out: {words}",) if words else ()),
            *(
                (f"wires that contradict each other, of which the middle one is read, with rows: {', '.join(off)}",)
                if off
                else ()
            ),
        ),
    )


def _of_wires(values: Sequence[float]) -> float:
    return sum(values[:3]) / 3 if _are_wires(values) else values[min(1, len(values) - 1)]


def _are_wires(values: Sequence[float | None]) -> bool:
    """Return whether readings are those of the upper, middle and lower wire, perhaps with their mean, or none."""
    if len(values) not in (3, 4) or None in values[:3]:
        return not any(values)
    upper, middle, lower = (value or 0.0 for value in values[:3])
    mean = values[3] or 0.0 if len(values) > 3 else middle
    # The middle wire may be off by a tenth of the interval of the outer ones.
    return upper > lower and max(abs(upper + lower - 2.0 * middle), abs(mean - middle)) <= 0.1 * (upper - lower)


class _LevelRow(NamedTuple):
    """A row of a levelling book, and the line of the file it stands in."""

    table: Found
    row: int
    cells: tuple[str, ...]

    def text(self, name: str) -> str:
        """Cell of a column, empty if it is missing."""
        place = self.table.header.index(self.table.columns[name]) if name in self.table.columns else len(self.cells)
        return self.cells[place].strip() if place < len(self.cells) else ""

    def side(self) -> str:
        """Name of the reading that a code says, empty if it is that of no reading."""
        return _CODES.get(_normalised(self.text("code")), "")

    def has_height(self) -> bool:
        """Return whether the row has a point and a height."""
        return bool(self.text("point") and _NUMBER.fullmatch(self.text("height")))

    def height(self) -> float:
        """Height in a row that has one."""
        return float(self.text("height").replace(",", "."))

    def has_readings(self) -> bool:
        """Return whether the row has a reading, and no word as in checks below a book: of a sum, or in its place."""
        cells = list(map(self.text, _READINGS[:3]))
        is_told = any(_WORD.search(cell) and not _DIGIT.search(cell) for cell in cells)
        is_told |= not self.text("point") and any(_TOTAL.match(cell.strip()) for cell in self.cells)
        return not is_told and any(self.number(name) is not None for name in _READINGS[:3])

    def number(self, name: str) -> float | None:
        """Number in a column, ``None`` if the cell has none or 0. Raises :class:`InputError` for a text with digits."""
        text = self.text(name)
        if not _DIGIT.search(text):
            return None
        if not _NUMBER.fullmatch(text):
            words = f"column {self.table.columns[name]}: found {text!r}, expected a number"
            raise InputError([Message(words, str(self.table.path), self.row)])
        return float(text.replace(",", ".")) or None


def _without_index(rows: _Cells) -> _Cells:
    """Rows without numbers that count them and have no heading, as programs print a table."""
    header, below = (rows[0], rows[1:]) if rows else ((), ())
    counts = [row[0].strip() for row in below if len(row) == len(header) + 1]
    start = int(counts[0]) if counts and counts[0] in ("0", "1") else 0
    if len(counts) < 2 or any(map(_NUMBER.fullmatch, header)) or counts != [str(start + k) for k in range(len(below))]:
        return rows
    return (header, *(row[1:] for row in below))


def _blocks(rows: _Cells, lines: tuple[int, ...]) -> list[_Block]:
    """Return tables beside each other, each with its header in the first row."""
    start = next((k for k, row in enumerate(rows[:_TITLES]) if _fits(row)), None)
    if start is None:
        return [_Block(_without_index(rows), lines)]
    found, rest, kinds = list[_Block](), list[str](), set[str]()
    above_it = sum(sum(bool(_NUMBER.fullmatch(cell.strip())) for cell in row) > 1 for row in rows[:start])
    if above_it:
        rest.append(f"rows with numbers stand above the header: {counted(above_it, 'row')} not read")
    for one, end in _side_by_side(rows, start):
        cut = [tuple(_cell(row, k) for k in range(one, end)) for row in rows[start:]] if end else rows[start:]
        kept = [k for k, row in enumerate(cut) if not end or any(row)]
        table, names = tuple(cut[k] for k in kept), [cell.strip() for cell in cut[0]]
        kind = next(iter(_kinds(_named(names))), "") if end else "alone"
        if kind and (kind not in kinds or kind.startswith(("points", "levelling"))):
            kinds.add(kind)
            above = [cell.strip() for cell in rows[start - 1][one : end or None]] if start else []
            title = next((cell for cell in above if cell and not _PLACEHOLDER.fullmatch(cell)), "")
            found.append(_Block(*_first_table(table, tuple(lines[start + k] for k in kept)), title))
        elif named := [cell for cell in names if cell and not _PLACEHOLDER.fullmatch(cell)]:
            count = counted(len(table) - 1, "row")
            rest.append(f"another table stands beside it (columns {', '.join(named)}): {count} not read")
    return [block._replace(notes=(*block.notes, *rest)) for block in found]


def _side_by_side(rows: _Cells, start: int) -> list[tuple[int, int]]:
    """Columns of tables beside each other: one is named twice, and empty ones or titles above part them; or (0, 0)."""
    header = [cell.strip() for cell in rows[start]]
    header = ["" if _PLACEHOLDER.fullmatch(cell) else cell for cell in header]
    named = [cell for cell in header if cell]
    if len(set(named)) == len(named):
        return [(0, 0)]
    above = [cell.strip() for cell in rows[start - 1]] if start else []
    titled = [k for k, cell in enumerate(above[: len(header)]) if cell and not _PLACEHOLDER.fullmatch(cell)]
    empty = [k for k, cell in enumerate(header) if not cell and not any(_cell(row, k) for row in rows[start + 1 :])]
    edges = sorted({0, len(header), *empty, *(titled if len(titled) > 1 else ())})
    found = list(pairwise(edges))
    return found if sum(bool(_kinds(_named(header[one:end]))) for one, end in found) > 1 else [(0, 0)]


def _first_table(rows: _Cells, lines: tuple[int, ...]) -> tuple[_Cells, tuple[int, ...], tuple[str, ...]]:
    """Rows up to the heading of another table, each column once, angles in one column; lines, and notes on the rest."""
    header, body, notes = tuple(cell.strip() for cell in rows[0]), rows[1:], list[str]()
    kinds = _kinds(_named(header))
    used = {cell for columns in kinds.values() for cell in columns.values()} or set(header)
    again = [k for k, row in enumerate(body) if _repeats(row, header, used)]
    bare = [k for k, row in enumerate(body) if not any(_NUMBER.fullmatch(cell.strip()) for cell in row)]
    # A row of headings that begins like the header is that of another table, even of one that is not known. One right
    # below the header has subheadings.
    others = [k for k in bare if k and k not in again and (_fits(body[k]) or _begins_alike(body[k], header))]
    if others:
        names = ", ".join(filter(None, (cell.strip() for cell in body[others[0]])))
        notes.append(f"another table begins below (columns {names}): {counted(len(body) - others[0], 'row')} not read")
        body, lines = body[: others[0]], lines[: others[0] + 1]
    if not any(kind.startswith("levelling") for kind in kinds):  # each book has points and heights of its own
        body = tuple(row for k, row in enumerate(body) if k not in again)
    header, *body_rows = _without_index((header, *body))
    header, body = _with_joined_parts(header, tuple(body_rows))
    if twice := sorted({cell for cell in header if cell and header.count(cell) > 1}):
        notes.append(f"column {', '.join(map(repr, twice))} is given twice: the first one is read")
        keep = [k for k, cell in enumerate(header) if not cell or cell not in header[:k]]
        header, body = tuple(header[k] for k in keep), tuple(tuple(_cell(row, k) for k in keep) for row in body)
    return (header, *body), lines, tuple(notes)


def _begins_alike(row: tuple[str, ...], header: tuple[str, ...]) -> bool:
    first, other = _normalised(_cell(header, 0)), _normalised(_cell(row, 0))
    return first == other != "" and sum(bool(cell.strip()) for cell in row) > 2


def _repeats(row: tuple[str, ...], header: Sequence[str], used: Collection[str]) -> bool:
    """Return whether a row has the header once more, at least its columns that are used."""
    return all(_cell(row, k) == cell for k, cell in enumerate(header) if cell in used)


def _with_joined_parts(header: tuple[str, ...], body: _Cells) -> tuple[tuple[str, ...], _Cells]:
    """Degrees, minutes and seconds below one heading, with two columns beside it that have none, as one column."""
    for k in range(len(header) - 2):
        if not header[k] or not all(not cell or _PLACEHOLDER.fullmatch(cell) for cell in header[k + 1 : k + 3]):
            continue
        cells = [[_whole(_cell(row, j)) for j in (k, k + 1, k + 2)] for row in body]
        parts = [[cell or "0" for cell in three] if three[0] else three for three in cells]
        if sum(map(all, cells)) > 1 and all(map(_is_sexagesimal, parts)):
            angles = ("-".join(three) if any(three) else "" for three in parts)
            below = tuple((*row[:k], angle, *row[k + 3 :]) for row, angle in zip(body, angles, strict=True))
            return _with_joined_parts((*header[: k + 1], *header[k + 3 :]), below)
    return header, body


def _columns_that_are_known(row: Sequence[str]) -> int:
    return sum(text in _KNOWN for _, text, _ in _named([cell.strip() for cell in row if cell.strip()]))


def _is_heading(row: Sequence[str]) -> bool:
    """Return whether no cell is a number, or few beside the names of the columns of a known table."""
    numbers = sum(bool(_NUMBER.fullmatch(cell.strip())) for cell in row)
    return not numbers or (3 * numbers < sum(bool(cell.strip()) for cell in row) and bool(_kinds(_named(row))))


def _fits(header: Sequence[str]) -> bool:
    """Return whether a row has the columns of a known table, perhaps of one with stations in rows of their own."""
    named = _named([cell.strip() for cell in header])
    return len(named) > 1 and bool(_kinds(named) or _kinds([*named, ("", "station", "")]))


def _tidied(rows: _Cells) -> tuple[_Cells, dict[str, str]]:
    """Rows with whole headings and without units below them, with the station in every row, and the units."""
    if not rows or not _fits(rows[0]):
        return rows, {}
    header, body = tuple(cell.strip() for cell in rows[0]), rows[1:]
    merged = _with_subheadings(header, body[0]) if body else ()
    is_merged = bool(merged) and _fits(merged)
    if is_merged:
        header, body = merged, body[1:]
    units = [cell.strip(" []()") for cell in body[0]] if body else []
    stated = {}
    known = [_WORDS_OF_UNITS.get(unit) or _WORDS_OF_UNITS.get(unit.lower(), "") for unit in units]
    if any(units) and all(word for word, unit in zip(known, units, strict=True) if unit not in ("", "-")):
        stated = {cell: unit for cell, unit in zip(header, known, strict=False) if unit}
        body = body[1:]
    named = _named(header)
    if not _kinds(named):
        return _with_stations(header, body) or rows, stated
    columns: Mapping[str, str] = next(iter(_kinds(named).values()))
    places = [header.index(columns[name]) for name in _STATION if name in columns]
    body = _without_zeros_below(header, body, columns, places)
    empty = [bool(places) and len(row) == len(header) and not row[places[0]].strip() for row in body]
    if not is_merged and not stated and not any(empty[1:]):
        return rows, {}
    filled: list[tuple[str, ...]] = []
    if any(empty) and "set" in KINDS[next(iter(_kinds(named)))][1]:
        header, body, columns = _with_set_ups(header, body, columns)
        empty = [len(row) == len(header) and not row[places[0]].strip() for row in body]
    for row, below in zip(body, empty, strict=True):
        above = filled[-1] if filled and below and len(filled[-1]) == len(header) else row
        sets = () if above is row or "set" not in columns else (header.index(columns["set"]),)
        filled.append(
            tuple(above[k] if k in places or (k in sets and not cell) else cell for k, cell in enumerate(row))
        )
    return (header, *filled), stated


def _without_zeros_below(header: Sequence[str], body: _Cells, columns: Mapping[str, str], places: list[int]) -> _Cells:
    """Rows without the name 0 of a station if it stands below another one and no sight leads to 0."""
    targets = [header.index(columns[name]) for name in ("to", "point") if name in columns]
    if not places or not targets or any(_cell(row, k) == "0" for row in body for k in targets):
        return body
    place, first = places[0], next(iter(body), ())
    if _cell(first, place) in ("", "0"):
        return body
    return tuple((*row[:place], "", *row[place + 1 :]) if _cell(row, place) == "0" else row for row in body)


def _with_set_ups(
    header: tuple[str, ...], body: _Cells, columns: Mapping[str, str]
) -> tuple[tuple[str, ...], _Cells, Mapping[str, str]]:
    """Rows below their stations with other names of sets where a station is set up once more, after another one."""
    place, visits, last, row_visits = header.index(columns["station"]), dict[str, int](), "", list[int]()
    for row in body:
        name = _cell(row, place)
        visits[name] = visits.get(name, 0) + bool(name and name != last)
        last = name or last
        row_visits.append(visits.get(last, 1))
    if max(row_visits, default=1) == 1:
        return header, body, columns
    if "set" not in columns:
        header, body, columns = (*header, "set"), tuple((*row, "") for row in body), {**columns, "set": "set"}
    k, last = header.index(columns["set"]), ""
    rows = list[tuple[str, ...]]()
    for row, visit in zip(body, row_visits, strict=True):
        last = _cell(row, k) or ("" if _cell(row, place) else last)
        name = last if visit == 1 else f"{last} ({visit})".strip()
        rows.append((*row[:k], name, *row[k + 1 :]))
    return header, tuple(rows), columns


def _with_subheadings(header: Sequence[str], below: Sequence[str]) -> tuple[str, ...]:
    """Names of columns from headings, each for several columns, and subheadings below them; empty if there are none."""
    if any(_NUMBER.fullmatch(cell.strip()) for cell in below) or len(below) != len(header):
        return ()
    names, group, divided = list[str](), "", False
    parts = [_name_and_unit(part.strip())[0] for part in below]
    for cell, part, name in zip(header, below, parts, strict=True):
        is_own = bool(cell) and not _PLACEHOLDER.fullmatch(cell)
        group = cell if is_own else group
        divided |= bool(part) and not is_own
        # A name of its own that no other group has needs none, as the height behind the readings of a book.
        # Headings of up to three letters such as D, M, S and sec say nothing without the one above them.
        is_alone = not is_own and name in _KNOWN and len(name) > 3 and parts.count(name) == 1
        names.append((part.strip() if is_alone else f"{group} {part.strip()}") if part.strip() else cell)
    return _with_hairs(names) if divided else ()


def _hairs(header: Sequence[str]) -> dict[str, tuple[int, int, int]]:
    """Places of the upper, middle and lower hair of readings back, forward and between, where all three are."""
    names, found = [_name_and_unit(cell.strip())[0] for cell in header], dict[str, tuple[int, int, int]]()
    for ours, others in _HAIRED_NAMES.items():
        for forms in _HAIRS:
            rest = [[name[len(other) :] for other in others if name.startswith(other)] for name in names]
            places = [[k for k, ends in enumerate(rest) if any(map(form.fullmatch, ends))] for form in forms]
            if all(len(one) == 1 for one in places) and len({one[0] for one in places}) == len(places):
                found.setdefault(ours, (places[0][0], places[1][0], places[2][0]))
    return found


def _with_hairs(header: Sequence[str]) -> tuple[str, ...]:
    """Header of a levelling book in which the hairs of readings have names that are known, and their units."""
    cells = list(header)
    for ours, places in _hairs(header).items():
        for k, hair in zip(places, ("upper", "middle", "lower"), strict=True):
            unit = _name_and_unit(cells[k].strip())[1]
            cells[k] = f"{ours} {hair} [{unit}]" if unit else f"{ours} {hair}"
    return tuple(cells if _columns("levelling", _named(cells)) else header)


def _with_whole_readings(rows: _Cells) -> tuple[_Cells, tuple[str, ...]]:
    """Rows with the mean of three hairs in columns beside each other, and 100 times their interval; and a note on it.

    Where the middle hair is not the mean of the others in every row, it alone is the reading.
    """
    hairs = _hairs(rows[0]) if rows else {}
    read = {ours: [[_number(_cell(row, k)) for k in places] for row in rows[1:]] for ours, places in hairs.items()}
    if not {"back", "fore"} <= read.keys() or not all(_are_wires(one) for found in read.values() for one in found):
        return rows, ()
    unit = _name_and_unit(rows[0][hairs["back"][1]].strip())[1]
    ends = {"back": "back_distance", "fore": "fore_distance"}
    header = [f"{name} [{unit}]" if unit else name for name in (*read, *ends.values())]
    left = {k for places in hairs.values() for k in places}
    lines = [(*(cell for k, cell in enumerate(rows[0]) if k not in left), *header)]
    for k, row in enumerate(rows[1:]):
        three = {ours: [value for value in found[k] if value is not None] for ours, found in read.items()}
        means = [f"{sum(values) / 3:.9g}" if values else "" for values in three.values()]
        sights = (three["back"], three["fore"] or three.get("between", []))
        far = [f"{100.0 * (values[0] - values[2]):.9g}" if values else "" for values in sights]
        full = (*row, *[""] * (len(rows[0]) - len(row)))
        lines.append((*(cell for k, cell in enumerate(full) if k not in left), *means, *far))
    count = sum(any(one[0] is not None for one in found) for found in zip(*read.values(), strict=True))
    return tuple(lines), (f"three wires at {counted(count, 'point')}: their mean, and 100 times their interval",)


def _number(cell: str) -> float | None:
    return float(cell.replace(",", ".")) or None if _NUMBER.fullmatch(cell) else None


def _with_whole_angles(rows: _Cells) -> _Cells:
    for k, row in enumerate(rows[:_TITLES]):
        names = [_bare_name(cell) for cell in row]
        for j in range(len(row) - 2):
            if quadrant := _PARTS_OF_QUADRANT.match(" ".join(names[j:])):
                end = j + len(quadrant[0].split())
                bearings = (
                    f"{line[j]} {'-'.join(map(_whole, line[j + 1 : end - 1]))} {line[end - 1]}"
                    if len(line) >= end and any(line[j:end])
                    else ""
                    for line in rows[k + 1 :]
                )
                below = ((*ln[:j], text, *ln[end:]) for ln, text in zip(rows[k + 1 :], bearings, strict=True))
                return _with_whole_angles((*rows[:k], (*row[:j], "bearing", *row[end:]), *below))
            found = [form.fullmatch(name) for form, name in zip(_PARTS, names[j : j + 3], strict=True)]
            before = {match[1] for match in found if match}
            if None in found or len(before) > 1:
                continue
            cells = [[_whole(cell) for cell in line[j : j + 3]] for line in rows[k + 1 :]]
            name = before.pop()
            if not name and len(names[j]) == 1 and names[j].isalpha() and not all(map(_is_sexagesimal, cells)):
                continue
            if not name:
                header = (*row[:j], "angle", *row[j + 3 :])
                name = "angle" if _columns("angle", _named(header)) else "direction"
            parts = ("-".join(cell or "0" for cell in three) if any(three) else "" for three in cells)
            joined = (
                (*line[:j], angle, *line[j + 3 :]) if len(line) > j + 2 else line
                for line, angle in zip(rows[k + 1 :], parts, strict=True)
            )
            return _with_whole_angles((*rows[:k], (*row[:j], name, *row[j + 3 :]), *joined))
    return rows


def _without_packed_angles(rows: _Cells) -> tuple[_Cells, tuple[str, ...]]:
    """Rows with d-m-s for angles in degrees, minutes and seconds behind one point, as 12.3456; and a note on them.

    Of other angles one in three has minutes and seconds below 60 in this sense.
    """
    header, body, notes = tuple(cell.strip() for cell in rows[0]) if rows else (), rows[1:], list[str]()
    places = {cell for columns in _kinds(_named(header)).values() for name, cell in columns.items() if name in _ANGLES}
    for k in (k for k, cell in enumerate(header) if cell in places):
        cells = [_PACKED.fullmatch(_cell(row, k).replace(",", ".")) for row in body]
        digits = [(match["rest"] or "").ljust(4, "0") for match in cells if match]
        long = {text for text in digits if len(text.rstrip("0")) > 2}
        numbers = [_cell(row, k) for row in body if _NUMBER.fullmatch(_cell(row, k))]
        # Twelve different angles tell d.mmss: in others all minutes and seconds are below 60 once in 200 000 tables.
        if len(long) < 12 or len(digits) < len(numbers) or any(max(t[:1], t[2:3]) > "5" for t in digits):
            continue
        texts = []
        for row, match in zip(body, cells, strict=True):
            rest = (match["rest"] or "").ljust(4, "0") if match else ""
            seconds = f"{rest[2:4]}.{rest[4:]}".rstrip(".")
            texts.append(f"{match['whole']}-{rest[:2]}-{seconds}" if match else _cell(row, k))
        rows = _replaced(rows, k, header[k], texts)
        body = rows[1:]
        notes.append(f"column {header[k]!r}: degrees, minutes and seconds as d.mmss")
    return rows, tuple(notes)


def _is_sexagesimal(cells: Sequence[str]) -> bool:
    """Return whether three cells are degrees, minutes and seconds, or empty."""
    if not any(cells):
        return True
    if not all(map(_NUMBER.fullmatch, cells)):
        return False
    minutes, seconds = (float(cell.replace(",", ".")) for cell in cells[1:])
    return minutes.is_integer() and 0.0 <= minutes < 60.0 and 0.0 <= seconds < 60.0


def _without_switched_off(rows: _Cells) -> tuple[_Cells, tuple[str, ...]]:
    """Rows without those that a column of yes and no leaves out, and a note on them."""
    header, body = (rows[0], rows[1:]) if rows else ((), ())
    kinds = _kinds(_named([cell.strip() for cell in header]))
    for k, name in enumerate(map(_normalised, header)):
        cells = [_normalised(_cell(row, k)) or _cell(row, k) for row in body]
        if not kinds or any(kind.startswith("points") for kind in kinds) or not set(cells) <= _YES | _NO:
            continue
        if _OFF.fullmatch(name) or _ON.fullmatch(name):
            unwanted = _YES if _OFF.fullmatch(name) else _NO
            kept = tuple(row for row, cell in zip(body, cells, strict=True) if cell not in unwanted)
            words = f"rows that the column {header[k].strip()} leaves out: {counted(len(body) - len(kept), 'row')}"
            return ((header, *kept), (words,)) if 0 < len(kept) < len(body) else (rows, ())
    return rows, ()


def _without_empty_readings(rows: _Cells) -> _Cells:
    """Rows without names of columns of readings that are empty in each row: of forms that have one for each kind."""
    while len(rows) > 1:
        header = [cell.strip() for cell in rows[0]]
        places = {
            header.index(cell)
            for kind, columns in _kinds(_named(header)).items()
            if not kind.startswith(("points", "images", "stations", "levelling"))
            for name, cell in columns.items()
            if (name in KINDS[kind][0] and name not in (*PLACES, "image")) or name.startswith("sigma")
        }
        listed = _kinds(_named(header)).get("points", {})
        plan = {header.index(listed[axis]) for axis in "xy" if axis in listed}
        empty = {k for k in places | plan if not any(_cell(row, k) for row in rows[1:])}
        empty -= plan if not plan <= empty or "z" not in listed else set()
        if not empty:
            break
        rows = (tuple(f"column{k + 1}" if k in empty else cell for k, cell in enumerate(rows[0])), *rows[1:])
    return rows


def _with_sigmas(rows: _Cells) -> tuple[_Cells, tuple[str, ...]]:
    """Rows with standard deviations for variances, and with 0 for those that a column of yes and no holds fixed.

    Where it does, standard deviations of the other points are of former results, and a note says that they are not
    used.
    """
    header, body = (rows[0], rows[1:]) if rows else ((), ())
    names = [_normalised(cell) for cell in header]
    for k, name in enumerate(names):
        match = _VARIANCE.fullmatch(name)
        cells = [_cell(row, k).replace(",", ".") for row in body]
        others = {"sigma", "sigma1"}.intersection(names)
        if match and not others and all(_NUMBER.fullmatch(cell) and cell[0] != "-" for cell in cells if cell):
            roots = [f"{math.sqrt(float(cell)):.9g}" if cell else "" for cell in cells]
            of = match["of"] or match["behind"] or match["before"] or ""
            rows = _replaced(rows, k, f"sigma_{of}" if of else "sigma", roots)
    kinds = _kinds(_named([cell.strip() for cell in header]))
    points = next((columns for kind, columns in kinds.items() if kind.startswith("points")), {})
    former = [[cell.strip() for cell in header].index(points[name]) for name in points if name.startswith("sigma")]
    notes: tuple[str, ...] = ()
    for k, name in enumerate(names if points else ()):
        match, signs = _HELD.fullmatch(name), dict[str, str]()
        if len(legend := _LEGEND.findall(header[k])) > 1:
            signs = {_normalised(sign): _normalised(word) for word, sign in legend}
        elif _ROLE.fullmatch(name):
            signs = _ROLES
        cells = [_normalised(_cell(row, k)) or _cell(row, k) for row in body]
        cells = [signs.get(cell, cell) for cell in cells]
        axis_named = match["axis"] if match else ""
        axes = [axis for axis in "xyz" if axis in points and (axis_named or axis) in _AXES[axis]]
        is_told = match or (signs and any(cell.isalpha() and cell in _NO for cell in cells))
        if is_told and axes and _YES & set(cells) and set(cells) <= _YES | _NO:
            for place in former:
                notes = ("standard deviations beside a column that says what is fixed are not used",)
                rows = _replaced(rows, place, f"column{place + 1}", [_cell(row, place) for row in rows[1:]])
            zeros = ["0" if cell in _YES else "" for cell in cells]
            rows = _replaced(rows, k, f"sigma_{axes[0]}", zeros)
            for axis in axes[1:]:
                rows = tuple((*row, cell) for row, cell in zip(rows, (f"sigma_{axis}", *zeros), strict=True))
    return rows, notes


def _with_faces(rows: _Cells) -> _Cells:
    """Rows with 1 and 2 for faces that are letters or words."""
    header, body = (rows[0], rows[1:]) if rows else ((), ())
    for k, name in enumerate(map(_normalised, header)):
        cells = [_normalised(_cell(row, k)) for row in body]
        if name in _SIGHT["face"].split("|") and any(cells) and set(cells) <= _FACES.keys():
            rows = _replaced(rows, k, header[k], [_FACES[cell] for cell in cells])
    return rows


def _with_targets(rows: _Cells) -> _Cells:
    """Rows in face 2 with the target of the row above in face 1, if they have none of their own."""
    header, body = ([cell.strip() for cell in rows[0]], rows[1:]) if rows else ([], ())
    columns = next(
        (columns for columns in _kinds(_named(header)).values() if "face" in columns and "to" in columns), {}
    )
    if not columns:
        return rows
    face, to = header.index(columns["face"]), header.index(columns["to"])
    cells = [_cell(row, to) for row in body]
    for k, (above, row) in enumerate(pairwise(body), start=1):
        if not cells[k] and (_cell(above, face), _cell(row, face)) == ("1", "2"):
            cells[k] = cells[k - 1]
    return rows if cells == [_cell(row, to) for row in body] else _replaced(rows, to, rows[0][to], cells)


def _with_station(rows: _Cells) -> tuple[_Cells, tuple[str, ...]]:
    """Rows of directions with a column for their station if there is none, as for one set-up; and a note on it."""
    named = _named([cell.strip() for cell in rows[0]]) if rows else []
    if not named or _kinds(named) or _columns("directions", [("station", "station", ""), *named]) is None:
        return rows, ()
    below = (("station", *row) for row in rows[1:])
    return (("station", *rows[0]), *below), ("no column names the station of the readings: it is called 'station'",)


def _without_zeros(rows: _Cells) -> tuple[_Cells, tuple[str, ...]]:
    """Rows without coordinates that are all 0 if several points have such: they are none. And a note on it."""
    header = [cell.strip() for cell in rows[0]] if rows else []
    kinds = _kinds(_named(header))
    columns = next((columns for kind, columns in kinds.items() if kind.startswith("points")), {})
    places = [header.index(columns[axis]) for axis in "xyz" if axis in columns]
    if len(places) < 2:
        return rows, ()
    bare = [
        row
        for row in rows[1:]
        if all(_ZERO.fullmatch(_cell(row, k)) for k in places) and any(_cell(row, k) for k in places)
    ]
    if len(bare) < 2:
        return rows, ()
    kept = tuple(
        tuple("" if k in places else cell for k, cell in enumerate(row)) if row in bare else row for row in rows[1:]
    )
    return (rows[0], *kept), (f"coordinates that are all 0 are none: {counted(len(bare), 'point')}",)


def _without_zero_readings(rows: _Cells) -> tuple[_Cells, tuple[str, ...]]:
    """Rows without the 0 of a direction or a distance if each row has one of them: it was not measured."""
    header = [cell.strip() for cell in rows[0]] if rows else []
    kinds = _kinds(_named(header))
    pairs = []
    for name in ("horizontal", "distance"):
        columns = next((columns for columns in kinds.values() if name in columns), {})
        pairs.append([header.index(columns[part]) for part in (name, "sigma") if part in columns])
    if not all(pairs):
        return rows, ()
    body, zeros = list(rows[1:]), [[bool(_ZERO.fullmatch(_cell(row, pair[0]))) for pair in pairs] for row in rows[1:]]
    counts = [sum(column) for column in zip(*zeros, strict=True)]
    if min(counts, default=0) < 1 or sum(counts) < 3 or not all(one != other for one, other in zeros):
        return rows, ()
    for number, (row, zero) in enumerate(zip(rows[1:], zeros, strict=True)):
        gone = {place for pair, none in zip(pairs, zero, strict=True) if none for place in pair}
        body[number] = tuple("" if k in gone else cell for k, cell in enumerate(row))
    return (rows[0], *body), (f"readings of 0 beside another reading are none: {counted(sum(counts), 'row')}",)


def _replaced(rows: _Cells, place: int, name: str, cells: Sequence[str]) -> _Cells:
    """Rows with another name and other cells in one column; rows that are too short are filled up."""
    width = len(rows[0])
    full = ((*row, *[""] * (width - len(row))) for row in rows)
    return tuple((*row[:place], cell, *row[place + 1 :]) for row, cell in zip(full, (name, *cells), strict=True))


def _bare_name(cell: str) -> str:
    signs = {"°": "deg", "º": "deg", "''": "sec", '"': "sec", "″": "sec", "'": "min", "′": "min"}
    text = cell.strip().lower()
    for sign, word in signs.items():
        text = text.replace(sign, word)
    return _normalised(text)


def _whole(cell: str) -> str:
    """Part of an angle without the ``.0`` of spreadsheets."""
    return re.sub(r"[.,]0+$", "", cell.strip())


def _with_stations(header: tuple[str, ...], rows: _Cells) -> _Cells:
    """Rows of sights with the stations, which stand in rows of their own without readings; empty if none does."""
    kind, columns = next(iter(_kinds([*_named(header), ("", "station", "")]).items()))
    places = {name: header.index(cell) for name, cell in columns.items() if cell}
    readings = [places[name] for name in KINDS[kind][0] if name in places and name != "to"]
    height = places.get("station_height", places.get("from_height"))
    station, found = ("", ""), list[tuple[str, ...]]()
    for cells in rows:
        row = (*cells, *[""] * (len(header) - len(cells)))
        if "to" in places and not any(row[place].strip() for place in readings):
            station = row[places["to"]], "" if height is None else row[height]
        elif not station[0]:
            return ()
        else:
            found.append((station[0], *(cell or station[1] if k == height else cell for k, cell in enumerate(row))))
    return (("station", *header), *found) if found else ()


def _tell_elevations(kinds: dict[str, dict[str, str]], header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    for kind, (other, column) in _ELEVATIONS.items():
        old = "zenith" if kind == "zenith_directions" else kind
        if kind not in kinds:
            continue
        place = header.index(kinds[kind][old])
        cells = (row[place].strip().replace(",", ".") for row in rows if len(row) > place)
        values = [abs(float(match[0])) for match in map(_LEADING.match, cells) if match]
        # The median of zenith angles is larger than 45 degrees or gon, that of elevations is smaller.
        if values and median(values) < 45.0:
            columns = kinds.pop(kind)
            kinds[other] = {column if name == old else name: cell for name, cell in columns.items()}


def told_apart(tables: Sequence[Found]) -> list[Found]:
    """Return the tables, with those lists of points that hold images of the other tables as lists of images.

    A list ``id, x, y, z`` may hold points, or projection centres by GNSS: the measurements tell which of them. Lists
    of heights alone that lack points that were measured are control. Copies of files of one name get numbers. Raises
    :class:`InputError` for a list with both.
    """
    tables = _with_image_points_apart(_with_names_of_observations(tables))
    paths = dict.fromkeys(table.path for table in tables)
    for k, table in enumerate(tables):
        same = [path for path in paths if path.stem == table.path.stem].index(table.path)
        tables[k] = table._replace(part=f"{table.part}_{same + 1}".strip("_")) if same else table
    images = {name for table in tables if table.kind == "image" for name in table.texts("image")}
    points = {name for table in tables for place in PLACES for name in table.texts(place) if name}
    found = [_told_apart(table, images - points, points) if table.kind == "points" else table for table in tables]
    lists = [table for table in found if table.kind == "points"]
    bare = [dict(zip(t.texts("id"), t.texts("x"), strict=True)) for t in lists if not t.has_header]
    for number, (one, other) in enumerate(pairwise(bare)):
        elsewhere = sum(one[name] != other[name] for name in one.keys() & other.keys())
        if elsewhere > 2 and 2 * elsewhere > len(other):
            path = [t.path for t in lists if not t.has_header][number + 1]
            words = (
                "a list without a header is read as points (name, x, y, z), but another one has the same names at "
                "other places: write a header if these are points in images"
            )
            raise InputError([Message(words, str(path))])
    new = points.difference(*(table.texts("id") for table in lists))
    if not new or any(table.is_control or table.has_sigma or "x" in table.columns for table in lists):
        return found
    words = f"taken as control: {counted(len(new), 'point')} of the measurements are not in it"
    return [t._replace(is_control=True, notes=(*t.notes, words)) if t.kind == "points" else t for t in found]


def _with_names_of_observations(tables: Sequence[Found]) -> list[Found]:
    """Return the tables, with lists of points by the column that has their names in the observations.

    Lists often have numbers of their own beside them.
    """
    found, names = list(tables), {name for table in tables for place in PLACES for name in table.texts(place) if name}
    for k, table in enumerate(tables):
        if table.kind != "points" or not names.isdisjoint(table.texts("id")):
            continue
        for cell in table.unused:
            columns = {**table.columns, "id": cell}
            other = table._replace(columns=columns)
            own = [name for name in other.texts("id") if name]
            if len(set(own)) == len(own) and 2 * len(names.intersection(own)) > len(own):
                unused = tuple(name for name in table.unused if name != cell)
                found[k] = other._replace(unused=(*unused, table.columns["id"]))
                break
    return found


def _with_image_points_apart(tables: Sequence[Found]) -> list[Found]:
    """Return the tables, with other names for points of a table that another table has elsewhere in the same images.

    Tie points and control points are often numbered from 1 each. The table of listed points keeps their names. Raises
    :class:`InputError` if both or neither of them has listed points only.
    """
    found = list(tables)
    listed = {name for table in tables if table.kind == "points" for name in table.texts("id")}
    for one, other in combinations([k for k, table in enumerate(tables) if table.kind == "image"], 2):
        places, names = zip(*(_image_points(found[k]) for k in (one, other)), strict=True)
        shared = places[0].keys() & places[1].keys()
        if not shared:
            continue
        both = [(places[0][key], places[1][key]) for key in shared]
        size = max(abs(value) for pair in both for place in pair for value in place)
        # Two places of one point differ by less than 5 % of the largest image coordinate.
        apart = sum(max(abs(a - b) for a, b in zip(*pair, strict=True)) > 0.05 * size for pair in both)
        if 2 * apart <= len(shared):
            continue
        is_control = [name <= listed for name in names]
        image, point = min(shared)
        first, second = (found[k].path.name for k in (one, other))
        if is_control[0] == is_control[1]:
            words = (
                f"image {image}, point {point} is elsewhere than in {first}: give points of the same name that are "
                "different points other names"
            )
            raise InputError([Message(words, str(found[other].path))])
        k, kept = (one, second) if is_control[1] else (other, first)
        table = found[k]
        place, stem = table.header.index(table.columns["point"]), table.path.stem
        rows = tuple((*row[:place], f"{_cell(row, place)} ({stem})", *row[place + 1 :]) for row in table.rows)
        note = f"points named as in {kept} are elsewhere in the images and other points: called NAME ({stem})"
        found[k] = table._replace(rows=rows, tidied=True, notes=(*table.notes, note))
    return found


def _image_points(table: Found) -> tuple[dict[tuple[str, str], tuple[float, float]], set[str]]:
    """Places by image and point, and the names of the points."""
    keys = list(zip(table.texts("image"), table.texts("point"), strict=False))
    xs, ys = table.numbers("x"), table.numbers("y")
    is_whole = len(keys) == len(xs) == len(ys)
    return dict(zip(keys, zip(xs, ys, strict=False), strict=False)) if is_whole else {}, {point for _, point in keys}


def _told_apart(table: Found, images: set[str], points: set[str]) -> Found:
    ids = table.texts("id")
    of_images, of_points = ([name for name in ids if name in known] for known in (images, points))
    if of_images and of_points:
        words = (
            f"image {of_images[0]!r} and point {of_points[0]!r} are in one list; split it into two tables, "
            "positions of images and points"
        )
        raise InputError([Message(words, str(table.path))])
    return table._replace(kind="images") if of_images else table


class _File(NamedTuple):
    """Rows of a file without comments and empty lines."""

    delimiter: str
    rows: _Cells
    lines: tuple[int, ...]
    above: tuple[str, ...]
    """Cells of a comment that may be the header."""
    encoding: str
    was_joined: bool = False


def _cells(path: Path, sheet: str | None, width: int) -> _File:
    """Rows of a file; ``width``: columns that it is said to have, or 0."""
    if is_spreadsheet(path):
        numbers, cells = sheet_rows(path, sheet)
        return _File(",", tuple(map(tuple, cells)), tuple(numbers), (), "")
    text, encoding = decoded(as_utf8(read_bytes(path, TABLE)))
    if encoding in CODE_PAGES and "\0" in text:
        raise InputError([Message("this is not UTF-8 text", str(path))])
    numbered = [
        (k, ln)
        for k, ln in enumerate(text.split("\n"), start=1)
        if ln.strip() and not ln.startswith(("#", "%")) and not _is_ruler(ln)
    ]
    is_counted = len(numbered) > 1 and numbered[0][1].strip() == str(len(numbered) - 1)
    numbered = numbered[is_counted:]  # the first line was the number of rows
    lines = [line for _, line in numbered]
    comments = [line.strip()[1:] for line in takewhile(lambda line: line.startswith(("#", "%")), text.split("\n"))]
    first = lines[0] if lines else ""
    has_bars = 2 * sum(line.count("|") > 1 for line in lines) > len(lines) and ";" not in text
    if has_bars:
        lines = [line.strip().removeprefix("|").removesuffix("|").replace("|", ";") for line in lines]
        first = lines[0]
    likely = max(";\t,", key=first.count)
    likely = likely if first.count(likely) else " "
    if width:
        delimiter = next(
            (sign for sign in ";\t ," if any(len(row) == width for row in _rows(lines[-1:], sign))), likely
        )
    else:
        signs = sorted((likely, *";\t,"), key=lambda sign: sign == " ")  # a title has blanks, too
        fitting = (sign for sign in signs if any(map(_fits, _rows(lines[:_TITLES], sign))))
        delimiter = next(fitting, likely)
    reader = csv.reader(_spaced(lines, delimiter), delimiter=delimiter)
    try:
        found = [(numbered[reader.line_num - 1][0], tuple(row)) for row in reader if any(map(str.strip, row))]
        heads = [
            tuple(cell.strip() for cell in row) for row in csv.reader(_spaced(comments, delimiter), delimiter=delimiter)
        ]
    except csv.Error as error:
        raise InputError([Message(f"this is not a table: {error}; is a quote not closed?", str(path))]) from None
    above = next((head for head in reversed(heads) if found and len(head) == len(found[0][1])), ())
    joined = (
        is_counted
        or has_bars
        or (delimiter == " " and any(_BRACKETED_UNIT.search(" ".join(line.split())) for line in lines))
    )
    return _File(delimiter, tuple(row for _, row in found), tuple(line for line, _ in found), above, encoding, joined)


def _is_ruler(line: str) -> bool:
    """Return whether a line is drawn below a header, with signs alone."""
    return not line.strip(" \t\r;,|+-=_") and any(2 * sign in line for sign in "-=_")


def _rows(lines: list[str], delimiter: str) -> list[list[str]]:
    try:
        return list(csv.reader(_spaced(lines, delimiter), delimiter=delimiter))
    except csv.Error:
        return []


def _spaced(lines: list[str], delimiter: str) -> list[str]:
    """Lines with one blank between cells if blanks separate them; a unit in brackets belongs to the name before it."""
    if delimiter != " ":
        return lines
    return [_BRACKETED_UNIT.sub(r"\1", " ".join(line.split())) for line in lines]


def has_two_names(rows: Sequence[Sequence[str]]) -> bool:
    """Return whether the rows are two names (from and to), then numbers."""
    words = [[cell.strip().replace(",", ".") for cell in row] for row in rows]
    if not words or not all(len(row) == len(words[0]) > 2 and all(map(_NUMBER.fullmatch, row[2:])) for row in words):
        return False
    starts, ends = {row[0] for row in words}, {row[1] for row in words}
    named = any(not _NUMBER.fullmatch(end) for end in ends)
    return named or (bool(starts & ends) and all(end.isdecimal() for end in starts | ends))


def _check_width(path: Path, line: int, header: tuple[str, ...], body: _Cells, used: Collection[str]) -> None:
    """Refuse columns between blanks if every row is shorter than the header: which column is empty is not known.

    Columns at the end that are not used, as remarks, may be empty.
    """
    names = [cell for cell in header if not _PLACEHOLDER.fullmatch(cell)]
    longest = max((len([cell for cell in row if cell.strip()]) for row in body), default=0)
    if not longest or longest >= len(names):
        return
    last = [_cell(row, longest - 1) for row in body if len(row) >= longest]
    ends = names[longest - 1] not in used or all(_NUMBER.fullmatch(cell.replace(",", ".")) for cell in last)
    if not ends or any(name in used for name in names[longest:]):
        words = (
            f"the header has {len(names)} names and no row more than {longest} values between blanks; separate the "
            "columns by commas or tabs, or write names without blanks"
        )
        raise InputError([Message(words, str(path), line)])


def _padded(rows: _Cells) -> _Cells:
    length = max(map(len, rows), default=0)
    return tuple((*row, *[""] * (length - len(row))) for row in rows)


def _is_list_of_points(rows: Sequence[Sequence[str]]) -> bool:
    """Return whether the rows are name, x, y, z (or nothing), and perhaps codes that are no numbers, each name once."""
    return len({row[0] for row in rows if row}) == len(rows) > 0 and all(
        len(row) == len(rows[0]) >= 4
        and row[0].strip()
        and all(_NUMBER.fullmatch(cell.strip()) for cell in row[1:3])
        and (not row[3].strip() or _NUMBER.fullmatch(row[3].strip()))
        and not any(_NUMBER.fullmatch(cell.strip()) for cell in row[4:])
        for row in rows
    )


def _kinds(named: Sequence[tuple[str, str, str]]) -> dict[str, dict[str, str]]:
    """Columns by their names in a project, for every kind that the table holds.

    If it is none, coordinates may have a suffix (E_GNSS, N_GNSS; dx-ecef, dy-ecef), which is left out.
    """
    found = _kinds_as_named(named)
    if not found:
        matches = [_SUFFIX.fullmatch(cell.strip()) for cell, _, _ in named]
        for end in dict.fromkeys(match["end"] for match in matches if match):
            bare = [
                (cell, *_name_and_unit(match["name"] + match["unit"])) if match and match["end"] == end else entry
                for entry, match in zip(named, matches, strict=True)
                for cell in entry[:1]
            ]
            found = found or _kinds_as_named(bare)
        found = {kind: columns for kind, columns in found.items() if {"x", "dx"} & columns.keys()}
    return found


def _kinds_as_named(named: Sequence[tuple[str, str, str]]) -> dict[str, dict[str, str]]:
    names = {text for _, text, _ in named}
    # Names of the point from which an angle is turned; zenith angle and distance of the row are to the other one.
    backsights = not names.isdisjoint(("backsight", "bs"))
    for kind in ("angle", *KINDS) if backsights else KINDS:
        columns = (_columns(kind, _without_place(named)) if kind == "image" else None) or _columns(kind, named)
        if columns is not None:
            break
    else:
        return {}
    found = {kind: columns}
    if kind == "distance" and _normalised(_name_and_unit(columns[kind])[0]) in _N.length.split("|"):
        levelled = _columns("height_difference", named)
        if levelled is not None:
            return {"height_difference": levelled}
    for other in ("zenith_angle", *_LINES) if kind == "angle" and backsights else _ALSO.get(kind, ()):
        if other in _LINES and not found.keys().isdisjoint(_LINES):
            continue
        own = KINDS[other][0].keys() - {"from", "to"}
        free = [entry for entry in named if entry[0] not in columns.values() or _shared(columns, entry[0])]
        more = _columns(other, free)
        if more is not None and not own.isdisjoint(more):
            found[other] = more
    return found


def _without_place(named: Sequence[tuple[str, str, str]]) -> list[tuple[str, str, str]]:
    """Columns without three that follow each other and have the names of the coordinates of a point."""
    axes = [names.split("|") for names in _POINTS.values()]
    for k in range(len(named) - 2):
        if all(text in names for (_, text, _), names in zip(named[k : k + 3], axes, strict=True)):
            return [*named[:k], *named[k + 3 :]]
    return list(named)


def _shared(columns: Mapping[str, str], cell: str) -> bool:
    """True for a column that says between what, from what height or when something was measured."""
    return any(columns.get(name) == cell for name in (*PLACES, *_SIGHT, *_HEIGHTS))


def _columns(kind: str, named: Sequence[tuple[str, str, str]]) -> dict[str, str] | None:
    """Columns of a kind by their names in a project; ``None`` if one that it must have is missing."""
    required, optional = KINDS[kind]
    cells = dict[str, list[str]]()
    for cell, text, _ in named:
        cells.setdefault(text, []).append(cell)
    columns: dict[str, str] = {}
    for ours, others in (*required.items(), *optional.items()):
        for name in dict.fromkeys((_normalised(ours), *filter(None, others.split("|")))):
            free = [cell for cell in cells.get(name, ()) if cell not in columns.values()]
            if free:
                columns[ours] = free[0]
                break
        else:
            if ours in required:
                return None
    return columns


def _named(header: Sequence[str]) -> list[tuple[str, str, str]]:
    return [(cell, *_name_and_unit(cell)) for cell in header]


def _name_and_unit(cell: str) -> tuple[str, str]:
    """Normalised name and unit of a column heading (``x_mm``, ``x [mm]``, ``x (mm)``)."""
    if len(cell) > 200:
        return cell, ""
    match = _WITH_UNIT.fullmatch(cell.strip())
    if match:
        word = next(group for group in match.groups()[1:] if group is not None)
        if unit := _WORDS_OF_UNITS.get(word) or _WORDS_OF_UNITS.get(word.strip().lower()):
            return _normalised(match[1]), unit
    first = _normalised(_ANOTHER.sub("", cell.strip()))
    return first if first in _KNOWN and _normalised(cell) not in _KNOWN else _normalised(cell), ""


def _normalised(name: str) -> str:
    signed = _SIGNED.fullmatch(name.strip().lower())
    if signed:
        return "back" if signed[1] == "+" else "fore"
    text = unicodedata.normalize("NFKD", name.strip().lower().translate(_UMLAUTS))
    return re.sub(r"[\W_]", "", "".join(letter for letter in text if not unicodedata.combining(letter)))


def _known() -> str:
    hidden = ("images with a camera", "images with positions")
    kinds = {kind: required for kind, (required, _) in KINDS.items() if kind not in hidden}
    return "known are " + "; ".join(f"{kind}: {', '.join(required)}" for kind, required in kinds.items())


# ---- A new project file with comments, begun from the tables that are there.

_SIGMA = {
    "image": "{sigma: 1 um}",
    "zenith_directions": "{sigma_horizontal: 1 mgon, sigma_zenith: 1 mgon}",
    "directions": "{sigma: 1 mgon}",
    "angle": "{sigma: 1 mgon}",
    "bearing": "{sigma: 1 mgon}",
    "zenith_angle": "{sigma: 1 mgon}",
    "vertical_direction": "{sigma: 1 mgon}",
    "distance": "{sigma: 2 mm}",
    "horizontal_distance": "{sigma: 2 mm}",
    "vector": "{sigma: 5 mm}",
    "height_difference": "{sigma: 1 mm}",
}
_VERTICAL = ("zenith_directions", "directions", "zenith_angle", "vertical_direction")
"""Types with a vertical circle, where a table has its readings."""
_VERTICAL_COLUMNS = {"zenith", "vertical", "zenith_angle", "vertical_direction"}
_PLANE = {"angle", "bearing", "directions", "horizontal_distance"}
"""Types without heights."""


_FINEST = 1e-4
"""Standard deviation in degrees or gon below that of any theodolite."""
_DECIMETRE = 0.1
"""Standard deviation in metres that no distance, levelling line or vector exceeds."""


class CameraSettings(NamedTuple):
    """Known settings of the camera; ``None`` if there are none."""

    name: str = "camera"
    constant: float | None = None
    size: tuple[int, int] | None = None
    pixel: str = "0.004 mm"


def begin(
    target: Path,
    tables: Sequence[Found],
    title: str,
    units: tuple[str, str],
    camera: CameraSettings,
    datum: str = "fixed",
) -> dict[Path, str]:
    """Texts by path: the project file and the lists of names that belong to no table.

    ``units``: length and angle; if that of angles is empty, zenith angles or coordinates may tell it.
    """
    listed = {
        name for t in tables if t.kind == "points" and not t.part.startswith(_BENCHMARK) for name in t.texts("id")
    }
    tables = [t for t in tables if t.rows and (not t.part.startswith(_BENCHMARK) or listed.isdisjoint(t.texts("id")))]
    tables = [t._replace(delimiter=",;"[t.decimal_comma]) if t.tidied and t.delimiter == " " else t for t in tables]
    by_kind = {kind: [t for t in tables if t.kind == kind] for kind in ("images", "points", "stations")}
    measured = [t for t in tables if t.kind not in by_kind]
    texts: dict[Path, str] = {}
    for table in tables:
        if table.tidied:
            lines = io.StringIO()
            writer = csv.writer(lines, delimiter=table.delimiter, lineterminator="\n")
            writer.writerows([table.header, *table.rows] if table.has_header else table.rows)
            texts[table.copy(target)] = lines.getvalue()
    seen = [t for t in measured if t.kind == "image"]
    corner = any(_from_a_corner(t) for t in seen)
    kinds = {t.kind for t in measured}
    levelled = bool(measured) and all(t.kind == "height_difference" for t in measured)
    has_heights = any(t.has_heights for t in by_kind["points"])
    in_plan = any("x" in t.columns and not t.has_heights for t in by_kind["points"]) or not (
        has_heights or kinds.isdisjoint(_PLANE)
    )
    is_plane = (kinds <= _PLANE | {"distance"} and in_plan) or (
        "horizontal_distance" in kinds <= _PLANE and not has_heights
    )
    if is_plane:
        flat = [{ours: cell for ours, cell in t.columns.items() if ours != "z"} for t in by_kind["points"]]
        by_kind["points"] = [t._replace(columns=c) for t, c in zip(by_kind["points"], flat, strict=True)]
    in_lists = {name for t in by_kind["points"] for name, z in zip(*map(t.texts, ("id", "z")), strict=False) if z}
    is_flat = bool(measured) and kinds <= _PLANE and not is_plane and in_lists.issuperset(_names(measured, PLACES))
    held = ("x", "y") if levelled else ("z",) if is_flat else ()
    circles = _circles(tables)
    guessed = circles.unit if not units[1] else None
    content = {
        "name": target.name,
        "title": _quoted(title),
        "length": units[0],
        "angle": units[1] or guessed or "gon",
        "angle_guessed": guessed is not None,
        "axes": _exchanged(by_kind["points"]) if circles.reversed else "",
        "zenith": any(t.kind in _VERTICAL and not _VERTICAL_COLUMNS.isdisjoint(t.columns) for t in measured),
        "camera": _camera(camera, corner, seen) if seen or by_kind["images"] else None,
        "more_images": _rest(target, "images", _names(seen, ("image",)), by_kind["images"], texts),
        "more_points": _rest(
            target, "points", _names(measured, PLACES), [*by_kind["points"], *by_kind["stations"]], texts
        ),
        "observations": [_entry(target, table, corner) for table in measured],
        "datum": datum,
        "levelled": levelled,
        "plane": is_plane,
        **{
            kind: [
                _entry(target, table, corner, held, table.is_control and not table.has_sigma and datum == "fixed")
                for table in found
            ]
            for kind, found in by_kind.items()
        },
    }
    return {target: _rendered("new.yaml.j2", content), **texts}


def _quoted(text: str) -> str:
    return str(yaml.safe_dump(text, allow_unicode=True, width=1000)).split("\n")[0]


def _rendered(template: str, content: dict[str, Any]) -> str:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("mor.project"),
        undefined=StrictUndefined,
        trim_blocks=True,
        autoescape=False,
        keep_trailing_newline=True,
    )
    return environment.get_template(template).render(content)


def begin_test(target: Path, title: str, protocol: str) -> dict[Path, str]:
    """Texts by path: the project of a test by ISO 17123 or VDI/VDE 2634, and its table to fill in."""
    content = {"name": target.name, "title": _quoted(title)}
    if protocol == "iso17123-4":
        table, header = "distances.csv", "from,to,distance"
        pairs = [(str(one), str(other)) for one, other in combinations(range(1, 8), 2)]
    elif protocol == "vdi2634-1":
        table, header = "lengths.csv", "from,to,distance"
        pairs = [(f"L{line}-1", f"L{line}-{end}") for line, end in product(range(1, 8), range(2, 7))]
        content["ends"] = ", ".join(f"[L{line}-{end}]" for line, end in product(range(1, 8), range(1, 7)))
    elif protocol == "iso17123-5":
        table, header = "coordinates.csv", "system,point,x,y,z"
        set_ups = list(product("123", "123"))
        pairs = [(f"{series}-{k}", f"{to},,") for series, k in set_ups for to in "123" if to != k]
        content["systems"] = "\n      - ".join(f'["{one}-{k}", "{k}", 0, 0, 1]' for one, k in set_ups)
    elif protocol == "iso17123-8":
        table, header = "positions.csv", "series,set,point,x,y,z"
        pairs = [(f"{series},{k}", f"{point},,") for series, k, point in product("123", "12345", "12")]
    else:
        table, header = "directions.csv", "station,to,horizontal"
        sets, targets = list(product(range(1, 5), range(1, 4))), list(product(range(1, 5), range(2, 6)))
        pairs = [(f"S{series}-{k}", f"T{series}-{t}") for series, k in sets for t in range(1, 6)]
        content |= {
            "stations": ", ".join(f"[S{series}-{k}, S]" for series, k in sets),
            "targets": ", ".join(f"[T{series}-{t}]" for series, t in targets),
            "distances": ", ".join(f"[S, T{series}-{t}]" for series, t in targets),
        }
    rows = "".join(f"{one},{other},\n" for one, other in pairs)
    return {target: _rendered(f"{protocol}.yaml.j2", content), target.with_name(table): f"{header}\n{rows}"}


def _camera(settings: CameraSettings, corner: bool, seen: Sequence[Found]) -> dict[str, Any]:
    width, height = settings.size or (_format(seen) if corner else (None, None))
    return {
        "name": settings.name,
        "constant": settings.constant or 28,
        "guessed": settings.constant is None,
        "r0": 14,
        "width": width,
        "height": height,
        "pixel": settings.pixel,
        "sure": settings.size is not None,
        "corner": corner,
    }


def _format(seen: Sequence[Found]) -> tuple[int, int]:
    """Width and height of a format 3 : 2 that holds the image points."""
    values = (
        value / size for table in seen for axis, size in (("x", 1500), ("y", 1000)) for value in table.numbers(axis)
    )
    times = max(4, math.ceil(max(values, default=0.0)))
    return 1500 * times, 1000 * times


def _from_a_corner(table: Found) -> bool:
    if table.units.get("x", "px") != "px":
        return False
    values = [value for name in "xy" for value in table.numbers(name)]
    # Image coordinates that go beyond 100 and never below zero are pixels from a corner.
    return bool(values) and min(values) >= 0.0 and max(values) > 100.0


class _Circles(NamedTuple):
    """Unit and sense of angles, as the angles and the coordinates beside them tell."""

    unit: str | None = None
    """Degrees or gon; empty if the angles do not tell, ``None`` if all are in a stated unit."""
    reversed: bool = False
    """True if angles agree with coordinates only in the other sense."""


def _circles(tables: Sequence[Found]) -> _Circles:
    """Return the unit and the sense of horizontal angles.

    Most sights are level, or else horizontal angles agree with coordinates, or those of a traverse close.
    """
    bare = [table for table in tables if any(_is_bare(table, name) for name in _ANGLES)]
    places = {
        name: (float(x.replace(",", ".")), float(y.replace(",", ".")))
        for table in tables
        if table.kind == "points"
        for name, x, y in zip(*map(table.texts, ("id", "x", "y")), strict=False)
        if _NUMBER.fullmatch(x) and _NUMBER.fullmatch(y)
    }
    off = {(unit, sense): [_misfit(table, places, _CIRCLES[unit], sense) for table in tables] for unit, sense in _WAYS}
    best = {way: min((size for size in sizes if size is not None), default=1.0) for way, sizes in off.items()}
    for name, full in _CIRCLES.items():
        sums = [abs((total / full * 2.0 + 0.5) % 1.0 - 0.5) for table in bare for total in _traversed(table)]
        best[name, 1] = min([best[name, 1], *sums])
    zeniths = [v for t in bare for name in ("zenith", "zenith_angle") if name not in t.units for v in t.numbers(name)]
    least = {name: min(best[name, 1], best[name, -1]) for name in _CIRCLES}
    level = [median(abs(v % (full / 2) - full / 4) for v in zeniths or (0.0,)) for full in _CIRCLES.values()]
    # Zenith angles tell the unit if half of the sights rise or fall by at most 2 degrees or gon; steep ones do not.
    if min(level) < 2.0:
        least = dict(zip(_CIRCLES, level, strict=True))
    first, second = sorted(_CIRCLES, key=lambda name: least[name])
    told = (first if least[first] < _AGREES * least[second] else "") or _by_range(bare)
    known = told or "gon"
    # With exchanged axes angles agree within 2 % of the circle.
    is_reversed = best[known, -1] < min(_AGREES * best[known, 1], 0.02)
    return _Circles(told if bare else None, is_reversed)


def _by_range(tables: Sequence[Found]) -> str:
    """Unit of directions: gon go beyond 360; several that end right below 360 are back where their set began."""
    values = [v for table in tables if "horizontal" not in table.units for v in table.numbers("horizontal")]
    if max(values, default=0.0) >= 360.0:
        return "gon"
    return "deg" if sum(v > 359.9 for v in values) > 1 else ""


def _traversed(table: Found) -> Iterator[float]:
    """Sum of the angles of a closed traverse, a multiple of half a circle; nothing if they are not those of one."""
    if table.kind != "angle":
        return
    numbers = table.numbers("angle")
    ends = dict(zip(table.texts("at"), table.texts("to"), strict=False))
    if len(ends) == len(table.rows) == len(numbers) > 2:
        at = start = next(iter(ends))
        passed = 0
        while at in ends and passed < len(ends) and (passed == 0 or at != start):
            at, passed = ends[at], passed + 1
        if at == start and passed == len(ends):
            yield sum(numbers)


def _exchanged(points: Iterable[Found]) -> str:
    """Axes of coordinates that fit angles in the other sense: x leads north if the columns do not say otherwise."""
    named = {_name_and_unit(table.columns.get("x", ""))[0] for table in points}
    return "{xy: ne}" if named <= {"x", "x0", "xo", "xcoord", "xcoordinate", "coordx"} else "{angles: counterclockwise}"


def _is_bare(table: Found, name: str) -> bool:
    """Return whether a table has angles of this name that are plain numbers in no stated unit."""
    return name in table.columns and name not in table.units and bool(table.numbers(name))


def _misfit(table: Found, places: Mapping[str, tuple[float, float]], full: float, sense: int) -> float | None:
    """Median misfit of angles to coordinates as part of the circle, ``None`` without both.

    Angles in no stated unit are in the unit that has ``full`` in a circle. ``sense`` -1 is that of exchanged axes.
    """
    # Columns with the point of the circle, where an angle begins and ends, and the reading.
    names = {
        "angle": ("at", "from", "to", "angle"),
        "bearing": ("from", "from", "to", "bearing"),
        "directions": ("station", "station", "to", "horizontal"),
        "zenith_directions": ("station", "station", "to", "horizontal"),
    }.get(table.kind)
    if names is None:
        return None
    before: tuple[str, float, float] | None = None
    apart = list[float]()
    sets = table.texts("set") or [""] * len(table.rows)
    full = {"deg": 360.0, "gon": 400.0}.get(table.units.get(names[3], ""), full)
    for at, start, end, text, number in zip(*map(table.texts, names), sets, strict=False):
        value = _turn(text.replace(",", ".") if table.decimal_comma else text, full)
        if value is None or not {at, start, end} <= places.keys() or places[at] == places[end]:
            continue
        back, ahead = (
            math.atan2(places[name][0] - places[at][0], places[name][1] - places[at][1]) / math.tau
            for name in (start, end)
        )
        if table.kind == "angle":
            apart.append(value - sense * (ahead - back))
        elif table.kind == "bearing":
            apart.append(value - (ahead if sense > 0 else 0.25 - ahead))
        else:
            last, before = before, (f"{at} {number}", value, ahead)
            if last is not None and last[0] == before[0]:
                apart.append(before[1] - last[1] - sense * (ahead - last[2]))
    return median(abs((size + 0.5) % 1.0 - 0.5) for size in apart) if apart else None


def _turn(text: str, full: float) -> float | None:
    """An angle as part of the circle; degrees, minutes and seconds may be in one cell."""
    if _NUMBER.fullmatch(text):
        return float(text) / full if "," not in text else None
    if not _DMS.match(text):
        return None
    degrees, minutes, *seconds = map(float, re.findall(r"\d+\.?\d*", text)[:3])
    return (degrees + minutes / 60.0 + sum(seconds) / 3600.0) / 360.0


def _names(tables: Iterable[Found], columns: Sequence[str]) -> list[str]:
    names = (name for table in tables for column in columns for name in table.texts(column))
    return list(dict.fromkeys(name for name in names if name))


def _units_of_precision(table: Found) -> dict[str, str]:
    """Units of standard deviations and covariances that would be too large or small in the units of the project.

    Those of lengths above a decimetre are millimetres, those of angles above a tenth of a degree or gon seconds of arc,
    those of angles finer than any theodolite radians.
    """
    is_angle = table.kind in ("directions", "angle", "bearing", "zenith_angle", "zenith_directions")
    is_list_of_heights = table.kind == "points" and "x" not in table.columns
    if table.kind not in (*_LINES, "height_difference", "vector") and not (is_angle or is_list_of_heights):
        return {}
    variances = [value for name in ("cov_dx_dx", "cov_dy_dy", "cov_dz_dz") for value in table.numbers(name)]
    stated = [name for name in table.columns if name.startswith("sigma") and "height" not in name]
    sizes = [math.sqrt(abs(variance)) for variance in variances]
    sizes += [value for name in stated for value in table.numbers(name)]
    is_fine = is_angle and 0.0 < median(sizes or [0.0]) < _FINEST
    if not sizes or (median(sizes) < _DECIMETRE and not is_fine):
        return {}
    stated += [name for name in table.columns if name.startswith("cov_")]
    return {name: "rad" if is_fine else "arcsec" if is_angle else "mm" for name in stated if name not in table.units}


_ON_ONE_LINE: Mapping[str, Any] = {
    "default_flow_style": True,
    "sort_keys": False,
    "width": 100_000,
    "allow_unicode": True,
}


def _rest(target: Path, what: str, names: list[str], tables: list[Found], texts: dict[Path, str]) -> str:
    listed = set(_names(tables, ("id",)))
    rest = [name for name in names if name not in listed]
    if not rest:
        return ""
    if len(rest) <= LONGEST:
        rows = yaml.safe_dump([[name] for name in rest], **_ON_ONE_LINE).strip()
        return f"columns: [id]\n    rows: {rows}"
    path = target.with_name(f"{target.stem}_{what}.csv")
    texts[path] = "id\n" + "".join(f"{guarded(name)}\n" for name in rest)
    return f"file: {path.name}"


def _entry(target: Path, table: Found, corner: bool, held: Sequence[str] = (), is_held: bool = False) -> dict[str, Any]:
    """Entry of the template for a table; ``held``: coordinates that nothing measures.

    ``is_held``: all coordinates in it are held.
    """
    renamed = {theirs: ours for ours, theirs in table.columns.items() if ours != theirs}
    others = [name for name in table.header if name not in table.columns.values()]
    guessed = _units_of_precision(table)
    units = {**table.units, **guessed}
    units |= dict.fromkeys((name for name in _ANGLES if any(map(_DMS.match, table.texts(name)))), "dms")
    if "km" in _normalised(table.columns.get("length", "")):
        units.setdefault("length", "km")
    keys: dict[str, Any] = {"sheet": table.sheet} if table.sheet and not table.tidied else {}
    if not table.has_header:
        keys["columns"] = [renamed.get(name, name if name in table.columns else None) for name in table.header]
    elif renamed or others:
        keys["columns"] = {**renamed, **dict.fromkeys(others)}
    if units:
        keys["units"] = units
    if table.delimiter != ",":
        keys["delimiter"] = table.delimiter
    if table.decimal_comma:
        keys["decimal"] = ","
    if held:
        keys |= ({} if held[0] in table.columns else {"values": dict.fromkeys(held, 0)}) | {"fixed": list(held)}
    if is_held:
        keys["fixed"] = list(
            dict.fromkeys([*keys.get("fixed", ()), *(axis for axis in "xyz" if axis in table.columns)])
        )
    lines = [f"{key}: {yaml.safe_dump(value, **_ON_ONE_LINE).splitlines()[0]}" for key, value in keys.items()]
    if table.header[:4] == _OF_POINTS and not table.has_header:
        lines[0] += "  # CHECK the order: the file has no header"
    lines = [f"{line}  # CHECK" if is_held and line.startswith("fixed:") else line for line in lines]
    lines = [
        f"{line}  # CHECK: the standard deviations are no usual ones in the unit of the readings"
        if line.startswith("units:") and guessed
        else line
        for line in lines
    ]
    return {
        "kind": table.kind,
        "file": Path(os.path.relpath(table.copy(target) if table.tidied else table.path, target.parent)).as_posix(),
        "details": lines,
        "has_camera": "camera" in table.columns,
        "has_sigma": table.has_sigma or is_held,
        "of": "1 km" if "length" in table.columns else "your measurements",
        "sigma": "{sigma: 0.3 px}" if table.kind == "image" and corner else _SIGMA.get(table.kind, ""),
    }
