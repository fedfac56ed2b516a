"""The vertical of points in any attitude, from horizontal directions of levelled sets and vertical angles."""

import numpy as np
import pytest

from mor.model.rotations import exponential
from mor.start.sights import HorizontalSet, VerticalAngles, vertical_of_directions

NO_ANGLES = VerticalAngles(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


def turned_scene(seed, count=12):
    """Points with Z up, and a rotation into axes that nobody knows."""
    draw = np.random.default_rng(seed)
    return (
        draw,
        draw.normal(size=(count, 3)) * [1.0, 1.0, 0.5],
        exponential(2.0 * draw.normal(size=(1, 3)))[0],
    )


def reading(draw, place, points):
    """Horizontal directions, clockwise, from any zero."""
    away = points - place
    return np.arctan2(away[:, 0], away[:, 1]) + draw.uniform(0.0, 6.0) + 1e-4 * draw.standard_normal(len(points))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("known", [True, False])
def test_a_set_of_horizontal_directions_tells_the_vertical(seed, known):
    draw, points, D = turned_scene(seed)
    place = np.array([2.0, -1.5, 0.7])
    one = HorizontalSet(D @ place if known else np.full(3, np.nan), points @ D.T, reading(draw, place, points))
    found = vertical_of_directions([one], NO_ANGLES)
    assert found.redundancy == len(points) - (3 if known else 5)
    assert np.linalg.norm(found.up - D[:, 2]) < 6.0 * found.sigma


def test_a_wrong_direction_does_not_agree_with_it():
    draw, points, D = turned_scene(11, count=12)
    places = np.array([[2.0, -1.5, 0.7], [-1.8, -1.0, 0.2]])
    sets = [HorizontalSet(np.full(3, np.nan), points @ D.T, reading(draw, place, points)) for place in places]
    sets[0].directions[3] += 0.3
    found = vertical_of_directions(sets, NO_ANGLES)
    assert found.agreeing == 2 * len(points) - 1
    assert np.linalg.norm(found.up - D[:, 2]) < 0.02


def test_vertical_angles_between_known_points_tell_it_too():
    draw, points, D = turned_scene(5)
    line = points[1:] - points[0]
    values = np.arcsin(line[:, 2] / np.linalg.norm(line, axis=1)) + 1e-4 * draw.standard_normal(len(line))
    start = np.repeat(points[:1], len(line), axis=0)
    found = vertical_of_directions([], VerticalAngles(start @ D.T, points[1:] @ D.T, values))
    np.testing.assert_allclose(found.up, D[:, 2], atol=2e-3)


def test_directions_to_five_points_alone_control_nothing():
    draw, points, D = turned_scene(2, count=5)
    place = np.array([2.0, -1.5, 0.7])
    one = HorizontalSet(np.full(3, np.nan), points @ D.T, reading(draw, place, points))
    assert vertical_of_directions([one], NO_ANGLES) is None
