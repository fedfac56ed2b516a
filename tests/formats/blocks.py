"""Small image blocks with a known truth, as projects, for round trips through formats."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mor.model.cameras import CAMERA_MODELS
from mor.model.rotations import rotation_from_angles
from mor.types import FloatArray

MODELS: dict[str, dict[str, float]] = {
    "SIMPLE_PINHOLE": {"c": 1210.5, "xh": 3.5, "yh": -2.25},
    "SIMPLE_RADIAL": {"c": 1210.5, "xh": 3.5, "yh": -2.25, "A1": -2e-8},
    "RADIAL": {"c": 1210.5, "xh": 3.5, "yh": -2.25, "A1": -2e-8, "A2": 3e-15},
    "PINHOLE": {"fx": 1200.0, "fy": 1203.0, "cx": 812.0, "cy": 597.5},
    "OPENCV": {
        "fx": 1200.0, "fy": 1203.0, "cx": 812.0, "cy": 597.5, "k1": -0.1, "k2": 0.02, "p1": 1e-3, "p2": -2e-3,
    },
    "FULL_OPENCV": {
        "fx": 1200.0, "fy": 1203.0, "cx": 812.0, "cy": 597.5, "k1": -0.1, "k2": 0.02, "p1": 1e-3, "p2": -2e-3,
        "k3": 1e-3, "k4": 0.01, "k5": 2e-3, "k6": 1e-4,
    },
    "OPENCV_FISHEYE": {
        "fx": 800.0, "fy": 801.0, "cx": 812.0, "cy": 597.5, "k1": -0.02, "k2": 4e-3, "k3": -1e-3, "k4": 2e-4,
    },
    "THIN_PRISM_FISHEYE": {
        "fx": 800.0, "fy": 801.0, "cx": 812.0, "cy": 597.5, "k1": -0.02, "k2": 4e-3, "p1": 1e-3, "p2": -2e-3,
        "k3": -1e-3, "k4": 2e-4, "sx1": 3e-3, "sy1": -4e-3,
    },
    "RAD_TAN_THIN_PRISM_FISHEYE": {
        "fx": 800.0, "fy": 801.0, "cx": 812.0, "cy": 597.5, "k0": -0.02, "k1": 4e-3, "k2": -1e-3, "k3": 2e-4,
        "k4": 3e-5, "k5": -1e-5, "p0": 1e-3, "p1": -2e-3, "s0": 3e-3, "s1": -4e-3, "s2": 2e-3, "s3": 1e-3,
    },
    "FOV": {"fx": 800.0, "fy": 801.0, "cx": 812.0, "cy": 597.5, "omega": 0.9},
}  # fmt: skip
"""Interior orientations, px, by the camera model of COLMAP that says the same."""
WIDTH, HEIGHT = 1600, 1200
_KEYS = {
    "OPENCV_FISHEYE": "fisheye",
    "THIN_PRISM_FISHEYE": "thin-prism-fisheye",
    "RAD_TAN_THIN_PRISM_FISHEYE": "rad-tan-thin-prism-fisheye",
    "FOV": "fov",
}


def block(seed: int, model: str, images: int = 6, points: int = 30, noise: float = 0.3) -> dict[str, Any]:
    """A project with a camera of a model, poses around a cloud of points, and image points with noise (px)."""
    rng = np.random.default_rng(seed)
    values = MODELS[model]
    key = _KEYS.get(model, "mor" if "c" in values else "opencv")
    X = rng.uniform(-2.0, 2.0, (points, 3))
    angles = np.column_stack([rng.uniform(-0.6, 0.6, (images, 2)), rng.uniform(-3.0, 3.0, images)])
    D = rotation_from_angles(angles)
    centre = np.einsum("nji,j->ni", D, [0.0, 0.0, 8.0]) + rng.uniform(-0.3, 0.3, (images, 3))
    rays = []
    for k in range(images):
        xy = _seen(key, values, (X - centre[k]) @ D[k].T) + noise * rng.standard_normal((points, 2))
        rays += [[f"{k + 1}", f"{p + 1}", repr(float(x)), repr(float(y))] for p, (x, y) in enumerate(xy)]
    held = ("xh", "yh", "cx", "cy")
    poses = np.concatenate([centre, angles], axis=1)
    return {
        "mor": "1",
        "units": {"length": "m", "angle": "rad"},
        "axes": {"xy": "en"},
        "cameras": {
            "7": {
                "model": key,
                "unit": "px",
                "coordinates": "corner",
                "image": {"width": str(WIDTH), "height": str(HEIGHT)},
                "interior": {n: {"fixed" if n in held else "free": repr(v)} for n, v in values.items()},
            }
        },
        "images": [
            {
                "columns": ["id", "camera", "x", "y", "z", "omega", "phi", "kappa"],
                "rows": [[f"{k + 1}", "7", *(repr(float(v)) for v in row)] for k, row in enumerate(poses)],
            }
        ],
        "points": [
            {
                "columns": ["id", "x", "y", "z"],
                "rows": [[f"{p + 1}", *(repr(float(v)) for v in row)] for p, row in enumerate(X)],
            }
        ],
        "observations": [
            {"type": "image", "columns": ["image", "point", "x", "y"], "rows": rays, "values": {"sigma": "1"}}
        ],
        "datum": "free",
    }


def _seen(key: str, values: dict[str, float], star: FloatArray) -> FloatArray:
    """px from the upper left corner, y down."""
    model = CAMERA_MODELS[key]
    interior = np.tile([values.get(c.name, 0.0) for c in model.components], (len(star), 1))
    constants = np.zeros((len(star), len(model.constants)))
    xy = model.project(star, interior, constants, np.zeros((len(star), 2))).xy
    centre = (WIDTH / 2.0, HEIGHT / 2.0) if key == "mor" else (0.0, 0.0)
    turned: FloatArray = xy * np.array([1.0, -1.0]) + np.array(centre)
    return turned


def written(folder: Path, data: dict[str, Any]) -> Path:
    """A project file with the data of :func:`block`."""
    from mor.project.document import project_files

    path = folder / "block.yaml"
    for name, text in project_files(data, folder, path).items():
        name.write_text(text)
    return path
