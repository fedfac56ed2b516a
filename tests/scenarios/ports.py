"""Images through the port of an underwater housing, traced by code that shares nothing with the program.

Rays start in the camera, at the projection centre, and are followed outwards, one by one, by Snell's law: the
component of a ray across the normal is multiplied by n/n'.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

FLAT = {
    "tilt_x": 0.02,
    "tilt_y": -0.03,
    "distance": 0.06,
    "glass": 0.01,
    "n_air": 1.0003,
    "n_glass": 1.49,
    "n_water": 1.334,
}
DOME = {
    "centre_x": 0.005,
    "centre_y": -0.004,
    "centre_z": 0.012,
    "radius": 0.08,
    "glass": 0.006,
    "n_air": 1.0003,
    "n_glass": 1.52,
    "n_water": 1.341,
}


def in_water(direction: np.ndarray, port: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Where a ray with this direction in the air leaves the glass (3,), and its unit direction in the water (3,)."""
    ray, at = direction / np.linalg.norm(direction), np.zeros(3)
    for depth, before, after in ((0.0, "n_air", "n_glass"), (port["glass"], "n_glass", "n_water")):
        if "radius" in port:
            centre = np.array([port[f"centre_{axis}"] for axis in "xyz"])
            foot = ray @ (centre - at)  # from here to the point of the ray that is nearest to the centre
            aside = np.linalg.norm(at + foot * ray - centre)
            at = at + (foot + math.sqrt((port["radius"] + depth) ** 2 - aside**2)) * ray
            normal = (at - centre) / (port["radius"] + depth)
        else:
            normal = np.array([port["tilt_x"], port["tilt_y"], -1.0])
            normal = normal / np.linalg.norm(normal)
            at = at + (port["distance"] + depth - normal @ at) / (normal @ ray) * ray
        across = port[before] / port[after] * (ray - (ray @ normal) * normal)
        ray = across + math.sqrt(1.0 - across @ across) * normal
    return at, ray


def seen_in(star: np.ndarray, port: dict[str, float]) -> np.ndarray:
    """(2,) X/−Z and Y/−Z of the direction in the air in which a point (3,) in the water is seen."""

    def beside(slopes: np.ndarray) -> np.ndarray:
        at, ray = in_water(np.array([*slopes, -1.0]), port)
        return np.cross(ray, (star - at) / np.linalg.norm(star - at))

    begin = star[:2] / -star[2]
    return least_squares(beside, begin, xtol=1e-15, ftol=1e-15, gtol=1e-15).x


CONSTANT = 20.0
"""Camera constant, mm."""
VIEWS = [(0, 0, 0), (0.5, 0, 1.57), (-0.5, 0, 3.14), (0, 0.5, -1.57), (0, -0.5, 0.4), (0.35, 0.35, 2)]


def test_field(port: dict[str, float]) -> tuple[np.ndarray, list[tuple[int, int, np.ndarray]]]:
    """Points of a field of 1.5 m, and what images see of it: image, point, x and y without errors."""
    grid = np.linspace(-0.75, 0.75, 6)
    heights = np.random.default_rng(1).uniform(-0.15, 0.15, (6, 6))
    points = np.array([(x, y, heights[i, j]) for i, x in enumerate(grid) for j, y in enumerate(grid)])
    seen = []
    for k, (omega, phi, kappa) in enumerate(VIEWS):
        tilted = Rotation.from_euler("XYZ", [omega, phi, 0.0]).as_matrix()
        turned = Rotation.from_euler("z", -kappa).as_matrix()
        centre = tilted @ [0.0, 0.0, 1.9 + 0.1 * (k % 3)]
        for number, point in enumerate(points):
            xy = CONSTANT * seen_in(turned @ tilted.T @ (point - centre), port)
            if abs(xy[0]) < 18.0 and abs(xy[1]) < 12.0:
                seen.append((k, number, xy))
    return points, seen


PROJECT = """\
mor: 1
cameras:
  C:
    medium: {medium}
    image: {{width: 6000, height: 4000, pixel: 6 um}}
    interior: {{c: 20, {interior}}}
points:
  - {{columns: [id, x, y, z], fixed: [x, y, z], rows: {points}}}
images:
  - {{columns: [id, camera], rows: {images}}}
observations:
  - {{type: image, columns: [image, point, x, y], values: {{sigma: 0.5 um}}, rows: {rows}}}
"""


def write_project(
    file: Path,
    interior: dict[str, object],
    points: np.ndarray,
    seen: list[tuple[int, int, np.ndarray]],
    errors: np.ndarray,
) -> Path:
    """Write a project with known points, cameras without poses, and ``errors`` (n, 2) in mm."""
    text = PROJECT.format(
        medium="dome-port" if "radius" in interior else "flat-port",
        interior=", ".join(f"{name}: {value}" for name, value in interior.items()),
        points=[[f"P{k}", *map(float, point)] for k, point in enumerate(points)],
        images=[[f"I{k}", "C"] for k in range(len(VIEWS))],
        rows=[
            [f"I{k}", f"P{number}", *map(float, xy + error)]
            for (k, number, xy), error in zip(seen, errors, strict=True)
        ],
    )
    file.write_text(text, encoding="utf-8")
    return file
