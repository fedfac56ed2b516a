"""Longitude, latitude and height on WGS84 as east, north, up about a reference point: exact, without a projection."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray

_AXIS, _FLATTENING = 6378137.0, 1.0 / 298.257223563


def east_north_up(places: FloatArray, reference: FloatArray) -> FloatArray:
    """East, north, up (n, 3), m, of latitudes, longitudes (degrees) and heights (m) (n, 3) about ``reference`` (3,)."""
    lat, lon = np.radians(reference[:2])
    turn = np.array(
        [
            [-np.sin(lon), np.cos(lon), 0.0],
            [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
            [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)],
        ]
    )
    local: FloatArray = (geocentric(places) - geocentric(reference[None])) @ turn.T
    return local


def geocentric(places: FloatArray) -> FloatArray:
    """Geocentric coordinates (n, 3), m, of latitudes, longitudes (degrees) and heights (m) (n, 3)."""
    lat, lon = np.radians(places[:, 0]), np.radians(places[:, 1])
    e2 = _FLATTENING * (2.0 - _FLATTENING)
    normal = _AXIS / np.sqrt(1.0 - e2 * np.sin(lat) ** 2)
    across = (normal + places[:, 2]) * np.cos(lat)
    up = (normal * (1.0 - e2) + places[:, 2]) * np.sin(lat)
    return np.stack([across * np.cos(lon), across * np.sin(lon), up], axis=1)
