"""Sections of a textbook network file: their headers with units, and their lines without comments."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import NamedTuple

from mor.errors import nearest
from mor.formats.draft import Draft
from mor.units import ANGLE_UNITS, LENGTH_UNITS

_HEADER = re.compile(r"^\s*\[\s*([^,\]]+?)\s*(?:,\s*([^,\]]*?)\s*)?(?:,\s*([^,\]]*?)\s*)?\]\s*$")
_SHORT_UNITS = {"s": "arcsec", '"': "arcsec", "°": "deg"}
_OTHER_NAMES = {
    "quelle": "Source",
    "winkel": "Angles",
    "direction": "Directions",
    "horizontaldistances": "Distances",
    "azimuth": "GridBearings",
    "3dbasislinie": "3DBaseline",
}
NOT_READ = ("ApproximateScale", "ApproximateAdditiveConstant")
"""Start values of unknowns that no textbook network of this form has: left out with a note."""
_COMMENT = re.compile(r"(?:^|(?<=\s))[%#]|%")
"""A comment; a name may contain #."""

FREE_TEXT = ("Project", "Source", "Graphics")
OBSERVED = (
    "LevelledHeightDifferences",
    "Distances",
    "SpatialDistances",
    "Directions",
    "Angles",
    "GridBearings",
    "ZenithAngles",
    "VerticalAngles",
    "TrigonometricHeightDifferences",
    "PositionAngles",
    "3DBaseline",
)
KNOWN = (*FREE_TEXT, "Coordinates", "Datum", "Sigma0", *OBSERVED, "ApproximateOrientation", *NOT_READ)


class Line(NamedTuple):
    """Words of a line, and its number."""

    words: list[str]
    number: int


@dataclass
class Section:
    """A section: its name, the units of values and sigmas as its header says, its lines."""

    name: str
    unit: str
    sigma_unit: str
    number: int
    lines: list[Line] = field(default_factory=list)


def read_sections(text: str, draft: Draft) -> list[Section]:
    """All sections in their order; unknown headers and lines before the first one are mistakes."""
    sections: list[Section] = []
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


def _section(whole: str, number: int, draft: Draft) -> Section:
    match = _HEADER.match(_COMMENT.split(whole, maxsplit=1)[0])
    if match is None:
        draft.problem(
            f"found {whole.strip()!r}, expected [Name] or [Name,unit of values,unit of sigmas]", number
        )
        return Section("Graphics", "", "", number)
    given = match[1]
    by_name = {name.lower(): name for name in KNOWN}
    name = by_name.get(given.lower()) or _OTHER_NAMES.get(given.lower())
    if name is None:
        words = f"unknown section [{given}]{nearest(given, KNOWN)} (known: {', '.join(KNOWN)})"
        draft.problem(words, number)
        return Section("Graphics", "", "", number)
    if name in NOT_READ:
        draft.note(f"[{name}] is not read", number)
    units = [_unit(text or "", number, draft) for text in (match[2], match[3])]
    return Section(name, units[0], units[1], number)


def _unit(text: str, number: int, draft: Draft) -> str:
    unit = _SHORT_UNITS.get(text, text)
    if unit and unit not in ANGLE_UNITS and unit not in LENGTH_UNITS:
        draft.problem(
            f"unknown unit {text!r} (known: {', '.join((*ANGLE_UNITS, *LENGTH_UNITS, *_SHORT_UNITS))})",
            number,
        )
        return ""
    return unit
