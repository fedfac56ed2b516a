"""The sphere under a local network: `curvature` of the project file."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.earth import EARTH_RADIUS, LocalSphere, gaussian_radius
from mor.observations import PLAIN_TYPES, ObservationType
from mor.observations.curvature import on_sphere
from mor.project.edge import Edge, UnitError
from mor.project.file.earth import Curvature
from mor.project.network.reading import Reading
from mor.units import ANGLE, LENGTH

_NAMES = ("point", "station", "image")
_HALF_PI = 0.5 * np.pi


def read_sphere(reading: Reading) -> None:
    """Put the sphere of the project and its observation types into ``reading``; problems are collected there."""
    section = reading.project.curvature
    if not section:
        return
    place = reading.at("curvature")
    if reading.project.world is not None:
        words = "curvature: a network on the ellipsoid (world) has it already; remove the key"
        reading.problems.append(place.problem(words))
        return
    refused = [
        *(("cameras", name) for name, c in reading.project.cameras.items() if c.readout is not None),
        *((("trajectories",),) if reading.project.trajectories else ()),
    ]
    for path in refused:
        what = "trajectories" if path == ("trajectories",) else "a rolling shutter"
        words = f"curvature: {what} cannot be on the sphere; use world, or leave curvature out"
        reading.problems.append(reading.at(*path).problem(words))
    radius = _radius(reading, section if isinstance(section, Curvature) else Curvature.model_construct())
    origin = _origin(reading, section if isinstance(section, Curvature) else Curvature.model_construct())
    if refused or radius is None or origin is None:
        return
    reading.sphere = LocalSphere(radius, origin)
    reading.types = types_on_sphere(reading.sphere, reading.edge)
    given = np.array(origin) @ reading.edge.matrix  # rows: project axes = matrixᵀ · internal
    unit = reading.edge.units.length
    x, y, z = (f"{value:.10g}" for value in given)
    words = (
        f"curvature: heights are above a sphere of radius {radius:.10g} {unit}, which is at height {z} {unit} at "
        f"x = {x}, y = {y}"
    )
    reading.notes.append(place.problem(words))


def types_on_sphere(sphere: LocalSphere, edge: Edge) -> Mapping[str, ObservationType]:
    """Return the plain observation types by key, with those that the curvature changes on the sphere."""
    return {key: on_sphere(type_, sphere, edge.metres) for key, type_ in PLAIN_TYPES.items()}


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
        words = "curvature: radius and latitude are two ways to say the same; remove one"
        reading.problems.append(place.problem(words))
        return None
    try:
        if section.latitude is not None:
            latitude = reading.edge.number(section.latitude, ANGLE)
            if abs(latitude) > _HALF_PI:
                raise UnitError(f"found {np.degrees(latitude):.6g}°, expected it between -90° and 90°")
            return gaussian_radius(latitude) / metres
        if section.radius is None:
            return EARTH_RADIUS / metres
        radius = reading.edge.number(section.radius, LENGTH)
        if radius * metres < _SMALLEST:
            raise UnitError(f"found {radius * metres / 1e3:.6g} km, expected that of the earth, some 6371 km")
        return radius
    except UnitError as error:
        key = "latitude" if section.latitude is not None else "radius"
        reading.problems.append(place.problem(f"curvature: {key}: {error}", key))
        return None


_SMALLEST = 1e6
"""Metres; a smaller radius is a mistake in the unit."""


def _origin(reading: Reading, section: Curvature) -> tuple[float, float, float] | None:
    if section.origin is None:
        store = reading.shop.store("point")
        positions = store.start_values(store.all_values())
        things = [reading.shop.things[space] for space in _NAMES if space in reading.shop.things]
        blocks = np.concatenate(
            [thing.parts["position"] for thing in things] or [np.zeros(0, dtype=np.int64)]
        )
        return median_origin(positions[np.unique(blocks)], 1.0 / reading.edge.metres)
    given = []
    for name in ("x", "y", "z"):
        try:
            given.append(reading.edge.number(getattr(section.origin, name), LENGTH))
        except UnitError as error:
            words = f"curvature: origin: {name}: {error}"
            reading.problems.append(reading.at("curvature").problem(words, "origin"))
            return None
    x, y, z = np.array(given) @ reading.edge.matrix.T
    return float(x), float(y), float(z)
