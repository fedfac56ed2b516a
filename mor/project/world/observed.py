"""Deflections, geoid heights and places that observations on the earth need."""

from __future__ import annotations

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.observations import ObservationType
from mor.observations.earth import GEOID
from mor.observations.earth.attitude import CONVERGENCE
from mor.observations.names import Names
from mor.project.network.reading import Reading
from mor.project.tables.columns import tell_rows
from mor.project.tables.tables import Rows
from mor.project.world.grids import GridError, geoid_heights
from mor.project.world.world import World

PLANE = ("east", "north")
"""Columns of the place at which angles refer to the axes of a projection."""
MEANT = "its height above the geoid is meant, and nothing says where that is: column geoid, or world: {geoid: FILE}"


def known_at(
    reading: Reading, world: World, known: str, blocks: IntArray, rows: Rows, names: Names
) -> FloatArray:
    """Deflections or geoid heights (n,) at positions; a missing geoid height is a mistake."""
    values = world.of_points(known, blocks)
    tell_rows(reading.problems, np.isnan(values), rows, lambda row: f"{names[row]!r}: {MEANT}")
    return values


def place_of_observed(
    reading: Reading, world: World, blocks: IntArray, rows: Rows, given: FloatArray
) -> FloatArray:
    """Constants (n, 10) of positions (n, 3) that were observed in the projection of the project."""
    N, planned = np.zeros(rows.count), _planned(reading, given)
    if world.orthometric:
        N = rows.number(GEOID)
        N = np.where(np.isnan(N), world.of_points(GEOID, blocks), N)
        N = np.where(np.isnan(N), _of_grid(reading, world, given), N)
        tell_rows(reading.problems, np.isnan(N) & ~planned, rows, MEANT)
    lost = np.any(np.isnan(given), axis=1)
    tell_rows(reading.problems, lost, rows, "a position on the earth needs all of east, north, height")
    place = world.to_object(np.where(planned[:, None], world.inside(), given), N)
    return np.concatenate([place, world.grid(place).reshape(-1, 4), given], axis=1)


def convergence_of_rows(world: World, rows: Rows) -> FloatArray:
    """Directions of grid north (n,) at the places of the columns ``east`` and ``north``; NaN if there are none."""
    there = np.stack([rows.number(name) for name in PLANE], axis=1)
    found, known = np.full(rows.count, np.nan), np.isfinite(there).all(axis=1)
    if known.any():
        found[known] = world.convergence(there[known])
    return found


def _planned(reading: Reading, given: FloatArray) -> BoolArray:
    """(n,) rows that nobody has measured: their place is that of the plan, and zeros stand for their values."""
    return np.asarray((given == 0.0).all(axis=1) & reading.planned)


def _of_grid(reading: Reading, world: World, given: FloatArray) -> FloatArray:
    if world.geoid is None:
        return np.full(len(given), np.nan)
    try:
        return geoid_heights(world.geoid, world.system.to_geodetic(given * world.metres)) / world.metres
    except GridError:  # told with the points
        return np.full(len(given), np.nan)


def needs_place(type_: ObservationType) -> bool:
    """True for types that are told where they were observed."""
    return any(constant.name.startswith("grid ") for constant in type_.constants)


def needs_convergence(type_: ObservationType) -> bool:
    """True for types whose angles refer to grid north."""
    return CONVERGENCE in type_.constants
