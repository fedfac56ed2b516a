"""Station coordinate files: places in the coordinate system of the adjustment, with geoid heights and deflections."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.errors import InputError, Problem, nearest
from mor.formats.draft import Draft
from mor.formats.snap.lines import Line, Words, angle, lines_of
from mor.project.world.reference_system import ReferenceSystem, reference_system

SYSTEMS = {
    "NZGD1949": "EPSG:4272",
    "NZGD2000": "EPSG:4167",
    "NZMG": "EPSG:27200",
    "NZTM": "EPSG:2193",
    "WGS84": "EPSG:4326",
}
"""EPSG codes of SNAP's coordinate systems."""
_OPTIONS = ("deflections", "geoid_heights", "geoid", "station_orders")


class Station(NamedTuple):
    """A station as it was given; angles in degrees, deflections in arc seconds."""

    place: tuple[float, float, float]
    N: float
    deflection: tuple[float, float]
    line: int


class Stations(NamedTuple):
    """All stations of a file."""

    path: Path
    title: str
    code: str
    crs: str
    system: ReferenceSystem
    orthometric: bool
    geoid: bool
    deflections: bool
    by_name: dict[str, Station]

    def geocentric(self, names: list[str]) -> FloatArray:
        """(n, 3) of stations by their coordinates."""
        given = np.array([self.by_name[name].place for name in names])
        if self.system.kind == "geographic":
            given[:, :2] = np.radians(given[:, :2])
        geodetic = self.system.to_geodetic(given)
        if self.orthometric:
            geodetic[:, 2] += [self.by_name[name].N for name in names]
        return self.system.ellipsoid.geocentric(geodetic)

    def axes(self, names: list[str]) -> FloatArray:
        """(3, 3) east, north, up at the middle of stations."""
        from mor.geometry.earth import east_north_up

        middle = self.geocentric(names).mean(axis=0)
        latitude, longitude, _ = self.system.ellipsoid.geodetic(middle[None])[0]
        return east_north_up(latitude, longitude)


def read_stations(path: Path, draft: Draft) -> Stations:
    """Stations of a coordinate file. Raises :class:`InputError`."""
    lines = [line for line in lines_of(path, draft) if line.words]
    if len(lines) < 2:
        words = "expected a title, a coordinate system and stations"
        raise InputError([Problem(words, str(path), len(lines) or 1)])
    code = lines[1].words[0]
    crs = _system(code, path, lines[1].number)
    has_options = len(lines) > 2 and lines[2].words[0].lower() == "options"
    options = [word.lower() for word in lines[2].words[1:]] if has_options else ["geoid"]
    classes = sum(word.startswith("c=") for word in options) + ("station_orders" in options)
    vertical = "/" in code
    orthometric = "orthometric_heights" in options or (vertical and "ellipsoidal_heights" not in options)
    orthometric = orthometric or not has_options
    geoid, deflections = (bool({"geoid", word} & set(options)) for word in ("geoid_heights", "deflections"))
    if vertical and not geoid:
        words = f"{code}: the geoid of {code.partition('/')[2]} is not in this file; add geoid_heights to it"
        raise InputError([Problem(words, str(path), lines[1].number)])
    found = Stations(
        path, " ".join(lines[0].words), code, crs, reference_system(crs), orthometric, geoid, deflections, {}
    )
    form = "deg" if "degrees" in options else "dms"
    for line in lines[2 + has_options :]:
        try:
            _read(found, line, form, classes)
        except ValueError as error:
            draft.problem(str(error), line.number, str(path))
    if not geoid:
        draft.note("there are no geoid heights: the geoid is taken as the ellipsoid", 1, str(path))
    return found


def _system(code: str, path: Path, line: int) -> str:
    plain = code.partition("/")[0].upper()
    known = next((name for name in SYSTEMS if plain == name or plain.startswith(f"{name}_2")), "")
    if not known:
        words = f"coordinate system {code!r} is not followed{nearest(plain, SYSTEMS)} (known: {', '.join(SYSTEMS)})"
        raise InputError([Problem(words, str(path), line)])
    return SYSTEMS[known]


def _read(found: Stations, line: Line, form: str, classes: int) -> None:
    words = Words(line.words)
    name = words.take("a station")
    if name.upper() in (known.upper() for known in found.by_name):
        raise ValueError(f"station {name!r} is there twice")
    if found.system.kind == "geographic":
        place = [angle(words, form, "NS"), angle(words, form, "EW")]
        if abs(place[0]) > 90.0:
            raise ValueError(f"station {name!r}: found the latitude {place[0]:g}, expected -90 to 90")
    else:
        place = [words.number("east"), words.number("north")]
    height = words.number("a height")
    deflection = (0.0, 0.0)
    if found.deflections:
        deflection = (words.number("a deflection north"), words.number("a deflection east"))
    N = words.number("a geoid height") if found.geoid else 0.0
    found.by_name[name] = Station((place[0], place[1], height), N, deflection, line.number)
    for _ in range(classes):
        words.take(f"a class of station {name!r}")
