from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mor.model.cameras import CAMERA_MODELS
from mor.types import FloatArray

MODEL = CAMERA_MODELS["fisheye"]
VALUES = np.array([620.0, 615.0, 950.0, 700.0, 0.03, -0.012, 0.004, -7e-4, 0.02])


def stars(angles: FloatArray, azimuth: float = 0.7, distance: float = 3.0) -> FloatArray:
    """Points at ``angles`` from the viewing direction, the azimuth counted from X* towards Y*."""
    across = np.outer(np.sin(angles), [np.cos(azimuth), np.sin(azimuth)])
    return distance * np.column_stack((across, -np.cos(angles)))


def arguments(star: FloatArray, values: FloatArray = VALUES) -> tuple[FloatArray, ...]:
    n = len(star)
    return star, np.tile(values, (n, 1)), np.empty((n, 0)), np.full((n, 2), np.nan)


@pytest.fixture
def cv2() -> Any:
    return pytest.importorskip("cv2", reason="opencv-python is not installed")


def test_equidistant_image_up_to_nearly_180_degrees() -> None:
    angles = np.array([1e-300, 1e-12, 1e-3, 0.8, np.pi / 2 - 1e-9, np.pi / 2, np.pi / 2 + 1e-9, 2.0, 3.1])
    values = np.array([100.0, 100.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    xy = MODEL.project(*arguments(stars(angles), values)).xy
    expected = 100.0 * np.outer(angles, [np.cos(0.7), np.sin(0.7)])
    np.testing.assert_allclose(xy, expected, rtol=1e-13)


def test_hand_computed_image_point_at_90_degrees_and_above_the_axis() -> None:
    values = np.array([10.0, 20.0, 1.0, 2.0, 0.1, 0.01, 0.001, 0.0001, 0.5])
    theta = np.pi / 2
    bent = theta * (1.0 + 0.1 * theta**2 + 0.01 * theta**4 + 0.001 * theta**6 + 0.0001 * theta**8)
    xy = MODEL.project(*arguments(np.array([[0.0, 2.0, 0.0]]), values)).xy
    np.testing.assert_allclose(xy, [[10.0 * 0.5 * -bent + 1.0, 20.0 * bent - 2.0]], rtol=1e-14)


@pytest.mark.parametrize("azimuth", [0.0, 0.7, np.pi / 2, 4.0])
def test_derivatives_against_differences(azimuth: float, assert_derivatives: Callable[..., None]) -> None:
    angles = np.array([0.0, 1e-12, 1e-6, 1e-3, 0.8, np.pi / 2 - 1e-7, np.pi / 2, np.pi / 2 + 0.02, 2.2, 2.9])
    assert_derivatives(MODEL, *arguments(stars(angles, azimuth)))


def test_straight_ahead_is_the_limit_of_nearly_ahead() -> None:
    on_axis = MODEL.project(*arguments(np.array([[0.0, 0.0, -3.0]])))
    np.testing.assert_array_equal(on_axis.xy, [[950.0, -700.0]])
    expected = [[[620.0 / 3.0, -620.0 * 0.02 / 3.0, 0.0], [0.0, 615.0 / 3.0, 0.0]]]
    np.testing.assert_allclose(on_axis.by_star, expected, rtol=1e-15)
    for azimuth in (0.3, 2.0, 5.0):
        beside = MODEL.project(*arguments(stars(np.array([1e-9]), azimuth)))
        for limit, value in zip(on_axis, beside, strict=True):
            np.testing.assert_allclose(value, limit, rtol=1e-8, atol=1e-6)


def test_straight_behind_has_no_image() -> None:
    behind = MODEL.project(*arguments(np.array([[0.0, 0.0, 3.0]])))
    assert np.isnan(behind.xy).all()


def test_image_points_and_derivatives_agree_with_opencv(cv2: Any) -> None:
    # OpenCV divides by the depth: only angles below 90° can be compared
    star = np.vstack([stars(np.array([0.01, 0.4, 1.1, 1.55, 1.5707]), azimuth) for azimuth in (0.0, 0.7, 3.9)])
    camera = np.array([[VALUES[0], 0.0, VALUES[2]], [0.0, VALUES[1], VALUES[3]], [0.0, 0.0, 1.0]])
    in_opencv_axes = (star * [1.0, -1.0, -1.0])[:, np.newaxis]
    zero = np.zeros((3, 1))
    uv, jacobian = cv2.fisheye.projectPoints(in_opencv_axes, zero, zero, camera, VALUES[4:8], alpha=VALUES[8])
    projection = MODEL.project(*arguments(star))
    np.testing.assert_allclose(projection.xy * [1.0, -1.0], uv[:, 0], rtol=1e-12)
    # OpenCV's columns: fx fy, cx cy, k1 … k4, rotation 3, translation 3, alpha
    theirs = jacobian.reshape(len(star), 2, -1) * np.array([[1.0], [-1.0]])
    interior = theirs[:, :, [0, 1, 2, 3, 4, 5, 6, 7, 14]]
    np.testing.assert_allclose(projection.by_interior, interior, rtol=1e-10, atol=1e-8)
    by_star = theirs[:, :, 11:14] * [1.0, -1.0, -1.0]
    np.testing.assert_allclose(projection.by_star, by_star, rtol=1e-9, atol=1e-7)
