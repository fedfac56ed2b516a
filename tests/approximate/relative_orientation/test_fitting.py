"""All orientations that fit: of five to seven points the true one is among them, of a plane both are."""

import numpy as np
import pytest

from mor.model.rotations import exponential
from mor.start.bundle import direction_bundle
from mor.start.image_pair import fitting_orientations


def _pair(seed, count, flat=False):
    draw = np.random.default_rng(seed)
    X = draw.uniform(-1.0, 1.0, (count, 3)) * [1.0, 1.0, 0.0 if flat else 0.6] + [0.0, 0.0, -4.0]
    base = draw.standard_normal(3) * [1.0, 1.0, 0.2]
    base /= np.linalg.norm(base)
    turn = exponential(0.2 * draw.standard_normal((1, 3)))[0]
    sigma = np.full(count, 1e-6)
    rays = [X, (X - base) @ turn.T]
    rays = [r / np.linalg.norm(r, axis=1, keepdims=True) + 1e-6 * draw.standard_normal(r.shape) for r in rays]
    return [direction_bundle(r / np.linalg.norm(r, axis=1, keepdims=True), sigma) for r in rays], base, turn


@pytest.mark.parametrize("count", [5, 6, 7, 12])
@pytest.mark.parametrize("flat", [False, True])
def test_the_true_orientation_is_among_those_that_fit(count, flat):
    off = []
    for seed in range(12):
        (a, b), base, turn = _pair(seed, count, flat)
        found = fitting_orientations(a, b)
        off.append(
            min(
                (np.linalg.norm(one.base - base) + np.linalg.norm(one.rotation - turn) for one in found),
                default=9.0,
            )
        )
    assert np.median(off) < 2e-3
    assert max(off) < 0.05


def test_four_points_leave_too_many():
    (a, b), *_ = _pair(1, 4)
    assert fitting_orientations(a, b) == []
