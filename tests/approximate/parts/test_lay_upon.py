"""A part that was worked out without rough coordinates is laid upon them: shape and size stay."""

import numpy as np

from mor.model.rotations import exponential
from mor.start.join import lay_upon
from mor.start.movement import FreeRotation
from mor.start.part import empty_part


def test_shape_and_size_stay_and_the_place_is_that_of_the_rough_ones():
    draw = np.random.default_rng(4)
    true = draw.uniform(-5.0, 5.0, (12, 3))
    rough = true + 0.05 * draw.standard_normal(true.shape)
    rough[3] += 3.0
    rough[5] = np.nan
    part = empty_part(len(true))
    part.points[:] = true @ exponential(np.array([[0.3, 1.0, -0.4]]))[0].T + [100.0, -20.0, 3.0]
    lay_upon(part, rough, FreeRotation.ANY, True)
    assert np.abs(part.points - true).max() < 0.15
    lengths, expected = (np.linalg.norm(X[:, None] - X[None], axis=2) for X in (part.points, true))
    np.testing.assert_allclose(lengths, expected, atol=1e-9)


def test_a_levelled_part_turns_about_the_vertical_only():
    draw = np.random.default_rng(4)
    true = draw.uniform(-5.0, 5.0, (8, 3))
    part = empty_part(len(true))
    part.points[:] = true @ exponential(np.array([[0.0, 0.0, 2.0]]))[0].T
    lay_upon(part, true @ exponential(np.array([[0.05, 0.0, 0.0]]))[0].T, FreeRotation.VERTICAL, True)
    np.testing.assert_allclose(np.ptp(part.points[:, 2] - true[:, 2]), 0.0, atol=1e-9)


def test_two_points_are_too_few_and_nothing_moves():
    part = empty_part(2)
    part.points[:] = [[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]
    before = part.points.copy()
    lay_upon(part, before + 5.0, FreeRotation.ANY, True)
    np.testing.assert_array_equal(part.points, before)


def test_size_is_taken_from_the_given_places_if_nothing_was_measured_of_it():
    draw = np.random.default_rng(4)
    true = draw.uniform(-5.0, 5.0, (8, 3))
    part = empty_part(len(true))
    part.points[:] = 0.01 * true @ exponential(np.array([[0.5, 0.1, 2.0]]))[0].T
    lay_upon(part, true, FreeRotation.ANY, False)
    np.testing.assert_allclose(part.points, true, atol=1e-6)
