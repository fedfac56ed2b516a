"""Blocks without a datum, with far points, gross errors and rough start values, against MINPACK."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import make_problem, read_document, read_network
from mor.solve.iterate import moved_by
from mor.solve.normals import make_plan
from tests.scenarios.bal_problems import SAME, Minimum, bal_problem, by_mor, by_scipy, projected


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


def test_steps_change_the_inverse_distance_of_points_that_rays_meet(tmp_path: Path):
    path = tmp_path / "problem.txt"
    path.write_text(bal_problem(0).text)
    network = read_network(read_document(path), tmp_path)
    plan = make_plan(make_problem(network, network.start, network.start))
    points, cameras = plan.seen_points
    assert len(points) == len(bal_problem(0).points)
    values, columns = network.start, plan.problem.index.columns["point"]
    away = values["point"][points] - values["point"][cameras]
    for part in (-3.0, 0.5, 3.0):
        step = np.zeros(plan.problem.index.count)
        step[columns[points]] = part * away
        moved = moved_by(plan, values, step)["point"]
        times = 1.0 / (1.0 - min(part, 0.9))
        np.testing.assert_allclose(moved[points] - values["point"][cameras], times * away, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", [1001, 1004, 1034])
def test_far_points_and_gross_errors_end_at_the_minimum(seed: int, tmp_path: Path):
    """The points 16 of 1004 and 79 of 1034 decide: one moves to infinity, the other must not."""
    problem = bal_problem(seed)
    lowest = {1001: 5522.92874295, 1004: 4008.36779024, 1034: 22403.34787570}[seed]
    found = by_mor(problem, tmp_path)
    assert found.converged, found.words
    assert found.cost <= lowest * (1.0 + SAME)
    assert found.iterations <= 40


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 16, 17])
def test_the_program_reaches_the_minimum_that_minpack_reaches(seed: int, tmp_path: Path):
    """These seeds are known to converge: they guard against regressions, and tell no rate."""
    problem = bal_problem(seed)
    expected, found = by_scipy(problem), by_mor(problem, tmp_path)
    assert found.converged, found.words
    assert "left out" not in found.words
    assert found.cost <= expected.cost * (1.0 + SAME)


@pytest.mark.slow
def test_a_point_ends_at_infinity_where_the_test_says_nothing_against_it(tmp_path: Path):
    problem = bal_problem(5)
    expected, found = by_scipy(problem), by_mor(problem, tmp_path)
    redundancy = 2 * len(problem.xy) - problem.cameras.size - problem.points.size + 7
    assert "left out" not in found.words
    assert "87 at infinity" in found.words
    assert found.is_as_low_as(expected, redundancy), found.words


@pytest.mark.slow
def test_no_solution_is_told_that_lies_above_what_the_iteration_came_down_to(tmp_path: Path):
    """A point runs to infinity, so slowly that nothing converges; other minima lie twelve times as high."""
    found = by_mor(bal_problem(5057), tmp_path)
    assert found.cost < 63.2, found.words


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "lowest"), [(15267, 28522.81579), (15327, 185661.72782), (15378, 7679.32486)])
def test_points_at_infinity_do_not_end_above_the_minimum_without_them(seed: int, lowest: float, tmp_path: Path):
    """The lowest is that of Ceres Solver from the same start; more points at infinity may cost what may be chance."""
    problem = bal_problem(seed)
    found = by_mor(problem, tmp_path)
    redundancy = 2 * len(problem.xy) - problem.cameras.size - problem.points.size + 7
    assert found.is_as_low_as(Minimum(lowest, 0, True), redundancy), found.words
