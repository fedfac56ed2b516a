"""Narrow images from nearly one side do not tell the camera constants: c and the distance change together."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from mor.model.rotations import angles_from_rotation
from tests.scenarios.small_projects import mor


def _block(seed: int, half_angle: float, is_one_camera: bool) -> str:
    """Six images of 15 mm from an arc of 60 m radius (half of it in degrees), of 40 points within 8 m by 4 m by 1 m."""
    random = np.random.default_rng(seed)
    points = random.uniform(-1.0, 1.0, (40, 3)) * [4.0, 2.0, 0.5]
    cameras, images, rays = {}, [], []
    for k, angle in enumerate(np.radians(np.linspace(-half_angle, half_angle, 6))):
        centre = np.array([60.0 * np.sin(angle), 2.0 * random.normal(), 60.0 * np.cos(angle)])
        back = centre / np.linalg.norm(centre)
        across = np.cross([0.0, 1.0, 0.0], back)
        rotation = np.array([across / np.linalg.norm(across), np.cross(back, across / np.linalg.norm(across)), back])
        seen = (points - centre) @ rotation.T
        measured = -15.0 * seen[:, :2] / seen[:, 2:] + 0.005 * random.normal(size=(40, 2))
        camera = "C0" if is_one_camera else f"C{k}"
        cameras[camera] = {"interior": {"c": {"free": 15.0}}}
        images.append([f"I{k}", camera, *centre.tolist(), *map(float, angles_from_rotation(rotation))])
        rays += [[f"I{k}", f"P{j}", *xy] for j, xy in enumerate(measured.tolist())]
    project = {
        "mor": 1,
        "units": {"angle": "rad"},
        "cameras": cameras,
        "points": [{"columns": ["id", "x", "y", "z"], "rows": [[f"P{j}", *p] for j, p in enumerate(points.tolist())]}],
        "images": [{"columns": ["id", "camera", "x", "y", "z", "omega", "phi", "kappa"], "rows": images}],
        "observations": [
            {"type": "image", "values": {"sigma": 0.005}, "columns": ["image", "point", "x", "y"], "rows": rays}
        ],
        "datum": "free",
    }
    return yaml.safe_dump(project)


@pytest.mark.parametrize("seed", range(1, 5))
def test_constants_that_nothing_tells_are_named(seed: int, tmp_path: Path) -> None:
    project = tmp_path / "p.yaml"
    project.write_text(_block(seed, 6.0, is_one_camera=False), encoding="utf-8")
    run = mor("adjust", project)
    assert run.code == 4
    assert re.search(
        r"not determined along c.*interior orientation of camera C\d|camera C\d is not determined along c;", run.err
    )


@pytest.mark.parametrize("seed", range(1, 5))
def test_a_constant_that_images_from_all_sides_tell_is_accepted(seed: int, tmp_path: Path) -> None:
    project = tmp_path / "p.yaml"
    project.write_text(_block(seed, 60.0, is_one_camera=True), encoding="utf-8")
    assert mor("adjust", project).code == 0
