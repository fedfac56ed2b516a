"""Far points of images with free cameras: put at infinity while nothing is known, and taken back."""

from __future__ import annotations

import numpy as np
import pytest

import mor
from mor.geometry.rotations import angles_from_rotation

C, SIGMA = 30.0, 0.002
SIDE = 5


def _scene(seed: int) -> dict[str, object]:
    """SIDE² images from 45 m above, each with a camera of its own, and 12 points 500 to 3 000 m behind the object."""
    random = np.random.default_rng(seed)
    near = np.c_[random.uniform(-20.0, 20.0, (150, 2)), random.uniform(-4.0, 4.0, 150)]
    depth = random.uniform(500.0, 3000.0, 12)
    points = np.r_[near, np.c_[random.uniform(-0.2, 0.2, (12, 2)) * depth[:, None], -depth]]
    images, rays = [], []
    for k, (x, y) in enumerate(
        np.stack(np.meshgrid(*2 * [np.linspace(-24.0, 24.0, SIDE)]), axis=-1).reshape(-1, 2)
    ):
        centre = np.array([x, y, 45.0 + random.uniform(-4.0, 4.0)])
        back = centre - centre * (0.35, 0.35, 0.0) - random.normal(0.0, 1.0, 3)
        back /= np.linalg.norm(back)
        right = np.cross([0.0, 1.0, 0.1], back)
        right /= np.linalg.norm(right)
        turn = k % 4 * np.pi / 2.0
        D = np.stack([right, np.cross(back, right), back])
        D = (
            np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
            @ D
        )
        images.append([f"I{k}", f"K{k}", *centre, *angles_from_rotation(D)])
        star = (points - centre) @ D.T
        xy = -C * star[:, :2] / star[:, 2:]
        seen = np.flatnonzero((np.abs(xy) < (18.0, 12.0)).all(axis=1))
        xy += SIGMA * random.standard_normal(xy.shape) + (0.05, -0.08)
        rays += [[f"I{k}", f"P{j}", *xy[j]] for j in seen]
    return {
        "mor": 1,
        "units": {"angle": "rad"},
        "cameras": {
            f"K{k}": {"r0": 10, "interior": {"c": {"free": 29}, "xh": {"free": 0}, "yh": {"free": 0}}}
            for k in range(SIDE**2)
        },
        "points": [{"columns": ["id", "x", "y", "z"], "rows": [[f"P{j}", *p] for j, p in enumerate(points)]}],
        "images": [{"columns": ["id", "camera", "x", "y", "z", "omega", "phi", "kappa"], "rows": images}],
        "observations": [
            {
                "type": "image",
                "columns": ["image", "point", "x", "y"],
                "rows": rays,
                "values": {"sigma": f"{SIGMA} mm"},
            }
        ],
        "datum": "free",
    }


@pytest.mark.parametrize("seed", [1, 2])
def test_far_points_that_bend_the_cameras_are_taken_back_from_infinity(seed: int) -> None:
    result = mor.adjust(_scene(seed))
    assert result.outcome == "converged"
    assert result.sigma0 == pytest.approx(1.0, abs=0.05)
    assert not result.solved.network.undeterminable
