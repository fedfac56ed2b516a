from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mor.model.brown import residuals_in_measured_image
from mor.model.cameras import CAMERA_MODELS
from mor.types import FloatArray

MODEL = CAMERA_MODELS["brown"]
VALUES = np.array([7.457, -0.011, 0.1056, 4.6e-3, -4.5e-5, -2.1e-6, -6.1e-5, -4.4e-5, 3.9e-4, -2.7e-4])
# 7.25 mm × 5.44 mm: centre, principal point, beside it, ordinary, corners
MEASURED = np.array([[0.0, 0.0], [-0.011, 0.1056], [-0.011 + 1e-9, 0.1056], [1.3, -2.0], [3.6, 2.7], [-3.6, -2.7]])
N = len(MEASURED)
INTERIOR = np.tile(VALUES, (N, 1))
STAR = np.array([[0.0, 0.0, -2.0], [0.1, 0.2, -2.0], [0, 1e-9, -3], [0.4, -0.5, -2], [1, 0.7, -2], [-1, -0.8, -2]])
NOTHING = np.empty((N, 0))


def residuals(star: FloatArray, interior: FloatArray, measured: FloatArray) -> FloatArray:
    return MODEL.project(star, interior, np.empty((len(star), 0)), measured).xy - measured


def points_seen_at_corrected(corrected: FloatArray) -> FloatArray:
    """Points in the image system whose ideal coordinates are ``corrected``."""
    return np.column_stack((corrected / VALUES[0], -np.ones(len(corrected))))


def corrected_of(measured: FloatArray) -> FloatArray:
    """Corrected coordinates, out of the residuals of a point on the axis: v = 0 − corrected."""
    axis = np.tile([0.0, 0.0, -1.0], (len(measured), 1))
    return -residuals(axis, np.tile(VALUES, (len(measured), 1)), measured)


def test_hand_computed_residual() -> None:
    # x' = 1, y' = 2; the affinity makes x' = 1.1 + 0.1·2 = 1.3; r² = 1.69 + 4 = 5.69; ideal (1, 2)
    interior = np.array([[10.0, 0.5, -0.5, 0.01, 0.001, 0.0001, 0.002, 0.003, 0.1, 0.1]])
    q = 0.01 * 5.69 + 0.001 * 5.69**2 + 0.0001 * 5.69**3
    x = 1.3 + 1.3 * q + 0.002 * (5.69 + 2.0 * 1.69) + 2.0 * 0.003 * 1.3 * 2.0
    y = 2.0 + 2.0 * q + 0.003 * (5.69 + 2.0 * 4.0) + 2.0 * 0.002 * 1.3 * 2.0
    v = residuals(np.array([[1.0, 2.0, -10.0]]), interior, np.array([[1.5, 1.5]]))
    np.testing.assert_allclose(v, [[1.0 - x, 2.0 - y]], rtol=1e-14)


def test_derivatives_against_differences(assert_derivatives: Callable[..., None]) -> None:
    assert_derivatives(MODEL, STAR, INTERIOR, NOTHING, MEASURED)


def test_positive_k1_is_barrel_distortion() -> None:
    interior = np.zeros((1, 10))
    interior[0, [0, 3]] = 10.0, 1e-3
    # seen where the undistorted camera would see it, the point must lie further out: v > 0
    v = residuals(np.array([[3.0, 4.0, -10.0]]), interior, np.array([[3.0, 4.0]]))
    np.testing.assert_allclose(v, [[-0.075, -0.1]], rtol=1e-12)
    # the measured point that fits lies nearer the centre than the ideal (3, 4)
    fitting = np.array([3.0, 4.0]) + residuals_in_measured_image(v, interior, np.array([[3.0, 4.0]]))[0]
    assert np.hypot(*fitting) < 5.0


def test_without_distortion_its_affinity_is_that_of_mor() -> None:
    interior, affine = np.zeros((N, 10)), np.zeros((N, 10))
    interior[:, :3] = affine[:, :3] = VALUES[:3]
    interior[:, 8:] = b1, b2 = 0.1, -0.2
    affine[:, 8:] = 1.0 / (1.0 + b1) - 1.0, -b2 / (1.0 + b1)
    seen = CAMERA_MODELS["mor"].project(STAR, affine, np.zeros((N, 1)), MEASURED).xy
    np.testing.assert_allclose(residuals(STAR, interior, seen), 0.0, atol=1e-14)


def test_residuals_in_the_measured_image_against_a_known_shift() -> None:
    # truth: the point belongs to measured + shift; to first order that is what must come out
    shift = np.array([[0.3, -0.7]] * N) * 1e-5
    star = points_seen_at_corrected(corrected_of(MEASURED + shift))
    v = residuals(star, INTERIOR, MEASURED)
    moved = residuals_in_measured_image(v, INTERIOR, MEASURED)
    np.testing.assert_allclose(moved, shift, atol=1e-10)
    assert np.abs(v - shift)[-1].max() > 1e-7  # at the corner the two images do differ


def test_residuals_where_the_correction_folds_are_not_invented() -> None:
    interior = np.zeros((1, 10))
    interior[0, [0, 3]] = 10.0, -1e-2  # corrected radius r − r³/100 turns back at r = 5.77
    v = np.full((1, 2), 1e-3)
    assert np.isfinite(residuals_in_measured_image(v, interior, np.array([[5.7, 0.0]]))).all()
    assert np.isnan(residuals_in_measured_image(v, interior, np.array([[5.8, 0.0]]))).all()
