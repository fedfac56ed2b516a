"""Projections as polynomials over the area of a network, for observations in their plane."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from mor.arrays import FloatArray
from mor.observations import ObservationType
from mor.observations.earth.attitude import projected_attitude
from mor.observations.earth.projected_bearing import Plane, projected_bearing
from mor.project.file.model import Observations
from mor.project.network.reading import Reading
from mor.project.tables.columns import tell_rows
from mor.project.tables.tables import Place, Rows
from mor.project.world.observed import PLANE
from mor.project.world.reference_system import ReferenceSystem, ReferenceSystemError, reference_system
from mor.project.world.world import World

_DEGREES = (6, 10, 15, 21)
_CLOSE = 1e-7
"""Metres to which a polynomial is the projection, and ellipsoids are the same."""
_LEAST = 100_000.0
"""Metres around a network that belong to its area, for points without given places; else its own extent."""


class PlaneError(ValueError):
    """A projection that is no polynomial over the area; the words say why."""


def plane_of(
    system: ReferenceSystem, world: World, crs: str | None = None, extent: FloatArray | None = None
) -> Plane:
    """The plane of a projected system over the area of the points, in the unit of the project.

    The area is the ``extent`` (2, 2) of object coordinates, that of the given places where nothing is said. Raises
    :class:`PlaneError`.
    """
    low, high = world.extent if extent is None else extent
    margin = np.maximum(high - low, _LEAST / world.metres)
    middle, half = 0.5 * (low + high), 0.5 * (high - low) + margin
    for degree in _DEGREES:
        nodes = chebyshev.chebpts1(degree + 4)
        grid = np.stack([g.ravel() for g in np.meshgrid(nodes, nodes, indexing="ij")], axis=1)
        place, plane = _projected(system, world, middle, half, grid)
        if not np.isfinite(plane).all():
            raise PlaneError(f"{system.name} does not reach as far as the network")
        matrix = chebyshev.chebvander2d(place[:, 0], place[:, 1], [degree, degree])
        whole = np.round(
            plane.mean(axis=0)
        )  # small numbers keep their digits: bearings of short lines need them
        solution = np.asarray(np.linalg.lstsq(matrix, plane - whole, rcond=None)[0], dtype=np.float64)
        found = Plane(middle, half, solution.reshape(degree + 1, degree + 1, 2), crs)
        between = 0.97 * grid + 0.01
        there, expected = _projected(system, world, middle, half, between)
        if np.abs(found.at(there * half + middle)[0] + whole - expected).max() * world.metres < _CLOSE:
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
        return projected_bearing(world.horizon, plane_of(system, world, entry.projection))
    except (ReferenceSystemError, PlaneError) as error:
        reading.problems.append(place.problem(f"projection: {error}", "projection"))
        return None


def with_convergence_at_images(
    reading: Reading, type_: ObservationType, rows: Rows, place: Place
) -> ObservationType | None:
    """The type of attitudes in the projection of the project, where rows do not say for which place they are.

    Mistakes are told.
    """
    world, given = reading.world, [np.isfinite(rows.number(name)) for name in PLANE]
    assert world is not None
    words = "the place of an attitude needs both of east, north, or neither: then it is that of its image"
    tell_rows(reading.problems, given[0] != given[1], rows, words)
    if given[0].all():
        return type_
    try:
        return projected_attitude(world.horizon, plane_of(world.system, world))
    except PlaneError as error:
        reading.problems.append(place.problem(f"projection: {error}", "type"))
        return None
