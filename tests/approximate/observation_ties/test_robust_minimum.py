"""Many starts at once find the minimum of Σ log(1 + v²), gross errors or not."""

from typing import NamedTuple

import numpy as np

from mor.start.join_by_observations import minima


class Places(NamedTuple):
    x: np.ndarray


class Distances:
    """A point in the plane by its distances from known ones."""

    unknowns = 2

    def __init__(self, centres, lengths):
        self.centres, self.lengths = centres, lengths

    def residuals(self, states):
        away = states.x[:, None, :] - self.centres
        return (np.linalg.norm(away, axis=2) - self.lengths) / 1e-3

    def derivatives(self, states):
        away = states.x[:, None, :] - self.centres
        return away / np.linalg.norm(away, axis=2)[:, :, None] / 1e-3

    def moved(self, states, steps):
        return Places(states.x + steps)


def test_the_minimum_is_found_beside_a_gross_error():
    draw = np.random.default_rng(3)
    centres, X = draw.uniform(-1.0, 1.0, (7, 2)), np.array([0.3, -0.8])
    lengths = np.linalg.norm(X - centres, axis=1)
    lengths[2] += 0.7
    starts = Places(draw.uniform(-3.0, 3.0, (40, 2)))
    found = minima(Distances(centres, lengths), starts)
    np.testing.assert_allclose(found.states[0][0], X, atol=1e-6)
    assert abs(found.residuals[0, 2]) > 600.0
    assert np.all(np.diff(found.objectives) >= 0.0)


def test_two_minima_that_fit_alike_are_both_found():
    centres, X = np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([0.4, 0.9])
    lengths = np.linalg.norm(X - centres, axis=1)
    draw = np.random.default_rng(3)
    found = minima(Distances(centres, lengths), Places(draw.uniform(-3.0, 3.0, (40, 2))))
    exact = found.states[0][found.objectives < 1e-6]
    assert {bool(y > 0.0) for y in exact[:, 1]} == {True, False}
    np.testing.assert_allclose(np.abs(exact[:, 1]), 0.9, atol=1e-6)
