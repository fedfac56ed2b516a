"""Two bundles that know the vertical: four points and more."""

import numpy as np
import pytest

from mor.approximate.relative_orientation.upright import upright_orientation


@pytest.mark.parametrize("seed", range(8))
def test_base_and_turn_are_those_of_the_truth(seed):
    random = np.random.default_rng(seed)
    points = random.normal(size=(4 + seed % 4, 3)) * [5.0, 5.0, 2.0]
    places, turns, rays = [], [], []
    for angle in random.uniform(0.0, 6.0, 2):
        place = np.array([9.0 * np.cos(angle), 9.0 * np.sin(angle), random.normal()])
        c, s = np.cos(3.0 * angle), np.sin(3.0 * angle)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        star = (points - place) @ turn.T
        places.append(place)
        turns.append(turn)
        rays.append(star / np.linalg.norm(star, axis=1, keepdims=True))
    found = upright_orientation(*rays, 1e-3)
    base = turns[0] @ (places[1] - places[0])
    np.testing.assert_allclose(found.base, base / np.linalg.norm(base), atol=1e-4)
    np.testing.assert_allclose(found.turn, turns[1] @ turns[0].T, atol=1e-4)


def test_rays_that_do_not_meet_have_none():
    random = np.random.default_rng(1)
    rays = random.normal(size=(2, 7, 3))
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    assert upright_orientation(rays[0], rays[1], 1e-3) is None
