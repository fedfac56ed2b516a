"""Two flight strips of nine images each, with GNSS positions of the projection centres and a few control points."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sample_projects.simulate.camera import Camera, in_axes, inside
from sample_projects.simulate.files import IMAGE_HEADER, camera_table, image_row, numbers, point_table, table
from sample_projects.simulate.geometry import DEGREE, Array, Frame, Mask, disturbed, rotation
from sample_projects.simulate.rays import measured, seen_points, with_enough_rays

CAMERA = Camera(c=120.0037, width=13824, height=7680, pixel=0.012, xh=-0.0041, yh=0.0023)
EAST, NORTH = 455_200.0, 5_412_800.0
FLYING_HEIGHT = 1_290.0
BASE, STRIP_DISTANCE = 320.0, 960.0
SIGMA = 0.0035
"""mm in the image, 0.3 pixels."""
GNSS_SIGMA = np.array([0.05, 0.05, 0.08])
CONTROL_SIGMA = np.array([0.02, 0.02, 0.03])

FULL = {"P101": (110.0, -330.0), "P102": (2440.0, -300.0), "P103": (90.0, 1250.0), "P104": (2470.0, 1290.0)}
HEIGHT_ONLY = {"H201": (1300.0, -350.0), "H202": (1270.0, 1300.0)}
"""Places east and north of the beginning of the first strip."""


def simulate() -> dict[str, str]:
    """Files of the sample."""
    random = np.random.RandomState(2403)
    full = {name: _on_the_ground(*place) for name, place in FULL.items()}
    height_only = {name: _on_the_ground(*place) for name, place in HEIGHT_ONLY.items()}
    points = {**full, **height_only, **_tie_points(random)}
    frames = _frames(random)

    def visible(camera: Camera, frame: Frame) -> Mask:
        return inside(camera, in_axes(frame, np.stack(list(points.values()))), border=60.0)

    images = {name: (CAMERA, frame) for name, frame in frames.items()}
    drop = np.array([0.08 if name.startswith("T") else 0.0 for name in points])
    rays = with_enough_rays(measured(images, points, visible, SIGMA, random, drop), 2)
    seen = seen_points(rays, points)
    tie = {name: xyz for name, xyz in seen.items() if name.startswith("T")}
    return {
        "control.csv": point_table({n: p + CONTROL_SIGMA * random.standard_normal(3) for n, p in full.items()}, 3),
        "height_control.csv": table("id,x,y,z", _height_rows(height_only, random)),
        "tie_points.csv": point_table({n: p + 4.0 * random.standard_normal(3) for n, p in tie.items()}, 0),
        "images.csv": table(IMAGE_HEADER, _image_rows(frames, random)),
        "image_points.csv": table("image,point,x,y", ([r.image, r.point, *numbers(r.xy, 4)] for r in rays)),
        "truth/points.csv": point_table(seen, 4),
        "truth/images.csv": table(IMAGE_HEADER, [image_row(n, "DMC", f, 4, DEGREE, 8) for n, f in frames.items()]),
        "truth/cameras.csv": camera_table({"DMC": CAMERA}),
    }


def _on_the_ground(east: float, north: float) -> Array:
    """A place with its terrain height: a valley with a ridge along one side."""
    height = 262.0 + 34.0 * np.sin(east / 640.0) + 41.0 * np.cos(north / 520.0) + 12.0 * np.sin((east + north) / 190.0)
    return np.array([EAST + east, NORTH + north, height])


def _tie_points(random: np.random.RandomState) -> dict[str, Array]:
    """Tie points scattered around the places where images overlap."""
    result = {}
    for column in range(19):
        for row in range(10):
            east = -160.0 + 0.5 * BASE * column + random.uniform(-70.0, 70.0)
            north = -490.0 + 216.0 * row + random.uniform(-60.0, 60.0)
            result[f"T{column + 1:02d}{row + 1:02d}"] = _on_the_ground(east, north)
    return result


def _frames(random: np.random.RandomState) -> dict[str, Frame]:
    """The first strip flown eastwards, the second back westwards; the image's y axis points in flight direction."""
    result = {}
    for strip, heading in enumerate((-90.0, 90.0)):
        for k in range(9):
            along = k if strip == 0 else 8 - k
            place = np.array([BASE * (along + 0.04), STRIP_DISTANCE * strip, FLYING_HEIGHT])
            place += random.normal(0.0, 1.0, 3) * np.array([12.0, 15.0, 6.0])
            turn = random.normal(0.0, 1.0, 3) * np.array([1.5, 1.5, 2.5]) + np.array([0.0, 0.0, heading])
            frame = Frame(place + np.array([EAST, NORTH, 0.0]), rotation(*(turn * DEGREE)))
            result[f"{strip + 1}_{k + 1:04d}"] = frame
    return result


def _image_rows(frames: Mapping[str, Frame], random: np.random.RandomState) -> list[list[str]]:
    """Positions as GNSS gave them; angles as flown by plan, a degree or two off."""
    rows = []
    for name, frame in frames.items():
        planned = disturbed(frame, random, 0.0, 1.0 * DEGREE)
        seen = Frame(frame.position + GNSS_SIGMA * random.standard_normal(3), planned.D)
        rows.append(image_row(name, "DMC", seen, 3, DEGREE, 0))
    return rows


def _height_rows(points: Mapping[str, Array], random: np.random.RandomState) -> list[list[str]]:
    rows = []
    for name, xyz in points.items():
        rough, height = (
            xyz[:2] + 2.0 * random.standard_normal(2),
            xyz[2] + CONTROL_SIGMA[2] * random.standard_normal(),
        )
        rows.append([name, *numbers(rough, 0), *numbers([height], 3)])
    return rows
