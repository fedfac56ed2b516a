"""A network on the earth for writers: where its points are and what is held of them, clusters of GNSS."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.errors import InputError, Problem
from mor.formats.content import Content
from mor.formats.networks.terrestrial import Group, stations
from mor.observations.earth import DEFLECTIONS, GEOID
from mor.project.network.build import Network
from mor.project.tables.statuses import number_column
from mor.project.tables.tables import Column
from mor.project.world.world import World
from mor.units import ANGLE, LENGTH

_HELD = 1e-6
"""Largest σ (m) that is as good as none."""


class EarthPoints(NamedTuple):
    """Points at their start values, in metres and radians; arrays have a row for each."""

    ids: list[str]
    geodetic: FloatArray
    """(n, 3) latitude, longitude, ellipsoidal height."""
    given: FloatArray
    """(n, 3) in the reference system and the heights of the project."""
    geoid: FloatArray
    """(n,) N, NaN if unknown."""
    deflections: FloatArray
    """(n, 2) ξ, η."""
    held: BoolArray
    """(n, 3) east, north, up: held, or observed with a σ of a micrometre."""

    @property
    def geoid_by_name(self) -> dict[str, float]:
        """Geoid heights by name, 0 where unknown."""
        return dict(zip(self.ids, np.nan_to_num(self.geoid).tolist(), strict=True))


def world_of(content: Content, what: str) -> None:
    """Raise :class:`InputError` where a project is none on the earth."""
    if content.project.world is None:
        words = f"{what} has networks on the earth: this project has no world"
        raise InputError([Problem(words, content.document.file)])


def clockwise_from_north(content: Content, what: str) -> None:
    """Raise :class:`InputError` where angles of a project have other senses and zeros."""
    if content.project.axes.angles != "clockwise" or content.project.axes.bearings_from != "north":
        words = f"{what} has angles clockwise and azimuths from north"
        raise InputError([content.place("axes").problem(words)])


def earth_points(content: Content, network: Network, what: str) -> EarthPoints:
    """All points. Raises :class:`InputError` for those without a place, and for σ that ``what`` has not."""
    world, things = network.world, network.things["point"]
    assert world is not None
    blocks = things.parts["position"]
    object_ = network.start["point"][blocks]
    words = "has no coordinates; convert an adjusted project (adjusted.yaml)"
    problems = [
        Problem(f"point {name!r} {words}", content.document.file)
        for name, place in zip(things.ids, object_, strict=True)
        if not np.isfinite(place).all()
    ]
    tables = _tables(content, world, what, problems)
    if problems:
        raise InputError(problems)
    geoid = world.geoid_at(blocks, object_)
    given = world.in_metres(world.from_object(object_, np.nan_to_num(geoid)))
    entries = [tables.get(name, _NOTHING) for name in things.ids]
    own = np.array([entry.given for entry in entries]).reshape(-1, 3)
    deflections = [world.of_points(f"deflection_{axis}", blocks) for axis in ("north", "east")]
    return EarthPoints(
        list(things.ids),
        world.horizon.to_geodetic(object_) * np.array([1.0, 1.0, world.metres]),
        np.where(np.isfinite(own), own, given),
        geoid * world.metres,
        np.stack(deflections, axis=1),
        np.array([entry.held for entry in entries]).reshape(-1, 3),
    )


class _Entry(NamedTuple):
    """A point as its table has it: coordinates (m, rad; NaN if there are none), what is held."""

    given: FloatArray
    held: BoolArray


_NOTHING = _Entry(np.full(3, np.nan), np.zeros(3, dtype=bool))


def _tables(content: Content, world: World, what: str, problems: list[Problem]) -> dict[str, _Entry]:
    """Points of all tables, so that coordinates are those of the project to the last digit.

    σ that do not hold a component are mistakes.
    """
    edge, known = content.edge, {}
    names, coordinates = ("sigma_east", "sigma_north", "sigma_up"), world.system.coordinates
    for number, table in enumerate(content.project.points):
        columns = [Column("id", required=True), Column(GEOID), *(Column(name) for name in DEFLECTIONS)]
        columns += [number_column(name, LENGTH, edge) for name in ("sigma", *names)]
        for name in coordinates:
            quantity = ANGLE if "tude" in name else LENGTH
            columns += [number_column(f"{begin}{name}", quantity, edge) for begin in ("", "start_")]
        rows = content.rows("points", number, table, columns)
        sigma = np.stack([rows.number(name) for name in names], axis=1)
        sigma = np.where(np.isnan(sigma), rows.number("sigma")[:, None], sigma) * edge.metres
        sigma[:] = 0.0 if table.fixed else sigma
        if (sigma > _HELD * (1.0 + 1e-9)).any():
            words = "coordinates or leaves them free: observe them instead (gnss_position with a covariance)"
            problems.append(content.place("points", number).problem(f"{what} holds {words}"))
        start = np.stack([rows.number(f"start_{name}") for name in coordinates], axis=1)
        plain = np.stack([rows.number(name) for name in coordinates], axis=1)
        given = world.in_metres(np.where(np.isnan(start), plain, start))
        for name, three, held in zip(rows.text("id"), given, np.isfinite(sigma), strict=True):
            known[name] = _Entry(three, held)
    return known


class SetUps:
    """Points under the stations of directions."""

    def __init__(self, content: Content, points: Collection[str]) -> None:
        self._content, self._points = content, set(points)
        self._under = {name: point for name, (point, _) in stations(content).items()}

    def point(self, station: str) -> str:
        """The point of a station. Raises :class:`InputError` if it stands on none."""
        point = self._under.get(station, station)
        if point not in self._points:
            words = f"station {station!r} stands on no point"
            raise InputError([Problem(words, self._content.document.file)])
        return point


def raised(content: Content, found: list[Group]) -> bool:
    """Return True if directions have heights of instrument or target."""
    sets = [group for group in found if group.entry.type == "directions"]
    columns = [group.rows.number(f"{end}_height") for group in sets for end in ("from", "to", "station")]
    own = [height for _, height in stations(content).values()] if sets else []
    return any(np.nan_to_num(column).any() for column in columns) or any(own)


def clusters(content: Content, group: Group, what: str) -> Iterator[tuple[list[int], FloatArray]]:
    """Rows of vectors or positions that are correlated, and their (3n, 3n) covariances: m², rad of latitude, longitude.

    A table with a matrix is one cluster, every row of others one of its own. Raises :class:`InputError` for rows with
    some components only, which ``what`` has not.
    """
    Q = _covariance(content, group)
    rows = np.flatnonzero(np.isfinite(group.values).all(axis=1)).tolist()
    if 3 * len(rows) != len(Q):
        words = f"{what} has vectors and positions with all three components"
        raise InputError([Problem(words, content.document.file)])
    if group.entry.covariance is not None:
        yield rows, Q
        return
    for k, row in enumerate(rows):
        yield [row], Q[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]


def _covariance(content: Content, group: Group) -> FloatArray:
    assert group.covariance is not None
    geodetic = group.entry.type == "geodetic_position"
    metres = content.edge.metres
    lengths = np.array([1.0, 1.0, metres] if geodetic else [metres] * 3)
    own = group.factors if group.entry.covariance is not None else np.ones(3)
    scale = np.tile(own * lengths, len(group.covariance) // 3)
    return np.asarray(group.covariance * np.outer(scale, scale))
