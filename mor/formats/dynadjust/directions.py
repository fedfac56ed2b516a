"""Sets of directions (D): the station with its first target, then every other target of the set.

Source: *DynAdjust User's Guide*, appendices on DNA and DynaML, and what DynAdjust itself writes: a line or an element
for each target; the number of the set counts those behind the first.
"""

from __future__ import annotations

from typing import NamedTuple

from mor.formats.draft import Row, number
from mor.formats.dynadjust.lines import NAMES, OFF, VALUES, Collected, Measurements, measured_words
from mor.formats.dynadjust.terrestrial import sexagesimal_words

CODE = "D"
_FROM, _TARGET = slice(2, 42), NAMES[2]
_COLUMNS = ("station", "to", "horizontal", "sigma", "set")


class Sight(NamedTuple):
    """A target of a set: its direction as d-m-s, its σ in seconds."""

    target: str
    value: str
    sigma: str
    line: int
    off: bool = False


def read_directions(found: Measurements) -> None:
    """A set of a DNA file. Raises ``ValueError`` with words."""
    text = found.lines[found.at]
    station, target = (text[place].strip() for place in NAMES[:2])
    said, off = text[_TARGET].strip(), text[1:2] == "*"
    sights = [_sight(found, target)]
    while _goes_on(found):
        found.at += 1
        text = found.lines[found.at]
        sights.append(_sight(found, text[_TARGET].strip()))
    put_set(found, station, sights, said, off)


def _goes_on(found: Measurements) -> bool:
    """Return True if the next line is one of the same set: its station is left out."""
    text = found.lines[found.at + 1] if found.at + 1 < len(found.lines) else ""
    return text[:1] in (CODE, " ") and not text[_FROM].strip() and bool(text[_TARGET].strip())


def _sight(found: Measurements, target: str) -> Sight:
    text = found.lines[found.at][VALUES:]
    words = measured_words(text, 4)
    if len(words) != 4:
        raise ValueError(f"found {len(words)} numbers, expected an angle and its σ")
    off = found.lines[found.at][1:2] == "*"
    number(words[3])
    return Sight(target, sexagesimal_words(text, words), words[3], found.at + 1, off)


def put_set(found: Collected, station: str, sights: list[Sight], said: str, off: bool) -> None:
    """Put a set into the draft. ``said``: number of targets behind the first; ``off``: all of it is switched off.

    Raises ``ValueError`` where there are not so many, or one is there twice.
    """
    used = [sight for sight in sights if not sight.off]
    if said not in (str(len(sights) - 1), str(len(used) - 1)):
        raise ValueError(
            f"found {len(sights) - 1} directions behind the first, expected {said or 'how many'}"
        )
    if off:
        found.skip(OFF, sights[0].line)
        return
    for sight in sights:
        if sight.off:
            found.skip(OFF, sight.line)
        else:
            found.known([station, sight.target], sight.line)
    names = [sight.target for sight in used]
    if len(set(names)) < len(names):
        raise ValueError(f"station {station!r} has a target twice in one set")
    found.sets += 1
    rows = [Row([station, s.target, s.value, s.sigma, str(found.sets)], s.line) for s in used]
    found.tables.setdefault(CODE, []).extend(rows)


def put_directions(found: Collected) -> None:
    """Put the sets that were read into a table."""
    rows = found.tables.pop(CODE, [])
    if rows:
        found.draft.table("observations", _COLUMNS, rows, type="directions", units={"sigma": "arcsec"})
