"""The compiled kernel of rolling shutters against the equation in numpy."""

from __future__ import annotations

import numpy as np
import pytest

from mor.adjustment.rays.compiled.cameras import MODELS
from mor.adjustment.rays.moving import compiled_model, computed_moving
from mor.geometry.cameras import CAMERA_MODELS
from mor.geometry.rotations import rotation_from_angles
from mor.observations import MOVING_TYPES, ObservationGroup

ROWS = 30


@pytest.mark.parametrize("model", list(MODELS))
@pytest.mark.parametrize("readout", [0.0, 0.03])
def test_kernel_is_the_equation(model: str, readout: float) -> None:
    random, type_ = np.random.default_rng(11), MOVING_TYPES[model]
    sizes = {slot.part: slot.kind for slot in type_.slots}
    size = len(CAMERA_MODELS[model].components)
    values = {
        "point": random.uniform(-20.0, 20.0, (ROWS, 3)) * [1.0, 1.0, 0.1],
        "rotation": rotation_from_angles(random.uniform(-0.05, 0.05, (3, 3))),
        "height": np.array([[0.0], [0.4]]),
        "eccentricity": random.uniform(-0.1, 0.1, (2, 3)),
        "image velocity": np.array([[0.0, 0.0, 0.0], [1.0, 9.0, -0.5]]),
        "rotation rate": np.array([[0.0, 0.0, 0.0], [0.1, -0.2, 3.0]]),
        "readout": np.array([[readout]]),
        sizes["interior"]: np.array([[8.8, 0.02, -0.01, *random.uniform(-1e-6, 1e-6, size - 3)]]),
    }
    values["point"][:3, 2] = 60.0
    number = random.integers(0, 3, ROWS)
    one, nothing = random.integers(0, 2, ROWS), np.zeros(ROWS, dtype=np.int64)
    blocks = (number, number, one, one, one, one, nothing, nothing, np.arange(ROWS))
    constants = np.concatenate(
        [
            random.uniform(-3.0, 3.0, (ROWS, 2)),
            np.full((ROWS, len(type_.constants) - 5), 5.0),
            np.tile([0.02, -0.11, 0.01], (ROWS, 1)),
        ],
        axis=1,
    )
    nothing_observed = np.zeros((ROWS, 2))
    group = ObservationGroup("g", type_, blocks, nothing_observed, nothing_observed, constants, ((), ()))
    rows = np.arange(3, ROWS)
    found = computed_moving(group, compiled_model(group), values, rows)
    gathered = [values[slot.kind][own[rows]] for slot, own in zip(type_.slots, blocks, strict=True)]
    expected = type_.equation(gathered, constants[rows])
    np.testing.assert_allclose(found.values, expected.values, atol=1e-11)
    for slot, own, other in zip(type_.slots, found.jacobians, expected.jacobians, strict=True):
        scale = max(float(np.abs(other).max()), 1e-12)
        np.testing.assert_allclose(own / scale, other / scale, atol=1e-11, err_msg=slot.part)
