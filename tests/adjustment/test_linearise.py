"""Misclosures and Jacobians of groups: wrapping, what is not observed, what is fixed, and how unknowns move."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.parameters import move
from mor.solve.problem import linearise, misclosures, rotation_tangents
from tests.dense_reference import dense_system
from tests.scenarios.scenes import GON, Scene, mixed_network, plane_network

EVERYTHING = slice(None)


@pytest.mark.parametrize(
    ("reading", "expected"), [(399.9999, -2e-4), (0.0003, 2e-4), (400.0003, 2e-4), (-0.0001, -2e-4)]
)
def test_a_direction_across_zero_has_a_small_misclosure(reading, expected):
    scene = Scene()
    scene.add("point", "A", [0.0, 0.0, 0.0], free=False)
    scene.add("point", "B", [100.0 * np.sin(1e-4 * GON), 100.0 * np.cos(1e-4 * GON), 0.0])
    scene.observe("bearing", "A", None, "B", None, sigma=1e-5, observed=reading * GON)
    problem = scene.problem()
    found = misclosures(problem.groups[0], scene.values())
    assert found[0, 0] == pytest.approx(expected * GON, abs=1e-14)


def test_an_angle_over_half_a_circle_is_the_same_as_its_negative():
    scene = Scene()
    for name, xy in (("S", [0, 0]), ("L", [-1, 5]), ("R", [1, 5])):
        scene.add("point", name, [*xy, 0])
    beta = 2.0 * np.arctan2(1.0, 5.0)
    scene.observe("angle", "S", "L", "R", sigma=1e-5, observed=beta)
    scene.observe("angle", "S", "R", "L", sigma=1e-5, observed=2.0 * np.pi - beta)
    np.testing.assert_allclose(misclosures(scene.problem().groups[0], scene.values()), 0.0, atol=1e-15)


def test_distances_do_not_wrap():
    scene, _ = plane_network()
    scene.observe("horizontal_distance", "N0", None, "N1", None, sigma=1e-3, observed=70.0)
    group = scene.problem().groups[0]
    assert misclosures(group, scene.values())[-1, 0] == pytest.approx(70.0 - np.hypot(60.0, 5.0), abs=1e-12)


def test_what_is_not_observed_leaves_no_trace():
    scene, _ = plane_network(distances=False, directions=True)
    problem = scene.problem()
    rows = linearise(problem.groups[0], problem.index, scene.start(0.01), None, EVERYTHING)
    np.testing.assert_array_equal(rows.misclosure[:, 1], 0.0)
    np.testing.assert_array_equal(rows.jacobian[:, 1], 0.0)
    assert np.isnan(misclosures(problem.groups[0], scene.values())[:, 1]).all()


def test_slots_that_are_fixed_throughout_are_left_out():
    scene, _ = plane_network()
    problem = scene.problem()
    rows = linearise(problem.groups[0], problem.index, scene.values(), None, EVERYTHING)
    assert rows.jacobian.shape == (10, 1, 6)  # two points; no heights, no distance meter
    assert rows.columns.shape == (10, 6)


def test_a_choice_of_rows_is_the_choice_of_all_rows():
    scene, _ = plane_network(distances=False, directions=True)
    problem, values = scene.problem(), scene.start(0.01)
    tangent = rotation_tangents(problem.index, values)
    whole = linearise(problem.groups[0], problem.index, values, tangent, EVERYTHING)
    chosen = np.array([7, 3, 12])
    part = linearise(problem.groups[0], problem.index, values, tangent, chosen)
    for one, other in zip(part, whole, strict=True):
        np.testing.assert_array_equal(one, other[chosen])


def _by_moves(problem, values, step):
    """Derivatives of the computed values by every unknown, from what a step of the unknown does to the misclosure."""
    columns = []
    for unknown in range(problem.index.count):
        direction = np.zeros(problem.index.count)
        direction[unknown] = step
        after = move(problem.index, values, direction)
        before = move(problem.index, values, -direction)
        change = [misclosures(g, before) - misclosures(g, after) for g in problem.groups]
        columns.append(np.concatenate([part.ravel() for part in change]) / (2.0 * step))
    return np.stack(columns, axis=1)


def test_jacobians_are_those_of_the_moves_partly_free_rotations_included():
    scene, _ = mixed_network()
    # one station free but for its turn about its own y axis, one with φ fixed, both tilted; one levelled
    scene.free["rotation"]["S1"] = np.array([True, False, True])
    scene.truth["rotation"]["S1"] = scene.truth["rotation"]["I0"]
    scene.by_axes.add("S1")
    scene.free["rotation"]["I1"] = np.array([True, False, True])
    problem = scene.problem()
    values = scene.start(0.02)
    tangent = rotation_tangents(problem.index, values)
    numeric = _by_moves(problem, values, 1e-6)
    first = 0
    for group in problem.groups:
        rows = linearise(group, problem.index, values, tangent, EVERYTHING)
        m = group.observed.shape[1]
        for i in range(group.count):
            analytic = np.zeros((m, problem.index.count))
            for k, column in enumerate(rows.columns[i]):
                if column >= 0:
                    analytic[:, column] += rows.jacobian[i, :, k]
            expected = numeric[first + i * m : first + (i + 1) * m]
            np.testing.assert_allclose(analytic, expected, atol=2e-7, err_msg=f"{group.name} {i}")
        first += group.observed.size


def test_the_dense_reference_of_these_tests_agrees():
    scene, _ = mixed_network()
    problem, values = scene.problem(), scene.start(0.02)
    dense = dense_system(problem, values)
    np.testing.assert_allclose(dense.A, _by_moves(problem, values, 1e-6)[dense.entries], atol=2e-7)
