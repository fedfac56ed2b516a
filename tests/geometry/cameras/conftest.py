"""What the camera tests share: differences to test Jacobians against."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mor.model.cameras import CameraModel
from mor.types import FloatArray

AssertDerivatives = Callable[[CameraModel, FloatArray, FloatArray, FloatArray, FloatArray], None]


def difference_quotient(function: Callable[[FloatArray], FloatArray], step: FloatArray) -> FloatArray:
    """Fourth-order central difference of ``function`` at 0, with one step for each of its n rows."""
    outer = function(2.0 * step) - function(-2.0 * step)
    inner = function(step) - function(-step)
    return (8.0 * inner - outer) / (12.0 * step[:, np.newaxis])


def compare(analytic: FloatArray, numeric: FloatArray, rounding: FloatArray, what: str) -> None:
    """Compare derivatives (n, 2), each row beside the size of its own derivatives of both coordinates."""
    allowed = 1e-8 * np.abs(numeric).max(axis=1) + rounding
    difference = np.abs(analytic - numeric).max(axis=1)
    assert np.all(difference <= allowed), f"derivative by {what}: {difference} beyond {allowed}"


@pytest.fixture
def assert_derivatives() -> AssertDerivatives:
    """Check both Jacobians of a model against differences; no interior component may be zero."""

    def check(
        model: CameraModel,
        star: FloatArray,
        interior: FloatArray,
        constants: FloatArray,
        measured: FloatArray,
    ) -> None:
        projection = model.project(star, interior, constants, measured)
        rounding = 4.0 * np.finfo(float).eps * np.abs(projection.xy).max(axis=1)
        step = 5e-4 * np.linalg.norm(star, axis=1)
        for axis, name in enumerate(("X*", "Y*", "Z*")):
            direction = np.eye(3)[axis]

            def moved(step: FloatArray, direction: FloatArray = direction) -> FloatArray:
                shifted = star + step[:, np.newaxis] * direction
                return model.project(shifted, interior, constants, measured).xy

            numeric = difference_quotient(moved, step)
            compare(projection.by_star[:, :, axis], numeric, rounding / step, name)

        assert np.all(interior != 0.0)
        for column, component in enumerate(model.components):
            direction = np.eye(len(model.components))[column]

            def changed(step: FloatArray, direction: FloatArray = direction) -> FloatArray:
                values = interior + step[:, np.newaxis] * direction
                return model.project(star, values, constants, measured).xy

            step = 3e-3 * np.abs(interior[:, column])
            numeric = difference_quotient(changed, step)
            compare(projection.by_interior[:, :, column], numeric, rounding / step, component.name)

    return check
