"""Measurements of one line: angles, azimuths, distances, heights, height differences."""

from __future__ import annotations

from typing import NamedTuple

from mor.formats.draft import Row, number
from mor.formats.dynadjust.lines import OFF, VALUES, Collected, Measurements, measured_words


class Kind(NamedTuple):
    """A kind of measurement: its type in a project, the columns of its names, that of its value."""

    type: str
    names: tuple[str, ...]
    value: str
    angle: bool = False
    heights: bool = False
    """True if heights of instrument and target may follow."""
    on_geoid: bool = False
    """True if it cannot be told without the geoid."""


_LINE = ("from", "to")
KINDS = {
    "A": Kind("angle", ("at", "from", "to"), "angle", angle=True),
    "B": Kind("azimuth", _LINE, "azimuth", angle=True),
    "C": Kind("ellipsoid_chord", _LINE, "distance"),
    "E": Kind("ellipsoid_arc", _LINE, "distance"),
    "H": Kind("orthometric_height", ("point",), "height", on_geoid=True),
    "K": Kind("astronomic_azimuth", _LINE, "azimuth", angle=True),
    "L": Kind("height_difference", _LINE, "dz", on_geoid=True),
    "M": Kind("mean_sea_level_distance", _LINE, "distance", on_geoid=True),
    "R": Kind("ellipsoidal_height", ("point",), "height"),
    "S": Kind("distance", _LINE, "distance", heights=True),
    "V": Kind("zenith_angle", _LINE, "zenith_angle", angle=True, heights=True),
    "Z": Kind("vertical_direction", _LINE, "vertical_direction", angle=True, heights=True),
}
LEFT_OUT = {
    "I": "astronomic latitudes",
    "J": "astronomic longitudes",
    "P": "geodetic latitudes",
    "Q": "geodetic longitudes",
}
"""What is not followed, in DynAdjust's letters."""


def read_line(found: Measurements, code: str) -> None:
    """One measurement. Raises ``ValueError`` with words."""
    kind, text = KINDS[code], found.lines[found.at]
    names = found.stations_of(text, len(kind.names))
    count = 4 if kind.angle else 2
    words = measured_words(text[VALUES:], count)
    if len(words) != count and not (kind.heights and len(words) == count + 2):
        raise ValueError(
            f"found {len(words)} numbers, expected {'an angle' if kind.angle else 'a value'} and its σ"
        )
    if text[1:2] == "*":
        found.skip(OFF, found.at + 1)
        return
    value = sexagesimal_words(text[VALUES:], words) if kind.angle else words[0]
    heights = words[count:] if len(words) > count else [None, None]
    cells = [*names, value, words[count - 1], *(heights if kind.heights else [])]
    found.tables.setdefault(code, []).append(Row(cells, found.at + 1))


def sexagesimal_words(text: str, words: list[str]) -> str:
    """d-m-s of the first three words of a text. Raises ``ValueError``."""
    degrees, minutes, seconds = (number(word) for word in words[:3])
    if not (0.0 <= minutes < 60.0 and 0.0 <= seconds < 60.0 and degrees == int(degrees)):
        raise ValueError(f"found the angle {' '.join(words[:3])}, expected degrees, minutes, seconds")
    sign = "-" if text.strip().startswith("-") else ""
    return f"{sign}{abs(int(degrees))}-{int(minutes)}-{seconds!r}"


def put_lines(found: Collected) -> None:
    """Put the rows that were read into tables, one for each kind."""
    for code, rows in found.tables.items():
        kind = KINDS[code]
        columns = [*kind.names, kind.value, "sigma"]
        columns += ["from_height", "to_height"] if kind.heights else []
        units = {"sigma": "arcsec"} if kind.angle else None
        found.draft.table("observations", columns, rows, type=kind.type, units=units)
        if kind.on_geoid and not found.geoid:
            words = "refers to the geoid, and there is no file .geo beside this one that says where it is"
            found.draft.problem(f"measurement {code} {words}", rows[0].line)
