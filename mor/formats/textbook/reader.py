"""Textbook networks (``.dat``, F. Krumm, Geodetic Network Adjustment Examples) as a project.

x east, y north, bearings clockwise from north; lengths in metres, angles in gon where the header says nothing else.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from mor.formats.draft import Draft, Row, number
from mor.formats.textbook.points import put_coordinates, read_coordinates
from mor.formats.textbook.sections import OBSERVED, Line, Section, read_sections
from mor.input_files import read_text
from mor.project.file.nodes import Document
from mor.units import ANGLE_UNITS, LENGTH_UNITS, parse_dms


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
    "VerticalAngles": KrummKind(
        "vertical_direction", ("from", "to"), "vertical_direction", angular=True, heights=True
    ),
}
"""Sections of the form names, value, σ, and heights where it says so; the others have readers of their own."""
_PLANE = ("Distances", "Directions", "Angles", "GridBearings")


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
    put_coordinates(coordinates, draft)
    _put_orientations([section for section in sections if section.name == "ApproximateOrientation"], draft)
    for section in observed:
        _put_section(section, draft)
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
    return "xy" if names <= set(_PLANE) else "xyz"


def _is_positive(word: str, line: Line, draft: Draft) -> bool:
    try:
        good = number(word) > 0.0
    except ValueError:
        good = False
    if not good:
        draft.problem(f"found {word!r}, expected a number > 0", line.number)
    return good


def _put_section(section: Section, draft: Draft) -> None:
    if section.name == "LevelledHeightDifferences":
        _put_levelling(section, draft)
    elif section.name == "3DBaseline":
        _put_baselines(section, draft)
    else:
        _put_plain(section, KINDS[section.name], draft)


def _put_plain(section: Section, kind: KrummKind, draft: Draft) -> None:
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
        draft.table(
            "observations", columns, rows, type=kind.type, units={kind.value: unit, "sigma": sigma_unit}
        )


def _sigma(word: str, kind: KrummKind, line: Line, draft: Draft) -> str:
    """A σ as written, with the unit that a sign behind it means: 30" are seconds of arc."""
    sign = word[-1:]
    unit = (
        {'"': "arcsec", "″": "arcsec", "'": "arcmin", "′": "arcmin", "°": "deg"}.get(sign)
        if kind.angular
        else None
    )
    number_ = word[:-1] if unit else word
    if not _is_positive(number_, line, draft):
        return "1"
    return f"{number_} {unit}" if unit else number_


def _form(kind: KrummKind) -> str:
    return f"{' '.join(kind.names)} value σ{' [instrument height, target height]' if kind.heights else ''}"


def _is_value(word: str, unit: str, line: Line, draft: Draft) -> bool:
    try:
        parse_dms(word) if unit == "dms" else number(word)
    except ValueError as error:
        draft.problem(str(error), line.number)
        return False
    return True


def _put_levelling(section: Section, draft: Draft) -> None:
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


def _put_baselines(section: Section, draft: Draft) -> None:
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
        columns = [
            "from",
            "to",
            "dx",
            "dy",
            "dz",
            *(f"cov_{pair}" for pair in pairs),
            "from_height",
            "to_height",
        ]
        draft.table("observations", columns, rows, type="vector")


def _put_orientations(sections: list[Section], draft: Draft) -> None:
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
