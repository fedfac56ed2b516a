"""Observations on the Earth, in a projected plane, on a sphere, and in a free network."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial import chebyshev

from mor.model.contract import Names, ObservationGroup, ObservationType
from mor.model.curvature import on_sphere
from mor.model.earth import EARTH_RADIUS, LocalSphere, gaussian_radius
from mor.model.geodetic import CONVERGENCE, GEOID, ProjectionPolynomial, projected_attitude, projected_bearing
from mor.model.observation_types import PLAIN_TYPES
from mor.project.axes import UnitError
from mor.project.entities import Reading
from mor.project.reference_system import (
    EarthModel,
    GridError,
    ReferenceSystem,
    ReferenceSystemError,
    geoid_heights,
    reference_system,
)
from mor.project.schema import Curvature, Observations
from mor.project.tables import Rows, TableLocation
from mor.types import FloatArray, IntArray
from mor.units import ANGLE, LENGTH

# ---- Deflections, geoid heights and places that observations on the earth need.

PLANE = ("east", "north")
"""Columns of the place at which angles refer to the axes of a projection."""
MEANT = "its height is above the geoid, but the geoid is unknown: give a column geoid, or world: {geoid: FILE}"


def known_at(world: EarthModel, known: str, blocks: IntArray, rows: Rows, names: Names) -> FloatArray:
    """Deflections or geoid heights (n,) at positions; a missing geoid height is a mistake."""
    values = world.of_points(known, blocks)
    rows.tell_where(np.isnan(values), lambda row: f"{names[row]!r}: {MEANT}")
    return values


def place_of_observed(
    reading: Reading, world: EarthModel, blocks: IntArray, rows: Rows, given: FloatArray
) -> FloatArray:
    """Constants (n, 10) of positions (n, 3) that were observed in the projection of the project."""
    N, planned = np.zeros(rows.count), np.asarray((given == 0.0).all(axis=1) & reading.planned)
    if world.orthometric:
        N = rows.number(GEOID)
        N = np.where(np.isnan(N), world.of_points(GEOID, blocks), N)
        N = np.where(np.isnan(N), _of_grid(world, given), N)
        rows.tell_where(np.isnan(N) & ~planned, MEANT)
    rows.tell_where(np.any(np.isnan(given), axis=1), "a position on the earth needs all of east, north, height")
    place = world.to_object(np.where(planned[:, None], world.inside(), given), N)
    return np.concatenate([place, world.grid(place).reshape(-1, 4), given], axis=1)


def convergence_of_rows(world: EarthModel, rows: Rows) -> FloatArray:
    """Directions of grid north (n,) at the places of the columns ``east`` and ``north``; NaN if there are none."""
    there = np.stack([rows.number(name) for name in PLANE], axis=1)
    found, known = np.full(rows.count, np.nan), np.isfinite(there).all(axis=1)
    if known.any():
        found[known] = world.convergence(there[known])
    return found


def _of_grid(world: EarthModel, given: FloatArray) -> FloatArray:
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


# ---- Projections as polynomials over the area of a network, for observations in their plane.

_CLOSE = 1e-7
"""Metres to which a polynomial is the projection, and ellipsoids are the same."""


class PlaneError(ValueError):
    """A projection that is no polynomial over the area; the words say why."""


def plane_of(
    system: ReferenceSystem, world: EarthModel, crs: str | None = None, extent: FloatArray | None = None
) -> ProjectionPolynomial:
    """The plane of a projected system over the area of the points, in the unit of the project.

    The area is the ``extent`` (2, 2) of object coordinates, that of the given places where nothing is said. Raises
    :class:`PlaneError`.
    """
    low, high = world.extent if extent is None else extent
    # Metres around a network that belong to its area, for points without given places; else its own extent.
    margin = np.maximum(high - low, 100_000.0 / world.metres)
    middle, half = 0.5 * (low + high), 0.5 * (high - low) + margin
    for degree in (6, 10, 15, 21):
        nodes = chebyshev.chebpts1(degree + 4)
        grid = np.stack([g.ravel() for g in np.meshgrid(nodes, nodes, indexing="ij")], axis=1)
        place, plane = _projected(system, world, middle, half, grid)
        if not np.isfinite(plane).all():
            raise PlaneError(f"{system.name} does not reach as far as the network")
        matrix = chebyshev.chebvander2d(place[:, 0], place[:, 1], [degree, degree])
        whole = np.round(plane.mean(axis=0))  # small numbers keep their digits: bearings of short lines need them
        solution = np.asarray(np.linalg.lstsq(matrix, plane - whole, rcond=None)[0], dtype=np.float64)
        found = ProjectionPolynomial(middle, half, solution.reshape(degree + 1, degree + 1, 2), crs)
        between = 0.97 * grid + 0.01
        there, expected = _projected(system, world, middle, half, between)
        if np.abs(found.at(there * half + middle)[0] + whole - expected).max() * world.metres < _CLOSE:
            return found
    raise PlaneError(f"{system.name} is not a polynomial over the area of the network")


def _projected(
    system: ReferenceSystem, world: EarthModel, middle: FloatArray, half: FloatArray, grid: FloatArray
) -> tuple[FloatArray, FloatArray]:
    above = np.hstack([grid * half + middle, np.zeros((len(grid), 1))])
    foot = world.horizon.foot(above).position
    geodetic = world.horizon.to_geodetic(foot)
    geodetic[:, 2] = 0.0
    return (foot[:, :2] - middle) / half, system.from_geodetic(geodetic)[:, :2] / world.metres


def in_its_projection(reading: Reading, entry: Observations, place: TableLocation) -> ObservationType | None:
    """The type of a group with the projection that it names, or that of the project; mistakes are told."""
    world = reading.world
    assert world is not None
    if entry.projection is None and world.system.kind != "projected":
        place.tell(f"{entry.type}: {world.system.name} is not a projection; name one (projection: EPSG:25832)", "type")
        return None
    try:
        system = world.system if entry.projection is None else reference_system(entry.projection)
        if system.kind != "projected":
            raise ReferenceSystemError(f"{system.name} is not a projection")
        ours, theirs = world.system.ellipsoid, system.ellipsoid
        if abs(ours.a - theirs.a) > _CLOSE or abs(ours.f - theirs.f) * ours.a > _CLOSE:
            raise ReferenceSystemError(f"{system.name} is of another ellipsoid than {world.system.name}")
        return projected_bearing(world.horizon, plane_of(system, world, entry.projection))
    except (ReferenceSystemError, PlaneError) as error:
        place.tell(f"projection: {error}", "projection")
        return None


def with_convergence_at_images(
    reading: Reading, type_: ObservationType, rows: Rows, place: TableLocation
) -> ObservationType | None:
    """The type of attitudes in the projection of the project, where rows do not say for which place they are.

    Mistakes are told.
    """
    world, given = reading.world, [np.isfinite(rows.number(name)) for name in PLANE]
    assert world is not None
    words = "the place of an attitude needs both of east, north, or neither: then it is that of its image"
    rows.tell_where(given[0] != given[1], words)
    if given[0].all():
        return type_
    try:
        return projected_attitude(world.horizon, plane_of(world.system, world))
    except PlaneError as error:
        place.tell(f"projection: {error}", "type")
        return None


# ---- The sphere under a local network: `curvature` of the project file.


def read_sphere(reading: Reading) -> None:
    """Put the sphere of the project and its observation types into ``reading``; problems are collected there."""
    section = reading.project.curvature
    if not section:
        return
    place = reading.at("curvature")
    if reading.project.world is not None:
        place.tell("curvature: a network on the ellipsoid (world) has it already; remove the key")
        return
    refused = [
        *(("cameras", name) for name, c in reading.project.cameras.items() if c.readout is not None),
        *((("trajectories",),) if reading.project.trajectories else ()),
    ]
    for path in refused:
        what = "trajectories" if path == ("trajectories",) else "a rolling shutter"
        reading.at(*path).tell(f"curvature: {what} cannot be on the sphere; use world, or leave curvature out")
    radius = _radius(reading, section if isinstance(section, Curvature) else Curvature.model_construct())
    origin = _origin(reading, section if isinstance(section, Curvature) else Curvature.model_construct())
    if refused or radius is None or origin is None:
        return
    reading.sphere = LocalSphere(radius, origin)
    reading.types = {key: on_sphere(type_, reading.sphere, reading.edge.metres) for key, type_ in PLAIN_TYPES.items()}
    given = np.array(origin) @ reading.edge.matrix  # rows: project axes = matrixᵀ · internal
    unit = reading.edge.units.length
    x, y, z = (f"{value:.10g}" for value in given)
    words = (
        f"curvature: heights are above a sphere of radius {radius:.10g} {unit}, which is at height {z} {unit} at "
        f"x = {x}, y = {y}"
    )
    reading.notes.append(place.problem(words))


def median_origin(positions: FloatArray, metre: float) -> tuple[float, float, float]:
    """Return the median of coordinates (n, 3), rounded to a metre (in units of length); 0 where none is known."""
    found = []
    for column in positions.T:
        known = column[np.isfinite(column)]
        found.append(float(np.round(np.median(known) / metre) * metre) if len(known) else 0.0)
    return found[0], found[1], found[2]


def _radius(reading: Reading, section: Curvature) -> float | None:
    place, metres = reading.at("curvature"), reading.edge.metres
    if section.radius is not None and section.latitude is not None:
        place.tell("curvature: radius and latitude are two ways to say the same; remove one")
        return None
    try:
        if section.latitude is not None:
            latitude = reading.edge.number(section.latitude, ANGLE)
            if abs(latitude) > 0.5 * np.pi:
                raise UnitError(f"found {np.degrees(latitude):.6g}°, expected it between -90° and 90°")
            return gaussian_radius(latitude) / metres
        if section.radius is None:
            return EARTH_RADIUS / metres
        radius = reading.edge.number(section.radius, LENGTH)
        # Metres; a smaller radius is a mistake in the unit.
        if radius * metres < 1e6:
            raise UnitError(f"found {radius * metres / 1e3:.6g} km, expected that of the earth, some 6371 km")
        return radius
    except UnitError as error:
        key = "latitude" if section.latitude is not None else "radius"
        place.tell(f"curvature: {key}: {error}", key)
        return None


def _origin(reading: Reading, section: Curvature) -> tuple[float, float, float] | None:
    if section.origin is None:
        store = reading.shop.store("point")
        positions = store.start_values(store.all_values())
        things = [reading.shop.things[space] for space in ("point", "station", "image") if space in reading.shop.things]
        blocks = np.concatenate([thing.parts["position"] for thing in things] or [np.zeros(0, dtype=np.int64)])
        return median_origin(positions[np.unique(blocks)], 1.0 / reading.edge.metres)
    given = []
    for name in ("x", "y", "z"):
        try:
            given.append(reading.edge.number(getattr(section.origin, name), LENGTH))
        except UnitError as error:
            reading.at("curvature").tell(f"curvature: origin: {name}: {error}", "origin")
            return None
    x, y, z = np.array(given) @ reading.edge.matrix.T
    return float(x), float(y), float(z)


# ---- Networks on the earth that plumb lines leave neither free nor determined: these have no solution, and are told.
#
# Levelled instruments tell nothing of a turn of their network about its vertical, nor of a movement along the
# earth that turns it with its plumb lines: on a sphere nothing at all, on the ellipsoid what its curvature
# changes from place to place. But verticals are constants of a step, and in such a step the plumb lines of
# the other places, by d/R beside the one in the middle, hold the network against the turn, and with levelled
# heights its shifts, too. What seems determined there is no information; the iteration follows it, and never
# comes to an end. An inner constraint in its place would have to be a condition of its own, beside the
# defect.

_LIES = (
    "datum: on the earth levelled instruments and heights neither determine the position of the network nor leave it "
    "free, because verticals differ from place to place; fix or observe a point"
)


def check_held_on_earth(reading: Reading, groups: Sequence[ObservationGroup], free: bool) -> None:
    """Tell a datum that plumb lines leave open; ``groups`` are those of the project, control among them.

    ``free``: of a network that is not, and in which nothing is held, the defect is told later.
    """
    kinds = {group.type.key for group in groups}
    levelled = {"directions", "zenith_directions", "zenith_angle", "vertical_direction", "angle", "horizontal_distance"}
    if reading.world is None or not kinds & levelled:
        return
    held = _places_held(reading, groups)
    heights = {"height_difference", "ellipsoidal_height_difference", "ellipsoidal_height", "orthometric_height"}
    turn_open = (
        "datum: on the earth levelled instruments neither determine the rotation about the vertical nor leave it free, "
        "because verticals differ from place to place; fix or observe two points, or one point and an azimuth"
    )
    turn_about_point_open = (
        "datum: on the earth levelled instruments neither determine the rotation about the only fixed point nor leave "
        "it free, because verticals differ from place to place; fix or observe a second point, or an azimuth"
    )
    if not _turn_is_held(reading, groups) and (held == 1 or (held == 0 and free)):
        reading.at("datum").tell(turn_about_point_open if held else turn_open)
    elif held == 0 and free and kinds & heights:
        reading.at("datum").tell(_LIES)


def _places_held(reading: Reading, groups: Sequence[ObservationGroup]) -> int:
    free = reading.shop.store("point").all_free()
    held = np.zeros(len(free), dtype=bool)
    for things in reading.shop.things.values():
        if "position" in things.parts:
            blocks = things.parts["position"]
            held[blocks[(~free[blocks]).any(axis=1)]] = True
    for group in groups:
        if group.type.key in {"control", "gnss_position", "geodetic_position", "projected_position"}:
            held[group.blocks[0]] = True
    return int(np.count_nonzero(held))


def _turn_is_held(reading: Reading, groups: Sequence[ObservationGroup]) -> bool:
    turned = {
        "gnss_vector",
        "azimuth",
        "astronomic_azimuth",
        "projected_bearing",
        "projected_attitude",
        "navigation_attitude",
    }
    if any(group.type.key in turned for group in groups):
        return True
    kappa = 2
    if any(group.type.key == "observed/rotation" and group.mask[:, kappa].any() for group in groups):
        return True
    free = reading.shop.store("rotation").all_free()
    rotations = [
        reading.shop.things[space].parts["rotation"]
        for space in ("station", "image", "system")
        if space in reading.shop.things
    ]
    return any(bool((~free[blocks[blocks >= 0], kappa]).any()) for blocks in rotations)
