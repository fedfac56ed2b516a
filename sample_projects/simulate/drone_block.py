"""A quarry flown by a drone whose camera has a rolling shutter: 30 ms from the first row to the last, at 9 m/s."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sample_projects.simulate.camera import Camera, in_axes, inside
from sample_projects.simulate.files import camera_table, numbers, parameter_table, point_table, table
from sample_projects.simulate.geometry import DEGREE, Array, Frame, angles, rotation
from sample_projects.simulate.rays import ImagePoint, seen_points, with_enough_rays
from sample_projects.simulate.rolling_shutter import Flight, seen_by_row

CAMERA = Camera(
    c=8.7712, width=5472, height=3648, pixel=0.0024, xh=0.0183, yh=-0.0094, radial=(-6.1e-4, 4.3e-6), r0=5.0
)
READOUT = 0.030
"""Seconds."""
FLYING_HEIGHT, SPEED = 62.0, 9.0
BASE, STRIP_DISTANCE = 12.0, 24.0
SIGMA = 0.00096
"""mm in the image, 0.4 pixels."""
GNSS_SIGMA = np.array([0.02, 0.02, 0.03])
CONTROL_SIGMA = np.array([0.01, 0.01, 0.015])
SPEED_SIGMA, RATE_SIGMA = 0.3, 0.3
"""m/s of the velocities of the flight log, and degrees per second of the gyroscopes of the gimbal."""
GUST = 0.5
"""m/s by which the drone is faster or slower than planned, and drifts."""
SWAY = 4.0
"""Degrees per second at which the gimbal turns."""

CONTROL = {
    "C1": (-16.0, -14.0),
    "C2": (94.0, -12.0),
    "C3": (90.0, 58.0),
    "C4": (-15.0, 62.0),
    "C5": (41.0, 25.0),
}
CHECK = {"K1": (12.0, 8.0), "K2": (70.0, 10.0), "K3": (72.0, 44.0), "K4": (10.0, 42.0), "K5": (44.0, -6.0)}


def simulate(seed: int = 1703) -> dict[str, str]:
    """Files of the sample."""
    random = np.random.RandomState(seed)
    control = {name: _ground(*place) for name, place in CONTROL.items()}
    check = {name: _ground(*place) for name, place in CHECK.items()}
    points = {**control, **check, **_tie_points(np.random.RandomState(88))}
    flights = _flights(np.random.RandomState(89))
    rays = with_enough_rays(_measured(flights, points, random), 3)
    seen = seen_points(rays, points)
    tie = {name: xyz for name, xyz in seen.items() if name.startswith("T")}
    observed = {n: p + CONTROL_SIGMA * random.standard_normal(3) for n, p in control.items()}
    return {
        "control.csv": point_table(observed, 3),
        "check_points.csv": point_table(check, 3),
        "points.csv": table("id", [[name] for name in (*check, *tie)]),
        "images.csv": table(_HEADER, _image_rows(flights, random)),
        "image_points.csv": table("image,point,x,y", ([r.image, r.point, *_pixels(r)] for r in rays)),
        "truth/points.csv": point_table(seen, 4),
        "truth/images.csv": table(_HEADER, _true_rows(flights)),
        "truth/cameras.csv": camera_table({"drone": CAMERA}),
        "truth/parameters.csv": parameter_table({("readout", "camera drone", "readout"): READOUT}),
    }


_HEADER = "id,camera,x,y,z,omega,phi,kappa,vx,vy,vz,rate_x,rate_y,rate_z"


def _ground(east: float, north: float) -> Array:
    """A place in the quarry: benches of five metres, and the floor below."""
    bench = 5.0 * np.tanh((east - 20.0) / 3.0) + 5.0 * np.tanh((east + north - 90.0) / 4.0)
    return np.array([500.0 + east, 800.0 + north, 130.0 + bench + 0.8 * np.sin(east / 9.0) * np.cos(north / 7.0)])


def _tie_points(random: np.random.RandomState) -> dict[str, Array]:
    """Tie points scattered around a grid over the quarry."""
    result = {}
    for column in range(15):
        for row in range(11):
            place = np.array([-22.0 + 9.0 * column, -22.0 + 9.0 * row]) + random.uniform(-3.0, 3.0, 2)
            result[f"T{column + 1:02d}{row + 1:02d}"] = _ground(*place)
    return result


def _flights(random: np.random.RandomState) -> dict[str, Flight]:
    """Three strips to and fro, and one across; the top of the image points in flight direction."""
    places = [
        (
            strip + 1,
            k + 1,
            (BASE * (k if strip % 2 == 0 else 7 - k), STRIP_DISTANCE * strip),
            (-90.0, 90.0)[strip % 2],
        )
        for strip in range(3)
        for k in range(8)
    ]
    places += [(4, k + 1, (42.0, -6.0 + BASE * k), 0.0) for k in range(6)]
    result = {}
    for strip, number, place, heading in places:
        wobble = random.normal(0.0, 1.0, 3) * np.array([2.0, 2.0, 3.0]) + np.array([0.0, 0.0, heading])
        centre = np.array([500.0 + place[0], 800.0 + place[1], 130.0 + FLYING_HEIGHT]) + random.normal(0.0, 0.8, 3)
        velocity = np.array([0.0, SPEED, 0.0]) + GUST * random.standard_normal(3)
        rate = SWAY * DEGREE * random.standard_normal(3)
        result[f"{strip}_{number:02d}"] = Flight(Frame(centre, rotation(*(wobble * DEGREE))), velocity, rate)
    return result


def _measured(
    flights: Mapping[str, Flight], points: Mapping[str, Array], random: np.random.RandomState
) -> list[ImagePoint]:
    """Image points, 0.4 px of noise; every tenth one was not found, the same ones whatever the noise."""
    names, coordinates = list(points), np.stack(list(points.values()))
    found = np.random.RandomState(90)
    result = []
    for image, flight in flights.items():
        missed = found.uniform(size=len(names)) < np.array([0.1 if n.startswith("T") else 0.0 for n in names])
        visible = inside(CAMERA, in_axes(flight.frame, coordinates), border=60.0) & ~missed
        for k in np.flatnonzero(visible):
            xy = seen_by_row(CAMERA, flight, coordinates[k], READOUT) + SIGMA * random.standard_normal(2)
            result.append(ImagePoint(image, names[k], xy))
    return result


def _pixels(ray: ImagePoint) -> list[str]:
    half = np.array([CAMERA.width, CAMERA.height]) / 2.0
    return numbers(half + ray.xy / CAMERA.pixel * np.array([1.0, -1.0]), 3)


def _image_rows(flights: Mapping[str, Flight], random: np.random.RandomState) -> list[list[str]]:
    """Positions by GNSS, velocities and rates of the flight log turned into the image; angles to whole degrees."""
    rows = []
    for name, flight in flights.items():
        place = flight.frame.position + GNSS_SIGMA * random.standard_normal(3)
        velocity = flight.velocity + SPEED_SIGMA * random.standard_normal(3)
        rate = flight.rate / DEGREE + RATE_SIGMA * random.standard_normal(3)
        turn = angles(flight.frame.D) / DEGREE
        rows.append([name, "drone", *numbers(place, 3), *numbers(turn, 0), *numbers(velocity, 2), *numbers(rate, 2)])
    return rows


def _true_rows(flights: Mapping[str, Flight]) -> list[list[str]]:
    return [
        [
            name,
            "drone",
            *numbers(flight.frame.position, 4),
            *numbers(angles(flight.frame.D) / DEGREE, 6),
            *numbers(flight.velocity, 4),
            *numbers(flight.rate / DEGREE, 4),
        ]
        for name, flight in flights.items()
    ]
