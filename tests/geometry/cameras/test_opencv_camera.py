from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mor.model.cameras import CAMERA_MODELS

MODEL = CAMERA_MODELS["opencv"]
VALUES = np.array([3200.0, 3190.0, 2010.0, 1490.0, -0.12, 0.08, 7e-4, -4e-4, -0.02, 0.03, -0.01, 0.005])
STAR = np.array(
    [
        [0.0, 0.0, -2.0],
        [1e-9, 0.0, -2.0],
        [0.2, -0.4, -2.0],
        [1.3, 0.9, -2.0],
        [-1.3, 0.9, -2.0],
        [7.0, -9.0, -15.0],
    ]
)
N = len(STAR)
INTERIOR = np.tile(VALUES, (N, 1))
NOTHING, NOT_LOOKED_AT = np.empty((N, 0)), np.full((N, 2), np.nan)


@pytest.fixture
def cv2() -> Any:
    return pytest.importorskip("cv2", reason="opencv-python is not installed")


def test_hand_computed_image_point() -> None:
    # a = 0.5, b = −1 (the point is above the axis); r² = 1.25
    interior = np.array([[100.0, 200.0, 10.0, 20.0, 0.1, 0.0, 0.01, 0.02, 0.0, 0.2, 0.0, 0.0]])
    factor = 1.125 / 1.25
    a = 0.5 * factor + 2.0 * 0.01 * -0.5 + 0.02 * (1.25 + 0.5)
    b = -1.0 * factor + 0.01 * (1.25 + 2.0) + 2.0 * 0.02 * -0.5
    xy = MODEL.project(np.array([[1.0, 2.0, -2.0]]), interior, np.empty((1, 0)), np.zeros((1, 2))).xy
    np.testing.assert_allclose(xy, [[100.0 * a + 10.0, -(200.0 * b + 20.0)]], rtol=1e-15)


def test_derivatives_against_differences(assert_derivatives: Callable[..., None]) -> None:
    assert_derivatives(MODEL, STAR, INTERIOR, NOTHING, NOT_LOOKED_AT)


def test_image_points_and_derivatives_agree_with_opencv(cv2: Any) -> None:
    camera = np.array([[VALUES[0], 0.0, VALUES[2]], [0.0, VALUES[1], VALUES[3]], [0.0, 0.0, 1.0]])
    in_opencv_axes = STAR * [1.0, -1.0, -1.0]
    uv, jacobian = cv2.projectPoints(in_opencv_axes, np.zeros(3), np.zeros(3), camera, VALUES[4:])
    projection = MODEL.project(STAR, INTERIOR, NOTHING, NOT_LOOKED_AT)
    np.testing.assert_allclose(projection.xy * [1.0, -1.0], uv[:, 0], rtol=1e-13)
    # OpenCV's columns: rotation 3, translation 3, fx fy, cx cy, distortion
    theirs = jacobian.reshape(N, 2, -1) * np.array([[1.0], [-1.0]])
    np.testing.assert_allclose(projection.by_interior, theirs[:, :, 6:18], rtol=1e-11, atol=1e-9)
    by_star = theirs[:, :, 3:6] * [1.0, -1.0, -1.0]
    np.testing.assert_allclose(projection.by_star, by_star, rtol=1e-11, atol=1e-9)


def test_an_opencv_pose_is_a_pose_of_this_program(cv2: Any) -> None:
    # X_c = R X + t becomes D = diag(1, −1, −1) R, X0 = −Rᵀ t, as docs/camera-models.md says
    rotation_vector, shift = np.array([0.3, -0.5, 1.1]), np.array([0.2, -0.1, 4.0])
    points = np.random.default_rng(8).uniform(-1.0, 1.0, (N, 3))
    camera = np.array([[VALUES[0], 0.0, VALUES[2]], [0.0, VALUES[1], VALUES[3]], [0.0, 0.0, 1.0]])
    uv, _ = cv2.projectPoints(points, rotation_vector, shift, camera, VALUES[4:])
    rotation = cv2.Rodrigues(rotation_vector)[0]
    to_image = np.diag([1.0, -1.0, -1.0]) @ rotation
    star = (points + rotation.T @ shift) @ to_image.T
    xy = MODEL.project(star, INTERIOR, NOTHING, NOT_LOOKED_AT).xy
    np.testing.assert_allclose(xy * [1.0, -1.0], uv[:, 0], rtol=1e-12)


def test_it_is_mor_when_both_leave_out_what_the_other_lacks() -> None:
    # fx = fy = c; A_i = k_i / c^2i; b points down, so B1 = p2/c, B2 = −p1/c; principal point (cx, −cy)
    c, cx, cy = VALUES[0], 3.0, -5.0
    k1, k2, p1, p2, k3 = VALUES[4:9]
    opencv = np.tile([c, c, cx, cy, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0], (N, 1))
    mor = np.tile([c, cx, -cy, k1 / c**2, k2 / c**4, k3 / c**6, p2 / c, -p1 / c, 0.0, 0.0], (N, 1))
    ours = MODEL.project(STAR, opencv, NOTHING, NOT_LOOKED_AT)
    other = CAMERA_MODELS["mor"].project(STAR, mor, np.zeros((N, 1)), NOT_LOOKED_AT)
    np.testing.assert_allclose(ours.xy, other.xy, rtol=1e-13)
    np.testing.assert_allclose(ours.by_star, other.by_star, rtol=1e-11, atol=1e-9)
