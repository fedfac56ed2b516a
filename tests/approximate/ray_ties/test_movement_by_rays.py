"""The movement between two systems, rays of each of which go to points of the other."""

import numpy as np
import pytest

from mor.approximate.parts.movement import Turn
from mor.approximate.ray_ties.movement_by_rays import Planes, movement_by_rays
from mor.geometry.rotations import exponential

SCALE = 3.7
SHIFT = np.array([2000.0, -3000.0, 150.0])


def planes_of(centres, points, of_source):
    """Two planes for each ray from a centre to a point, in one system."""
    rows = []
    for centre in centres:
        for point in points:
            towards = (point - centre) / np.linalg.norm(point - centre)
            rows += [(normal, centre, point, towards) for normal in np.linalg.svd(towards[None])[2][1:]]
    normal, at, point, ahead = (np.array(column) for column in zip(*rows, strict=True))
    return Planes(normal, at, point, np.full(len(rows), of_source), np.zeros(len(rows)), ahead)


def scene(turn):
    """Planes of three rays of the target and five of the source, and the rotation that is to be found."""
    draw = np.random.default_rng(8)
    axis = draw.normal(size=3) if turn is Turn.ANY else np.array([0.0, 0.0, 2.0])
    R = exponential(axis[None])[0]
    points = draw.normal(size=(8, 3))
    centres = np.array([[4.0, 1.0, 2.0], [-3.0, 3.0, 1.0]])
    of_source = planes_of(centres[:1], points[:5], True)
    of_target = planes_of(centres[1:], points[5:], False)

    def carried(X):
        return SCALE * X @ R.T + SHIFT

    turned = of_target.normal @ R.T, carried(of_target.at), of_target.ahead @ R.T
    both = (
        (of_source.normal, turned[0]),
        (of_source.at, turned[1]),
        (carried(of_source.point), of_target.point),
        (of_source.of_source, of_target.of_source),
        (of_source.reach, of_target.reach),
        (of_source.ahead, turned[2]),
    )
    return Planes(*(np.concatenate(pair) for pair in both)), R


@pytest.mark.parametrize("turn", [Turn.ANY, Turn.VERTICAL])
def test_rays_of_each_to_points_of_the_other_tie_two_systems(turn):
    planes, R = scene(turn)
    found = movement_by_rays(planes, turn, False, 3)
    assert found.open == 0
    assert not found.alternatives
    np.testing.assert_allclose(found.rotation, R, atol=1e-6)
    assert found.scale == pytest.approx(SCALE, rel=1e-6)
    np.testing.assert_allclose(found.shift, SHIFT, atol=1e-5)


def test_a_ray_to_another_point_does_not_spoil_it():
    planes, R = scene(Turn.ANY)
    wrong = planes.point.copy()
    wrong[:2] = wrong[4]
    found = movement_by_rays(planes._replace(point=wrong), Turn.ANY, False, 3)
    np.testing.assert_allclose(found.rotation, R, atol=0.02)


def test_points_behind_their_rays_agree_with_nothing():
    planes, _ = scene(Turn.ANY)
    assert movement_by_rays(planes._replace(ahead=-planes.ahead), Turn.ANY, False, 3) is None


def test_three_rays_control_nothing():
    planes, _ = scene(Turn.ANY)
    few = Planes(*(array[:6] for array in planes))
    assert movement_by_rays(few, Turn.ANY, False, 0) is None
