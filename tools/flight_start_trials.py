"""``python -m tools.flight_start_trials --count 50``: how often strips are adjusted that start from points alone.

Two strips there and back, of three lines or of images, at any heading, with sway, over hills; control points and tie
points are seen, and of the flight nothing is known, or its positions or attitudes alone. A trial has worked where the
adjustment converges to the solution that the truth leads to: vᵀPv within a thousandth.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

import mor
from mor.api.pipeline import determinable_start, make_problem
from mor.errors import MorError
from mor.linalg.compilation import chosen_by_size
from mor.project.network import Network
from mor.project.planned_network import with_image_poses
from mor.solve.iterate import Outcome, adjust
from sample_projects.simulate.geometry import DEGREE, Array, angles, rotation

KINDS = ("lines", "lines, GNSS", "lines, INS", "images", "images, GNSS")
C, PIXEL, WIDTH, LINE_TIME = 60.0, 0.0065, 8000, 0.0015
LINES = {"forward": 27.0, "nadir": 0.5, "backward": -17.0}
IMAGE_HEIGHT, EVERY = 6000, 4.0
"""Rows of a frame image, and seconds from one to the next."""
SIGMA = 0.4
LENGTH, WIDTH_OF_ALL, APART = 1500.0, 900.0, 340.0
SAME = 1e-3
"""Part of vᵀPv by which solutions may differ."""


class Strip(NamedTuple):
    """A flight that sways."""

    begin: Array
    velocity: Array
    mean: Array
    size: Array
    period: Array
    phase: Array
    seconds: float

    def pose(self, time: Array) -> tuple[Array, Array]:
        """X0 (n, 3) and D (n, 3, 3)."""
        swing = self.size * np.sin(2.0 * np.pi * time[:, None, None] / self.period + self.phase).sum(axis=1)
        place = self.begin + time[:, None] * self.velocity + swing[:, :3]
        return place, np.stack([rotation(*row) for row in (self.mean + swing[:, 3:]) * DEGREE])

    def seen(self, time: Array, points: Array) -> Array:
        """(n, 2) mm."""
        place, D = self.pose(time)
        star = np.einsum("nij,nj->ni", D, points - place)
        return -C * star[:, :2] / star[:, 2:]


def flown(kind: str, seed: int) -> tuple[dict[str, Any], list[Strip], dict[str, Array]]:
    """A project, its flights, and the true places of its points."""
    random = np.random.default_rng(seed)
    heading = random.uniform(0.0, 360.0)
    turn = rotation(0.0, 0.0, heading * DEGREE)[:2, :2].T  # from along and across to east and north
    points = {f"T{k}": xy for k, xy in enumerate(random.uniform((0, 0), (LENGTH, WIDTH_OF_ALL), (160, 2)))}
    control = random.uniform((0.05, 0.05), (0.95, 0.95), (int(random.integers(5, 9)), 2))
    points |= {f"C{k}": xy for k, xy in enumerate(control * (LENGTH, WIDTH_OF_ALL))}
    hills = random.uniform(5.0, 60.0), random.uniform(200.0, 500.0)
    truth = {
        name: np.array([*(turn @ xy), 300.0 + hills[0] * np.sin(xy[0] / hills[1]) * np.cos(xy[1] / hills[1])])
        for name, xy in points.items()
    }
    flying, speed = random.uniform(900.0, 1100.0), random.uniform(50.0, 80.0)
    strips = [_strip(random, turn, heading, flying, speed, back) for back in (False, True)]
    images, rows = [], []
    for number, strip in enumerate(strips):
        taken = (
            _lines(strip, number, truth, random) if kind.startswith("lines") else _images(strip, number, truth, random)
        )
        images += taken[0]
        rows += taken[1]
    kept = {name for name in truth if name[0] == "C" or sum(row[1] == name for row in rows) > 2}
    rows = [row for row in rows if row[1] in kept]
    truth = {name: truth[name] for name in truth if name in kept}
    return _project(kind, strips, images, rows, truth, random), strips, truth


def _strip(random: np.random.Generator, turn: Array, heading: float, flying: float, speed: float, back: bool) -> Strip:
    ahead, behind = (flying * abs(LINES[name]) / C + 150.0 for name in ("forward", "backward"))
    along = LENGTH + behind if back else -ahead
    if back:
        along = LENGTH + ahead
    direction = -1.0 if back else 1.0
    across = WIDTH_OF_ALL / 2.0 + (APART if back else -APART) / 2.0
    begin = np.array([*(turn @ (along, across)), 300.0 + flying])
    velocity = direction * speed * np.array([*turn[:, 0], 0.0])
    mean = np.array([*random.normal(0.0, 1.0, 2), heading - 90.0 + (180.0 if back else 0.0) + random.normal(0.0, 2.0)])
    size = np.array([1.5, 1.5, 1.2, 0.3, 0.3, 0.4])
    period, phase = random.uniform(15.0, 40.0, (2, 6)), random.uniform(0.0, 2.0 * np.pi, (2, 6))
    return Strip(begin, velocity, mean, size, period, phase, (LENGTH + ahead + behind) / speed)


def _lines(
    strip: Strip, number: int, truth: dict[str, Array], random: np.random.Generator
) -> tuple[list[list[Any]], list[list[Any]]]:
    """Images and image points of three lines, by halving the time."""
    images, rows = [], []
    places = np.stack(list(truth.values()))
    for camera, line in LINES.items():
        early, late = np.zeros(len(places)), np.full(len(places), strip.seconds)
        for _ in range(40):
            time = 0.5 * (early + late)
            passed = strip.seen(time, places)[:, 1] < line
            early, late = np.where(passed, early, time), np.where(passed, time, late)
        x = strip.seen(early, places)[:, 0]
        good = (np.abs(x) < 25.5) & (early > 0.1) & (early < strip.seconds - 0.1) & (random.random(len(x)) < 0.9)
        images.append([f"{camera} {number}", camera, f"S{number}", 0.0])
        for name, column, t, seen in zip(truth, x / PIXEL + WIDTH / 2.0, early / LINE_TIME, good, strict=True):
            if seen:
                noise = SIGMA * random.standard_normal(2)
                rows.append([f"{camera} {number}", name, column + noise[0], t + noise[1]])
    return images, rows


def _images(
    strip: Strip, number: int, truth: dict[str, Array], random: np.random.Generator
) -> tuple[list[list[Any]], list[list[Any]]]:
    """Frame images at times and their image points."""
    images, rows = [], []
    places = np.stack(list(truth.values()))
    for k, time in enumerate(np.arange(0.2, strip.seconds - 0.2, EVERY).tolist()):
        xy = strip.seen(np.full(len(places), time), places)
        good = (np.abs(xy[:, 0]) < 25.5) & (np.abs(xy[:, 1]) < IMAGE_HEIGHT * PIXEL / 2.0 - 0.5)
        images.append([f"I{number}.{k}", "frame", f"S{number}", time])
        for name, (x, y), seen in zip(truth, xy, good, strict=True):
            if seen:
                noise = SIGMA * random.standard_normal(2)
                rows.append(
                    [
                        f"I{number}.{k}",
                        name,
                        x / PIXEL + WIDTH / 2.0 + noise[0],
                        IMAGE_HEIGHT / 2.0 - y / PIXEL + noise[1],
                    ]
                )
    return images, rows


def _project(
    kind: str,
    strips: list[Strip],
    images: list[list[Any]],
    rows: list[list[Any]],
    truth: dict[str, Array],
    random: np.random.Generator,
) -> dict[str, Any]:
    """The project as a user would write it."""
    camera = {"coordinates": "corner", "interior": {"c": C}}
    cameras: dict[str, Any] = {
        name: camera | {"image": {"width": WIDTH, "height": 1, "pixel": "6.5 um"}, "line_time": "1.5 ms", "line": line}
        for name, line in LINES.items()
    }
    if kind.startswith("images"):
        cameras = {"frame": camera | {"image": {"width": WIDTH, "height": IMAGE_HEIGHT, "pixel": "6.5 um"}}}
    control = [[name, *(xyz + 0.03 * random.standard_normal(3)), 0.03] for name, xyz in truth.items() if name[0] == "C"]
    observations = [
        {"type": "image", "columns": ["image", "point", "x", "y"], "rows": rows, "values": {"sigma": SIGMA}}
    ]
    of_flight = {
        "GNSS": ("trajectory_position", ("x", "y", "z"), 0.05),
        "INS": ("trajectory_attitude", ("omega", "phi", "kappa"), 0.01),
    }
    system = kind.partition(", ")[2]
    if system:
        type_, names, sigma = of_flight[system]
        table = []
        for k, strip in enumerate(strips):
            times = np.arange(0.0, strip.seconds, 1.0)
            place, D = strip.pose(times)
            values = place if system == "GNSS" else np.stack([angles(one) for one in D]) / DEGREE
            table += [
                [f"S{k}", t, *(row + sigma * random.standard_normal(3))] for t, row in zip(times, values, strict=True)
            ]
        observations.append(
            {
                "type": type_,
                "columns": ["trajectory", "time", *names],
                "rows": table,
                "values": {"sigma": sigma},
            }
        )
    knots = [[f"S{k}", t] for k, strip in enumerate(strips) for t in (0.0, strip.seconds)]
    steady = {"position": "0.1 m/s^2", "attitude": "0.03 deg/s^2"}
    return {
        "mor": 1,
        "units": {"length": "m", "angle": "deg"},
        "cameras": cameras,
        "trajectories": [
            {
                "columns": ["trajectory", "time"],
                "rows": knots,
                "spacing": "2 s",
                "interpolation": "cubic",
                "smoothness": steady,
            }
        ],
        "images": [{"columns": ["id", "camera", "trajectory", "time"], "rows": images}],
        "points": [
            {"columns": ["id", "x", "y", "z", "sigma"], "rows": control},
            {"columns": ["id"], "rows": [[name] for name in truth if name[0] == "T"]},
        ],
        "observations": observations,
    }


def said(kind: str, seed: int) -> str:
    """What became of a trial; empty where it worked."""
    data, strips, truth = flown(kind, seed)
    network = mor.read(data).network
    with chosen_by_size(network.observations), np.errstate(all="ignore"):
        try:
            started, start = determinable_start(network)
        except MorError as error:
            return f"{type(error).__name__}: {str(error)[:150]}"
        found = adjust(make_problem(started, start, start), start)
        if found.outcome is not Outcome.CONVERGED:
            return f"{found.outcome.value}: {found.reason[:150]}"
        start = _at_truth(network, start, strips, truth)
        best = adjust(make_problem(started, start, start), start)
    one, other = found.normals.objective, best.normals.objective
    return "" if abs(one - other) < SAME * other else f"another solution: {one:.1f} in place of {other:.1f}"


def _at_truth(
    network: Network, start: Mapping[str, Array], strips: list[Strip], truth: dict[str, Array]
) -> dict[str, Array]:
    """Start values: the true knots and points."""
    point, turns = start["point"].copy(), start["rotation"].copy()
    for trajectory, strip in zip(network.trajectories.values(), strips, strict=True):
        point[trajectory.positions], turns[trajectory.rotations] = strip.pose(trajectory.times)
    for number, name in enumerate(network.blocks["point"].ids):
        if name in truth:
            point[number] = truth[name]
    return with_image_poses(network, {**start, "point": point, "rotation": turns})


def main() -> None:
    """Print a line for each kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--kinds", nargs="*", default=KINDS)
    chosen = parser.parse_args()
    for kind in chosen.kinds:
        failed = {seed: words for seed in range(chosen.count) if (words := said(kind, seed))}
        print(f"{kind:14s} {chosen.count - len(failed)} of {chosen.count}", flush=True)
        for seed, words in failed.items():
            print(f"    {seed}: {words}", flush=True)


if __name__ == "__main__":
    main()
