"""Few images of few points, seeded, with nothing given: two images share seven points or fewer, often five."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from mor.model.rotations import angles_from_rotation

C = 30.0
SIGMA = 0.003


def few_points(seed: int, folder: Path) -> tuple[Path, Path]:
    """Write a block of 3 to 6 images and 7 to 11 points; its projects with nothing given, and with the truth.

    A third of the objects are plane. Two of three blocks have three control points, the others are free networks.
    """
    random = np.random.default_rng([7, seed])
    images, points = int(random.integers(3, 7)), int(random.integers(7, 12))
    plane, share = random.random() < 0.3, random.uniform(0.6, 0.9)
    X = random.uniform(-1.0, 1.0, (points, 3)) * [5.0, 5.0, 0.0 if plane else 3.0]
    control = random.choice(points, 3 if random.random() < 2.0 / 3.0 else 0, replace=False).tolist()
    poses, rays = [], []
    for k in range(images):
        around, up = random.uniform(-0.8, 0.8), random.uniform(0.5, 1.3)
        z = np.array([np.cos(up) * np.sin(around), -np.cos(up) * np.cos(around), np.sin(up)])
        x = np.cross([0.0, 0.0, 1.0], z) / np.cos(up)
        turn = np.exp(1j * random.uniform(-0.5, 0.5))
        y = np.cross(z, x)
        D = np.array([turn.real * x + turn.imag * y, turn.real * y - turn.imag * x, z])
        centre = random.uniform(18.0, 25.0) * z
        poses.append([*centre, *np.degrees(angles_from_rotation(D[None])[0])])
        star = (X - centre) @ D.T
        xy = -C * star[:, :2] / star[:, 2:] + random.normal(0.0, SIGMA, (points, 2))
        seen = np.flatnonzero(random.random(points) < share)
        rays += [[f"I{k}", f"P{j}", *xy[j].tolist()] for j in seen.tolist()]
    folder.mkdir(parents=True, exist_ok=True)
    return tuple(
        _project(folder / f"{name}.yaml", name == "truth", X, control, poses, rays) for name in ("nothing", "truth")
    )


def _project(path: Path, given: bool, X: np.ndarray, control: list[int], poses: list, rays: list) -> Path:
    def row(name: str, values: list) -> list:
        return [name, *(map(float, values) if given else [None] * len(values))]

    tables = [
        {"columns": ["id", "x", "y", "z"], "rows": [row(f"P{j}", X[j]) for j in range(len(X)) if j not in control]}
    ]
    if control:
        known = [[f"P{j}", *X[j].tolist()] for j in control]
        tables.append({"columns": ["id", "x", "y", "z"], "rows": known, "fixed": ["x", "y", "z"]})
    images = [[*row(f"I{k}", pose), "K"] for k, pose in enumerate(poses)]
    project = {
        "mor": 1,
        "units": {"length": "m", "angle": "deg"},
        "cameras": {"K": {"interior": {"c": {"fixed": C}, "xh": {"fixed": 0}, "yh": {"fixed": 0}}}},
        "images": [{"columns": ["id", "x", "y", "z", "omega", "phi", "kappa", "camera"], "rows": images}],
        "points": tables,
        "observations": [
            {"type": "image", "columns": ["image", "point", "x", "y"], "rows": rays, "values": {"sigma": SIGMA}}
        ],
        "datum": "fixed" if control else "free",
        "settings": {"undetermined": "leave_out"},
    }
    path.write_text(yaml.safe_dump(project))
    return path
