"""Kinds of tables, and the names that their columns have in many languages."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence
from importlib.resources import files
from itertools import product
from types import SimpleNamespace
from typing import Any

import yaml

from mor.units import ANGLE_UNITS, LENGTH_UNITS, PIXEL

_LISTED = yaml.load(
    files("mor.project").joinpath("column_names.yaml").read_text(encoding="utf-8"),
    Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader),
)


def _names(said: Any) -> list[str]:
    """Names as ``column_names.yaml`` lists them."""
    if isinstance(said, dict):
        if "sigma_of" in said:
            words = ["sigma", "sig", "std", "stdev", "stddev", "sd", "err", "error", "stdabw", "ско", "中误差"]
            own = _names(said["sigma_of"])
            both = [text for name, word in product(own, words) for text in (f"{word}{name}", f"{name}{word}")]
            return [*both, *(f"s{name}" for name in own)]
        left_out = said.get("without", "").split()
        ends = [end for part in said.get("with", [""]) for end in str(part).split() or [""]]
        return [f"{name}{end}" for name in _names(said["names"]) if name not in left_out for end in ends]
    return said.split() if isinstance(said, str) else [name for part in said for name in _names(part)]


def _joined(columns: Mapping[str, Any]) -> dict[str, str]:
    """Names of columns, joined by bars."""
    return {ours: "|".join(_names(others)) for ours, others in columns.items()}


NAMES = SimpleNamespace(**_joined({meaning: names for meaning, names in _LISTED.items() if isinstance(names, str)}))
"""Names of columns in many languages by their meaning, each list joined by bars."""
SIGHT = _joined(_LISTED["sight"])
"""Columns of sights besides their readings, with their names."""
STAFF_DISTANCES, SECOND_READINGS = tuple(_LISTED["staff_distances"]), tuple(_LISTED["second_readings"])
AXES = {"x": "xe", "y": "yn", "z": "zhu"}
KINDS = {kind: (_joined(columns["must"]), _joined(columns["may"])) for kind, columns in _LISTED["kinds"].items()}
"""Columns that a kind of table must have, and those that it may have, with other names for each.

The first kind whose columns are all there is taken. Names are compared in lower case without blanks and signs.
"""
SIGMAS = {kind: columns["precision"] for kind, columns in _LISTED["kinds"].items() if "precision" in columns}
"""Standard deviations that a new project proposes for each kind of measurements."""
KNOWN_NAMES = {re.sub(r"[\W_]", "", ours) for columns in KINDS.values() for part in columns for ours in part} | {
    name for columns in KINDS.values() for part in columns for names in part.values() for name in names.split("|")
}
"""All names of columns."""
_ANOTHER = re.compile(r"\s*(?:\(.*\)|\[.*\]|/(?!\s*(?:lon|lat)).*|;.*)$", re.IGNORECASE)
"""A second name behind the first one of a column: Northing (Y), X/East; not X/Longitude."""
_MEASURED = re.compile(
    "observed |measured |gemessene[rs]? |beobachtete[rs]? |observad[oa] |medid[oa] |实测", re.IGNORECASE
)
"""Words before the name of a reading."""
_WITH_UNIT = re.compile(r"(.*?)[\s_]*(?:\[([^\]]*)\]|\(([^)]*)\)|[\s_]in[\s_]([A-Za-zµ]+)|_([A-Za-zµ]+))")
LINES = ("distance", "horizontal_distance")
"""Kinds of distances: one is computed from the other where a table has both."""
_ALSO = {
    "image": ("points",),
    "zenith_directions": LINES,
    "directions": (*LINES, "height_difference"),
    "zenith_angle": LINES,
    "bearing": ("horizontal_distance", "distance"),
    "distance": ("height_difference",),
}
"""Kinds that a table may hold besides its own, in further columns."""
BENCHMARK = "benchmark"
"""Part of a levelling book with the point whose height is the first one in it."""
NO_READING, SUMS = "rows without readings", "sums of the readings"
_SIGNED = re.compile(r"(?:vista|visada|lectura|leitura|lecture|reading|v|l)?\s*\(?([-+−])\)?")
"""Readings back and forward that have the signs with which they enter the height."""
TOTAL = re.compile(r"sum|total|[σ∑]", re.IGNORECASE)
"""Beginning of the name of a row of sums."""
CONTROL = re.compile(
    r"(?:gcp|gcps|(?:fix|fixed|known|given|held|(?:ground)?control|kesin|fest|bekannte|gegebene|datum)"
    r"(?:points?|coordinates?|heights?|stations?|punkte?|koordinaten|hoehen|(?:koordinat|yuekseklik|nokta)(?:lar|ler)?)"
    r"|gcp(?:s|id|name|label|no)|idgcp|control|festpunkte?|passpunkte?|(?:已知|控制|像控|起算|опорн)\S*"
    r"|(?:puntos|pontos|points|punti|cotas|coordenadas)"
    r"(?:fijos|fixos|(?:de)?control[eo]?|con(?:oc|hec)id[oa]s|(?:de?)?(?:apoyo|apoio|appui|appoggio|calage)))"
)
"""Titles of lists of control points, and headings of their names."""
HEIGHT = re.compile(r"height|hoehe|altitud|vertical|cota|quota|高程|水准")
"""Words of lists of points that are known in height alone."""
DERIVED = re.compile(
    "adjusted|reduced|corrected|computed|calculated|mean|average|result|ajustad|compensad|corregid|corrigid|calculad"
    "|reducid|reduzid|promedi|resultad|ausgeglichen|reduziert|gemittelt|mittel|berechnet|verbessert|ergebnis"
    "|dengelen|duezelt|hesap|ortalama|sonuc|平差|平均|归零|改正|计算|成果|结果"
)
"""Words in titles and headings of values that are no readings."""
_SUFFIX = re.compile(r"(?P<name>[^-_]+)[-_](?P<end>[^-_()\[\]]+)(?P<unit>\s*(?:\(.*\)|\[.*\])?)")
PLACEHOLDER = re.compile(r"column\d+")
"""Name of a column of a spreadsheet that has none."""
UNITS_OF_NAMES = {**LENGTH_UNITS, **ANGLE_UNITS, PIXEL: 1.0}
WORDS_OF_UNITS = {unit: unit for unit in UNITS_OF_NAMES} | {
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
PLACES = ("point", "at", "from", "to", "station")
"""Columns of measurements that name points."""
TITLES = 20
"""Rows among which the header is looked for."""
Cells = tuple[tuple[str, ...], ...]
EMPTY, ZERO = re.compile(""), re.compile(r"(?:0+(?:[.,]0*)?)?")
NUMBER = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?")
ANGLES = ("horizontal", "zenith", "angle", "bearing", "zenith_angle", "vertical_direction")
"""Columns that may hold degrees, minutes and seconds."""
OF_POINTS = ("id", "x", "y", "z")
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


def is_control(title: str) -> bool:
    """Return whether words name control points."""
    return CONTROL.fullmatch(title.strip() if title.strip().startswith("已知") else normalised(title)) is not None


def cell_at(row: tuple[str, ...], place: int) -> str:
    """Return a cell without blanks around it; empty where a row is shorter."""
    return row[place].strip() if place < len(row) else ""


def columns_that_are_known(row: Sequence[str]) -> int:
    """Return how many cells are names of columns."""
    return sum(text in KNOWN_NAMES for _, text, _ in named_columns([cell.strip() for cell in row if cell.strip()]))


def is_heading(row: Sequence[str]) -> bool:
    """Return whether no cell is a number, or few beside the names of the columns of a known table."""
    numbers = sum(bool(NUMBER.fullmatch(cell.strip())) for cell in row)
    return not numbers or (3 * numbers < sum(bool(cell.strip()) for cell in row) and bool(kinds_of(named_columns(row))))


def fits_a_table(header: Sequence[str]) -> bool:
    """Return whether a row has the columns of a known table, perhaps of one with stations in rows of their own."""
    named = named_columns([cell.strip() for cell in header])
    return len(named) > 1 and bool(kinds_of(named) or kinds_of([*named, ("", "station", "")]))


def number_in(cell: str) -> float | None:
    """Return the number in a cell; ``None`` for 0 and for anything else."""
    return float(cell.replace(",", ".")) or None if NUMBER.fullmatch(cell) else None


def kinds_of(named: Sequence[tuple[str, str, str]]) -> dict[str, dict[str, str]]:
    """Columns by their names in a project, for every kind that the table holds.

    If it is none, coordinates may have a suffix (E_GNSS, N_GNSS; dx-ecef, dy-ecef), which is left out.
    """
    found = _kinds_as_named(named)
    if not found:
        matches = [_SUFFIX.fullmatch(cell.strip()) for cell, _, _ in named]
        for end in dict.fromkeys(match["end"] for match in matches if match):
            bare = [
                (cell, *name_and_unit(match["name"] + match["unit"])) if match and match["end"] == end else entry
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
        columns = (columns_of(kind, _without_place(named)) if kind == "image" else None) or columns_of(kind, named)
        if columns is not None:
            break
    else:
        return {}
    found = {kind: columns}
    name, unit = name_and_unit(columns.get("distance", ""))
    if kind == "distance" and (name in NAMES.length.split("|") or unit == "km"):
        levelled = columns_of("height_difference", named)
        if levelled is not None:
            return {"height_difference": levelled}
    for other in ("zenith_angle", *LINES) if kind == "angle" and backsights else _ALSO.get(kind, ()):
        if other in LINES and not found.keys().isdisjoint(LINES):
            continue
        own = KINDS[other][0].keys() - {"from", "to"}
        free = [entry for entry in named if entry[0] not in columns.values() or _shared(columns, entry[0])]
        more = columns_of(other, free)
        if more is not None and not own.isdisjoint(more):
            found[other] = more
    return found


def _without_place(named: Sequence[tuple[str, str, str]]) -> list[tuple[str, str, str]]:
    """Columns without three that follow each other and have the names of the coordinates of a point."""
    axes = [names.split("|") for names in (NAMES.x, NAMES.y, NAMES.z)]
    for k in range(len(named) - 2):
        if all(text in names for (_, text, _), names in zip(named[k : k + 3], axes, strict=True)):
            return [*named[:k], *named[k + 3 :]]
    return list(named)


def _shared(columns: Mapping[str, str], cell: str) -> bool:
    """True for a column that says between what, from what height or when something was measured."""
    return any(columns.get(name) == cell for name in (*PLACES, *SIGHT, "from_height"))


def columns_of(kind: str, named: Sequence[tuple[str, str, str]]) -> dict[str, str] | None:
    """Columns of a kind by their names in a project; ``None`` if one that it must have is missing."""
    required, optional = KINDS[kind]
    cells = dict[str, list[str]]()
    for cell, text, _ in named:
        cells.setdefault(text, []).append(cell)
    columns: dict[str, str] = {}
    for ours, others in (*required.items(), *optional.items()):
        for name in dict.fromkeys((normalised(ours), *filter(None, others.split("|")))):
            free = [cell for cell in cells.get(name, ()) if cell not in columns.values()]
            if free:
                columns[ours] = free[0]
                break
        else:
            if ours in required:
                return None
    return columns


def named_columns(header: Sequence[str]) -> list[tuple[str, str, str]]:
    """Return headings with their normalised names and units."""
    return [(cell, *name_and_unit(cell)) for cell in header]


_BRACKETS = str.maketrans("（）［］", "()[]")


def name_and_unit(cell: str) -> tuple[str, str]:
    """Normalised name and unit of a column heading (``x_mm``, ``x [mm]``, ``x (mm)``)."""
    if len(cell) > 200:
        return cell, ""
    cell = cell.translate(_BRACKETS)
    match, unit, bare = _WITH_UNIT.fullmatch(cell.strip()), "", cell
    if match:
        word = next(group for group in match.groups()[1:] if group is not None)
        unit = WORDS_OF_UNITS.get(word) or WORDS_OF_UNITS.get(word.strip().lower(), "")
        bare = match[1] if unit else cell
    others = (_ANOTHER.sub("", bare.strip()), _MEASURED.sub("", bare.strip()))
    names = (normalised(bare), *map(normalised, others))
    return next((name for name in names if name in KNOWN_NAMES), names[0]), unit


def normalised(name: str) -> str:
    """Return a heading in lower case, without blanks, accents and signs."""
    signed = _SIGNED.fullmatch(name.strip().lower())
    if signed:
        return "back" if signed[1] == "+" else "fore"
    text = unicodedata.normalize("NFKD", name.strip().lower().removeprefix("已知").translate(_UMLAUTS))
    return re.sub(r"[\W_]", "", "".join(letter for letter in text if not unicodedata.combining(letter)))


def known_kinds() -> str:
    """Return the kinds of tables with the columns that they must have, for a message."""
    hidden = ("images with a camera", "images with positions")
    kinds = {kind: required for kind, (required, _) in KINDS.items() if kind not in hidden}
    return "known are " + "; ".join(f"{kind}: {', '.join(required)}" for kind, required in kinds.items())


DECIMETRE = 0.1
"""Standard deviation in metres that no distance, levelling line or vector exceeds."""
