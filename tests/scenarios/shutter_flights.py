"""Flights of a drone with a rolling shutter along trajectories, simulated by code of their own.

Between knots half a second apart positions go straight and attitudes turn steadily (``scipy.spatial``), or both are
cubic convolutions (Keys 1981). Many images are taken near a knot, so that a part of their rows is read out in the next
interval. Rows and times are found in turn, as ``sample_projects.simulate.rolling_shutter`` does it.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parents[2]
from sample_projects.simulate.camera import in_axes, inside  # noqa: E402
from sample_projects.simulate.drone_block import CAMERA, SIGMA, _ground  # noqa: E402
from sample_projects.simulate.geometry import DEGREE, Array, Frame, angles  # noqa: E402
from sample_projects.simulate.rolling_shutter import seen_by_row  # noqa: E402

READOUT, SPACING, SECONDS, MARGIN = 0.030, 0.5, 11.0, 1.0
SPEED, APART, HEIGHT = 9.0, 24.0, 192.0
POSITION_SIGMA, ATTITUDE_SIGMA, CONTROL_SIGMA = 0.02, 0.05, 0.01
"""Metres of satellites and of control points, degrees of the inertial system."""


class Flight(NamedTuple):
    """Knots of a strip at regular times from ``begin`` on."""

    begin: float
    places: Array
    turns: Rotation
    """From the axes of the camera to the object system."""
    cubic: bool

    def at(self, time: float) -> Frame:
        """The pose at a time; beyond the last knots their interval goes on."""
        passed = (time - self.begin) / SPACING
        k = min(max(int(np.floor(passed)), 0), len(self.places) - 2)
        u = passed - k
        if self.cubic:
            near, weights = np.arange(k - 1, k + 3), _keys(u)
        else:
            near, weights = np.arange(k, k + 2), np.array([1.0 - u, u])
        vectors = (self.turns[k].inv() * self.turns[near]).as_rotvec()
        turn = self.turns[k] * Rotation.from_rotvec(weights @ vectors)
        return Frame(weights @ self.places[near], turn.as_matrix().T)


def _keys(u: float) -> Array:
    return np.array(
        [
            -0.5 * u**3 + u**2 - 0.5 * u,
            1.5 * u**3 - 2.5 * u**2 + 1.0,
            -1.5 * u**3 + 2.0 * u**2 + 0.5 * u,
            0.5 * u**3 - 0.5 * u**2,
        ]
    )


class Moment(NamedTuple):
    """A flight from a time on."""

    flight: Flight
    middle: float

    def at(self, time: float) -> Frame:
        """The pose so much later."""
        return self.flight.at(self.middle + time)


def flights(cubic: bool, strips: int) -> dict[str, Flight]:
    """Strips to and fro that sway by half a metre and some degrees."""
    random = np.random.default_rng(17)
    found = {}
    for k in range(strips):
        time = np.arange(-MARGIN, SECONDS + MARGIN + 0.01, SPACING)
        forth = 1.0 if k % 2 == 0 else -1.0
        begin = 500.0 if k % 2 == 0 else 500.0 + SPEED * SECONDS
        swing = np.sum(
            random.normal(0.0, 1.0, (1, 2, 6))
            * np.sin(2.0 * np.pi * time[:, None, None] / random.uniform(2.0, 5.0, (1, 2, 6)) + k),
            axis=1,
        )
        along = begin + forth * SPEED * time
        across = np.full(len(time), 800.0 + APART * k)
        places = np.stack([along, across, np.full(len(time), HEIGHT)], axis=1) + 0.4 * swing[:, :3]
        tilts = 2.0 * swing[:, 3:] + np.array([0.0, 0.0, -90.0 * forth])
        found[f"strip {k + 1}"] = Flight(
            1000.0 * k - MARGIN, places, Rotation.from_euler("XYZ", tilts, degrees=True), cubic
        )
    return found


def _hovering(flight: Flight) -> Flight:
    """The same where all knots are the one in the middle."""
    same = np.full(len(flight.places), len(flight.places) // 2)
    return flight._replace(places=flight.places[same], turns=flight.turns[same])


def moments(found: Mapping[str, Flight]) -> dict[str, tuple[str, float]]:
    """Trajectory and time of each image: every second image is within its readout of a knot."""
    random = np.random.default_rng(18)
    return {
        f"{strip[-1]}_{k:02d}": (
            strip,
            flight.begin
            + MARGIN
            + 1.0 * k
            + (random.uniform(-0.012, 0.012) if k % 2 == 0 else random.uniform(0.1, 0.4)),
        )
        for strip, flight in found.items()
        for k in range(12)
    }


def ground() -> dict[str, Array]:
    """Control points C…, check points K… and tie points T…."""
    random = np.random.default_rng(19)
    places = {f"T{k:03d}": random.uniform((-15.0, -20.0), (115.0, 70.0)) for k in range(170)}
    corners = [(-8.0, -12.0), (105.0, -10.0), (104.0, 60.0), (-6.0, 58.0), (50.0, 24.0)]
    places |= {f"C{k}": np.array(place) for k, place in enumerate(corners, start=1)}
    return {name: np.array(_ground(*place)) for name, place in places.items()}


class Files(NamedTuple):
    """Files of a project, and what is true."""

    files: dict[str, str]
    points: dict[str, Array]
    flights: dict[str, Flight]


def _flown(cubic: bool, strips: int, still: bool) -> dict[str, Flight]:
    found = flights(cubic, strips)
    return {name: _hovering(flight) for name, flight in found.items()} if still else found


@cache
def _without_errors(cubic: bool, strips: int, true: float, still: bool) -> list[tuple[str, str, Array]]:
    """Image, point and image coordinates (2,) of all that is seen."""
    found, points = _flown(cubic, strips, still), ground()
    names, coordinates = list(points), np.stack(list(points.values()))
    rays = []
    for image, (strip, time) in moments(found).items():
        moment = Moment(found[strip], time)
        visible = inside(CAMERA, in_axes(moment.at(0.0), coordinates), border=60.0)
        for k in np.flatnonzero(visible):
            seen = seen_by_row(CAMERA, moment, coordinates[k], true)  # type: ignore[arg-type]
            rays.append((image, names[k], seen))
    return rays


@cache
def simulated(
    seed: int,
    cubic: bool = False,
    readout: str = "{free: 20 ms}",
    strips: int = 3,
    true: float = READOUT,
    still: bool = False,
) -> Files:
    """A project and its truth; the noise is that of a seed, none of seed 0.

    ``readout`` is what the project says of the readout time, ``true`` how long it is; ``still`` flights hover.
    """
    random, noise = np.random.default_rng(seed), 0.0 if seed == 0 else 1.0
    found, taken, points = _flown(cubic, strips, still), moments(flights(cubic, strips)), ground()
    rays = ["image,point,x,y"]
    half = np.array([CAMERA.width, CAMERA.height]) / 2.0
    often = dict.fromkeys(points, 0)
    for image, name, exact in _without_errors(cubic, strips, true, still):
        xy = exact + noise * SIGMA * random.standard_normal(2)
        column, row = half + xy / CAMERA.pixel * np.array([1.0, -1.0])
        rays.append(f"{image},{name},{column:.9f},{row:.9f}")
        often[name] += 1
    seen = {name: place for name, place in points.items() if often[name] > 2}
    rays = [rays[0], *(ray for ray in rays[1:] if ray.split(",")[1] in seen)]
    knots = ["trajectory,time,x,y,z,omega,phi,kappa"]
    for strip, flight in found.items():
        for k, (place, turn) in enumerate(zip(flight.places, flight.turns, strict=True)):
            measured = place + noise * POSITION_SIGMA * random.standard_normal(3)
            told = angles(turn.as_matrix().T) / DEGREE + noise * ATTITUDE_SIGMA * random.standard_normal(3)
            values = ",".join(f"{value:.12f}" for value in (*measured, *told))
            knots.append(f"{strip},{flight.begin + SPACING * k:.6f},{values}")
    control = ["id,x,y,z"]
    for name, place in seen.items():
        if name.startswith("C"):
            values = place + noise * CONTROL_SIGMA * random.standard_normal(3)
            control.append(",".join([name, *(f"{value:.12f}" for value in values)]))
    images = [
        "id,camera,trajectory,time",
        *(f"{i},drone,{strip},{time:.9f}" for i, (strip, time) in taken.items()),
    ]
    files = {"control.csv": control, "knots.csv": knots, "images.csv": images, "image_points.csv": rays}
    files["points.csv"] = ["id", *(name for name in seen if not name.startswith("C"))]
    texts = {name: "\n".join(lines) + "\n" for name, lines in files.items()}
    text = PROJECT.replace("READOUT", readout).replace("CURVE", "cubic" if cubic else "linear")
    return Files({**texts, "project.yaml": text}, seen, found)


PROJECT = """mor: 1
units: {length: m, angle: deg}
cameras:
  drone:
    image: {width: 5472, height: 3648, pixel: 2.4 um}
    coordinates: corner
    r0: 5
    readout: READOUT
    readout_direction: down
    interior: {c: {free: 8.8}, xh: {free: 0}, yh: {free: 0}, A1: {free: 0}, A2: {free: 0}}
trajectories:
  - file: knots.csv
    interpolation: CURVE
    values: {sigma_x: 0.02, sigma_y: 0.02, sigma_z: 0.02, sigma_omega: 0.05, sigma_phi: 0.05, sigma_kappa: 0.05}
images:
  - file: images.csv
points:
  - {file: control.csv, values: {sigma: 0.01}}
  - file: points.csv
observations:
  - {type: image, name: image points, file: image_points.csv, values: {sigma: 0.4}}
"""
