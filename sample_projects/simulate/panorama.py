"""Panoramas in a church: four turns of a line camera among targets on walls and vault, some of them known."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from sample_projects.simulate.files import number, numbers, point_table, table
from sample_projects.simulate.geometry import GON, Array, Frame, rotation

WIDTH, HEIGHT = 22_000, 5_200
"""px."""
CAMERA = {
    "c": 3489.4,
    "yh": -14.2,
    "rate": 1.9e-4,
    "ahead": 0.0234,
    "aside": -0.0061,
    "lean": 6.1e-4,
    "pitch": -0.0021,
    "A1": -2.1e-9,
    "a1": 1.6e-4,
    "b1": -0.9e-4,
}
"""What the project estimates; all else is nothing."""
STATIONS = {
    "nave": (np.array([-6.0, 0.6, 1.62]), 37.0, (0.21, -0.34)),
    "crossing": (np.array([7.5, -0.8, 1.58]), 215.0, (-0.42, 0.11)),
    "aisle": (np.array([-12.5, -3.2, 1.6]), 122.0, (0.37, 0.29)),
    "choir": (np.array([14.0, 1.4, 1.66]), 318.0, (0.15, 0.48)),
}
"""Rotation centre, bearing of the middle of the panorama (gon), lean of the axis (gon)."""
SIGMA = 0.3
CONTROL = 0.0008
KNOWN = 20
"""Targets that a total station has measured."""


def targets(random: np.random.RandomState) -> dict[str, Array]:
    """Targets on the walls, in the vault and on the floor of a nave of 36 × 14 m, 12 m high."""
    points = []
    for _ in range(110):
        side, x, up = random.randint(4), random.uniform(-16.0, 19.0), random.uniform(0.4, 9.0)
        across = float(random.uniform(-6.0, 6.0))
        points.append(
            (
                np.array([x, 7.0, up]),
                np.array([x, -7.0, up]),
                np.array([19.5 if x > 0 else -16.5, across, up]),
                np.array([x, across, 12.0 - 0.09 * across**2]),
            )[side]
        )
    return {f"{k + 1:03d}": point for k, point in enumerate(points)}


def image_of(frame: Frame, point: Array) -> Array | None:
    """Image (px from the middle, y up) of a point: the turn at which it stands in the line, found by search."""
    v, star = CAMERA, frame.D @ (point - frame.position)

    def in_line(turn: float) -> Array:
        sight = np.array([np.sin(turn), 0.0, -np.cos(turn)])
        right = np.array([np.cos(turn), 0.0, np.sin(turn)])
        apart = star - v["ahead"] * sight - v["aside"] * right
        return np.array([apart @ right, apart[1], apart @ sight])

    middle = float(np.arctan2(star[0], -star[2]))
    turn = brentq(lambda a: in_line(a)[0] - v["lean"] * in_line(a)[1], middle - 0.4, middle + 0.4, xtol=1e-14)
    turn = (turn + np.pi) % (2.0 * np.pi) - np.pi
    _, up, depth = in_line(turn)
    y = v["c"] * np.tan(np.arctan2(up, depth) - v["pitch"])
    x = v["c"] * (1.0 + v["rate"]) * (turn + v["a1"] * np.sin(turn) + v["b1"] * np.cos(turn))
    xy = np.array([x, v["yh"] + y * (1.0 + v["A1"] * y**2)])
    return xy if abs(xy[1]) < HEIGHT / 2.0 - 20 else None


def simulate(seed: int = 2422) -> dict[str, str]:
    """Files of the sample; another seed gives other errors of the same measurements."""
    layout, random = np.random.RandomState(2421), np.random.RandomState(seed)
    points = targets(layout)
    rows = []
    for name, (place, bearing, lean) in STATIONS.items():
        upright = rotation(*(np.array(lean) * GON), 0.0) @ rotation(0.5 * np.pi, 0.0, 0.0)
        frame = Frame(place, upright @ rotation(0.0, 0.0, -bearing * GON))
        for target, point in points.items():
            xy = image_of(frame, point)
            if xy is not None and layout.uniform() > 0.1:
                pixel = np.array([WIDTH / 2.0 + xy[0], HEIGHT / 2.0 - xy[1]]) + SIGMA * random.standard_normal(2)
                rows.append([name, target, *numbers(pixel, 2)])
    counts = {target: sum(row[1] == target for row in rows) for target in points}
    rows = [row for row in rows if counts[row[1]] > 1]
    seen = {target: point for target, point in points.items() if counts[target] > 1}
    known = dict(list(seen.items())[:KNOWN])
    measured = {name: point + CONTROL * random.standard_normal(3) for name, point in known.items()}
    parts = [["C1", part, f"{value:.9g}"] for part, value in CAMERA.items()]
    return {
        "control.csv": point_table(measured, 4),
        "targets.csv": table("id", ([name] for name in seen if name not in known)),
        "image_points.csv": table("image,point,x,y", rows),
        "truth/points.csv": point_table(seen, 5),
        "truth/images.csv": table("id,x,y,z", ([n, *(number(v, 4) for v in p)] for n, (p, _, _) in STATIONS.items())),
        "truth/cameras.csv": table("camera,component,value", parts),
    }
