"""A calibration field of 2 m × 2 m × 0.5 m on the floor, two scale bars on it, twenty images all around."""

from __future__ import annotations

from collections.abc import Mapping

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
    c=20.4172,
    width=5568,
    height=3712,
    pixel=0.00645,
    xh=-0.0318,
    yh=0.0557,
    radial=(-2.127e-4, 4.31e-7),
    decentring=(-8.3e-6, 1.46e-5),
    r0=12.0,
)
STEEPEST = 75.0 * GON
SIGMA = 0.0005
"""mm in the image, a twelfth of a pixel."""
BAR_SIGMA = 0.015
BARS = {
    ("B1A", "B1B"): ((-640.0, -815.0, 12.0), (712.4, -790.0, 12.0)),
    ("B2A", "B2B"): ((-870.0, -420.0, 14.0), (-560.0, 830.5, 14.0)),
}


def simulate() -> dict[str, str]:
    """Files of the sample."""
    random = np.random.RandomState(2402)
    ends = {n: np.array(p) for names, places in BARS.items() for n, p in zip(names, places, strict=True)}
    points = {**_targets(random), **ends}
    frames = _frames(random)
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))

    def visible(camera: Camera, frame: Frame) -> Mask:
        return sees(camera, frame, np.stack(list(points.values())), normals, STEEPEST)

    images = {name: (CAMERA, frame) for name, frame in frames.items()}
    rays = with_enough_rays(measured(images, points, visible, SIGMA, random), 3)
    seen = seen_points(rays, points)
    start = {name: xyz + 8.0 * random.standard_normal(3) for name, xyz in seen.items()}
    image_rows = [image_row(n, "20mm", disturbed(f, random, 15.0, 1.0 * GON), 0, GON, 1) for n, f in frames.items()]
    return {
        "targets.csv": point_table(start, 0),
        "images.csv": table(IMAGE_HEADER, image_rows),
        "image_points.csv": table("image,point,x,y", ([r.image, r.point, *numbers(r.xy, 5)] for r in rays)),
        "scale_bars.csv": table("from,to,distance,sigma", _bars(ends, random)),
        "truth/points.csv": point_table(seen, 6),
        "truth/images.csv": table(IMAGE_HEADER, [image_row(n, "20mm", f, 6, GON, 8) for n, f in frames.items()]),
        "truth/cameras.csv": camera_table({"20mm": CAMERA}),
    }


def _targets(random: np.random.RandomState) -> dict[str, Array]:
    """A grid on the plate, every fourth target on a rod of its own height."""
    result = {}
    for row in range(10):
        for column in range(11):
            x, y = -960.0 + 192.0 * column, -940.0 + 208.0 * row
            on_rod = (row + 2 * column) % 4 == 0
            z = random.uniform(120.0, 500.0) if on_rod else random.uniform(-2.0, 2.0)
            xy = np.array([x, y]) + random.uniform(-40.0, 40.0, 2)
            result[f"{row + 1:02d}{column + 1:02d}"] = np.array([*xy, z])
    return result


def _frames(random: np.random.RandomState) -> dict[str, Frame]:
    """Eight places around at two heights, then from above; the camera is turned from image to image."""
    result = {}
    rolls = (0.0, 100.0, 0.0, -100.0, 200.0, 0.0, 100.0, -100.0)
    for k in range(16):
        azimuth = (50.0 * k + 25.0 * (k >= 8)) * GON + random.normal(0.0, 4.0 * GON)
        elevation = (52.0 if k < 8 else 70.0) * GON + random.normal(0.0, 2.0 * GON)
        distance = (2050.0 if k < 8 else 2250.0) + random.normal(0.0, 90.0)
        horizontal = distance * np.cos(elevation)
        place = [
            horizontal * np.sin(azimuth),
            horizontal * np.cos(azimuth),
            distance * np.sin(elevation) + 100.0,
        ]
        aimed = [*random.normal(0.0, 90.0, 2), 120.0]
        result[f"{k + 1:03d}"] = look_at(place, aimed, rolls[k % 8] * GON + random.normal(0.0, 2.0 * GON))
    for k, roll in enumerate((0.0, 100.0, 200.0, 300.0)):
        place = [*random.normal(0.0, 150.0, 2), 2350.0]
        frame = look_at(place, [*random.normal(0.0, 60.0, 2), 0.0], roll * GON, up=(0.0, 1.0, 0.0))
        result[f"{k + 17:03d}"] = frame
    return result


def _bars(ends: Mapping[str, Array], random: np.random.RandomState) -> list[list[str]]:
    rows = []
    for one, other in BARS:
        length = float(np.linalg.norm(ends[other] - ends[one])) + random.normal(0.0, BAR_SIGMA)
        rows.append([one, other, number(length, 3), f"{BAR_SIGMA:g}"])
    return rows
