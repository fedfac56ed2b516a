from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mor.model.cameras import CAMERA_MODELS

MODEL = CAMERA_MODELS["mor"]
# a 36 mm × 24 mm camera: centre, beside it, on an axis, ordinary, two corners, far and near
STAR = np.array(
    [
        [0.0, 0.0, -10.0],
        [1e-9, -1e-9, -10.0],
        [4.0, 0.0, -10.0],
        [2.0, -3.0, -11.0],
        [6.5, 4.2, -10.0],
        [-6.5, 4.2, -10.0],
        [2000.0, 3000.0, -9000.0],
        [-0.001, 0.002, -0.01],
    ]
)
VALUES = np.array([28.8, 0.017, -0.057, -1.1e-4, 1.5e-7, -3e-11, 5.8e-6, -8.6e-6, -7e-5, 3.1e-5])
INTERIOR = np.tile(VALUES, (len(STAR), 1))
R0 = np.full((len(STAR), 1), 13.488)
NOT_LOOKED_AT = np.full((len(STAR), 2), np.nan)


def test_hand_computed_image_point() -> None:
    # x_s = 1, y_s = 2, r² = 5, r0 = 1: q = 0.01·4 + 0.001·24 + 0.0001·124 = 0.0764
    star = np.array([[1.0, 2.0, -10.0]])
    interior = np.array([[10.0, 0.5, -0.25, 0.01, 0.001, 0.0001, 0.001, 0.002, 0.03, 0.04]])
    xy = MODEL.project(star, interior, np.array([[1.0]]), np.zeros((1, 2))).xy
    x = 0.5 + 1.0 + 0.0764 + 0.001 * 7.0 + 2.0 * 0.002 * 2.0 + 0.03 + 0.08
    y = -0.25 + 2.0 + 2.0 * 0.0764 + 0.002 * 13.0 + 2.0 * 0.001 * 2.0
    np.testing.assert_allclose(xy, [[x, y]], rtol=1e-15)


def test_derivatives_against_differences(assert_derivatives: Callable[..., None]) -> None:
    assert_derivatives(MODEL, STAR, INTERIOR, R0, NOT_LOOKED_AT)


def test_derivatives_without_zero_crossing(assert_derivatives: Callable[..., None]) -> None:
    assert_derivatives(MODEL, STAR, INTERIOR, np.zeros_like(R0), NOT_LOOKED_AT)


def test_radial_distortion_vanishes_at_the_zero_crossing() -> None:
    interior = np.zeros((1, 10))
    interior[0, [0, 3, 4, 5]] = 10.0, -1e-3, 2e-5, 3e-7
    xy = MODEL.project(np.array([[3.0, 4.0, -10.0]]), interior, np.array([[5.0]]), np.zeros((1, 2))).xy
    np.testing.assert_allclose(xy, [[3.0, 4.0]], rtol=1e-15)


def test_another_zero_crossing_is_another_camera_constant() -> None:
    # x_s [1 − Σ A_i r0^2i] takes over the role of x_s; the coefficients are scaled to it
    r0, a1, a2, a3 = 13.488, *VALUES[3:6]
    with_crossing = MODEL.project(STAR, INTERIOR, R0, NOT_LOOKED_AT).xy
    factor = 1.0 - a1 * r0**2 - a2 * r0**4 - a3 * r0**6
    interior = INTERIOR.copy()
    interior[:, 0] *= factor
    interior[:, 3:] /= factor ** np.array([3, 5, 7, 2, 2, 1, 1])
    without = MODEL.project(STAR, interior, np.zeros_like(R0), NOT_LOOKED_AT).xy
    np.testing.assert_allclose(with_crossing, without, atol=1e-13)
