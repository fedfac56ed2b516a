"""A valley scanned from an aircraft by three lines, forward, downward and backward, on two strips to and fro."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from sample_projects.simulate.camera import Camera, image_of, in_axes
from sample_projects.simulate.files import camera_table, number, numbers, parameter_table, point_table, table
from sample_projects.simulate.geometry import DEGREE, Array, Frame, angles, rotation
from sample_projects.simulate.rays import seen_points, with_enough_rays

CAMERA = Camera(c=60.214, width=8000, height=1, pixel=0.0065, xh=0.012, radial=(-2.1e-5, 6.0e-9), r0=20.0)
LINES = {"forward": 27.3, "nadir": 0.4, "backward": -16.9}
"""y of the three lines, mm."""
LINE_TIME = 0.0015
"""Seconds."""
SPEED, FLYING_HEIGHT = 70.0, 1000.0
LENGTH, WIDTH = 1300.0, 1000.0
"""Metres of ground along the strips, and across both."""
SIGMA = 0.4
"""Pixels, and lines."""
EVERY = 0.5
"""Seconds from one row of GNSS and INS to the next."""
GNSS_SIGMA, INS_SIGMA = np.array([0.03, 0.03, 0.05]), np.array([0.004, 0.004, 0.008])
"""Metres and degrees."""
ARM = np.array([0.15, -0.92, 1.31])
"""From the camera to the antenna, in the axes of the camera, metres."""
BORESIGHT = np.array([0.081, -0.113, 0.204])
"""Degrees, from the camera to the inertial system."""
CLOCK = 0.025
"""Seconds by which the inertial system is late: what it says at t is the attitude at t + 25 ms."""
SHIFTS = {"east": np.array([0.21, -0.13, 0.34]), "west": np.array([-0.17, 0.08, 0.26])}
"""Metres by which GNSS is off on each strip."""
CONTROL_SIGMA = np.array([0.02, 0.02, 0.03])
CONTROL = {
    "C1": (60.0, 60.0),
    "C2": (1240.0, 80.0),
    "C3": (1230.0, 930.0),
    "C4": (70.0, 920.0),
    "C5": (640.0, 510.0),
}
CHECK = {"K1": (330.0, 270.0), "K2": (960.0, 300.0), "K3": (940.0, 760.0), "K4": (310.0, 740.0)}


class Strip(NamedTuple):
    """A flight: its first second, how long it takes, and the pose at any time."""

    first: float
    seconds: float
    pose: Callable[[float], Frame]


class LinePoint(NamedTuple):
    """A point in an image: column and line."""

    image: str
    point: str
    xy: Array


def simulate(seed: int = 1811) -> dict[str, str]:
    """Files of the sample."""
    random = np.random.RandomState(seed)
    control = {name: _ground(*place) for name, place in CONTROL.items()}
    check = {name: _ground(*place) for name, place in CHECK.items()}
    points = {**control, **check, **_tie_points(np.random.RandomState(31))}
    strips = _strips()
    rays = with_enough_rays(_measured(strips, points, random), 3)  # type: ignore[arg-type]
    seen = seen_points(rays, points)
    tie = {name: xyz for name, xyz in seen.items() if name.startswith("T")}
    observed = {n: p + CONTROL_SIGMA * random.standard_normal(3) for n, p in control.items()}
    return {
        "control.csv": point_table(observed, 3),
        "check_points.csv": point_table(check, 3),
        "points.csv": table("id", [[name] for name in (*check, *tie)]),
        "images.csv": table("id,camera,trajectory,time", _images(strips)),
        "image_points.csv": table("image,point,x,y", ([r.image, r.point, *numbers(r.xy, 2)] for r in rays)),
        "gnss_ins.csv": table("trajectory,time,x,y,z,omega,phi,kappa", _gnss_ins(strips, random)),
        "truth/points.csv": point_table(seen, 4),
        "truth/cameras.csv": camera_table(dict.fromkeys(LINES, CAMERA)),
        "truth/trajectory.csv": table("trajectory,time,x,y,z,omega,phi,kappa", _true_rows(strips)),
        "truth/parameters.csv": parameter_table(_parameters()),
    }


def _parameters() -> dict[tuple[str, str, str], float]:
    """The time offset and the shifts, in the units of the program."""
    result = {("time offset", "ins", "time_offset"): CLOCK}
    for name, shift in SHIFTS.items():
        for axis, value in zip("xyz", shift, strict=True):
            result["position shift", f"gnss strip {name}", f"shift_{axis}"] = float(value)
    return result


def _ground(east: float, north: float) -> Array:
    """A valley with a brook: 150 m deep, hills on both sides."""
    valley = 150.0 * np.tanh((north - 420.0) / 260.0) ** 2
    hills = 25.0 * np.sin(east / 170.0) * np.cos(north / 140.0)
    return np.array([4000.0 + east, 7000.0 + north, 380.0 + valley + hills])


def _tie_points(random: np.random.RandomState) -> dict[str, Array]:
    """Tie points scattered around a grid."""
    result = {}
    for column in range(14):
        for row in range(9):
            place = np.array([40.0 + 94.0 * column, 60.0 + 110.0 * row]) + random.uniform(-30.0, 30.0, 2)
            result[f"T{column + 1:02d}{row + 1:02d}"] = _ground(*place)
    return result


def _strips() -> dict[str, Strip]:
    """Eastwards over the south, back over the north, with gusts and sway of several periods."""
    ahead = FLYING_HEIGHT * LINES["forward"] / CAMERA.c + 190.0
    behind = FLYING_HEIGHT * -LINES["backward"] / CAMERA.c + 190.0
    seconds = float(np.ceil((LENGTH + ahead + behind) / SPEED))
    result = {}
    for k, (name, heading, north) in enumerate((("east", 0.0, 330.0), ("west", 180.0, 670.0))):
        random = np.random.RandomState(40 + k)
        first = 200_000.0 + 300.0 * k
        begin = -ahead if heading == 0.0 else LENGTH + ahead
        direction = 1.0 if heading == 0.0 else -1.0
        result[name] = Strip(first, seconds, _flight(random, first, (begin, north), heading, direction))
    return result


def _flight(
    random: np.random.RandomState, first: float, begin: tuple[float, float], heading: float, direction: float
) -> Callable[[float], Frame]:
    """Pose as a function of time: a straight course and sums of oscillations."""
    period = random.uniform(14.0, 40.0, (3, 6))
    phase = random.uniform(0.0, 2.0 * np.pi, (3, 6))
    size = np.array([1.5, 1.5, 1.2, 0.25, 0.25, 0.35])
    mean = np.array([0.2, -0.3, heading - 90.0]) + np.array([0.0, 0.0, 1.1])

    def pose(time: float) -> Frame:
        t = time - first
        swing = size * np.sin(2.0 * np.pi * t / period + phase).sum(axis=0)
        place = np.array([4000.0 + begin[0] + direction * SPEED * t, 7000.0 + begin[1], 450.0 + FLYING_HEIGHT])
        return Frame(place + swing[:3], rotation(*((mean + swing[3:]) * DEGREE)))

    return pose


def _scanned(strip: Strip, line: float, point: Array) -> tuple[float, float] | None:
    """Time and x (mm) at which a point crosses a line, by halving; ``None`` where it does not, or beside the line."""

    def ahead(time: float) -> tuple[float, float]:
        frame = strip.pose(time)
        x, y = image_of(CAMERA, in_axes(frame, point[None]))[0]
        return y - line, x

    early, late = strip.first, strip.first + strip.seconds
    if ahead(early)[0] < 0.0 or ahead(late)[0] > 0.0:
        return None
    for _ in range(45):
        middle = 0.5 * (early + late)
        early, late = (middle, late) if ahead(middle)[0] > 0.0 else (early, middle)
    x = ahead(early)[1]
    return (early, x) if abs(x) < CAMERA.half_format[0] - 0.1 else None


def _measured(
    strips: Mapping[str, Strip], points: Mapping[str, Array], random: np.random.RandomState
) -> list[LinePoint]:
    """Image points; every tenth one was not found, the same ones whatever the noise."""
    found = np.random.RandomState(32)
    result = []
    for name, strip in strips.items():
        for camera, line in LINES.items():
            for point, place in points.items():
                missed = found.uniform() < (0.1 if point.startswith("T") else 0.0)
                seen = _scanned(strip, line, place)
                if seen is None or missed:
                    continue
                column = CAMERA.width / 2.0 + seen[1] / CAMERA.pixel
                row = (seen[0] - strip.first) / LINE_TIME
                if not 5.0 < row < strip.seconds / LINE_TIME - 5.0:
                    continue
                xy = np.array([column, row]) + SIGMA * random.standard_normal(2)
                result.append(LinePoint(f"{camera} {name}", point, xy))
    return result


def _images(strips: Mapping[str, Strip]) -> list[list[str]]:
    return [
        [f"{camera} {name}", camera, name, number(strip.first, 4)] for name, strip in strips.items() for camera in LINES
    ]


def _gnss_ins(strips: Mapping[str, Strip], random: np.random.RandomState) -> list[list[str]]:
    """Antenna and inertial system, every half second."""
    rows = []
    for name, strip in strips.items():
        for time in np.arange(strip.first, strip.first + strip.seconds + EVERY / 2.0, EVERY):
            frame = strip.pose(time)
            antenna = frame.position + frame.D.T @ ARM + SHIFTS[name] + GNSS_SIGMA * random.standard_normal(3)
            body = rotation(*(BORESIGHT * DEGREE)) @ strip.pose(time + CLOCK).D
            attitude = angles(body) / DEGREE + INS_SIGMA * random.standard_normal(3)
            rows.append([name, number(time, 4), *numbers(antenna, 3), *numbers(attitude, 4)])
    return rows


def _true_rows(strips: Mapping[str, Strip]) -> list[list[str]]:
    return [
        [name, number(time, 4), *numbers(frame.position, 4), *numbers(angles(frame.D) / DEGREE, 6)]
        for name, strip in strips.items()
        for time in np.arange(strip.first, strip.first + strip.seconds + 0.5, 1.0)
        for frame in [strip.pose(time)]
    ]
