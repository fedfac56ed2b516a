"""Distances that were reduced: to the ellipsoid (chord and arc), to the geoid, and by the heights of their ends.

The chord c joins the feet of both marks on the ellipsoid. The arc above it is that of the circle with Euler's radius R
in the azimuth of the line at its middle, s = 2R asin(c / 2R).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.earth import Horizon
from mor.observations._between import FROM_TO, spatial_length
from mor.observations._contract import Computed, Equation, ObservationType, Slot
from mor.observations.earth.ends import GEOID, end_constants
from mor.units import LENGTH, Component

_SLOTS = (
    Slot("point", "from", "position"),
    Slot("point", "to", "position"),
    Slot("distance meter", "instrument", "distance meter"),
)


class Reduced(NamedTuple):
    """A length (n,) with its derivatives (n, 3) by both ends."""

    length: FloatArray
    by_start: FloatArray
    by_end: FloatArray


def chord(horizon: Horizon, start: FloatArray, end: FloatArray) -> tuple[Reduced, FloatArray]:
    """The chord between the feet on the ellipsoid, and Euler's radius (n,) in its direction."""
    feet, moves = zip(*(foot_with_derivatives(horizon, place) for place in (start, end)), strict=True)
    length, by_vector = spatial_length(feet[1] - feet[0])
    middle = 0.5 * (start + end)
    M, N = horizon.ellipsoid.radii(horizon.to_geodetic(middle)[:, 0])
    along = np.einsum("nij,nj->ni", horizon.local_axes(middle), by_vector)
    north = along[:, 1] ** 2 / np.maximum(along[:, 0] ** 2 + along[:, 1] ** 2, np.finfo(float).tiny)
    radius = 1.0 / (north / M + (1.0 - north) / N)
    by_ends = [np.einsum("nj,nji->ni", by_vector, move) for move in moves]
    return Reduced(length, -by_ends[0], by_ends[1]), radius


def foot_with_derivatives(horizon: Horizon, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Feet (n, 3) on the ellipsoid and their derivatives (n, 3, 3) by the positions."""
    foot = horizon.foot(position)
    M, N = horizon.ellipsoid.radii(horizon.to_geodetic(position)[:, 0])
    axes = horizon.local_axes(position)
    shrinking = np.stack([N / (N + foot.height), M / (M + foot.height), np.zeros_like(M)], axis=1)
    return foot.position, np.einsum("nki,nk,nkj->nij", axes, shrinking, axes)


def arc(horizon: Horizon, start: FloatArray, end: FloatArray) -> tuple[Reduced, FloatArray]:
    """The arc on the ellipsoid, and Euler's radius."""
    straight, radius = chord(horizon, start, end)
    half = straight.length / (2.0 * radius)
    growth = (1.0 / np.sqrt(1.0 - half**2))[:, None]
    bent = Reduced(2.0 * radius * np.arcsin(half), straight.by_start * growth, straight.by_end * growth)
    return bent, radius


def by_heights(horizon: Horizon, start: FloatArray, end: FloatArray) -> Reduced:
    """√(s² − Δh²) of the slope distance s and the ellipsoidal heights."""
    vector = end - start
    low, high = horizon.foot(start), horizon.foot(end)
    rise = high.height - low.height
    length = np.sqrt(np.maximum(np.sum(vector**2, axis=1) - rise**2, np.finfo(float).tiny))
    by_start = (-vector + rise[:, None] * low.up) / length[:, None]
    by_end = (vector - rise[:, None] * high.up) / length[:, None]
    return Reduced(length, by_start, by_end)


def ellipsoid_chord(horizon: Horizon) -> ObservationType:
    """The straight line between the feet."""
    return _type("ellipsoid_chord", lambda start, end, _: chord(horizon, start, end)[0])


def ellipsoid_arc(horizon: Horizon) -> ObservationType:
    """The arc on the ellipsoid."""
    return _type("ellipsoid_arc", lambda start, end, _: arc(horizon, start, end)[0])


def height_reduced_distance(horizon: Horizon) -> ObservationType:
    """Return the slope distance reduced with the heights of its ends."""
    return _type("height_reduced_distance", lambda start, end, _: by_heights(horizon, start, end))


def mean_sea_level_distance(horizon: Horizon) -> ObservationType:
    """The arc at the height of the geoid, s (1 + N/R) with the mean N of both ends."""

    def length(start: FloatArray, end: FloatArray, geoid: FloatArray) -> Reduced:
        on_ellipsoid, radius = arc(horizon, start, end)
        growth = 1.0 + 0.5 * (geoid[:, 0] + geoid[:, 1]) / radius
        by_ends = (by * growth[:, None] for by in (on_ellipsoid.by_start, on_ellipsoid.by_end))
        return Reduced(on_ellipsoid.length * growth, *by_ends)

    return _type("mean_sea_level_distance", length, end_constants(["from", "to"], [GEOID]))


def _type(
    key: str,
    length: Callable[[FloatArray, FloatArray, FloatArray], Reduced],
    constants: tuple[Component, ...] = (),
) -> ObservationType:
    return ObservationType(
        key=key,
        components=(Component("distance", LENGTH),),
        references=FROM_TO,
        slots=_SLOTS,
        equation=_metered(length),
        constants=constants,
        distances=("from", "to"),
    )


def _metered(length: Callable[[FloatArray, FloatArray, FloatArray], Reduced]) -> Equation:
    """s_obs = (s − a)/m with scale m and zero offset a of the distance meter."""

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        start, end, meter = blocks
        reduced = length(start, end, constants)
        scale = meter[:, :1]
        computed = (reduced.length[:, None] - meter[:, 1:]) / scale
        by_ends = ((by / scale)[:, None, :] for by in (reduced.by_start, reduced.by_end))
        by_meter = np.stack([-computed / scale, -1.0 / scale], axis=2)
        return Computed(computed, (*by_ends, by_meter))

    return equation
