"""Projections as polynomials over the area of a network, for observations in their plane."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from mor.arrays import FloatArray
from mor.observations import ObservationType
from mor.observations.earth.projected_bearing import Plane, projected_bearing
from mor.project.file.model import Observations
from mor.project.network.reading import Reading
from mor.project.tables.tables import Place
from mor.project.world.reference_system import ReferenceSystem, ReferenceSystemError, reference_system
from mor.project.world.world import World

_DEGREES = (6, 10, 15, 21)
_CLOSE = 1e-6
"""Metres to which a polynomial is the projection."""
_LEAST = 100_000.0
"""Metres around a network that belong to its area, for points without given places; else its own extent."""


class PlaneError(ValueError):
    """A projection that is no polynomial over the area; the words say why."""


def plane_of(system: ReferenceSystem, world: World) -> Plane:
    """The plane of a projected system over the area of the points, in the unit of the project.

    Raises :class:`PlaneError`.
    """
    low, high = world.extent
    margin = np.maximum(high - low, _LEAST / world.metres)
    middle, half = 0.5 * (low + high), 0.5 * (high - low) + margin
    for degree in _DEGREES:
        nodes = chebyshev.chebpts1(degree + 4)
        grid = np.stack([g.ravel() for g in np.meshgrid(nodes, nodes, indexing="ij")], axis=1)
        place, plane = _projected(system, world, middle, half, grid)
        if not np.isfinite(plane).all():
            raise PlaneError(f"{system.name} does not reach as far as the network")
        matrix = chebyshev.chebvander2d(place[:, 0], place[:, 1], [degree, degree])
        solution = np.asarray(np.linalg.lstsq(matrix, plane, rcond=None)[0], dtype=np.float64)
        found = Plane(middle, half, solution.reshape(degree + 1, degree + 1, 2))
        between = 0.97 * grid + 0.01
        there, expected = _projected(system, world, middle, half, between)
        if np.abs(found.at(there * half + middle)[0] - expected).max() * world.metres < _CLOSE:
            return found
    raise PlaneError(f"{system.name} is no polynomial over the area of the network")


def _projected(
    system: ReferenceSystem, world: World, middle: FloatArray, half: FloatArray, grid: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Places of feet in the rectangle, and their E, N, of places above or below them."""
    above = np.hstack([grid * half + middle, np.zeros((len(grid), 1))])
    foot = world.horizon.foot(above).position
    geodetic = world.horizon.to_geodetic(foot)
    geodetic[:, 2] = 0.0
    plane = system.from_geodetic(geodetic)[:, :2] / world.metres
    return (foot[:, :2] - middle) / half, plane


def in_its_projection(reading: Reading, entry: Observations, place: Place) -> ObservationType | None:
    """The type of a group with the projection that it names, or that of the project; mistakes are told."""
    world = reading.world
    assert world is not None
    if entry.projection is None and world.system.kind != "projected":
        words = f"{entry.type}: {world.system.name} is no projection; name one (projection: EPSG:25832)"
        reading.problems.append(place.problem(words, "type"))
        return None
    try:
        system = world.system if entry.projection is None else reference_system(entry.projection)
        if system.kind != "projected":
            raise ReferenceSystemError(f"{system.name} is no projection")
        ours, theirs = world.system.ellipsoid, system.ellipsoid
        if abs(ours.a - theirs.a) > _CLOSE or abs(ours.f - theirs.f) * ours.a > _CLOSE:
            raise ReferenceSystemError(f"{system.name} is of another ellipsoid than {world.system.name}")
        return projected_bearing(world.horizon, plane_of(system, world))
    except (ReferenceSystemError, PlaneError) as error:
        reading.problems.append(place.problem(f"projection: {error}", "projection"))
        return None
