"""Reference system, object system, verticals and geoid of a network on the earth."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.geometry.earth import Ellipsoid, Horizon
from mor.observations.earth import DEFLECTIONS, GEOID
from mor.project.world.grids import geoid_heights
from mor.project.world.reference_system import ReferenceSystem


@dataclass(frozen=True)
class World:
    """The earth under a network. Lengths are in the unit of the project."""

    system: ReferenceSystem
    horizon: Horizon
    metres: float
    """Metres per unit of length."""
    orthometric: bool
    """True if heights of points are above the geoid."""
    extent: FloatArray = field(default_factory=lambda: np.zeros((2, 2)))
    """(2, 2) least and largest object coordinates x, y of the points whose places are given."""
    geoid: Path | None = None
    """Grid of geoid heights."""
    at_points: dict[str, FloatArray] = field(default_factory=dict)
    """(points,) by block: N, ξ, η; NaN if unknown. Points that were read later are not in it."""

    def of_points(self, name: str, blocks: IntArray) -> FloatArray:
        """(n,) ξ, η (0 where nothing is given) or N (NaN if nothing is given) of point blocks."""
        known = self.at_points.get(name, np.zeros(0))
        result = np.full(len(blocks), np.nan if name == GEOID else 0.0)
        inside = (blocks >= 0) & (blocks < len(known))
        result[inside] = known[blocks[inside]]
        return np.nan_to_num(result) if name in DEFLECTIONS else result

    def geoid_at(self, blocks: IntArray, positions: FloatArray) -> FloatArray:
        """N (n,) of point blocks at object coordinates (n, 3): as given, else of the grid there, else NaN."""
        N = self.of_points(GEOID, blocks)
        missing = np.isnan(N) & np.isfinite(positions).all(axis=1)
        if self.geoid is not None and missing.any():
            N[missing] = geoid_heights(self.geoid, self.horizon.to_geodetic(positions[missing])) / self.metres
        return N

    def to_object(self, coordinates: FloatArray, geoid: FloatArray) -> FloatArray:
        """Object coordinates (n, 3) of coordinates (n, 3) in the system; lengths and radians."""
        geodetic = self.system.to_geodetic(self.in_metres(coordinates))
        geodetic[:, 2] = geodetic[:, 2] / self.metres
        if self.orthometric:
            geodetic[:, 2] += geoid
        return self.horizon.from_geodetic(geodetic)

    def inside(self) -> FloatArray:
        """Coordinates (3,) in the system of the origin of the object system, at height 0: a place for what has none."""
        there: FloatArray = self.from_object(np.zeros((1, 3)), np.zeros(1))[0]
        return there

    def in_metres(self, coordinates: FloatArray) -> FloatArray:
        """Coordinates (n, 3) in the system with their lengths (not their angles) in metres."""
        return _scaled(self.system, coordinates, self.metres)

    def grid(self, position: FloatArray) -> FloatArray:
        """∂(east, north)/∂(e, n) (n, 2, 2) at object coordinates (n, 3): scale and convergence of the projection."""
        axes, nothing = self.horizon.local_axes(position), np.zeros(len(position))
        columns = []
        for k in range(2):
            ahead, behind = (
                self.from_object(position + sign * _NEAR * axes[:, k], nothing) for sign in (1, -1)
            )
            columns.append((ahead - behind)[:, :2] / (2.0 * _NEAR))
        return np.stack(columns, axis=2)

    def convergence(self, east_north: FloatArray) -> FloatArray:
        """(n,) direction of grid north, clockwise from true north, where coordinates (n, 2) of a projection are."""
        there = np.hstack([east_north, np.zeros((len(east_north), 1))])
        by_local = self.grid(self.to_object(there, np.zeros(len(there))))
        # Grid north keeps east as it is: it leads along (e, n) with ∂E/∂e e + ∂E/∂n n = 0.
        clockwise: FloatArray = np.arctan2(-by_local[:, 0, 1], by_local[:, 0, 0])
        return clockwise

    def from_object(self, position: FloatArray, geoid: FloatArray) -> FloatArray:
        """Coordinates (n, 3) in the system of object coordinates (n, 3); the way back of :meth:`to_object`."""
        geodetic = self.horizon.to_geodetic(position)
        if self.orthometric:
            geodetic[:, 2] -= geoid
        geodetic[:, 2] *= self.metres
        return _scaled(self.system, self.system.from_geodetic(geodetic), 1.0 / self.metres)


def _scaled(system: ReferenceSystem, coordinates: FloatArray, factor: float) -> FloatArray:
    """Coordinates with their lengths (not their angles) times a factor."""
    lengths = [1.0 if name in ("latitude", "longitude") else factor for name in system.coordinates]
    scaled: FloatArray = coordinates * np.array(lengths)
    return scaled


_NEAR = 10.0
"""Length over which a projection is differentiated: its scale changes by 1/R for every unit."""
_STEP = 1e-4
"""Degrees to which the middle of a network is rounded: the object system stays the same when a digit changes."""


def middle(ellipsoid: Ellipsoid, geodetic: FloatArray) -> Horizon:
    """The object system at the middle of places (n, 3), rounded."""
    directions = np.mean(ellipsoid.geocentric(geodetic), axis=0)
    latitude, longitude, _ = np.degrees(ellipsoid.geodetic(directions[None])[0])
    rounded = np.radians(np.round(np.array([latitude, longitude]) / _STEP) * _STEP)
    return Horizon(ellipsoid, float(rounded[0]), float(rounded[1]))
