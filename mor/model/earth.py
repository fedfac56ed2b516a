"""The ellipsoid of revolution, and the object system on it: geocentric axes shifted and turned into a horizon.

Latitude φ, longitude λ (radians, east positive) and ellipsoidal height h against geocentric X, Y, Z. The way back is
Bowring's (Survey Review 23, 1976, p. 323), repeated until nothing changes at heights from the sea floor to satellites;
the height is that of Heiskanen and Moritz written so that it is regular at the poles. Heights, coordinates and the axes
of the ellipsoid share one unit of length.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mor.types import FloatArray

EARTH_RADIUS = 6_371_000.0
"""Mean radius of the earth, metres."""

GRS80 = (6_378_137.0, 1.0 / 298.257222101)
"""Semi-major axis (metres) and flattening."""


class Ellipsoid(NamedTuple):
    """An ellipsoid of revolution."""

    a: float
    """Semi-major axis."""
    f: float
    """Flattening, 0 for a sphere."""

    @property
    def e2(self) -> float:
        """Square of the first eccentricity."""
        return self.f * (2.0 - self.f)

    def geocentric(self, geodetic: FloatArray) -> FloatArray:
        """X, Y, Z (n, 3) of latitude, longitude, height (n, 3)."""
        latitude, longitude, height = geodetic.T
        N = self.a / np.sqrt(1.0 - self.e2 * np.sin(latitude) ** 2)
        from_axis = (N + height) * np.cos(latitude)
        up = (N * (1.0 - self.e2) + height) * np.sin(latitude)
        return np.stack([from_axis * np.cos(longitude), from_axis * np.sin(longitude), up], axis=1)

    def geodetic(self, geocentric: FloatArray) -> FloatArray:
        """Latitude, longitude, height (n, 3) of X, Y, Z (n, 3); the longitude is 0 on the axis."""
        x, y, z = geocentric.T
        b = self.a * (1.0 - self.f)
        from_axis = np.hypot(x, y)
        parametric = np.arctan2(z * self.a, from_axis * b)
        latitude = parametric
        # Of Bowring's formula: an error of 1 in the parametric latitude falls below 10⁻¹⁵ at heights up to 10 000 km.
        rounds = 4
        for _ in range(rounds):
            latitude = np.arctan2(
                z + self.e2 / (1.0 - self.e2) * b * np.sin(parametric) ** 3,
                from_axis - self.e2 * self.a * np.cos(parametric) ** 3,
            )
            parametric = np.arctan2((1.0 - self.f) * np.sin(latitude), np.cos(latitude))
        sine = np.sin(latitude)
        height = from_axis * np.cos(latitude) + z * sine - self.a * np.sqrt(1.0 - self.e2 * sine**2)
        return np.stack([latitude, np.arctan2(y, x), height], axis=1)

    def radii(self, latitude: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Radii of curvature (n,) of the meridian, M, and across it, N."""
        w2 = 1.0 - self.e2 * np.sin(latitude) ** 2
        return self.a * (1.0 - self.e2) / w2**1.5, self.a / np.sqrt(w2)


def east_north_up(latitude: FloatArray, longitude: FloatArray) -> FloatArray:
    """Axes (n, 3, 3) east, north, up (rows) of vertical directions, in geocentric axes."""
    sin_p, cos_p, sin_l, cos_l = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    zero = np.zeros_like(sin_p)
    rows = [
        np.stack([-sin_l, cos_l, zero], axis=-1),
        np.stack([-sin_p * cos_l, -sin_p * sin_l, cos_p], axis=-1),
        np.stack([cos_p * cos_l, cos_p * sin_l, sin_p], axis=-1),
    ]
    return np.stack(rows, axis=-2)


class Foot(NamedTuple):
    """Feet of the normals from n places to the ellipsoid, in object coordinates."""

    position: FloatArray
    """(n, 3)."""
    up: FloatArray
    """(n, 3) the normals, outwards."""
    height: FloatArray
    """(n,) of the places along them."""


@dataclass(frozen=True)
class Horizon:
    """The object system of a network on the earth: X east, Y north, Z up at one place of the ellipsoid.

    Everything that observations need is worked out in this system, where numbers are small: as the points of the
    quadric 2 Z/d + xᵀB x = 0, d = a √(1 − e² sin²φ₀). By way of geocentric coordinates the last digit of heights
    would be a nanometre, and 10⁻⁶ of a σ of a millimetre.
    """

    ellipsoid: Ellipsoid
    latitude: float
    longitude: float
    """Of the origin, which lies on the ellipsoid: Z there is the ellipsoidal height."""

    @cached_property
    def origin(self) -> FloatArray:
        """(3,) geocentric."""
        return np.asarray(self.ellipsoid.geocentric(np.array([[self.latitude, self.longitude, 0.0]]))[0])

    @cached_property
    def axes(self) -> FloatArray:
        """(3, 3) rows east, north, up: object = axes · (geocentric − origin)."""
        return east_north_up(np.array(self.latitude), np.array(self.longitude))

    @cached_property
    def pole(self) -> FloatArray:
        """(3,) the direction to the pole, in object axes."""
        return self.axes[:, 2]

    @cached_property
    def _quadric(self) -> tuple[FloatArray, FloatArray]:
        """Matrix B (3, 3), and half the gradient (3,) at the origin."""
        a, b = self.ellipsoid.a, self.ellipsoid.a * (1.0 - self.ellipsoid.f)
        B = (self.axes / np.array([a, a, b]) ** 2) @ self.axes.T
        distance = a * np.sqrt(1.0 - self.ellipsoid.e2 * np.sin(self.latitude) ** 2)
        return B, np.array([0.0, 0.0, 1.0 / distance])

    def from_geocentric(self, geocentric: FloatArray) -> FloatArray:
        """Object coordinates (n, 3) of geocentric ones (n, 3)."""
        return (geocentric - self.origin) @ self.axes.T

    def to_geocentric(self, position: FloatArray) -> FloatArray:
        """Geocentric coordinates (n, 3) of object ones (n, 3)."""
        return position @ self.axes + self.origin

    def from_geodetic(self, geodetic: FloatArray) -> FloatArray:
        """Object coordinates (n, 3) of latitude, longitude, height (n, 3)."""
        return self.from_geocentric(self.ellipsoid.geocentric(geodetic))

    def to_geodetic(self, position: FloatArray) -> FloatArray:
        """Latitude, longitude, height (n, 3) of object coordinates (n, 3)."""
        foot = self.foot(position)
        across = np.linalg.norm(np.cross(foot.up, self.pole), axis=1)
        latitude = np.arctan2(foot.up @ self.pole, across)
        outwards = np.cross(np.array([1.0, 0.0, 0.0]), self.pole)  # from the axis, in the meridian of the origin
        longitude = self.longitude + np.arctan2(foot.up[:, 0], foot.up @ outwards)
        return np.stack([latitude, np.remainder(longitude + np.pi, 2.0 * np.pi) - np.pi, foot.height], axis=1)

    def foot(self, position: FloatArray) -> Foot:
        """Feet of the normals through positions (n, 3); NaN from about 10⁹ m on, where the iteration diverges."""
        B, at_origin = self._quadric
        by_position = at_origin + position @ B
        value = np.einsum("ni,ni->n", position, by_position + at_origin)
        largest = np.fmax.reduce(np.abs(position), axis=None, initial=0.0)  # of places that are known
        foot, digits = position, 4.0 * np.finfo(float).eps * largest
        # For a foot: each makes the error smaller by height over radius; on the ground two or three are enough.
        for _ in range(40):
            gradient = at_origin + foot @ B
            up = gradient / np.linalg.norm(gradient, axis=1)[:, None]
            slope = np.einsum("ni,ni->n", up, by_position)
            bend = np.einsum("ni,ni->n", up, up @ B)
            with np.errstate(invalid="ignore"):  # a line from so far away passes by the Earth
                height = value / (slope + np.sqrt(slope**2 - bend * value))
            before, foot = foot, position - height[:, None] * up
            if not np.any(np.abs(foot - before) > digits):
                break
        return Foot(foot, up, height)

    def local_axes(self, position: FloatArray, deflection: FloatArray | None = None) -> FloatArray:
        """East, north, up (n, 3, 3; rows, in object axes) at positions (n, 3).

        With the deflection ξ, η (n, 2) they are those of the plumb line: of the astronomic latitude φ + ξ and
        longitude λ + η/cos φ.
        """
        up = self.foot(position).up
        east = np.cross(self.pole, up)
        cosine = np.linalg.norm(east, axis=1)[:, None]
        east = east / cosine
        if deflection is not None:
            turn = deflection[:, 1:] / cosine
            east = np.cos(turn) * east + np.sin(turn) * np.cross(self.pole, east)
            latitude = np.arctan2(up @ self.pole, cosine[:, 0]) + deflection[:, 0]
            outwards = np.cross(east, self.pole)
            up = np.cos(latitude)[:, None] * outwards + np.sin(latitude)[:, None] * self.pole
        return np.stack([east, np.cross(up, east), up], axis=1)


class LocalSphere(NamedTuple):
    """A sphere under a project in plan coordinates and heights, and the Cartesian system in its tangent plane.

    The sphere passes through ``origin`` (x, y and height there). Plan coordinates x, y of a point are azimuthal
    equidistant about the origin: arcs on this sphere, of the direction and length that the point has from the
    origin. z is the height above the sphere, plus the height of the origin. The Cartesian system agrees with x, y, z
    at the origin. All lengths share one unit.
    """

    radius: float
    origin: tuple[float, float, float]

    def cartesian(self, position: FloatArray) -> FloatArray:
        """Return Cartesian coordinates (n, 3) of plan coordinates and heights (n, 3)."""
        x, y, height = (position - np.array(self.origin)).T
        angle = np.hypot(x, y) / self.radius
        from_centre = self.radius + height
        flat = from_centre / self.radius * np.sinc(angle / np.pi)
        up = height - 2.0 * from_centre * np.sin(0.5 * angle) ** 2
        return np.asarray(np.stack([flat * x, flat * y, up], axis=1) + np.array(self.origin))

    def local_axes(self, position: FloatArray) -> FloatArray:
        """Return axes (n, 3, 3; rows, Cartesian) of the horizon at plan coordinates and heights (n, 3).

        The third is the vertical. The others are those of the origin, turned with the vertical along the arc from
        the origin: the turn has no component about the vertical.
        """
        x, y = (position[:, :2] - np.array(self.origin[:2])).T
        distance = np.hypot(x, y)
        angle = distance / self.radius
        a, b = (np.where(distance > 0.0, v / np.where(distance > 0.0, distance, 1.0), 0.0) for v in (x, y))
        sine, flat = np.sin(angle), 2.0 * np.sin(0.5 * angle) ** 2
        rows = [
            np.stack([1.0 - a * a * flat, -a * b * flat, -a * sine], axis=1),
            np.stack([-a * b * flat, 1.0 - b * b * flat, -b * sine], axis=1),
            np.stack([a * sine, b * sine, 1.0 - flat], axis=1),
        ]
        return np.stack(rows, axis=1)


def gaussian_radius(latitude: float) -> float:
    """Return the Gaussian mean radius √(M N) of the ellipsoid GRS80 at a latitude (radians), metres."""
    M, N = Ellipsoid(*GRS80).radii(np.array([latitude]))
    return float(np.sqrt(M * N)[0])
