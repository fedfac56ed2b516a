"""The ellipsoid, its transverse Mercator projection and a geoid grid, written again: nothing of the program or of PROJ.

Geocentric coordinates, their way back (Bowring, repeated), and Krüger's series in the third flattening up to its fourth
power (Karney, Journal of Geodesy 85, 2011, eq. 7 to 11, 35 and 36): better than a nanometre in a zone of UTM.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from sample_projects.simulate.geometry import Array

A, FLATTENING = 6_378_137.0, 1.0 / 298.257222101
"""GRS80."""
_E2 = FLATTENING * (2.0 - FLATTENING)
_N = FLATTENING / (2.0 - FLATTENING)
_SCALE, _FALSE_EAST, _ZONE_32 = 0.9996, 500_000.0, np.radians(9.0)
_RECTIFYING = A / (1.0 + _N) * (1.0 + _N**2 / 4.0 + _N**4 / 64.0)
_FORWARD = (
    _N / 2.0 - 2.0 / 3.0 * _N**2 + 5.0 / 16.0 * _N**3 + 41.0 / 180.0 * _N**4,
    13.0 / 48.0 * _N**2 - 3.0 / 5.0 * _N**3 + 557.0 / 1440.0 * _N**4,
    61.0 / 240.0 * _N**3 - 103.0 / 140.0 * _N**4,
    49561.0 / 161280.0 * _N**4,
)
_BACK = (
    _N / 2.0 - 2.0 / 3.0 * _N**2 + 37.0 / 96.0 * _N**3 - 1.0 / 360.0 * _N**4,
    1.0 / 48.0 * _N**2 + 1.0 / 15.0 * _N**3 - 437.0 / 1440.0 * _N**4,
    17.0 / 480.0 * _N**3 - 37.0 / 840.0 * _N**4,
    4397.0 / 161280.0 * _N**4,
)


def geocentric(geodetic: Array) -> Array:
    """X, Y, Z (n, 3) of latitude, longitude (radians) and ellipsoidal height (n, 3)."""
    latitude, longitude, height = geodetic.T
    across = A / np.sqrt(1.0 - _E2 * np.sin(latitude) ** 2)
    off_axis = (across + height) * np.cos(latitude)
    up = ((1.0 - _E2) * across + height) * np.sin(latitude)
    return np.stack([off_axis * np.cos(longitude), off_axis * np.sin(longitude), up], axis=1)


def geodetic(xyz: Array) -> Array:
    """Latitude, longitude, height (n, 3) of geocentric coordinates."""
    x, y, z = xyz.T
    off_axis = np.hypot(x, y)
    latitude = np.arctan2(z, off_axis * (1.0 - _E2))
    for _ in range(8):
        across = A / np.sqrt(1.0 - _E2 * np.sin(latitude) ** 2)
        latitude = np.arctan2(z + _E2 * across * np.sin(latitude), off_axis)
    height = off_axis * np.cos(latitude) + z * np.sin(latitude)
    height -= A * np.sqrt(1.0 - _E2 * np.sin(latitude) ** 2)
    return np.stack([latitude, np.arctan2(y, x), height], axis=1)


def horizon(latitude: float, longitude: float) -> Array:
    """Axes east, north, up (rows) in geocentric axes."""
    s, c, sl, cl = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    return np.array([[-sl, cl, 0.0], [-s * cl, -s * sl, c], [c * cl, c * sl, s]])


def utm(places: Array) -> Array:
    """East, north (n, 2) in zone 32 of latitude, longitude, … (n, 2 or more)."""
    latitude, longitude = places[:, 0], places[:, 1] - _ZONE_32
    e = np.sqrt(_E2)
    tangent = np.tan(latitude)
    part = np.sinh(e * np.arctanh(e * np.sin(latitude)))
    conformal = tangent * np.sqrt(1.0 + part**2) - part * np.sqrt(1.0 + tangent**2)
    xi = np.arctan2(conformal, np.cos(longitude))
    eta = np.arcsinh(np.sin(longitude) / np.hypot(conformal, np.cos(longitude)))
    plane = xi + 1j * eta
    plane = plane + sum(c * np.sin(2.0 * k * plane) for k, c in enumerate(_FORWARD, start=1))
    return np.stack([_FALSE_EAST + _SCALE * _RECTIFYING * plane.imag, _SCALE * _RECTIFYING * plane.real], axis=1)


def from_utm(plane: Array) -> Array:
    """Latitude, longitude (n, 2) of east, north in zone 32."""
    place = (plane[:, 1] + 1j * (plane[:, 0] - _FALSE_EAST)) / (_SCALE * _RECTIFYING)
    place = place - sum(c * np.sin(2.0 * k * place) for k, c in enumerate(_BACK, start=1))
    xi, eta = place.real, place.imag
    conformal = np.sin(xi) / np.hypot(np.sinh(eta), np.cos(xi))
    e = np.sqrt(_E2)
    tangent = conformal
    for _ in range(6):  # Newton, Karney's eq. 19 to 21
        part = np.sinh(e * np.arctanh(e * tangent / np.sqrt(1.0 + tangent**2)))
        there = tangent * np.sqrt(1.0 + part**2) - part * np.sqrt(1.0 + tangent**2)
        slope = (1.0 + (1.0 - _E2) * tangent**2) / ((1.0 - _E2) * np.sqrt(1.0 + tangent**2))
        tangent = tangent + (conformal - there) / np.sqrt(1.0 + there**2) * slope
    return np.stack([np.arctan(tangent), _ZONE_32 + np.arctan2(np.sinh(eta), np.cos(xi))], axis=1)


class Geoid(NamedTuple):
    """A grid of geoid heights, degrees and metres."""

    south: float
    west: float
    step: float
    N: Array
    """(rows from the south, columns from the west)."""

    def at(self, places: Array) -> Array:
        """N (n,) at latitudes and longitudes (n, 2 or more; radians), bilinear."""
        row, column = (np.degrees(places[:, :2]) - [self.south, self.west]).T / self.step
        i, j = (np.floor(value).astype(int) for value in (row, column))
        up, right = row - i, column - j
        lower = self.N[i, j] * (1.0 - right) + self.N[i, j + 1] * right
        upper = self.N[i + 1, j] * (1.0 - right) + self.N[i + 1, j + 1] * right
        result: Array = lower * (1.0 - up) + upper * up
        return result

    def gtx(self) -> bytes:
        """The grid as a file GTX: its head, then the heights row by row."""
        head = struct.pack(">ddddii", self.south, self.west, self.step, self.step, *self.N.shape)
        return head + self.N.astype(">f4").tobytes()
