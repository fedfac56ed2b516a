"""Places of images, stations and systems given in the reference system of the project: where they start."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray
from mor.observations.earth import GEOID
from mor.project.network.reading import Reading
from mor.project.tables.columns import tell_rows
from mor.project.tables.statuses import Statuses, number_column
from mor.project.tables.tables import Column, Rows
from mor.project.world.grids import GridError, geoid_heights
from mor.project.world.world import World
from mor.units import ANGLE, LENGTH

_OBSERVED = (
    "on the earth the place of a frame is a start value: observe it (projected_position, geodetic_position, "
    "gnss_position), or put it on a point (column point)"
)


def place_names(world: World) -> tuple[str, ...]:
    """Names of the coordinates of frames: ``elevation`` for the height, for ``height`` is that of the instrument."""
    return tuple(name.replace("height", "elevation") for name in world.system.coordinates)


def frame_columns(reading: Reading) -> list[Column]:
    """Columns of places on the earth besides x, y, z; none in a project without ``world``."""
    world = reading.world
    if world is None or world.system.kind == "geocentric":
        return []
    columns = []
    for name in place_names(world):
        quantity = ANGLE if name in ("latitude", "longitude") else LENGTH
        columns.append(number_column(name, quantity, reading.edge))
    return [*columns, number_column(GEOID, LENGTH, reading.edge)]


def start_places(reading: Reading, rows: Rows, plain: Statuses) -> Statuses:
    """Start values of positions in object coordinates, of columns that :func:`frame_columns` has.

    ``plain`` is what stands in x, y, z: only in a geocentric system these are places on the earth.
    """
    world = reading.world
    if world is None:  # mistakes in the points, told already
        return plain
    names = ", ".join(place_names(world))
    observed = np.any(~np.isnan(plain.sigma) | np.isfinite(plain.start), axis=1)
    tell_rows(reading.problems, observed, rows, _OBSERVED)
    given = plain.values
    if world.system.kind != "geocentric":
        words = f"x, y, z of its own have no place in the world; expected {names}"
        tell_rows(reading.problems, np.any(np.isfinite(given), axis=1), rows, words)
        given = np.stack([rows.number(name) for name in place_names(world)], axis=1)
    some, whole = np.any(np.isfinite(given), axis=1), np.all(np.isfinite(given), axis=1)
    tell_rows(reading.problems, some & ~whole, rows, f"a position on the earth needs all of {names}, or none")
    free, held = np.any(plain.free, axis=1), ~np.all(plain.free, axis=1)
    tell_rows(reading.problems, held & ~whole, rows, "fixed or observed, but it has no coordinates")
    tell_rows(reading.problems, held & free, rows, _OBSERVED)
    places = world.to_object(given, _geoid(reading, world, rows, given))
    nothing = np.full(places.shape, np.nan)
    return Statuses(places, plain.free, nothing, nothing)


def _geoid(reading: Reading, world: World, rows: Rows, given: FloatArray) -> FloatArray:
    """N (n,) at places (n, 3): of the column, else of the grid; a mistake where heights need it in vain."""
    if not world.orthometric:
        return np.zeros(len(given))
    N = rows.number(GEOID)
    placed = np.isfinite(given).all(axis=1)
    missing = np.isnan(N) & placed
    if world.geoid is not None and missing.any():
        try:
            geodetic = world.system.to_geodetic(world.in_metres(given))
            N = np.where(np.isnan(N), geoid_heights(world.geoid, geodetic) / world.metres, N)
        except GridError:  # told with the points
            return N
    words = (
        "height above the geoid, and nothing says where that is: a column geoid, or world: {geoid: FILE} that "
        "reaches there"
    )
    tell_rows(reading.problems, np.isnan(N) & placed, rows, words)
    return N
