"""Calibration from a single station: a camera turned on its tripod, theodolite-known targets all around."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sample_projects.simulate.camera import Camera, in_axes, inside
from sample_projects.simulate.files import (
    camera_table,
    image_row,
    numbers,
    parameter_table,
    point_table,
    table,
)
from sample_projects.simulate.geometry import GON, Array, Frame, Mask, disturbed, look_at
from sample_projects.simulate.rays import measured, seen_points, with_enough_rays

CAMERA = Camera(
    c=35.8127,
    width=6048,
    height=4024,
    pixel=0.00594,
    xh=0.0418,
    yh=0.0266,
    radial=(-6.81e-5, 5.2e-8),
    decentring=(3.2e-6, 5.8e-6),
    r0=14.0,
)
ECCENTRICITY = np.array([0.0021, 0.0463, -0.0618])
"""From the projection centre to the rotation centre of the tripod head, image axes."""
CENTRE = np.array([0.0, 0.0, 1.482])
SIGMA = 0.0006
TARGET_SIGMA = 0.0003


def simulate() -> dict[str, str]:
    """Files of the sample."""
    random = np.random.RandomState(2406)
    points = _targets(random)
    turned = _turns(random)
    # the projection centre stands off the rotation centre: X* = D (X − X0) + r0*
    images = {n: (CAMERA, Frame(f.position - f.D.T @ ECCENTRICITY, f.D)) for n, f in turned.items()}

    def visible(camera: Camera, frame: Frame) -> Mask:
        return inside(camera, in_axes(frame, np.stack(list(points.values()))), border=40.0)

    rays = with_enough_rays(measured(images, points, visible, SIGMA, random), 2)
    seen = seen_points(rays, points)
    observed = {name: xyz + TARGET_SIGMA * random.standard_normal(3) for name, xyz in seen.items()}
    return {
        "targets.csv": point_table(observed, 5),
        "images.csv": table("id,camera,position,omega,phi,kappa", _rows(turned, random)),
        "image_points.csv": table("image,point,x,y", ([r.image, r.point, *numbers(r.xy, 5)] for r in rays)),
        "truth/points.csv": point_table({**seen, "tripod": CENTRE}, 6),
        "truth/images.csv": table("id,camera,x,y,z,omega,phi,kappa", _true_rows(turned)),
        "truth/cameras.csv": camera_table({"A7": CAMERA}),
        "truth/parameters.csv": parameter_table(
            {
                ("eccentricity", "camera A7", name): value
                for name, value in zip(("rx", "ry", "rz"), ECCENTRICITY, strict=True)
            }
        ),
    }


def _targets(random: np.random.RandomState) -> dict[str, Array]:
    """Targets all around a hall: on pillars and stands nearby, on the walls further away."""
    result = {}
    for k in range(132):
        azimuth = (400.0 / 132.0 * k + random.uniform(-2.0, 2.0)) * GON
        distance = (2.2, 5.5, 11.0)[k % 3] * random.uniform(0.85, 1.15)
        elevation = (-14.0, 3.0, 17.0, -5.0, 11.0)[k % 5] * GON + random.uniform(-3.0, 3.0) * GON
        horizontal = distance * np.cos(elevation)
        offset = [horizontal * np.sin(azimuth), horizontal * np.cos(azimuth), distance * np.sin(elevation)]
        result[f"{k + 1:03d}"] = CENTRE + np.array(offset)
    return result


def _turns(random: np.random.RandomState) -> dict[str, Frame]:
    """Once around in 16 images, camera upright and on its side in turn; then four upside down and up and down."""
    result = {}
    for k in range(20):
        azimuth = (25.0 * k if k < 16 else 100.0 * k + 12.0) * GON + random.normal(0.0, 3.0 * GON)
        upwards = (2.0 if k < 16 else (-9.0, 9.0)[k % 2]) * GON + random.normal(0.0, 2.0 * GON)
        roll = (0.0, 100.0, 0.0, -100.0)[k % 4] if k < 16 else 200.0
        ahead = [np.cos(upwards) * np.sin(azimuth), np.cos(upwards) * np.cos(azimuth), np.sin(upwards)]
        result[f"{k + 1:02d}"] = look_at(CENTRE.tolist(), (CENTRE + np.array(ahead)).tolist(), roll * GON)
    return result


def _rows(frames: Mapping[str, Frame], random: np.random.RandomState) -> list[list[str]]:
    """Every image at the same place, which the project gives by name; angles from the divided tripod head."""
    rows = []
    for name, frame in frames.items():
        row = image_row(name, "A7", disturbed(frame, random, 0.0, GON), 3, GON, 0)
        rows.append([*row[:2], "tripod", *row[5:]])
    return rows


def _true_rows(frames: Mapping[str, Frame]) -> list[list[str]]:
    return [image_row(n, "A7", f, 6, GON, 8) for n, f in frames.items()]
