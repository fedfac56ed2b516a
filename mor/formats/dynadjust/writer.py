"""A network on the earth as DynAdjust's files: ``.stn``, ``.msr`` and, where heights are above a geoid, ``.geo``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.errors import InputError, Problem
from mor.formats.content import Content, content_of, not_carried
from mor.formats.dynadjust.stations import SYSTEMS
from mor.formats.dynadjust.terrestrial import KINDS, Kind
from mor.formats.terrestrial import Group, groups
from mor.formats.written import Written
from mor.observations import PLAIN_TYPES
from mor.observations.earth import DEFLECTIONS, GEOID, earth_types
from mor.project.file.nodes import Document
from mor.project.network.build import Network, build_network
from mor.project.tables.statuses import number_column
from mor.project.tables.tables import Column
from mor.project.world.world import World
from mor.units import LENGTH

_CODES = {kind.type: code for code, kind in KINDS.items()}
_CLUSTERS = ("gnss_vector", "gnss_position", "geodetic_position")
_HELD = 1e-6
"""Largest σ (m) of a component that DynAdjust would hold: its own."""
_EPOCH = "01.01.2020"


class Stations(NamedTuple):
    """Names, latitude, longitude (rad) and ellipsoidal height (m), N, ξ, η, and which of east, north, up are held."""

    ids: list[str]
    geodetic: FloatArray
    geoid: FloatArray
    deflections: FloatArray
    held: BoolArray


def write_dynadjust(document: Document, folder: Path, target: Path) -> Written:
    """The files. Raises :class:`InputError` for networks that are not on GDA94 or GDA2020, and what DNA cannot say."""
    content = content_of(document, folder)
    _refuse(content)
    network = build_network(content.project, document, folder)
    world = network.world
    assert world is not None
    frame = _frame(content, world)
    stations = _stations(content, network, world)
    N = dict(zip(stations.ids, np.nan_to_num(stations.geoid).tolist(), strict=True))
    above = world.orthometric
    types = {**PLAIN_TYPES, **earth_types(world.horizon)}
    measured = [
        line
        for group in groups(content, (*_CODES, *_CLUSTERS), types)
        for line in _measurements(content, group, N if above else {}, frame)
    ]
    stem = target.with_suffix("") if target.suffix.lower() in (".stn", ".msr") else target
    head = f"!#=DNA 3.01 {{}}    {_EPOCH}{frame:>14}    {_EPOCH}{{:>10}}"
    count = sum(not line.startswith(" ") for line in measured)
    files = {
        ".stn": [head.format("STN", len(stations.ids)), *_station_lines(stations, above)],
        ".msr": [head.format("MSR", count), *measured],
    }
    if above:
        files[".geo"] = ["# DNA geoid file.", *_geoid_lines(stations)]
    notes = not_carried(content, (*_CODES, *_CLUSTERS), (), "DynAdjust")
    words = "the epoch is written as 1 January 2020: a project has none"
    notes.append(Problem(words, str(target)))
    texts = {
        stem.with_name(f"{stem.name}{end}"): "\n".join([*lines, ""]).encode() for end, lines in files.items()
    }
    return Written(texts, notes)


def _refuse(content: Content) -> None:
    """Mistakes of projects that are none of DynAdjust's."""
    project, problems = content.project, []
    if project.world is None:
        raise InputError(
            [Problem("DynAdjust has networks on the earth: this project has no world", content.document.file)]
        )
    if project.axes.angles != "clockwise" or project.axes.bearings_from != "north":
        problems.append(
            content.place("axes").problem("DynAdjust has angles clockwise and azimuths from north")
        )
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


def _stations(content: Content, network: Network, world: World) -> Stations:
    """Stations at their start values. Raises :class:`InputError` for those without, and for σ that DNA has not."""
    things = network.things["point"]
    blocks = things.parts["position"]
    object_ = network.start["point"][blocks]
    problems = [
        Problem(
            f"point {name!r} has no coordinates; convert an adjusted project (adjusted.yaml)",
            content.document.file,
        )
        for name, place in zip(things.ids, object_, strict=True)
        if not np.isfinite(place).all()
    ]
    long = [name for name in things.ids if len(name) > 20 or name != name.strip()]
    problems += [
        Problem(f"{name!r}: names in DNA files have up to 20 letters", content.document.file) for name in long
    ]
    held = _held(content, world, problems)
    if problems:
        raise InputError(problems)
    geodetic = world.horizon.to_geodetic(object_) * np.array([1.0, 1.0, world.metres])
    deflections = np.stack(
        [world.of_points(f"deflection_{axis}", blocks) for axis in ("north", "east")], axis=1
    )
    geoid = world.geoid_at(blocks, object_) * world.metres
    which = np.array([held.get(name, (False,) * 3) for name in things.ids])
    return Stations(list(things.ids), geodetic, geoid, deflections, which)


def _held(content: Content, world: World, problems: list[Problem]) -> dict[str, tuple[bool, ...]]:
    """Which of east, north, up of a point is held; other σ of points are mistakes."""
    edge, known = content.edge, {}
    names = ("sigma_east", "sigma_north", "sigma_up")
    coordinates = world.system.coordinates
    others = (*coordinates, *(f"start_{name}" for name in coordinates), GEOID, *DEFLECTIONS)
    for number, table in enumerate(content.project.points):
        columns = [
            Column("id", required=True),
            *(number_column(name, LENGTH, edge) for name in ("sigma", *names)),
        ]
        columns += [Column(name) for name in others]
        rows = content.rows("points", number, table, columns)
        sigma = np.stack([rows.number(name) for name in names], axis=1)
        sigma = np.where(np.isnan(sigma), rows.number("sigma")[:, None], sigma) * edge.metres
        sigma[:] = 0.0 if table.fixed else sigma
        if (sigma > _HELD * (1.0 + 1e-9)).any():
            words = "DNA holds coordinates or leaves them free: observe them instead (gnss_position with a covariance)"
            problems.append(content.place("points", number).problem(words))
        for name, three in zip(rows.text("id"), np.isfinite(sigma), strict=True):
            known[name] = tuple(three.tolist())
    return known


def _station_lines(stations: Stations, above: bool) -> Iterator[str]:
    heights = stations.geodetic[:, 2] - (np.nan_to_num(stations.geoid) if above else 0.0)
    for name, place, height, held in zip(
        stations.ids, stations.geodetic, heights, stations.held, strict=True
    ):
        letters = "".join("FC"[int(held[k])] for k in (1, 0, 2))
        latitude, longitude = (sexagesimal_text(value) for value in place[:2].tolist())
        yield f"{name:<20}{letters} LLH {latitude:>20}{longitude:>20}{height:>20.9f}"


def _geoid_lines(stations: Stations) -> Iterator[str]:
    for name, N, (xi, eta) in zip(
        stations.ids, np.nan_to_num(stations.geoid).tolist(), stations.deflections.tolist(), strict=True
    ):
        yield f"{name:<20}{_fixed(N, 3):>20}{_fixed(_seconds(xi), 3):>19}{_fixed(_seconds(eta), 3):>19}"


def _seconds(angle: float) -> float:
    return float(np.degrees(angle)) * 3600.0


def _fixed(value: float, least: int) -> str:
    """Ten decimals without the zeros at their end, but so many decimals at least."""
    whole, _, decimals = f"{value:.10f}".partition(".")
    return f"{whole}.{decimals.rstrip('0').ljust(least, '0')}"


def sexagesimal_text(angle: float) -> str:
    """ddd.mmss… of an angle in radians, seconds to ten decimals."""
    degrees, minutes, seconds, sign = _parts(angle, 10)
    return (
        f"{sign}{degrees}.{minutes:02d}{seconds:013.10f}".replace(".", "#", 1)
        .replace(".", "")
        .replace("#", ".")
    )


def _parts(angle: float, decimals: int) -> tuple[int, int, float, str]:
    """Degrees, minutes, seconds and the sign of an angle in radians; the seconds to so many decimals."""
    units = round(abs(_seconds(angle)) * 10**decimals)
    minutes, rest = divmod(units, 60 * 10**decimals)
    return minutes // 60, minutes % 60, rest / 10**decimals, "-" if angle < 0.0 else ""


def _measurements(content: Content, group: Group, N: dict[str, float], frame: str) -> Iterator[str]:
    if group.entry.type in _CLUSTERS:
        yield from _cluster_lines(content, group, N, frame)
    else:
        yield from _plain_lines(content, group, KINDS[_CODES[group.entry.type]])


def _plain_lines(content: Content, group: Group, kind: Kind) -> Iterator[str]:
    code, metres = _CODES[kind.type], content.edge.metres
    names = [group.rows.text(name) for name in kind.names]
    heights = [np.nan_to_num(group.rows.number(f"{end}_height")) * metres for end in ("from", "to")]
    for row, (value, sigma) in enumerate(zip(group.values[:, 0], group.sigma[:, 0], strict=True)):
        if not np.isfinite(value):
            continue
        head = f"{code} " + "".join(f"{column[row]:<20}" for column in names)
        if kind.angle:
            degrees, minutes, seconds, sign = _parts(value, 8)
            text = f"{f'{sign}{degrees}':>17} {minutes:02d} {_fixed(seconds, 4):0>7} {_fixed(_seconds(sigma), 3):>8}"
        else:
            text = f"{_fixed(float(value) * metres, 4):>14} {_fixed(float(sigma) * metres, 3):>22}"
        if kind.heights and any(column[row] for column in heights):
            text += "".join(f" {_fixed(float(column[row]), 3):>6}" for column in heights)
        yield f"{head:<62}{text}"


def _cluster_lines(content: Content, group: Group, N: dict[str, float], frame: str) -> Iterator[str]:
    """One cluster of a table with a covariance over all, else every row for itself."""
    Q = _covariance(content, group)
    rows = np.flatnonzero(np.isfinite(group.values).all(axis=1))
    if 3 * len(rows) != len(Q):
        words = "DNA has vectors and positions with all three components"
        raise InputError([Problem(words, content.document.file)])
    whole = group.entry.covariance is not None
    parts = [list(range(len(rows)))] if whole else [[k] for k in range(len(rows))]
    for part in parts:
        cells = np.concatenate([np.arange(3 * k, 3 * k + 3) for k in part])
        yield from _cluster(content, group, [int(rows[k]) for k in part], Q[np.ix_(cells, cells)], N, frame)


def _covariance(content: Content, group: Group) -> FloatArray:
    """Covariance in m² (radians of latitudes and longitudes), as DNA has it."""
    assert group.covariance is not None
    lengths = np.array([1.0 if "tude" in c else content.edge.metres for c in _components(group)])
    own = group.factors if group.entry.covariance is not None else np.ones(3)
    scale = np.tile(own * lengths, len(group.covariance) // 3)
    return np.asarray(group.covariance * np.outer(scale, scale))


def _components(group: Group) -> tuple[str, ...]:
    return ("latitude", "longitude", "height") if group.entry.type == "geodetic_position" else ("x", "y", "z")


def _cluster(
    content: Content, group: Group, rows: list[int], Q: FloatArray, N: dict[str, float], frame: str
) -> Iterator[str]:
    vectors, geodetic = group.entry.type == "gnss_vector", group.entry.type == "geodetic_position"
    code = "Y" if not vectors else "X" if group.entry.covariance is not None else "G"
    names = [group.rows.text(name) for name in (("from", "to") if vectors else ("point",))]
    scales = "   1.00      1.00      1.00      1.00"
    for k, row in enumerate(rows):
        if vectors:
            head = f"{code} {names[0][row]:<20}{names[1][row]:<20}" + (
                f"{len(rows):<20}" if code == "X" else ""
            )
        else:
            head = f"{code} {names[0][row]:<20}{'LLH' if geodetic else 'XYZ':<20}{len(rows):<20}"
        yield f"{head:<62}{scales}{frame:>20}{_EPOCH:>20}" if k == 0 else f"{head[:42]:<62}"
        values = _values(content, group, row, N.get(names[0][row], 0.0) if geodetic else 0.0)
        for i in range(3):
            covariances = "".join(f"{v:20.13e}" for v in Q[3 * k + i, 3 * k : 3 * k + i + 1])
            yield f"{'':<62}{values[i]:>20}{covariances}"
        for other in range(k + 1, len(rows)):
            for i in range(3):
                block = Q[3 * k + i, 3 * other : 3 * other + 3]
                yield f"{'':<82}" + "".join(f"{v:20.13e}" for v in block)


def _values(content: Content, group: Group, row: int, N: float) -> list[str]:
    three = group.values[row].tolist()
    if group.entry.type != "geodetic_position":
        return [repr(float(value) * content.edge.metres) for value in three]
    height = three[2] * content.edge.metres - N
    return [sexagesimal_text(three[0]), sexagesimal_text(three[1]), repr(height)]
