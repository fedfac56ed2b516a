"""Points of a network on the earth for writers: where they are, the geoid and the vertical there, what is held."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.errors import InputError, Problem
from mor.formats.content import Content
from mor.observations.earth import DEFLECTIONS, GEOID
from mor.project.network.build import Network
from mor.project.tables.statuses import number_column
from mor.project.tables.tables import Column
from mor.project.world.world import World
from mor.units import LENGTH

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
    """(n,) N, NaN where unknown."""
    deflections: FloatArray
    """(n, 2) ξ, η."""
    held: BoolArray
    """(n, 3) east, north, up: held, or observed with a σ of a micrometre."""

    @property
    def geoid_by_name(self) -> dict[str, float]:
        """Geoid heights by name, 0 where unknown."""
        return dict(zip(self.ids, np.nan_to_num(self.geoid).tolist(), strict=True))


def world_of(content: Content, what: str) -> None:
    """Raise :class:`InputError` where a project is none on the earth, or has other senses than clockwise from north."""
    project = content.project
    if project.world is None:
        words = f"{what} has networks on the earth: this project has no world"
        raise InputError([Problem(words, content.document.file)])
    if project.axes.angles != "clockwise" or project.axes.bearings_from != "north":
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
    held = _held(content, world, what, problems)
    if problems:
        raise InputError(problems)
    geoid = world.geoid_at(blocks, object_)
    deflections = [world.of_points(f"deflection_{axis}", blocks) for axis in ("north", "east")]
    return EarthPoints(
        list(things.ids),
        world.horizon.to_geodetic(object_) * np.array([1.0, 1.0, world.metres]),
        world.in_metres(world.from_object(object_, np.nan_to_num(geoid))),
        geoid * world.metres,
        np.stack(deflections, axis=1),
        np.array([held.get(name, (False,) * 3) for name in things.ids]).reshape(-1, 3),
    )


def _held(content: Content, world: World, what: str, problems: list[Problem]) -> dict[str, tuple[bool, ...]]:
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
            words = "coordinates or leaves them free: observe them instead (gnss_position with a covariance)"
            problems.append(content.place("points", number).problem(f"{what} holds {words}"))
        for name, three in zip(rows.text("id"), np.isfinite(sigma), strict=True):
            known[name] = tuple(three.tolist())
    return known
