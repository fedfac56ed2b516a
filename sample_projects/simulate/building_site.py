"""What stands on the site of the building: walls with their targets and details, network points, camera positions."""

from __future__ import annotations

import numpy as np

from sample_projects.simulate.camera import Camera
from sample_projects.simulate.geometry import GON, Array, Frame, Post, look_at

CAMERA = Camera(
    c=24.4163,
    width=6000,
    height=4000,
    pixel=0.006,
    xh=-0.0522,
    yh=0.0318,
    radial=(-1.62e-4, 2.20e-7),
    decentring=(6.1e-6, -9.4e-6),
    r0=14.0,
)
LENGTH, WIDTH, GROUND, EAVES = 30.0, 18.0, 98.9, 107.8
NETWORK = {
    "N1": np.array([-12.314, -10.221, 98.812]),
    "N2": np.array([40.118, 28.407, 99.306]),
    "N3": np.array([-10.642, 27.215, 99.128]),
    "N4": np.array([42.273, -9.138, 98.955]),
}
BOLTS = (
    {"HB1": np.array([29.2, 0.0, 99.614]), "HB2": np.array([0.0, 16.7, 99.705])},
    np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]]),
)
"""Levelling bolts in the walls, and the walls' normals."""
BARS = (
    {
        "SB1": np.array([7.012, -0.12, 100.102]),
        "SB2": np.array([8.513, -0.12, 100.115]),
        "SB3": np.array([-0.11, 8.204, 100.020]),
        "SB4": np.array([-0.11, 8.188, 101.521]),
    },
    np.array([[0.0, -1.0, 0.0]] * 2 + [[-1.0, 0.0, 0.0]] * 2),
)
"""Two scale bars: one leans at the south wall, one stands at the west wall."""
OBSTACLES = (
    Post(17.5, -6.0, 0.2, GROUND, 102.0),
    Post(17.5, -6.0, 1.6, 102.0, 106.5),
    Post(36.0, 9.0, 0.3, GROUND, 105.0),
)

WALLS: dict[str, tuple[tuple[float, float], tuple[float, float], tuple[float, float]]] = {
    "S": ((0.0, 0.0), (1.0, 0.0), (0.0, -1.0)),
    "E": ((LENGTH, 0.0), (0.0, 1.0), (1.0, 0.0)),
    "N": ((LENGTH, WIDTH), (-1.0, 0.0), (0.0, 1.0)),
    "W": ((0.0, WIDTH), (0.0, -1.0), (-1.0, 0.0)),
}
"""Corner, direction and outer normal of every wall."""


def _on_wall(wall: str, along: float, outwards: float, height: float) -> Array:
    corner, direction, normal = WALLS[wall]
    x, y = (corner[k] + along * direction[k] + outwards * normal[k] for k in range(2))
    return np.array([x, y, height])


def _length(wall: str) -> float:
    return LENGTH if wall in "SN" else WIDTH


def targets() -> tuple[dict[str, Array], Array]:
    """Four target plates on every wall, and their normals."""
    points, normals = {}, []
    for wall in WALLS:
        for k, (share, height) in enumerate(((0.06, 100.6), (0.36, 106.6), (0.66, 100.9), (0.94, 106.2)), start=1):
            points[f"{wall}P{k}"] = _on_wall(wall, share * _length(wall), 0.01, height + 0.1 * share)
            normals.append([*WALLS[wall][2], 0.0])
    return points, np.array(normals)


def details(random: np.random.RandomState) -> tuple[dict[str, Array], Array]:
    """Natural details: window frames, quoins, the eaves."""
    points, normals = {}, []
    for wall in WALLS:
        count = 34 if wall in "SN" else 22
        for k in range(1, count + 1):
            along = _length(wall) * (k - 0.5 + 0.7 * random.uniform(-0.5, 0.5)) / count
            outwards = random.choice([0.0, -0.18, 0.35])
            height = EAVES - 0.1 if outwards > 0.0 else random.uniform(GROUND + 0.7, EAVES - 0.7)
            points[f"{wall}{k:02d}"] = _on_wall(wall, along, outwards, height)
            normals.append([*WALLS[wall][2], 0.0])
    return points, np.array(normals)


def frames(random: np.random.RandomState) -> dict[str, Frame]:
    """Once around the building: six images along a long side, four along a short one, two at every corner."""
    places = []
    for wall in WALLS:
        count = 6 if wall in "SN" else 4
        for k in range(count):
            along = _length(wall) * (k + 0.5) / count
            places.append(
                (
                    _on_wall(wall, along, 13.5, 0.0),
                    _on_wall(wall, along + random.uniform(-2.0, 2.0), 0.0, 103.6),
                    0.0,
                )
            )
        corner = _on_wall(wall, _length(wall), 0.0, 103.6)
        for shift, roll in ((-2.0, 0.0), (2.5, 100.0)):
            place = _on_wall(wall, _length(wall) + 9.5 + shift, 9.5 - shift, 0.0)
            places.append((place, corner, roll))
    result = {}
    for k, (place, target, roll) in enumerate(places, start=1):
        walked = place + np.array([0.8, 0.8, 0.0]) * random.standard_normal(3)
        walked[2] = GROUND + 1.68 + 0.05 * random.standard_normal()
        aimed = target + 0.5 * random.standard_normal(3)
        turned = (roll + random.normal(0.0, 1.5)) * GON
        result[f"B{k:02d}"] = look_at(walked.tolist(), aimed.tolist(), turned)
    return result
