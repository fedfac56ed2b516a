from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mor.model.cameras import CAMERA_MODELS

MODEL = CAMERA_MODELS["brown-forward"]
VALUES = np.array([7.457, -0.010, 0.111, 4.5e-3, -9.8e-5, 1.8e-7, -5.7e-5, -2.8e-5])
STAR = np.array([[0.0, 0.0, -2.0], [1e-9, 0.0, -2.0], [0.2, -0.4, -2.0], [0.96, 0.72, -2.0], [-0.96, -0.72, -2.0]])
N = len(STAR)
INTERIOR = np.tile(VALUES, (N, 1))
NOTHING, NOT_LOOKED_AT = np.empty((N, 0)), np.full((N, 2), np.nan)


def test_hand_computed_image_point() -> None:
    star = np.array([[1.0, 2.0, -10.0]])
    interior = np.array([[10.0, 0.5, -0.25, 0.01, 0.001, 0.0001, 0.001, 0.002]])
    q = 0.05 + 0.025 + 0.0125
    x = 0.5 + 1.0 - (q + 0.007 + 0.008)
    y = -0.25 + 2.0 - (2.0 * q + 0.026 + 0.004)
    xy = MODEL.project(star, interior, np.empty((1, 0)), np.zeros((1, 2))).xy
    np.testing.assert_allclose(xy, [[x, y]], rtol=1e-15)


def test_derivatives_against_differences(assert_derivatives: Callable[..., None]) -> None:
    assert_derivatives(MODEL, STAR, INTERIOR, NOTHING, NOT_LOOKED_AT)


def test_it_is_mor_with_opposite_signs() -> None:
    forward = MODEL.project(STAR, INTERIOR, NOTHING, NOT_LOOKED_AT)
    signs = np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0, -1.0])
    interior = np.column_stack((INTERIOR * signs, np.zeros((N, 2))))
    mor = CAMERA_MODELS["mor"].project(STAR, interior, np.zeros((N, 1)), NOT_LOOKED_AT)
    np.testing.assert_allclose(forward.xy, mor.xy, rtol=1e-14)
    np.testing.assert_allclose(forward.by_star, mor.by_star, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(forward.by_interior, mor.by_interior[:, :, :8] * signs, rtol=1e-12, atol=1e-14)


def test_the_two_brown_models_agree_to_first_order_of_the_distortion() -> None:
    # with the distortion scaled down by t, the two differ by t²: a wrong sign would leave t
    differences = []
    for t in (1e-2, 1e-3):
        interior = INTERIOR.copy()
        interior[:, 3:] *= t
        xy = MODEL.project(STAR, interior, NOTHING, NOT_LOOKED_AT).xy
        both = np.column_stack((interior, np.zeros((N, 2))))
        v = CAMERA_MODELS["brown"].project(STAR, both, NOTHING, xy).xy - xy
        differences.append(np.abs(v).max())
    np.testing.assert_allclose(differences[0] / differences[1], 100.0, rtol=0.02)
