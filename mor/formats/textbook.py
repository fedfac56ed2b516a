"""Read networks of textbooks."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.errors import nearest
from mor.formats.draft import Draft, Line, Row, parse_number
from mor.input_files import read_text
from mor.project.document import Document
from mor.units import ANGLE_UNITS, LENGTH_UNITS, parse_dms

# ---- Sections of a textbook network file: their headers with units, and their lines without comments.

_COMMENT = re.compile(r"(?:^|(?<=\s))[%#]|%")
"""A comment; a name may contain #."""

FREE_TEXT = ("Project", "Source", "Graphics")
OBSERVED = (
    *("LevelledHeightDifferences", "Distances", "SpatialDistances", "Directions", "Angles", "GridBearings"),
    *("ZenithAngles", "VerticalAngles", "TrigonometricHeightDifferences", "PositionAngles", "3DBaseline"),
)


@dataclass
class TextSection:
    """A section: its name, the units of values and sigmas as its header says, its lines."""

    name: str
    unit: str
    sigma_unit: str
    number: int
    lines: list[Line] = field(default_factory=list)


def read_sections(text: str, draft: Draft) -> list[TextSection]:
    """All sections in their order; unknown headers and lines before the first one are mistakes."""
    sections: list[TextSection] = []
    for number, whole in enumerate(text.splitlines(), start=1):
        if whole.lstrip().startswith("["):
            sections.append(_section(whole, number, draft))
            continue
        free = bool(sections) and sections[-1].name in FREE_TEXT
        words = (whole.split("%")[0] if free else _COMMENT.split(whole, maxsplit=1)[0]).split()
        if not words:
            continue
        if not sections:
            draft.problem(f"found {words[0]!r} before the first [section]", number)
            continue
        sections[-1].lines.append(Line(words, number))
    return sections


def _section(whole: str, number: int, draft: Draft) -> TextSection:
    header = re.compile(r"^\s*\[\s*([^,\]]+?)\s*(?:,\s*([^,\]]*?)\s*)?(?:,\s*([^,\]]*?)\s*)?\]\s*$")
    match = header.match(_COMMENT.split(whole, maxsplit=1)[0])
    if match is None:
        draft.problem(f"found {whole.strip()!r}, expected [Name] or [Name,unit of values,unit of sigmas]", number)
        return TextSection("Graphics", "", "", number)
    given = match[1]
    # Start values of unknowns that no textbook network of this form has: left out with a note.
    not_read = ("ApproximateScale", "ApproximateAdditiveConstant")
    known = (*FREE_TEXT, "Coordinates", "Datum", "Sigma0", *OBSERVED, "ApproximateOrientation", *not_read)
    by_name = {name.lower(): name for name in known}
    name = by_name.get(given.lower()) or {
        "quelle": "Source",
        "winkel": "Angles",
        "direction": "Directions",
        "horizontaldistances": "Distances",
        "azimuth": "GridBearings",
        "3dbasislinie": "3DBaseline",
    }.get(given.lower())
    if name is None:
        draft.problem(f"unknown section [{given}]{nearest(given, known)} (known: {', '.join(known)})", number)
        return TextSection("Graphics", "", "", number)
    if name in not_read:
        draft.note(f"[{name}] is not read", number)
    units = [_unit(text or "", number, draft) for text in (match[2], match[3])]
    return TextSection(name, units[0], units[1], number)


def _unit(text: str, number: int, draft: Draft) -> str:
    short_units = {"s": "arcsec", '"': "arcsec", "°": "deg"}
    unit = short_units.get(text, text)
    if unit and unit not in ANGLE_UNITS and unit not in LENGTH_UNITS:
        draft.problem(
            f"unknown unit {text!r} (known: {', '.join((*ANGLE_UNITS, *LENGTH_UNITS, *short_units))})", number
        )
        return ""
    return unit


# ---- Coordinates and datum of a textbook network: fixed, free or observed with covariances.


@dataclass
class Coordinates:
    """Coordinates as written, by point and component, and what the datum says of them."""

    estimated: str
    """Estimated components: ``z``, ``xy`` or ``xyz``."""
    texts: dict[str, dict[str, str]] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)
    fixed: set[tuple[str, str]] = field(default_factory=set)
    free: list[tuple[str, str]] | None = None
    """Components that carry the datum of a free network; ``None`` if it is none."""
    observed: list[tuple[str, str]] = field(default_factory=list)
    covariance: list[list[str]] = field(default_factory=list)
    datum_line: int = 0


def read_coordinates(sections: list[TextSection], estimated: str, draft: Draft) -> Coordinates:
    """Coordinates: ``id x y [z]``; in levelling networks the height stands in the last column."""
    result = Coordinates(estimated)
    for line in (line for section in sections if section.name == "Coordinates" for line in section.lines):
        name, *values = line.words
        names = {1: "z", 2: "xy", 3: "xyz"}.get(len(values), "")
        if len(values) == 2 and estimated == "z":
            names = "xz"
        lacking = [component for component in estimated if component not in names]
        if lacking or not names:
            words = f"found {len(values)} coordinates of point {name!r}, expected {', '.join(estimated)}"
            draft.problem(words, line.number)
            continue
        if name in result.texts:
            draft.problem(f"point {name!r} is given twice (first in line {result.lines[name]})", line.number)
            continue
        if _numbers(values, line, draft):
            kept = {c: text for c, text in zip(names, values, strict=True) if c in estimated}
            result.texts[name], result.lines[name] = kept, line.number
    for section in sections:
        if section.name == "Datum":
            _read_datum(section, result, draft)
    return result


def _numbers(words: list[str], line: Line, draft: Draft) -> bool:
    before = len(draft.problems)
    for word in words:
        with draft.at(line.number):
            parse_number(word)
    return len(draft.problems) == before


def _read_datum(section: TextSection, coordinates: Coordinates, draft: Draft) -> None:
    kind = ""
    coordinates.datum_line = section.number
    before = len(coordinates.covariance)
    datum_kinds = ("fix", "free", "dyn")
    for line in section.lines:
        words = list(line.words)
        if words[0].lower() in datum_kinds:
            kind = words.pop(0).lower()
            if kind == "free":
                coordinates.free = coordinates.free or []
        if not kind:
            draft.problem(f"found {words[0]!r}, expected {', '.join(datum_kinds)}", line.number)
            return
        if kind == "dyn" and words:
            component = _component(words[0], coordinates, line, draft)
            if component is not None and _numbers(words[1:], line, draft):
                coordinates.observed.append(component)
                coordinates.covariance.append(words[1:])
            continue
        for component in (c for word in words for c in _components(word, coordinates, line, draft)):
            if kind == "fix":
                coordinates.fixed.add(component)
            elif coordinates.free is not None:
                coordinates.free.append(component)
    if before and len(coordinates.covariance) > before:
        draft.problem("observed coordinates are in two sections [Datum], expected one", section.number)
        coordinates.covariance.clear()
    elif not before:
        coordinates.covariance[:] = _complete(coordinates.covariance, section.number, draft)


def _complete(rows: list[list[str]], line: int, draft: Draft) -> list[list[str]]:
    """The whole covariance matrix [m²] behind its rows: complete, a triangle of them, or a σ [m] of each alone."""
    size = len(rows)
    lengths = [len(row) for row in rows]
    if all(length == size for length in lengths) and size > 1:
        return rows
    if all(length == 1 for length in lengths):
        return [
            [repr(float(row[0]) * float(row[0])) if i == k else "0" for k in range(size)] for i, row in enumerate(rows)
        ]
    lower = lengths == list(range(1, size + 1))
    if lower or lengths == list(range(size, 0, -1)):
        at = (lambda i, k: rows[i][k]) if lower else (lambda i, k: rows[k][i - k])
        return [[at(max(i, k), min(i, k)) for k in range(size)] for i in range(size)]
    words = f"{size} observed coordinates need a σ each, a {size} × {size} covariance matrix or a triangle of it"
    draft.problem(f"found rows of {', '.join(map(str, lengths))} numbers, {words}", line)
    return []


def _components(word: str, coordinates: Coordinates, line: Line, draft: Draft) -> list[tuple[str, str]]:
    """Point and component behind ``xA``; all components of the point behind a bare name."""
    means_one = word[:1].lower() in coordinates.estimated and word[1:] in coordinates.texts
    if word in coordinates.texts and not means_one:
        return [(word, component) for component in coordinates.estimated]
    component = _component(word, coordinates, line, draft)
    return [] if component is None else [component]


def _component(word: str, coordinates: Coordinates, line: Line, draft: Draft) -> tuple[str, str] | None:
    """Point and component behind ``xA``, or behind the bare name of a levelled point."""
    if coordinates.estimated == "z" and word in coordinates.texts:
        return word, "z"
    if word[:1].lower() in coordinates.estimated and word[1:] in coordinates.texts:
        return word[1:], word[0].lower()
    expected = (
        "a point" if coordinates.estimated == "z" else f"{', '.join(coordinates.estimated)} and a point, as in xA"
    )
    draft.problem(f"found {word!r}, expected {expected} of [Coordinates]", line.number)
    return None


def _free(coordinates: Coordinates) -> dict[str, object]:
    if not coordinates.free:
        return {"free": "all"}
    by_point: dict[str, str] = {}
    for name, component in coordinates.free:
        by_point[name] = by_point.get(name, "") + component
    by_components: dict[str, list[str]] = {}
    for name, components in by_point.items():
        by_components.setdefault("".join(sorted(set(components))), []).append(name)
    return {"free": by_components}


def _put_observed(coordinates: Coordinates, draft: Draft) -> None:
    """Observed coordinates, the covariances in the order of points and components."""
    names = list(dict.fromkeys(name for name, _ in coordinates.observed))
    ordered = sorted(
        range(len(coordinates.observed)),
        key=lambda k: (names.index(coordinates.observed[k][0]), coordinates.observed[k][1]),
    )
    chosen = set(coordinates.observed)
    rows = [
        Row(
            [name, *(coordinates.texts[name][c] if (name, c) in chosen else None for c in "xyz")],
            coordinates.datum_line,
        )
        for name in names
    ]
    matrix = np.array(coordinates.covariance, dtype=object)[np.ix_(ordered, ordered)].tolist()
    draft.table("observations", ("point", "x", "y", "z"), rows, type="coordinates", covariance=matrix)


# ---- Textbook networks (``.dat``, F. Krumm, Geodetic Network Adjustment Examples) as a project.
#
# x east, y north, bearings clockwise from north; lengths in metres, angles in gon where the header says nothing else.


class KrummKind(NamedTuple):
    """Observation group of a section."""

    type: str
    names: tuple[str, ...]
    value: str
    angular: bool = False
    heights: bool = False


KINDS = {
    "Distances": KrummKind("horizontal_distance", ("from", "to"), "distance"),
    "SpatialDistances": KrummKind("distance", ("from", "to"), "distance", heights=True),
    "Directions": KrummKind("directions", ("station", "to"), "horizontal", angular=True),
    "Angles": KrummKind("angle", ("at", "from", "to"), "angle", angular=True),
    "GridBearings": KrummKind("bearing", ("from", "to"), "bearing", angular=True),
    "ZenithAngles": KrummKind("zenith_angle", ("from", "to"), "zenith_angle", angular=True, heights=True),
    "TrigonometricHeightDifferences": KrummKind("height_difference", ("from", "to"), "dz"),
    "PositionAngles": KrummKind("spatial_angle", ("at", "from", "to"), "angle", angular=True),
    "VerticalAngles": KrummKind("vertical_direction", ("from", "to"), "vertical_direction", angular=True, heights=True),
}
"""Sections of the form names, value, σ, and heights where it says so; the others have readers of their own."""


def read_krumm(path: Path) -> Document:
    """The project a textbook network file describes. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    sections = read_sections(read_text(path), draft)
    observed = [section for section in sections if section.name in OBSERVED and section.lines]
    if not observed:
        draft.problem("there are no observations")
    estimated = _estimated({section.name for section in observed})
    title = [line for section in sections if section.name == "Project" for line in section.lines]
    draft.put("title", " ".join(word for line in title for word in line.words))
    draft.put("units", {"length": "m", "angle": "gon"})
    draft.put("axes", {"xy": "en", "angles": "clockwise", "bearings_from": "north"})
    coordinates = read_coordinates(sections, estimated, draft)
    # Tables of points by their fixed components, observed coordinates, and the datum.
    tables: dict[str, list[Row]] = {}
    for name, texts in coordinates.texts.items():
        held = "".join(c for c in coordinates.estimated if (name, c) in coordinates.fixed)
        tables.setdefault(held, []).append(Row([name, *(texts.get(c) for c in "xyz")], coordinates.lines[name]))
    for held, rows in tables.items():
        draft.table("points", ("id", "x", "y", "z"), rows, fixed=list(held))
    if coordinates.free is not None:
        draft.put("datum", _free(coordinates), coordinates.datum_line)
    if coordinates.covariance:
        _put_observed(coordinates, draft)
    _put_orientations([section for section in sections if section.name == "ApproximateOrientation"], draft)
    for section in observed:
        if section.name == "LevelledHeightDifferences":
            _put_levelling(section, draft)
        elif section.name == "3DBaseline":
            _put_baselines(section, draft)
        else:
            _put_plain(section, KINDS[section.name], draft)
    settings = {"dimensions": estimated}
    for section in sections:
        if (
            section.name == "Sigma0"
            and section.lines
            and _is_positive(section.lines[0].words[0], section.lines[0], draft)
        ):
            settings["sigma0"] = section.lines[0].words[0]
    draft.put("settings", settings)
    return draft.finish()


def _estimated(names: set[str]) -> str:
    if names and names <= {"LevelledHeightDifferences", "TrigonometricHeightDifferences"}:
        return "z"
    return "xy" if names <= {"Distances", "Directions", "Angles", "GridBearings"} else "xyz"


def _is_positive(word: str, line: Line, draft: Draft) -> bool:
    try:
        good = parse_number(word) > 0.0
    except ValueError:
        good = False
    if not good:
        draft.problem(f"found {word!r}, expected a number > 0", line.number)
    return good


def _put_plain(section: TextSection, kind: KrummKind, draft: Draft) -> None:
    unit = section.unit or ("gon" if kind.angular else "m")
    sigma_unit = section.sigma_unit or ("gon" if kind.angular else "m")
    for given in (unit, sigma_unit):
        if given not in (ANGLE_UNITS if kind.angular else LENGTH_UNITS):
            draft.problem(f"unit {given!r} does not fit [{section.name}]", section.number)
    count = len(kind.names) + 1
    rows = []
    sigma: str | None = None
    for line in section.lines:
        names, rest = line.words[: count - 1], line.words[count - 1 :]
        heights = rest[2:] if kind.heights else []
        if len(rest) - len(heights) not in (1, 2) or len(heights) not in (0, 2):
            draft.problem(f"found {len(line.words)} columns, expected {_form(kind)}", line.number)
            continue
        good = _is_value(rest[0], unit, line, draft) and all(_is_value(h, "m", line, draft) for h in heights)
        if len(rest) > 1:
            sigma = _sigma(rest[1], kind, line, draft)
        if sigma is None:
            draft.problem("no σ here, and none in the lines before", line.number)
        elif good:
            cells: list[str | None] = [*names, rest[0], sigma, *heights]
            rows.append(Row(cells + [None] * (2 - len(heights)), line.number))
    if rows:
        columns = [*kind.names, kind.value, "sigma", "from_height", "to_height"]
        draft.table("observations", columns, rows, type=kind.type, units={kind.value: unit, "sigma": sigma_unit})


def _sigma(word: str, kind: KrummKind, line: Line, draft: Draft) -> str:
    """A σ as written, with the unit that a sign behind it means: 30" are seconds of arc."""
    sign = word[-1:]
    unit = {'"': "arcsec", "″": "arcsec", "'": "arcmin", "′": "arcmin", "°": "deg"}.get(sign) if kind.angular else None
    number_ = word[:-1] if unit else word
    if not _is_positive(number_, line, draft):
        return "1"
    return f"{number_} {unit}" if unit else number_


def _form(kind: KrummKind) -> str:
    return f"{' '.join(kind.names)} value σ{' [instrument height, target height]' if kind.heights else ''}"


def _is_value(word: str, unit: str, line: Line, draft: Draft) -> bool:
    try:
        parse_dms(word) if unit == "dms" else parse_number(word)
    except ValueError as error:
        draft.problem(str(error), line.number)
        return False
    return True


def _put_levelling(section: TextSection, draft: Draft) -> None:
    """σ = σ_1km √(length / 1 km); both in metres."""
    rows = []
    sigma: str | None = None
    for line in section.lines:
        if len(line.words) not in (4, 5):
            draft.problem(f"found {len(line.words)} columns, expected from to dz length σ_1km", line.number)
            continue
        first, second, value, length, *rest = line.words
        good = _is_value(value, "m", line, draft) and _is_positive(length, line, draft)
        if rest:
            sigma = rest[0] if _is_positive(rest[0], line, draft) else "1"
        if sigma is None:
            draft.problem("no σ here, and none in the lines before", line.number)
        elif good:
            own = float(sigma) * (float(length) / 1000.0) ** 0.5
            rows.append(Row([first, second, value, repr(own)], line.number))
    if rows:
        draft.table("observations", ("from", "to", "dz", "sigma"), rows, type="height_difference")


def _put_baselines(section: TextSection, draft: Draft) -> None:
    """Vectors with the upper triangle of their covariance matrices, row by row."""
    rows = []
    for line in section.lines:
        if len(line.words) not in (11, 13):
            form = "from to dx dy dz, 6 covariances [instrument height, target height]"
            draft.problem(f"found {len(line.words)} columns, expected {form}", line.number)
            continue
        good = [_is_value(word, "m", line, draft) for word in line.words[2:]]
        if all(good):
            heights: list[str | None] = [*line.words[11:]] or [None, None]
            rows.append(Row([*line.words[:11], *heights], line.number))
    if rows:
        pairs = ("dx_dx", "dx_dy", "dx_dz", "dy_dy", "dy_dz", "dz_dz")
        columns = ["from", "to", "dx", "dy", "dz", *(f"cov_{pair}" for pair in pairs), "from_height", "to_height"]
        draft.table("observations", columns, rows, type="vector")


def _put_orientations(sections: list[TextSection], draft: Draft) -> None:
    """Approximate orientations: bearing = direction + orientation."""
    for section in sections:
        unit = section.unit or "gon"
        rows = []
        for line in section.lines:
            if len(line.words) != 2:
                draft.problem(f"found {len(line.words)} columns, expected station orientation", line.number)
            elif _is_value(line.words[1], unit, line, draft):
                rows.append(Row([line.words[0], *line.words], line.number))
        if rows:
            draft.table("stations", ("id", "point", "orientation"), rows, units={"orientation": unit})
