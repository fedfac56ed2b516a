"""Blocks of images without calibration, and points far behind the object, with and without start values."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import numpy as np

from mor.api.pipeline import make_problem, read_document, read_network, solve_network
from mor.model.rotations import angles_from_rotation
from mor.project.network import Network
from mor.solve.iterate import SolverSettings, adjust

C, SIGMA = 30.0, 0.002


def far_points(seed: int, side: int, own: bool = True, given: bool = True, c: float = 29.0) -> dict[str, object]:
    """side² images from 45 m above and 12 points 500 to 3 000 m behind the object, as a project.

    ``own``: each image has a camera of its own; ``given``: poses and points start at the truth. Camera constants start
    at ``c``, 3 % off.
    """
    random = np.random.default_rng(seed)
    near = np.c_[random.uniform(-20.0, 20.0, (150, 2)), random.uniform(-4.0, 4.0, 150)]
    depth = random.uniform(500.0, 3000.0, 12)
    points = np.r_[near, np.c_[random.uniform(-0.2, 0.2, (12, 2)) * depth[:, None], -depth]]
    images, rays = [], []
    for k, (x, y) in enumerate(np.stack(np.meshgrid(*2 * [np.linspace(-24.0, 24.0, side)]), axis=-1).reshape(-1, 2)):
        centre = np.array([x, y, 45.0 + random.uniform(-4.0, 4.0)])
        back = centre - centre * (0.35, 0.35, 0.0) - random.normal(0.0, 1.0, 3)
        back /= np.linalg.norm(back)
        right = np.cross([0.0, 1.0, 0.1], back)
        right /= np.linalg.norm(right)
        turn = k % 4 * np.pi / 2.0
        D = np.stack([right, np.cross(back, right), back])
        D = np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]]) @ D
        pose = [*centre, *angles_from_rotation(D)] if given else []
        images.append([f"I{k}", f"K{k}" if own else "K0", *pose])
        star = (points - centre) @ D.T
        xy = -C * star[:, :2] / star[:, 2:]
        seen = np.flatnonzero((np.abs(xy) < (18.0, 12.0)).all(axis=1))
        xy += SIGMA * random.standard_normal(xy.shape) + (0.05, -0.08)
        rays += [[f"I{k}", f"P{j}", *xy[j]] for j in seen]
    count = Counter(name for _, name, *_ in rays)
    coordinates = [[f"P{j}", *(p if given else [])] for j, p in enumerate(points) if count[f"P{j}"] > 1]
    place, angles = (["x", "y", "z"], ["omega", "phi", "kappa"]) if given else ([], [])
    return {
        "mor": 1,
        "units": {"angle": "rad"},
        "cameras": {
            f"K{k}": {"r0": 10, "interior": {"c": {"free": c}, "xh": {"free": 0}, "yh": {"free": 0}}}
            for k in range(side**2 if own else 1)
        },
        "points": [{"columns": ["id", *place], "rows": coordinates}],
        "images": [{"columns": ["id", "camera", *place, *angles], "rows": images}],
        "observations": [
            {
                "type": "image",
                "columns": ["image", "point", "x", "y"],
                "rows": [ray for ray in rays if count[ray[1]] > 1],
                "values": {"sigma": f"{SIGMA} mm"},
            }
        ],
        "datum": "free",
    }


def far_trial(seed: int, side: int, own: bool, given: bool, folder: Path) -> str:
    """Adjust a block whose camera constants start 3 % off; empty where it ends at the minimum, else what became of it.

    The minimum is where plain least squares come to rest that begin at the truth, camera constants and all.
    """
    network = _network(far_points(seed, side, own, True, C), folder)
    truth = adjust(make_problem(network, network.start, network.start), network.start, SolverSettings(50))
    assert truth.outcome.is_solution
    solved = solve_network(_network(far_points(seed, side, own, given), folder))
    if solved.quality is None:
        return f"{solved.adjustment.outcome.value}: {solved.adjustment.reason}"
    if solved.network.undeterminable:
        return "; ".join(map(str, solved.network.undeterminable))
    objectives = solved.adjustment.normals.objective, truth.normals.objective
    return "" if abs(objectives[0] / objectives[1] - 1.0) < 1e-9 else f"another solution: {objectives}"


def _network(project: dict[str, object], folder: Path) -> Network:
    path = folder / "project.yaml"
    path.write_text(json.dumps(project))
    return read_network(read_document(path), folder)
