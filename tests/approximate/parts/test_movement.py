"""The movement between two systems, from any mixture of coordinates and directions, near and far from the origin."""

import numpy as np
import pytest

from mor.model.rotations import rotation_from_angles
from mor.start.movement import FreeRotation, Ties, movement

NONE = np.zeros((0, 3))
HIDDEN = {
    "three full": [(0, 0, 0), (0, 0, 0), (0, 0, 0)],
    "two full, one height": [(0, 0, 0), (0, 0, 0), (1, 1, 0)],
    "three plan, three height": [(0, 0, 1)] * 3 + [(1, 1, 0)] * 3,
}


def systems(seed, count, far):
    random = np.random.default_rng(seed)
    R = rotation_from_angles(random.uniform(-3, 3, (1, 3)))[0]
    scale, shift = float(np.exp(random.normal())), far * random.normal(size=3)
    source = random.normal(size=(count, 3))
    return source, scale * source @ R.T + shift, R, scale


@pytest.mark.parametrize("hidden", HIDDEN.values(), ids=HIDDEN)
@pytest.mark.parametrize("far", [0.0, 1e6])
@pytest.mark.parametrize("seed", range(4))
def test_control_of_any_components_fixes_all_seven(hidden, far, seed):
    source, target, _, scale = systems(seed, len(hidden), far)
    found = movement(Ties(source, np.where(hidden, np.nan, target), NONE, NONE), FreeRotation.ANY, False)
    assert found.open == 0
    near = [
        float(np.abs(one.scale * source @ one.rotation.T + one.translation - target).max()) < 1e-5 * scale
        for one in (found.similarity, *found.alternatives)
    ]
    assert any(near)
    assert near[0] or len(near) > 1


def test_a_vertical_and_two_points_fix_all_but_nothing():
    source, target, R, scale = systems(7, 2, 10.0)
    up = np.array([[0.0, 0.0, 1.0]])
    found = movement(Ties(source, target, up @ R, up), FreeRotation.ANY, False)
    assert found.open == 0
    np.testing.assert_allclose(found.rotation, R, atol=1e-6)
    assert found.scale == pytest.approx(scale)


@pytest.mark.parametrize(("count", "open_"), [(1, 4), (2, 1), (3, 0)])
def test_what_stays_open_is_counted(count, open_):
    source, target, _, _ = systems(3, count, 1.0)
    assert movement(Ties(source, target, NONE, NONE), FreeRotation.ANY, False).open == open_


def test_one_point_far_off_does_not_spoil_the_rest():
    source, target, R, _ = systems(5, 12, 100.0)
    target[3] += 2.0
    found = movement(Ties(source, target, NONE, NONE), FreeRotation.ANY, False)
    np.testing.assert_allclose(found.rotation, R, atol=1e-2)


def test_a_single_place_far_off_tells_no_scale():
    """A part of a millionth of its size begins an adjustment that is singular there."""
    source, target, R, _ = systems(3, 1, 1e6)
    found = movement(Ties(source, target, np.eye(3), R.T), FreeRotation.ANY, False)
    assert found.open == 1
    assert found.scale == pytest.approx(1.0)
