"""The dam and its surroundings: what is where, in the horizon of a place on its crest, and on the earth."""

from __future__ import annotations

import numpy as np

from sample_projects.simulate import earth
from sample_projects.simulate.camera import Camera
from sample_projects.simulate.geometry import DEGREE, Array, Frame, look_at

ARCSEC = DEGREE / 3600.0
MIDDLE = np.array([46.9870 * DEGREE, 11.1820 * DEGREE, 1690.0])
"""Latitude, longitude, ellipsoidal height of the origin of the layout, in the middle of the foot of the dam."""
AXES = earth.horizon(*MIDDLE[:2])
RADIUS, HEIGHT = 115.0, 64.0
"""Of the downstream face of the arch at its crest; of the dam."""

PILLARS = {
    "P1": np.array([-150.0, -190.0, 32.0]),
    "P2": np.array([158.0, -172.0, 47.0]),
    "P3": np.array([-72.0, -395.0, -9.0]),
    "P4": np.array([121.0, -438.0, 14.0]),
    "P5": np.array([-205.0, 96.0, 88.0]),
}
"""Observation pillars; P5 stands above the reservoir."""
REFERENCE = {"R1": np.array([6120.0, 5480.0, 610.0]), "R2": np.array([-9350.0, -4210.0, -340.0])}
"""Stations of the national GNSS network."""
BENCHMARK = np.array([196.0, -318.0, 6.4])
CAMERA = Camera(
    c=35.062,
    width=8192,
    height=5460,
    pixel=0.0044,
    xh=0.041,
    yh=-0.027,
    radial=(-4.2e-5, 3.1e-8),
    r0=14.0,
)
LEVER = np.array([0.031, 0.142, 0.066])
"""From the projection centre to the phase centre of the antenna, image axes, m."""


def face(angle: float, z: float, off: float = 0.0) -> Array:
    """A place of the downstream face at an angle (radians) from its middle and a height, so far in front of it."""
    radius = RADIUS - 0.16 * (HEIGHT - z) - off
    return np.array([radius * np.sin(angle), radius * np.cos(angle) - RADIUS, z])


def normal(point: Array) -> Array:
    """Direction out of the face, level: downstream, towards the axis of the arch."""
    inwards = np.array([-point[0], -RADIUS - point[1], 0.0])
    result: Array = inwards / np.linalg.norm(inwards)
    return result


def crest() -> dict[str, Array]:
    """Bolts in the crest, on which antennas, prisms and staffs stand."""
    angles = np.linspace(-40.0, 40.0, 5) * DEGREE
    return {f"K{k}": face(a, HEIGHT + 1.1, off=-1.4) for k, a in enumerate(angles, start=1)}


def targets() -> dict[str, Array]:
    """Plates on the face in four rows: marks of the camera that the total stations see as well."""
    result = {}
    for row, (z, width) in enumerate(((8.0, 15.0), (24.0, 24.0), (41.0, 33.0), (58.0, 39.0)), start=1):
        for k, angle in enumerate(np.linspace(-width, width, 4 + row) * DEGREE, start=1):
            result[f"T{row}{k}"] = face(float(angle), z, off=0.02)
    return result


def details(random: np.random.RandomState) -> dict[str, Array]:
    """Edges and stains of the concrete, and rocks of the abutments, that the images have in common."""
    result = {}
    for k in range(90):
        z = float(random.uniform(3.0, HEIGHT))
        angle = float(random.uniform(-1.0, 1.0)) * (14.0 + 0.45 * z) * DEGREE
        result[f"N{k + 1:02d}"] = face(angle, z, off=float(random.uniform(0.0, 0.5 if k % 3 else 4.0)))
    return result


def frames(random: np.random.RandomState) -> dict[str, Frame]:
    """Images of an unmanned aircraft: three rows along the face, every second one with the camera on its side."""
    result = {}
    for row, (z, distance) in enumerate(((14.0, 70.0), (38.0, 78.0), (66.0, 74.0)), start=1):
        for k, angle in enumerate(np.linspace(-38.0, 38.0, 7) * DEGREE, start=1):
            place = face(float(angle), z, off=distance) + random.normal(0.0, 1.0, 3) * np.array([1.5, 1.5, 0.8])
            ahead = face(float(angle), 33.0) + random.normal(0.0, 1.0, 3) * 2.0
            roll = (0.0, 90.0, 0.0, -90.0)[(k + row) % 4] * DEGREE
            result[f"{row}{k:02d}"] = look_at(place, ahead, roll + float(random.normal(0.0, 0.03)))
    return result


def deflection(local: Array) -> Array:
    """ξ, η (radians) of places (n, 3): the mountains pull, more to the south and at the slopes."""
    north, east = local[:, 1] / 1000.0, local[:, 0] / 1000.0
    return ARCSEC * np.stack([11.4 + 1.3 * north - 0.4 * east, -6.2 - 0.5 * north + 1.9 * east], axis=1)


def geoid() -> earth.Geoid:
    """The national model: 0.01° of grid, 50 m above the ellipsoid with the slope that the deflections say."""
    south, west, step = 46.93, 11.04, 0.01
    latitude, longitude = np.meshgrid(south + step * np.arange(13), west + step * np.arange(25), indexing="ij")
    north = (latitude * DEGREE - MIDDLE[0]) * 6_367.0
    east = (longitude * DEGREE - MIDDLE[1]) * 6_390.0 * np.cos(MIDDLE[0])
    xi = 11.4 * north + 0.65 * north**2 - 0.4 * north * east
    eta = -6.2 * east + 0.95 * east**2
    return earth.Geoid(south, west, step, np.round(50.13 - 1000.0 * ARCSEC * (xi + eta), 4))


def to_geocentric(local: Array) -> Array:
    """Geocentric coordinates (n, 3) of the layout."""
    result: Array = local @ AXES + earth.geocentric(MIDDLE[None])[0]
    return result


def to_national(local: Array) -> Array:
    """East, north in UTM zone 32 and height above the geoid (n, 3) of the layout."""
    places = earth.geodetic(to_geocentric(local))
    return np.concatenate([earth.utm(places), (places[:, 2] - geoid().at(places))[:, None]], axis=1)


def plumb_axes(local: Array) -> Array:
    """East, north, up (n, 3, 3; rows, in axes of the layout) about the plumb lines of places (n, 3)."""
    places, tilt = earth.geodetic(to_geocentric(local)), deflection(local)
    latitude = places[:, 0] + tilt[:, 0]
    longitude = places[:, 1] + tilt[:, 1] / np.cos(places[:, 0])
    return np.stack([earth.horizon(*place) @ AXES.T for place in zip(latitude, longitude, strict=True)])
