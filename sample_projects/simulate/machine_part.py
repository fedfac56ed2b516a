"""A machined angle block: planes, a right angle and a straight edge are known as well as the images see them."""

from __future__ import annotations

import numpy as np

from sample_projects.simulate.camera import Camera, sees
from sample_projects.simulate.files import (
    IMAGE_HEADER,
    camera_table,
    image_row,
    number,
    numbers,
    point_table,
    table,
)
from sample_projects.simulate.geometry import GON, Array, Frame, Mask, disturbed, look_at
from sample_projects.simulate.rays import measured, seen_points, with_enough_rays

CAMERA = Camera(
    c=28.6418,
    width=4288,
    height=2848,
    pixel=0.0055,
    xh=-0.0147,
    yh=0.0382,
    radial=(-1.31e-4, 1.9e-7),
    decentring=(2.4e-6, -6.7e-6),
    r0=9.0,
)
SIGMA = 0.0004
BAR_SIGMA = 0.01
FLATNESS, STRAIGHTNESS = 0.012, 0.008
"""How far points are from the machined planes and from the edge, mm."""
LENGTH, DEPTH, HEIGHT = 620.0, 410.0, 280.0
BARS = {
    ("10", "11"): ((-160.0, -60.0, -40.0), (-140.0, 445.0, -40.0)),
    ("12", "13"): ((60.0, 520.0, -40.0), (565.0, 535.0, -40.0)),
}


def simulate() -> dict[str, str]:
    """Files of the sample."""
    random = np.random.RandomState(2407)
    points, normals = _targets(random)
    frames = _frames(random)

    def visible(camera: Camera, frame: Frame) -> Mask:
        return sees(camera, frame, np.stack(list(points.values())), normals, 72.0 * GON)

    images = {name: (CAMERA, frame) for name, frame in frames.items()}
    rays = measured(images, points, visible, SIGMA, random)
    seen = seen_points(with_enough_rays(rays, 3), points)
    start = {name: xyz + 6.0 * random.standard_normal(3) for name, xyz in seen.items()}
    image_rows = [image_row(n, "D300", disturbed(f, random, 12.0, GON), 0, GON, 0) for n, f in frames.items()]
    return {
        "targets.csv": point_table(start, 0),
        "images.csv": table(IMAGE_HEADER, image_rows),
        "image_points.csv": table(
            "image,point,x,y", ([r.image, r.point, *numbers(r.xy, 5)] for r in rays if r.point in seen)
        ),
        "scale_bars.csv": table("from,to,distance,sigma", _bars(points, random)),
        "truth/points.csv": point_table(seen, 6),
        "truth/images.csv": table(IMAGE_HEADER, [image_row(n, "D300", f, 6, GON, 8) for n, f in frames.items()]),
        "truth/cameras.csv": camera_table({"D300": CAMERA}),
    }


def _targets(random: np.random.RandomState) -> tuple[dict[str, Array], Array]:
    """Coded targets: 1xx on top, 2xx in front, 3xx on the right side, 4xx along the upper rear edge, 1x on the bars.

    Front and right side are machined at a right angle; what each target is off its plane or edge is part of the truth.
    """
    points: dict[str, Array] = {}
    normals: list[list[float]] = []

    def put(name: str, place: tuple[float, float, float], normal: list[float]) -> None:
        points[name] = np.array(place)
        normals.append(normal)

    for k in range(12):
        x, y = 70.0 + 160.0 * (k % 4), 60.0 + 120.0 * (k // 4)
        put(f"{101 + k}", (x, y, HEIGHT + random.normal(0.0, FLATNESS)), [0.0, 0.0, 1.0])
    for k in range(10):
        x, z = 60.0 + 125.0 * (k % 5), 70.0 + 150.0 * (k // 5)
        put(f"{201 + k}", (x, random.normal(0.0, FLATNESS), z), [0.0, -1.0, 0.0])
    for k in range(8):
        y, z = 55.0 + 100.0 * (k % 4), 70.0 + 150.0 * (k // 4)
        put(f"{301 + k}", (LENGTH + random.normal(0.0, FLATNESS), y, z), [1.0, 0.0, 0.0])
    for k in range(7):
        y, z = random.normal(0.0, STRAIGHTNESS, 2) + np.array([DEPTH + 5.0, HEIGHT + 8.0])
        put(f"{401 + k}", (30.0 + 93.0 * k, y, z), [0.0, 0.0, 1.0])
    for names, ends in BARS.items():
        for name, place in zip(names, ends, strict=True):
            put(name, place, [0.0, 0.0, 1.0])
    return points, np.array(normals)


def _frames(random: np.random.RandomState) -> dict[str, Frame]:
    """Eighteen images from the front, the right and above; the camera turned every other time."""
    result = {}
    for k in range(18):
        azimuth = (55.0 + 165.0 * (k % 9) / 8.0) * GON + random.normal(0.0, 4.0 * GON)
        elevation = (32.0 if k < 9 else 58.0) * GON + random.normal(0.0, 3.0 * GON)
        distance = 1750.0 + random.normal(0.0, 60.0)
        away = [
            np.cos(elevation) * np.sin(azimuth),
            np.cos(elevation) * np.cos(azimuth),
            np.sin(elevation),
        ]
        middle = np.array([LENGTH / 2.0, DEPTH / 2.0, 120.0]) + random.normal(0.0, 25.0, 3)
        roll = (0.0, 100.0, 0.0, -100.0)[k % 4] * GON + random.normal(0.0, 2.0 * GON)
        result[f"m{k + 1:02d}"] = look_at((middle + distance * np.array(away)).tolist(), middle.tolist(), roll)
    return result


def _bars(points: dict[str, Array], random: np.random.RandomState) -> list[list[str]]:
    rows = []
    for one, other in BARS:
        length = float(np.linalg.norm(points[other] - points[one])) + BAR_SIGMA * random.standard_normal()
        rows.append([one, other, number(length, 3), f"{BAR_SIGMA:g}"])
    return rows
