"""A camera with an unstable lens: camera constant and principal point differ from image to image."""

from __future__ import annotations

from dataclasses import replace

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
    c=24.1836,
    width=4592,
    height=3064,
    pixel=0.0051,
    xh=0.0735,
    yh=-0.0512,
    radial=(-1.94e-4, 3.6e-7),
    r0=9.0,
)
C_SIGMA, XH_SIGMA, YH_SIGMA = 0.04, 0.05, 0.05
"""How much c, xh, yh of an image differ from those of the camera, mm."""
SIGMA = 0.0007
DISTANCE_SIGMA = 0.05
DISTANCES = (("102", "113"), ("202", "208"), ("105", "216"))


def simulate() -> dict[str, str]:
    """Files of the sample."""
    random = np.random.RandomState(2408)
    points, normals = _targets(random)
    frames = _frames(random)
    shifts = np.array([C_SIGMA, XH_SIGMA, YH_SIGMA]) * random.standard_normal((len(frames), 3))
    cameras = {
        name: replace(CAMERA, c=CAMERA.c + c, xh=CAMERA.xh + x, yh=CAMERA.yh + y)
        for name, (c, x, y) in zip(frames, shifts, strict=True)
    }

    def visible(camera: Camera, frame: Frame) -> Mask:
        return sees(camera, frame, np.stack(list(points.values())), normals, 70.0 * GON)

    images = {name: (cameras[name], frame) for name, frame in frames.items()}
    rays = with_enough_rays(measured(images, points, visible, SIGMA, random), 3)
    seen = seen_points(rays, points)
    start = {name: xyz + 15.0 * random.standard_normal(3) for name, xyz in seen.items()}
    image_rows = [image_row(n, "zoom", disturbed(f, random, 20.0, GON), 0, GON, 0) for n, f in frames.items()]
    own = [[name, *numbers((camera.c, camera.xh, camera.yh), 6)] for name, camera in cameras.items()]
    return {
        "targets.csv": point_table(start, 0),
        "images.csv": table(IMAGE_HEADER, image_rows),
        "image_points.csv": table("image,point,x,y", ([r.image, r.point, *numbers(r.xy, 5)] for r in rays)),
        "distances.csv": table("from,to,distance,sigma", _distances(points, random)),
        "truth/points.csv": point_table(seen, 6),
        "truth/images.csv": table(IMAGE_HEADER, [image_row(n, "zoom", f, 6, GON, 8) for n, f in frames.items()]),
        "truth/image_interiors.csv": table("image,c,xh,yh", own),
        "truth/cameras.csv": camera_table({"zoom": CAMERA}),
    }


def _targets(random: np.random.RandomState) -> tuple[dict[str, Array], Array]:
    """Targets in the corner of a room: 1xx on the left wall, 2xx on the right one, 3xx on boxes in front."""
    points: dict[str, Array] = {}
    normals = []
    for first, count, normal in (
        (101, 30, (0.0, -1.0, 0.0)),
        (201, 30, (-1.0, 0.0, 0.0)),
        (301, 16, (-1.0, -1.0, 0.6)),
    ):
        for k in range(count):
            along = -2300.0 * (k % 10 + 0.5) / 10.0 + random.uniform(-60.0, 60.0)
            height = 500.0 + 700.0 * (k // 10) + random.uniform(-150.0, 150.0)
            place = {
                101: np.array([along, 0.0, height]),
                201: np.array([0.0, along, height]),
                301: np.array([-300.0, -300.0, 150.0]) + random.uniform(-1.0, 1.0, 3) * np.array([250.0, 250.0, 140.0]),
            }[first]
            points[f"{first + k}"] = place + 2.0 * random.standard_normal(3)
            normals.append(normal)
    return points, np.array(normals)


def _frames(random: np.random.RandomState) -> dict[str, Frame]:
    """Sixteen images along an arc, standing, kneeling and from a ladder; half of them turned."""
    result = {}
    for k in range(16):
        azimuth = (215.0 + 70.0 * (k % 8) / 7.0) * GON + random.normal(0.0, 2.0 * GON)
        distance = 3600.0 + random.normal(0.0, 250.0)
        height = (1650.0, 900.0, 2400.0)[k % 3] + random.normal(0.0, 60.0)
        aimed = np.array([-350.0, -350.0, 1050.0]) + random.normal(0.0, 80.0, 3)
        place = [distance * np.sin(azimuth), distance * np.cos(azimuth), height]
        roll = (0.0, 100.0, 0.0, -100.0)[k % 4] * GON + random.normal(0.0, 3.0 * GON)
        result[f"{k + 1:02d}"] = look_at(place, aimed.tolist(), roll)
    return result


def _distances(points: dict[str, Array], random: np.random.RandomState) -> list[list[str]]:
    rows = []
    for one, other in DISTANCES:
        length = float(np.linalg.norm(points[other] - points[one])) + DISTANCE_SIGMA * random.standard_normal()
        rows.append([one, other, number(length, 2), f"{DISTANCE_SIGMA:g}"])
    return rows
