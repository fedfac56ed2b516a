"""Lines of a STAR*NET input file: continued, without comments, with their code, and the values in them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from mor.formats.draft import number

_HEIGHTS = re.compile(r"^(-?[\d.]+)/(-?[\d.]+)$")
_DMS = re.compile(r"^([-+]?)(\d+)[-@:](\d+)(?:[-@:](\d+(?:\.\d*)?))?$")
_QUADRANT = re.compile(r"^([NS])(.+?)([EW])$", re.IGNORECASE)
SEPARATORS = "-,:;|_~^+="
"""Signs that may stand between the names of a line: the first one, or what .SEPARATOR says."""
STATUSES = ("!", "*", "&")
"""Fixed, free, the default: in place of a σ."""


class Line(NamedTuple):
    """Code and words of a line, with instrument and target height where the line has them."""

    code: str
    words: list[str]
    heights: tuple[float, float] | None
    number: int


def read_lines(lines: list[str]) -> Iterator[Line]:
    """Every line that says something; # begins a comment, ' a description.

    A last & continues where the next line begins with no code; else it is the default σ.
    """
    begun, first = "", 0
    bare = [re.split(r"#|(?:^|(?<=\s))'", text, maxsplit=1)[0].strip() for text in lines]
    for k, text in enumerate(bare, start=1):
        first = first if begun else k
        if text.endswith(" &") and k < len(bare) and bare[k] and not _CODE.match(bare[k]):
            begun += text[:-1]
            continue
        words, begun = (begun + text).split(), ""
        if words:
            yield _line(words, first)


_CODE = re.compile(r"(?:\.[A-Za-z0-9]+|[A-Za-z]{1,2}|[A-Za-z]\d)(?:\s|$)")


def _line(words: list[str], line: int) -> Line:
    heights = None
    kept = []
    for word in words[1:]:
        match = _HEIGHTS.match(word)
        if match and words[0][:1] != ".":
            heights = number(match[1]), number(match[2])
        else:
            kept.append(word)
    return Line(words[0].upper(), kept, heights, line)


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
