"""A stereo rig: two cameras on one bar, carried along a wall relief; the bar is the same in every set-up."""

from __future__ import annotations

import numpy as np

from sample_projects.simulate.camera import Camera, sees
from sample_projects.simulate.files import (
    IMAGE_HEADER,
    camera_table,
    image_row,
    number,
    numbers,
    parameter_table,
    point_table,
    table,
)
from sample_projects.simulate.geometry import GON, Array, Frame, Mask, disturbed, look_at, rotation
from sample_projects.simulate.rays import ImagePoint, measured, seen_points, with_enough_rays

LEFT = Camera(
    c=16.5214, width=4096, height=3000, pixel=0.00345, xh=0.0217, yh=-0.0108, radial=(-4.4e-4, 1.1e-6), r0=5.0
)
RIGHT = Camera(
    c=16.4873, width=4096, height=3000, pixel=0.00345, xh=-0.0134, yh=0.0302, radial=(-4.6e-4, 1.3e-6), r0=5.0
)
BASE = np.array([0.79832, 0.00415, -0.01127])
TURN = np.array([0.4127, 9.8312, -0.2240]) * GON
"""Place and attitude of the right camera in the axes of the left one: converging by 10 gon."""
SIGMA = 0.0004
TAPES = (("T0103", "T1101"), ("T0201", "T0804"), ("T0702", "T1104"))
TAPE_SIGMA = 0.0003


def simulate() -> dict[str, str]:
    """Files of the sample."""
    random = np.random.RandomState(2405)
    points = _relief(random)
    normals = np.tile([0.0, -1.0, 0.0], (len(points), 1))
    leaders = _set_ups(random)
    images: dict[str, tuple[Camera, Frame]] = {}
    for k, leader in enumerate(leaders, start=1):
        follower = Frame(leader.position + leader.D.T @ BASE, rotation(*TURN) @ leader.D)
        images |= {f"L{k:02d}": (LEFT, leader), f"R{k:02d}": (RIGHT, follower)}

    def visible(camera: Camera, frame: Frame) -> Mask:
        return sees(camera, frame, np.stack(list(points.values())), normals, 70.0 * GON)

    rays = with_enough_rays(measured(images, points, visible, SIGMA, random), 3)
    seen = seen_points(rays, points)
    start = {name: xyz + 0.03 * random.standard_normal(3) for name, xyz in seen.items()}
    rows = [
        image_row(n, "left", disturbed(f, random, 0.04, GON), 2, GON, 0) for n, (c, f) in images.items() if c is LEFT
    ]
    followers = [[f"R{k:02d}", "right", f"L{k:02d}", "bar"] for k in range(1, len(leaders) + 1)]
    return {
        "targets.csv": point_table(start, 2),
        "left_images.csv": table(IMAGE_HEADER, rows),
        "right_images.csv": table("id,camera,leader,pair", followers),
        "image_points.csv": table("image,point,x,y", map(_row, rays)),
        "tapes.csv": table("from,to,distance,sigma", _tapes(seen, random)),
        "truth/points.csv": point_table(seen, 6),
        "truth/images.csv": table(IMAGE_HEADER, _true_images(images)),
        "truth/pairs.csv": table("id,bx,by,bz,omega,phi,kappa", [["bar", *numbers(BASE, 6), *numbers(TURN / GON, 6)]]),
        "truth/cameras.csv": camera_table({"left": LEFT, "right": RIGHT}),
        "truth/parameters.csv": parameter_table(
            {("base", "pair bar", name): value for name, value in zip(("bx", "by", "bz"), BASE, strict=True)}
        ),
    }


def _relief(random: np.random.RandomState) -> dict[str, Array]:
    """Targets on a carved wall of 4.4 m × 2 m with 35 cm of relief."""
    result = {}
    for column in range(1, 13):
        for row in range(1, 7):
            x = 0.4 * column - 0.4 + random.uniform(-0.1, 0.1)
            z = 0.4 * row + 0.2 + random.uniform(-0.1, 0.1)
            depth = 0.18 * np.sin(1.7 * x) + 0.10 * np.cos(4.0 * z) + random.uniform(-0.08, 0.08)
            result[f"T{column:02d}{row:02d}"] = np.array([x, depth, z])
    return result


def _set_ups(random: np.random.RandomState) -> list[Frame]:
    """Twelve set-ups along the wall, high and low in turn, the bar upright in three of them."""
    result = []
    for k in range(12):
        along, height = -0.15 + 0.37 * k, 1.75 if k % 2 else 1.15
        roll = 100.0 if k in (2, 6, 9) else 0.0
        place = np.array([along, -2.35, height]) + 0.08 * random.standard_normal(3)
        aimed = np.array([along + 0.45, 0.0, 1.95 if k % 2 else 1.2]) + 0.08 * random.standard_normal(3)
        result.append(look_at(place.tolist(), aimed.tolist(), (roll + random.normal(0.0, 2.0)) * GON))
    return result


def _row(ray: ImagePoint) -> list[str]:
    return [ray.image, ray.point, *numbers(ray.xy, 5)]


def _true_images(images: dict[str, tuple[Camera, Frame]]) -> list[list[str]]:
    return [image_row(n, "left" if c is LEFT else "right", f, 6, GON, 8) for n, (c, f) in images.items()]


def _tapes(points: dict[str, Array], random: np.random.RandomState) -> list[list[str]]:
    rows = []
    for one, other in TAPES:
        length = float(np.linalg.norm(points[other] - points[one])) + TAPE_SIGMA * random.standard_normal()
        rows.append([one, other, number(length, 4), f"{TAPE_SIGMA:g}"])
    return rows
