"""Blocks without a datum, with far points, gross errors and rough start values, against MINPACK."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.scenarios.bal_problems import SAME, bal_problem, by_mor, by_scipy, projected


def test_derivatives_of_the_independent_solver():
    problem = bal_problem(0)
    cameras, points = problem.cameras[problem.image][:5], problem.points[problem.point][:5]
    _, by_camera, by_point = projected(cameras, points)
    for k in range(9):
        step = 1e-6 * np.eye(9)[k]
        moved = projected(cameras + step, points)[0] - projected(cameras - step, points)[0]
        np.testing.assert_allclose(moved / 2e-6, by_camera[:, :, k], rtol=1e-5, atol=1e-4)
    for k in range(3):
        step = 1e-6 * np.eye(3)[k]
        moved = projected(cameras, points + step)[0] - projected(cameras, points - step)[0]
        np.testing.assert_allclose(moved / 2e-6, by_point[:, :, k], rtol=1e-5, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 5, 13, 16, 17])
def test_the_program_reaches_the_minimum_that_minpack_reaches(seed: int, tmp_path: Path):
    """These seeds are known to converge: they guard against regressions, and tell no rate."""
    problem = bal_problem(seed)
    expected, found = by_scipy(problem), by_mor(problem, tmp_path)
    assert found.converged, found.words
    assert found.cost <= expected.cost * (1.0 + SAME)
