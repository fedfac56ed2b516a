"""A facade of 24 m × 14 m, photographed from the street and from a lift, with surveyed control points."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sample_projects.simulate.camera import Camera, pixels, sees
from sample_projects.simulate.files import (
    IMAGE_HEADER,
    camera_table,
    image_row,
    number,
    numbers,
    point_table,
    table,
)
from sample_projects.simulate.geometry import (
    DEGREE,
    GON,
    Array,
    Frame,
    Mask,
    Post,
    disturbed,
    hidden_by_post,
    look_at,
)
from sample_projects.simulate.rays import measured, seen_points, with_enough_rays
from sample_projects.simulate.survey import Sight, read, sight, theodolite

CAMERA = Camera(
    c=28.3718,
    width=6000,
    height=4000,
    pixel=0.006,
    xh=0.0624,
    yh=-0.0413,
    radial=(-1.153e-4, 1.37e-7),
    decentring=(1.21e-5, -0.74e-5),
    r0=14.0,
)
STEEPEST = 68.0 * DEGREE
CONTROL_SIGMA = 0.005
TARGET_SIGMA, DETAIL_SIGMA = 0.12, 0.35
"""Precision of image points in pixels: signalised targets, natural details."""

OBSTACLES = (
    Post(7.2, -4.6, 0.16, 0.0, 3.2),  # trunk
    Post(7.2, -4.6, 1.25, 3.2, 6.4),  # crown
    Post(16.5, -3.8, 0.10, 0.0, 7.5),  # lamp post
)
CONTROL = {
    "CP1": (1.85, -0.02, 2.10),
    "CP2": (22.20, 0.00, 2.32),
    "CP3": (0.62, 0.01, 12.75),
    "CP4": (23.41, -0.01, 12.60),
    "CP5": (11.70, 0.00, 1.95),
    "CP6": (12.35, -1.12, 9.05),
    "CP7": (5.10, 0.22, 7.10),
    "CP8": (18.60, 0.21, 6.80),
}
SETUPS = {"S1": ((6.5, -15.2, 1.58), 310.7), "S2": ((18.9, -16.1, 1.63), 36.2)}
"""Trunnion axis of the total station, and bearing of the zero of its circle in gon."""
READING = Sight(0.0005 * GON, 0.0005 * GON, 0.002)
"""σ of the total station, distances without reflector."""
VIEWS: tuple[tuple[tuple[float, float, float], tuple[float, float, float], float], ...] = (
    ((1.5, -12.6, 1.66), (5.0, 0.0, 5.9), 0.0),
    ((4.3, -13.4, 1.64), (6.2, 0.0, 6.2), 0.0),
    ((7.9, -12.1, 1.71), (8.0, 0.0, 6.0), 0.0),
    ((10.6, -12.9, 1.65), (11.0, 0.0, 6.3), 90.0),
    ((13.1, -13.2, 1.67), (12.5, 0.0, 6.0), 0.0),
    ((16.4, -12.4, 1.63), (16.0, 0.0, 6.1), 0.0),
    ((19.5, -13.6, 1.68), (18.2, 0.0, 6.2), -90.0),
    ((22.8, -12.2, 1.66), (19.0, 0.0, 5.8), 0.0),
    ((27.1, -10.8, 1.62), (19.5, 0.0, 6.0), 0.0),
    ((-1.8, -11.5, 8.20), (5.5, 0.0, 7.0), 0.0),
    ((5.2, -13.8, 8.60), (6.8, 0.0, 7.2), 0.0),
    ((11.9, -14.3, 9.10), (12.0, 0.0, 7.0), 180.0),
    ((18.3, -13.5, 8.40), (17.4, 0.0, 7.1), 0.0),
    ((24.6, -12.0, 8.70), (18.8, 0.0, 6.9), 0.0),
)
"""Where each photograph is taken from, what it is aimed at, how the camera is turned (degrees)."""


def simulate() -> dict[str, str]:
    """Files of the sample."""
    random = np.random.RandomState(2401)
    control = {name: np.array(xyz) for name, xyz in CONTROL.items()}
    details = _details(random)
    everything = {**control, **details}
    frames = _frames(random)
    normals = np.tile([0.0, -1.0, 0.0], (len(everything), 1))

    def visible(camera: Camera, frame: Frame) -> Mask:
        points = np.stack(list(everything.values()))
        seen = sees(camera, frame, points, normals, STEEPEST)
        for post in OBSTACLES:
            seen &= ~hidden_by_post(points, frame.position, post)
        return seen

    in_pixels = {name: TARGET_SIGMA if name in control else DETAIL_SIGMA for name in everything}
    sigma = np.array([in_pixels[name] * CAMERA.pixel for name in everything])
    images = {name: (CAMERA, frame) for name, frame in frames.items()}
    rays = with_enough_rays(measured(images, everything, visible, sigma, random), 3)
    seen = seen_points(rays, everything)
    rows = [
        [ray.image, ray.point, *numbers(pixels(CAMERA, ray.xy[None])[0], 2), f"{in_pixels[ray.point]:g}"]
        for ray in rays
    ]
    return {
        "control.csv": point_table(_noisy(control, CONTROL_SIGMA, random), 3),
        "tie_points.csv": point_table(_noisy({n: seen[n] for n in details if n in seen}, 0.05, random), 2),
        **_total_station(control),
        "images.csv": table(IMAGE_HEADER, _image_rows(frames, random)),
        "image_points.csv": table("image,point,x,y,sigma", rows),
        "truth/points.csv": point_table(seen, 6),
        "truth/images.csv": table(IMAGE_HEADER, [image_row(n, "D7", f, 6, DEGREE, 7) for n, f in frames.items()]),
        "truth/cameras.csv": camera_table({"D7": CAMERA}),
    }


def _total_station(control: Mapping[str, Array]) -> dict[str, str]:
    """Readings of the control points from two set-ups, with noise of their own."""
    random = np.random.RandomState(2410)
    directions, distances = [], []
    for name, (place, zero) in SETUPS.items():
        instrument = theodolite(np.array(place), 0.0, zero * GON)
        for point, xyz in control.items():
            reading = read(sight(instrument, xyz), READING, random)
            circles = numbers((reading.horizontal / GON, reading.zenith / GON), 4)
            directions.append([name, point, *circles])
            distances.append([name, point, number(reading.distance, 4)])
    return {
        "directions.csv": table("station,to,horizontal,zenith", directions),
        "distances.csv": table("from,to,distance", distances),
    }


def _details(random: np.random.RandomState) -> dict[str, Array]:
    """Natural details: on the wall, in the recessed windows, on balconies, on the cornice."""
    result = {}
    for letter, count, depth, low, high in (
        ("W", 68, 0.0, 0.5, 13.0),
        ("F", 28, 0.24, 1.5, 11.8),
        ("B", 14, -1.10, 4.9, 9.4),
        ("K", 12, -0.45, 13.2, 13.9),
    ):
        for number_ in range(1, count + 1):
            x = 0.3 + 23.4 * (number_ - 0.5 + 0.6 * random.uniform(-0.5, 0.5)) / count
            z = random.uniform(low, high)
            result[f"{letter}{number_:02d}"] = np.array([x, depth + 0.02 * random.standard_normal(), z])
    return result


def _frames(random: np.random.RandomState) -> dict[str, Frame]:
    result = {}
    for k, (position, target, roll) in enumerate(VIEWS):
        aimed = np.asarray(target) + 0.2 * random.standard_normal(3)
        result[f"IMG_{4711 + 3 * k}"] = look_at(position, aimed.tolist(), (roll + random.normal(0.0, 1.5)) * DEGREE)
    return result


def _noisy(points: Mapping[str, Array], sigma: float, random: np.random.RandomState) -> dict[str, Array]:
    return {name: xyz + sigma * random.standard_normal(3) for name, xyz in points.items()}


def _image_rows(frames: Mapping[str, Frame], random: np.random.RandomState) -> list[list[str]]:
    return [image_row(n, "D7", disturbed(f, random, 0.15, 1.0 * DEGREE), 2, DEGREE, 1) for n, f in frames.items()]
