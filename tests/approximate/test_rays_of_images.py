"""Rays of measured image points: the inverse of the camera models."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.cameras import CAMERA_MODELS
from mor.start.bundle import ideal_rays

CAMERAS = {
    "opencv": [712.0, 714.0, 269.0, 473.0, -0.018, -0.102, -5e-3, -9e-3, 0.0, 0.0, 0.0, 0.0],
    "mor": [712.0, 9.0, -7.0, -0.018 / 712.0**2, -0.102 / 712.0**4, 0.0, 1e-6, -2e-6, 1e-4, -2e-4],
    "fisheye": [420.0, 431.0, 512.0, 388.0, -0.02, 4e-3, -1e-3, 2e-4, 0.0],
}


@pytest.mark.parametrize("key", CAMERAS)
def test_rays_up_to_the_fold_of_the_distortion_come_back(key: str) -> None:
    """The polynomial turns back at 49.5°; a wrong begin of the iteration ends beyond it."""
    model, rng = CAMERA_MODELS[key], np.random.default_rng(11)
    off, around = np.radians(rng.uniform(0.0, 44.0, 500)), rng.uniform(0.0, 2.0 * np.pi, 500)
    rays = np.stack([np.sin(off) * np.cos(around), np.sin(off) * np.sin(around), -np.cos(off)], axis=1)
    interior = np.array([CAMERAS[key]])
    constants, of = np.zeros((500, len(model.constants))), np.zeros(500, dtype=np.int64)
    measured = model.project(rays, interior[of], constants, np.zeros((500, 2))).xy
    found = ideal_rays(model, interior, of, constants, measured)
    np.testing.assert_allclose(found, rays, rtol=0, atol=1e-9)
