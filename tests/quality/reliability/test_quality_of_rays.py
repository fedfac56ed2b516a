"""The kernel that notes the quality of rays against the plain form for any observations."""

from __future__ import annotations

import numpy as np
import pytest

from mor.quality.redundancy import fill
from mor.quality.test_statistics import CONTROLLED, joint_statistic


@pytest.mark.kernels
def test_joint_tests_of_rays_whatever_controls_them():
    random = np.random.default_rng(1)
    n = 400
    turn = random.uniform(0.0, np.pi, n)
    axes = np.stack([np.cos(turn), np.sin(turn), -np.sin(turn), np.cos(turn)], axis=1).reshape(n, 2, 2)
    stretch = random.uniform(0.01, 1.0, (n, 2))
    stretch[:100, 0] = 0.0  # a point of two rays: nothing controls them along the epipolar line
    stretch[100:130] = 0.0
    stretch[130:160, 1] = stretch[130:160, 0]
    white = np.eye(2) - np.einsum("nki,nk,nkj->nij", axes, stretch, axes)
    weight = random.uniform(1.0, 1e4, (n, 2))
    weight[[5, 150, 300], [0, 1, 0]] = 0.0  # not observed
    v = np.where(weight > 0.0, random.standard_normal((n, 2)) / np.where(weight > 0.0, weight, 1.0), np.nan)
    here = weight > 0.0
    expected, rank = joint_statistic(v * weight, np.eye(2) - white, here)
    absorbed, carried, joint = np.full((n, 2), np.nan), np.full((n, 2), np.nan), np.full(n, np.nan)
    freedom = np.zeros(n, dtype=np.int8)
    place, shares, by_point = (
        random.permutation(n),
        random.standard_normal((n, 2)),
        random.standard_normal((n, 2, 3)),
    )
    by_point[7] = 0.0  # nothing is carried into the point
    carries = shares * weight / np.where(np.arange(n) == 7, np.inf, np.linalg.norm(by_point, axis=2).T).T
    fill(place, place, weight, white, shares, by_point, CONTROLLED, v, absorbed, carried, joint, freedom)
    np.testing.assert_allclose(joint, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(freedom, rank)
    assert set(rank) == {0.0, 1.0, 2.0}
    np.testing.assert_array_equal(absorbed, np.where(here, np.diagonal(white, axis1=1, axis2=2), np.nan))
    np.testing.assert_allclose(carried, np.where(here, carries, np.nan), rtol=1e-14)
