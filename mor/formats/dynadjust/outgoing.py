"""A network on the earth in DynAdjust's terms, for the writers of DNA and DynaML."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.errors import InputError, Problem
from mor.formats.content import Content, content_of, not_carried
from mor.formats.dynadjust.stations import SYSTEMS
from mor.formats.dynadjust.terrestrial import KINDS, Kind
from mor.formats.networks.on_earth import (
    EarthPoints,
    SetUps,
    clockwise_from_north,
    clusters,
    earth_points,
    raised,
    world_of,
)
from mor.formats.networks.terrestrial import Group, circle_in_face_one, groups, tilted_stations
from mor.observations import PLAIN_TYPES
from mor.observations.earth import earth_types
from mor.project.file.nodes import Document
from mor.project.network.build import build_network
from mor.project.world.world import World

_CODES = {kind.type: code for code, kind in KINDS.items()}
_CLUSTERS = ("gnss_vector", "gnss_position", "geodetic_position")
_DIRECTIONS = "directions"
EPOCH = "01.01.2020"


class Line(NamedTuple):
    """A measurement of its own: rad or m, its σ, heights of instrument and target (m)."""

    code: str
    names: list[str]
    value: float
    sigma: float
    heights: tuple[float, float] | None


class Directions(NamedTuple):
    """A set: station, targets, directions and their σ (rad)."""

    station: str
    targets: list[str]
    values: list[float]
    sigmas: list[float]


class Cluster(NamedTuple):
    """A baseline (G), or members of a cluster (X, Y in XYZ or LLH); m, m², and rad of latitudes and longitudes."""

    code: str
    form: str
    names: list[list[str]]
    values: list[list[str]]
    """Three texts of each member: latitudes and longitudes as ddd.mmss…"""
    Q: FloatArray
    """(3n, 3n)."""


Measurement = Line | Directions | Cluster


class Outgoing(NamedTuple):
    """All that is written."""

    frame: str
    stations: EarthPoints
    above: bool
    """True if heights are above the geoid."""
    measured: list[Measurement]
    notes: list[Problem]


def outgoing(document: Document, folder: Path, target: Path) -> Outgoing:
    """Return the content of DynAdjust files for a project.

    Raises :class:`InputError` for networks that are not on GDA94 or GDA2020, and what the files cannot say.
    """
    content = content_of(document, folder)
    world_of(content, "DynAdjust")
    clockwise_from_north(content, "DynAdjust")
    _refuse(content)
    network = build_network(content.project, document, folder)
    world = network.world
    assert world is not None
    frame = _frame(content, world)
    points = earth_points(content, network, "DNA")
    long = [name for name in points.ids if len(name) > 20 or name != name.strip()]
    if long:
        words = "names in DNA files have up to 20 letters"
        raise InputError([Problem(f"{name!r}: {words}", document.file) for name in long])
    N = points.geoid_by_name if world.orthometric else {}
    kinds = (*_CODES, *_CLUSTERS, _DIRECTIONS)
    types = {**PLAIN_TYPES, **earth_types(world.horizon)}
    found = groups(content, kinds, types)
    set_ups = SetUps(content, points.ids)
    measured = [one for group in found for one in _measurements(content, group, N, set_ups)]
    notes = not_carried(content, kinds, ("stations",), "DynAdjust")
    words = f"the epoch is written as {EPOCH}: a project has none"
    notes.append(Problem(words, str(target)))
    if raised(content, found):
        notes.append(Problem("directions have no heights of instrument and target in DynAdjust", str(target)))
    return Outgoing(frame, points, world.orthometric, measured, notes)


def _refuse(content: Content) -> None:
    """Mistakes of projects that are none of DynAdjust's."""
    project, problems = content.project, tilted_stations(content, "DynAdjust")
    for number, entry in enumerate(project.observations):
        place = content.place("observations", number)
        if entry.cluster:
            problems.append(
                place.problem("DNA has covariances of one group of vectors or positions at a time")
            )
        elif entry.covariance is not None and entry.type not in _CLUSTERS:
            problems.append(place.problem(f"DNA has no covariances of {entry.type}"))
        if entry.instrument or entry.ppm or entry.centring:
            problems.append(place.problem("DNA has no instruments, ppm and centring: each value has its σ"))
    if problems:
        raise InputError(problems)


def _frame(content: Content, world: World) -> str:
    geodetic = world.system.crs.geodetic_crs
    name = geodetic.name.upper() if geodetic is not None else ""
    frame = next((frame for frame in SYSTEMS if name == frame), "")
    if not frame:
        words = f"DynAdjust's files are in {' or '.join(SYSTEMS)}, found {world.system.name}"
        raise InputError([content.place("world").problem(words)])
    return frame


def _measurements(
    content: Content, group: Group, N: dict[str, float], set_ups: SetUps
) -> Iterator[Measurement]:
    if group.entry.type in _CLUSTERS:
        yield from _clusters(content, group, N)
    elif group.entry.type == _DIRECTIONS:
        yield from _sets(group, set_ups)
    else:
        yield from _lines(content, group, KINDS[_CODES[group.entry.type]])


def _lines(content: Content, group: Group, kind: Kind) -> Iterator[Line]:
    code, metres = _CODES[kind.type], content.edge.metres
    names = [group.rows.text(name) for name in kind.names]
    heights = [np.nan_to_num(group.rows.number(f"{end}_height")) * metres for end in ("from", "to")]
    unit = 1.0 if kind.angle else metres
    for row, (value, sigma) in enumerate(zip(group.values[:, 0], group.sigma[:, 0], strict=True)):
        if np.isfinite(value):
            ends = (float(heights[0][row]), float(heights[1][row])) if kind.heights else (0.0, 0.0)
            own = [column[row] for column in names]
            yield Line(code, own, float(value) * unit, float(sigma) * unit, ends if any(ends) else None)


def _sets(group: Group, set_ups: SetUps) -> Iterator[Directions]:
    """Sets in the order of their first sights; face two as it would read in face one."""
    rows = group.rows
    value = circle_in_face_one(group.values[:, 0], rows.number("face"))
    sets: dict[tuple[str, str], Directions] = {}
    names = zip(rows.text("station"), rows.text("set"), rows.text("to"), strict=True)
    for row, (station, set_, to) in enumerate(names):
        if np.isfinite(value[row]):
            one = sets.setdefault((station, set_), Directions(set_ups.point(station), [], [], []))
            one.targets.append(to)
            one.values.append(float(value[row]))
            one.sigmas.append(float(group.sigma[row, 0]))
    yield from sets.values()


def _clusters(content: Content, group: Group, N: dict[str, float]) -> Iterator[Cluster]:
    vectors, geodetic = group.entry.type == "gnss_vector", group.entry.type == "geodetic_position"
    code = "Y" if not vectors else "X" if group.entry.covariance is not None else "G"
    names = [group.rows.text(name) for name in (("from", "to") if vectors else ("point",))]
    for rows, Q in clusters(content, group, "DNA"):
        values = [
            _values(content, group, row, N.get(names[0][row], 0.0) if geodetic else 0.0) for row in rows
        ]
        own = [[column[row] for column in names] for row in rows]
        yield Cluster(code, "LLH" if geodetic else "XYZ", own, values, Q)


def _values(content: Content, group: Group, row: int, N: float) -> list[str]:
    three = group.values[row].tolist()
    if group.entry.type != "geodetic_position":
        return [repr(float(value) * content.edge.metres) for value in three]
    height = three[2] * content.edge.metres - N
    return [sexagesimal_text(three[0]), sexagesimal_text(three[1]), repr(height)]


def fixed(value: float, least: int) -> str:
    """Ten decimals without the zeros at their end, but so many decimals at least."""
    whole, _, decimals = f"{value:.10f}".partition(".")
    return f"{whole}.{decimals.rstrip('0').ljust(least, '0')}"


def seconds_of(angle: float) -> float:
    """Arc seconds of an angle in radians."""
    return float(np.degrees(angle)) * 3600.0


def sexagesimal_text(angle: float) -> str:
    """ddd.mmss… of an angle in radians, seconds to ten decimals."""
    degrees, minutes, seconds, sign = parts_of(angle, 10)
    return (
        f"{sign}{degrees}.{minutes:02d}{seconds:013.10f}".replace(".", "#", 1)
        .replace(".", "")
        .replace("#", ".")
    )


def parts_of(angle: float, decimals: int) -> tuple[int, int, float, str]:
    """Degrees, minutes, seconds and the sign of an angle in radians; the seconds to so many decimals."""
    units = round(abs(seconds_of(angle)) * 10**decimals)
    minutes, rest = divmod(units, 60 * 10**decimals)
    return minutes // 60, minutes % 60, rest / 10**decimals, "-" if angle < 0.0 else ""
