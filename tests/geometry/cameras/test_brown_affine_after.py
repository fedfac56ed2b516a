"""DBAT's models 4 and 5 against their own steps in pixels from the corner, differences, and what they share with 3."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mor.model.cameras import CAMERA_MODELS
from mor.types import FloatArray

VALUES = np.array([7.457, -0.011, 0.1056, 4.6e-3, -4.5e-5, -2.1e-6, -6.1e-5, -4.4e-5, 3.9e-2, -2.7e-2])
MEASURED = np.array([[0.0, 0.0], [-0.011, 0.1056], [0.02, 0.1], [1.3, -2.0], [3.6, 2.7], [-3.6, -2.7]])
N = len(MEASURED)
STAR = np.array([[0.0, 0.0, -2.0], [0.1, 0.2, -2.0], [0, 1e-9, -3], [0.4, -0.5, -2], [1, 0.7, -2], [-1, -0.8, -2]])
NOTHING = np.empty((N, 0))
KEYS = ("brown-4", "brown-5")


def residuals(key: str, values: FloatArray, measured: FloatArray = MEASURED) -> FloatArray:
    interior = np.tile(values, (len(measured), 1))
    return CAMERA_MODELS[key].project(STAR, interior, NOTHING, measured).xy - measured


@pytest.mark.parametrize("key", KEYS)
def test_derivatives_against_differences(key: str, assert_derivatives: Callable[..., None]) -> None:
    assert_derivatives(CAMERA_MODELS[key], STAR, np.tile(VALUES, (N, 1)), NOTHING, MEASURED)


def in_pixels(key: str, values: FloatArray) -> FloatArray:
    """Residuals as DBAT has them: scale of a pixel, y flipped, principal point from the upper left corner."""
    c, xh, yh, k1, k2, k3, p1, p2, b1, b2 = values
    size, width, height = 0.003, 2400, 1800
    px = np.column_stack((MEASURED[:, 0] / size + width / 2, height / 2 - MEASURED[:, 1] / size))
    # the scale of model 5 acts about the corner, and the principal point is that of the scaled image
    stretch = 1.0 + (b1 if key == "brown-5" else 0.0)
    xp, yp = xh + stretch * size * width / 2, size * height / 2 - yh
    u = np.array([[1.0, 0.0], [0.0, -1.0]]) @ (size * px).T
    if key == "brown-5":
        u = np.diag([1.0 + b1, 1.0]) @ u
    x, y = u - np.array([[xp], [-yp]])
    r2 = x * x + y * y
    radial = k1 * r2 + k2 * r2**2 + k3 * r2**3
    corrected = np.stack(
        [
            x + x * radial + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y,
            y + y * radial + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y,
        ]
    )
    after = np.array([[1.0 if key == "brown-5" else 1.0 + b1, b2], [0.0, 1.0]])
    return (-c * STAR[:, :2] / STAR[:, 2:]) - (after @ corrected).T


@pytest.mark.parametrize("key", KEYS)
def test_residuals_are_those_of_the_steps_in_pixels(key: str) -> None:
    np.testing.assert_allclose(residuals(key, VALUES), in_pixels(key, VALUES), rtol=0, atol=1e-13)


@pytest.mark.parametrize("key", KEYS)
def test_without_affinity_they_are_brown(key: str) -> None:
    values = VALUES * (np.arange(10) < 8)
    np.testing.assert_allclose(residuals(key, values), residuals("brown", values), rtol=0, atol=1e-15)


def test_without_distortion_all_three_are_one_affinity() -> None:
    values = VALUES * np.array([1, 1, 1, 0, 0, 0, 0, 0, 1, 1])
    scaled = values.copy()
    scaled[1] *= 1.0 + values[8]
    expected = residuals("brown", values)
    np.testing.assert_allclose(residuals("brown-4", values), expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(residuals("brown-5", scaled), expected, rtol=0, atol=1e-14)


def test_with_distortion_they_differ() -> None:
    found = [residuals(key, VALUES) for key in ("brown", *KEYS)]
    for one, other in ((0, 1), (0, 2), (1, 2)):
        assert np.abs(found[one] - found[other]).max() > 1e-4
