"""A plane object from two or more images as plain data."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mor.approximate.planar.plane_object import PlacedPlane, on_level_plane, on_wall, scale_from_length
from mor.approximate.planar.plane_precision import Length, corners, derived, placed_covariance
from mor.approximate.planar.plane_shape import PlaneShape, shape_of_plane
from mor.arrays import FloatArray
from mor.errors import InputError, Problem
from mor.geometry.rotations import angles_from_rotation
from mor.report.orientation.measured import Measured, bundles, check_names
from mor.report.orientation.numbers import ANGLES, by_turn, correlation, number, numbers, sigmas, with_sigma
from mor.units import ANGLE_UNITS


class Wanted(NamedTuple):
    """Scale, system and unit of angles in which the user wants the object."""

    length: tuple[str, str, float] | None
    length_sigma: float
    wall: bool
    unit: str


def planar(measured: Measured, constants: FloatArray, sigma: float, off: tuple[str, ...] = ()) -> PlaneShape:
    """Shape of the plane object from all images; ``off`` names points beside the plane, else they are looked for.

    Raises :class:`InputError` for names that are not there.
    """
    check_names(measured, off)
    beside = np.isin(np.array(measured.ids, dtype=object), off) if off else None
    return shape_of_plane(bundles(measured, constants, sigma), beside)


def is_known(shape: PlaneShape) -> bool:
    """Return True if the outcome names a solution, unambiguous or not."""
    return shape.outcome.usable


def planar_data(
    measured: Measured, shape: PlaneShape, constants: FloatArray, wanted: Wanted
) -> dict[str, Any]:
    """Plane object and cameras; lengths in the unit of the given length, else the first two points are one apart."""
    check_names(measured, () if wanted.length is None else wanted.length[:2])
    shapes = (shape, *shape.alternatives) if is_known(shape) else ()
    return {
        "outcome": shape.outcome.name.lower(),
        "words": shape.outcome.value,
        "usable": shape.outcome.usable,
        "sigma0": number(shape.sigma0),
        "redundancy": shape.redundancy,
        "scaled": wanted.length is not None,
        "system": "wall Y = 0, Z up" if wanted.wall else "level plane Z = 0",
        "solutions": [_solution(measured, one, constants, wanted) for one in shapes],
    }


def _tie(measured: Measured, shape: PlaneShape, wanted: Wanted) -> Length:
    """The points that carry origin, direction and length."""
    known = np.isfinite(shape.points[:, 0])
    if wanted.length is None:
        first, second = (int(k) for k in np.flatnonzero(shape.in_plane & known)[:2])
        return Length(first, second, 1.0, 0.0)
    first, second = (measured.ids.index(name) for name in wanted.length[:2])
    apart = np.linalg.norm(shape.points[second] - shape.points[first])
    if not known[first] or not known[second] or not apart > 0.0:
        raise InputError(
            [Problem("the points of the length have no place in the plane, or stand above each other")]
        )
    return Length(first, second, wanted.length[2], wanted.length_sigma)


def _solution(measured: Measured, shape: PlaneShape, constants: FloatArray, wanted: Wanted) -> dict[str, Any]:
    tie = _tie(measured, shape, wanted)
    scale = scale_from_length(shape, tie.first, tie.second, tie.length)
    placed = (on_wall if wanted.wall else on_level_plane)(shape, tie.first, tie.second, scale)
    covariance = placed_covariance(shape, placed, tie)
    per_unit = ANGLE_UNITS[wanted.unit]
    return {
        "points": _points(measured, shape, placed, covariance),
        "images": _images(placed, covariance, per_unit),
        **_derived(measured, shape, placed, covariance, constants, per_unit),
        "angle_unit": wanted.unit,
    }


def _points(
    measured: Measured, shape: PlaneShape, placed: PlacedPlane, covariance: FloatArray
) -> list[dict[str, Any]]:
    frames, rows = 6 * len(placed.positions), []
    for k, name in enumerate(measured.ids):
        block = covariance[frames + 3 * k : frames + 3 * k + 3, frames + 3 * k : frames + 3 * k + 3]
        known = bool(np.isfinite(placed.points[k, 0]))
        sigma = sigmas(block) if known else np.full(3, np.nan)
        rows.append(
            {
                "id": name,
                **with_sigma(("x", "y", "z"), placed.points[k], sigma),
                "correlation": numbers(correlation(block)),
                "place": "plane" if shape.in_plane[k] else "off the plane" if known else "left out",
            }
        )
    return rows


def _images(placed: PlacedPlane, covariance: FloatArray, per_unit: float) -> list[dict[str, Any]]:
    rows = []
    for k, angles in enumerate(angles_from_rotation(placed.rotations)):
        carried = np.eye(6)
        carried[3:, 3:] = by_turn(angles)
        block = carried @ covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] @ carried.T
        rows.append(
            {
                **with_sigma(("x", "y", "z"), placed.positions[k], sigmas(block)[:3]),
                **with_sigma(ANGLES, angles / per_unit, sigmas(block)[3:] / per_unit),
                "rotation": numbers(placed.rotations[k]),
                "correlation": numbers(correlation(block)),
            }
        )
    return rows


def _derived(
    measured: Measured,
    shape: PlaneShape,
    placed: PlacedPlane,
    covariance: FloatArray,
    constants: FloatArray,
    per_unit: float,
) -> dict[str, Any]:
    """Sides, angles, heights, flying heights and scales with σ, and their correlation in one matrix."""
    round_it = corners(shape)
    found = derived(shape, placed, covariance, round_it, constants)
    names = [measured.ids[k] for k in round_it]
    count, images = len(names), range(1, len(constants) + 1)
    off = [measured.ids[k] for k in np.flatnonzero(~shape.in_plane & ~shape.left_out)]
    told = [("side", f"{a}-{b}") for a, b in zip(names, [*names[1:], names[0]], strict=True)]
    told += [("angle", name) for name in names] + [("height", name) for name in off]
    told += [(kind, str(k)) for kind in ("flying height", "flying height / c") for k in images]
    unit = np.ones(len(told))
    unit[count : 2 * count] = per_unit
    values, sigma = found.values / unit, sigmas(found.covariance) / unit
    return {
        "corners": names,
        "sides": numbers(values[:count]),
        "angles": numbers(values[count : 2 * count]),
        "results": [
            {"kind": kind, "of": of, "value": number(value), "sigma": number(one)}
            for (kind, of), value, one in zip(told, values, sigma, strict=True)
        ],
        "correlation": numbers(correlation(found.covariance)),
    }
