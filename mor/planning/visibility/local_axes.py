"""Which way is up, and where coordinates lie: everywhere the same, or on the earth that of the place."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray
from mor.project.network.reading import Reading

GEOGRAPHIC = "on the earth a surface has its corners in a projection or geocentric, or by names of points"
NO_GEOID = "corners above the geoid need its grid (world: {geoid: FILE}), or names of points"


def local_axes(reading: Reading, positions: FloatArray) -> FloatArray:
    """(n, 3, 3) rows x, y, up at places (n, 3), internal axes; on the earth east, north, up."""
    if reading.world is None:
        return np.broadcast_to(reading.edge.matrix.T, (len(positions), 3, 3))
    return reading.world.horizon.local_axes(positions)


def upwards(reading: Reading, positions: FloatArray) -> FloatArray:
    """(n, 3) upward directions at places (n, 3), internal axes."""
    if reading.world is None:
        return np.broadcast_to(np.array([0.0, 0.0, 1.0]), positions.shape)
    return reading.world.horizon.local_axes(positions)[:, 2]


def placed(reading: Reading, coordinates: FloatArray) -> FloatArray:
    """Coordinates (n, 3) as a project gives them, in its axes; on the earth from those of its reference system.

    Raises ``ValueError`` where these say no place.
    """
    world = reading.world
    if world is None:
        return coordinates
    if world.system.kind == "geographic":
        raise ValueError(GEOGRAPHIC)
    N = np.zeros(len(coordinates))
    if world.orthometric:
        N = world.geoid_at(np.full(len(coordinates), -1), world.to_object(coordinates, N))
        if np.isnan(N).any():
            raise ValueError(NO_GEOID)
    there: FloatArray = world.to_object(coordinates, N) @ reading.edge.matrix
    return there
