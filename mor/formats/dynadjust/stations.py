"""Stations as latitude, longitude and height, with what is known of the geoid at them, held or free."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.errors import InputError
from mor.formats.draft import Draft, Row, number
from mor.formats.dynadjust.lines import Collected, marked_lines
from mor.formats.fieldbook.book import sexagesimal
from mor.project.world.reference_system import (
    ReferenceSystem,
    ReferenceSystemError,
    reference_system,
)

SYSTEMS = {
    "GDA94": 4283,
    "GDA2020": 7844,
    "ITRF1996": 8995,
    "ITRF1997": 8996,
    "ITRF2000": 8997,
    "ITRF2005": 8998,
    "ITRF2008": 8999,
    "ITRF2014": 9000,
    "ITRF2020": 9990,
}
"""Geographic systems of the frames that DynAdjust's files are in, by EPSG code."""
_ZONES = {"GDA94": 28300, "GDA2020": 7800}
"""EPSG codes of the map grids of these frames, without their zones."""
_HELD = "1e-6"
"""σ (m) of what is held in part: DynAdjust's own."""
_SIGMAS = ("sigma_east", "sigma_north", "sigma_up")


class Station(NamedTuple):
    """A station as a file has it: what is held, the kind of its coordinates, their texts, the zone of a map grid."""

    name: str
    held: str
    kind: str
    values: list[str]
    zone: str
    line: int
    off: bool = False


def stations_of_lines(path: Path, draft: Draft) -> Iterator[Station]:
    """Stations of a DNA file. Raises :class:`InputError` if it is none."""
    for line, text in enumerate(marked_lines(path, draft)[1:], start=2):
        if text.strip():
            values = [text[place].strip() for place in (slice(28, 48), slice(48, 68), slice(68, 88))]
            name, held, kind = text[:20].strip(), text[20:23].upper(), text[24:27].upper()
            yield Station(name, held, kind, values, text[88:90].strip(), line, text[:1] == "*")


def put_stations(path: Path, stations: Iterable[Station], found: Collected, frame: str) -> None:
    """Stations that take part: free, held, or held in some components."""
    draft = found.draft
    tables: dict[str, list[Row]] = {"free": [], "held": [], "in part": []}
    known: set[str] = set()
    for station in stations:
        name = station.name
        if station.off or name not in found.names:
            known.add(name)
            continue
        if name in known:
            draft.problem(f"station {name!r} is there twice", station.line, str(path))
            continue
        known.add(name)
        try:
            place = _place(station, frame, found.geoid.get(name, (0.0,))[0])
            sigmas = _sigmas(station.held, station.kind)
        except (ValueError, ReferenceSystemError) as error:
            draft.problem(f"station {name!r}: {error}", station.line, str(path))
            continue
        which = {"CCC": "held", "FFF": "free"}.get(station.held, "in part")
        tables[which].append(Row([name, *place, *_geoid(found, name), *sigmas], station.line))
    for name, line in found.names.items():
        if name not in known:
            draft.problem(f"station {name!r} is not in {path.name}", line)
    _put_tables(draft, path, tables)
    if tables["free"] and not tables["held"] and not tables["in part"] and not _positions(draft):
        draft.put("datum", "free")
        draft.note("no station is held, and no position is observed: the network is free", 1, str(path))


def _positions(draft: Draft) -> bool:
    """True if positions of stations are observed."""
    types = {table["type"] for table in draft.data.get("observations", [])}
    return bool(types & {"gnss_position", "geodetic_position"})


def _put_tables(draft: Draft, path: Path, tables: dict[str, list[Row]]) -> None:
    columns = (
        "id",
        "latitude",
        "longitude",
        "height",
        "geoid",
        "deflection_north",
        "deflection_east",
        *_SIGMAS,
    )
    units = {"latitude": "deg", "longitude": "deg"}
    for which, rows in tables.items():
        if not rows:
            continue
        own = dict(units)
        if any(row.cells[5] is not None for row in rows):
            own |= dict.fromkeys(columns[5:7], "arcsec")
        fixed = ["x", "y", "z"] if which == "held" else []
        draft.table("points", columns, rows, str(path), units=own, fixed=fixed)
    if tables["in part"]:
        words = f"stations that are held in part are observed with σ {_HELD} m, as DynAdjust does it"
        draft.note(words, tables["in part"][0].line, str(path))


def _geoid(found: Collected, name: str) -> list[str | None]:
    if not found.geoid:
        return [None] * 3
    if name not in found.geoid:
        found.draft.problem(f"station {name!r} is not in the file of geoid heights", found.names[name])
        return [None] * 3
    return [repr(value) for value in found.geoid[name]]


def _sigmas(held: str, kind: str) -> list[str | None]:
    """σ east, north, up of what is held in part. Raises ``ValueError``."""
    if len(held) != 3 or set(held) - set("CF"):
        raise ValueError(f"found the constraints {held!r}, expected three letters C or F")
    if held in ("CCC", "FFF"):
        return [None] * 3
    if kind == "XYZ":
        raise ValueError(f"{held} in XYZ holds a geocentric axis; only CCC and FFF can be followed")
    order = (0, 1, 2) if kind == "UTM" else (1, 0, 2)
    return [_HELD if held[k] == "C" else None for k in order]


def _place(station: Station, frame: str, N: float) -> list[str]:
    """Latitude, longitude (degrees) and height as given, of X, Y, Z the one above the geoid."""
    words, kind = station.values, station.kind
    if kind == "LLH":
        latitude, longitude = (sexagesimal(word) for word in words[:2])
        if abs(latitude) > 90.0:
            raise ValueError(f"found the latitude {latitude:g}, expected it between -90 and 90")
        return [repr(latitude), repr(longitude), repr(number(words[2]))]
    values = np.array([[number(word) for word in words]])
    if kind == "XYZ":
        latitude, longitude, height = system_of(frame).ellipsoid.geodetic(values)[0].tolist()
        height -= N
    elif kind == "UTM":
        zone = station.zone
        if not zone.isdecimal() or not 1 <= int(zone) <= 60:
            raise ValueError(f"found the zone {zone!r}, expected a number from 1 to 60")
        if frame not in _ZONES:
            raise ValueError(f"found UTM in {frame}, which has no map grid; expected LLH or XYZ")
        grid = _system(_ZONES[frame] + int(zone))
        latitude, longitude, height = grid.to_geodetic(values)[0].tolist()
    else:
        raise ValueError(f"found coordinates in {kind!r}, expected LLH, UTM or XYZ")
    return [repr(float(np.degrees(latitude))), repr(float(np.degrees(longitude))), repr(height)]


def system_of(frame: str) -> ReferenceSystem:
    """The system of a frame. Raises :class:`ReferenceSystemError`."""
    return _system(SYSTEMS[frame])


@cache
def _system(code: int) -> ReferenceSystem:
    return reference_system(f"EPSG:{code}")


def frame_of(lines: list[str], draft: Draft) -> str:
    """The frame that the first line names. Raises :class:`InputError` if it is none that is known."""
    words = lines[0].split()
    frame = next((word.upper() for word in words[3:] if word.upper() in SYSTEMS), "")
    return known_frame(frame or (words[4] if len(words) > 4 else lines[0]), 1, draft)


def known_frame(name: str, line: int, draft: Draft) -> str:
    """A frame by its name. Raises :class:`InputError` if it is none that is known."""
    if name.upper() not in SYSTEMS:
        words = f"found the reference frame {name!r}, expected one of {', '.join(SYSTEMS)}"
        draft.problem(words, line)
        raise InputError(draft.problems)
    return name.upper()
