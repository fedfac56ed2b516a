"""The loop: truth recovered, dense Gauss–Newton reproduced, far starts reached, and every way it can end."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mor.model.parameters import move
from mor.solve.iterate import Outcome, SolverSettings, adjust
from tests.dense_reference import dense_system
from tests.scenarios.scenes import (
    OBJECT_POINTS,
    Scene,
    coordinates,
    levelling_network,
    mixed_network,
    photo_block,
    plane_network,
    solve,
)

NETWORKS = {
    "mixed": (mixed_network, False),
    "plane, distances": (plane_network, True),
    "plane, directions": (lambda: plane_network(distances=False, directions=True), True),
    "levelling": (levelling_network, True),
    "bundle": (photo_block, True),
    "bundle with a scale bar": (lambda: photo_block(scale_bar=True), True),
}
EACH = pytest.mark.parametrize("network", NETWORKS)


@EACH
def test_noise_free_data_give_back_the_truth(network):
    make, free = NETWORKS[network]
    scene, points = make()
    adjustment = solve(scene, None, points if free else None, disturbed=1e-2)
    truth = np.array([scene.truth["point"][name] for name in points])
    size = np.ptp(truth, axis=0).max()
    np.testing.assert_allclose(coordinates(adjustment, points), truth, atol=1e-8 * size)
    assert adjustment.normals.objective < 1e-10
    assert len(adjustment.iterations) < 12
    if not free:
        np.testing.assert_allclose(adjustment.values["rotation"], scene.values()["rotation"], atol=1e-9)


def test_the_solution_is_that_of_a_dense_adjustment():
    scene, _ = mixed_network()
    problem, values = scene.problem(np.random.default_rng(6)), scene.start(1e-3)
    adjustment = adjust(problem, values)
    for _ in range(8):
        dense = dense_system(problem, values)
        lower = np.linalg.cholesky(dense.covariance)
        white, size = np.linalg.solve(lower, dense.A), np.linalg.norm(dense.A, axis=0)
        step = np.linalg.lstsq(white / size, np.linalg.solve(lower, dense.l), rcond=None)[0] / size
        values = move(problem.index, values, step)
    for kind in values:
        np.testing.assert_allclose(adjustment.values[kind], values[kind], atol=1e-9)
    dense = dense_system(problem, values)
    assert adjustment.normals.objective == pytest.approx(dense.l @ dense.weights @ dense.l, rel=1e-10)


@EACH
def test_at_the_solution_the_gradient_vanishes(network):
    make, free = NETWORKS[network]
    scene, points = make()
    adjustment = solve(scene, np.random.default_rng(3), points if free else None)
    dense = dense_system(adjustment.problem, adjustment.values)
    gradient = dense.A.T @ dense.weights @ dense.l
    assert np.abs(gradient / np.sqrt(np.diagonal(dense.normal))).max() < 1e-6


def test_a_far_start_is_reached_without_ever_getting_worse():
    scene, points = photo_block(scale_bar=True)
    for name in ("P0", "P5", "P6", "P11"):
        scene.free["point"][name] = np.zeros(3, dtype=bool)
    problem = scene.problem(np.random.default_rng(2))
    near = adjust(problem, scene.start(1e-3))
    far = adjust(problem, scene.start(0.45, seed=5))
    assert far.outcome is Outcome.CONVERGED
    assert any(iteration.damping > 0.0 for iteration in far.iterations)
    assert far.iterations[-1].damping == 0.0
    objectives = [iteration.objective for iteration in far.iterations]
    assert all(after <= before * (1 + 1e-9) for before, after in pairwise(objectives))
    np.testing.assert_allclose(coordinates(far, points), coordinates(near, points), atol=1e-9)


def test_what_the_watcher_sees_is_what_is_kept():
    scene, points = photo_block()
    seen = []
    adjustment = adjust(scene.problem(None, points), scene.start(1e-2), watch=seen.append)
    assert tuple(seen) == adjustment.iterations
    assert [iteration.number for iteration in seen] == list(range(1, len(seen) + 1))


def test_too_few_iterations_are_said_to_be_too_few():
    scene, points = photo_block()
    problem = scene.problem(None, points)
    adjustment = adjust(problem, scene.start(1e-2), SolverSettings(max_iterations=1))
    assert adjustment.outcome is Outcome.NOT_CONVERGED
    assert len(adjustment.iterations) == 1


def test_a_loose_network_is_singular_before_anything_is_solved():
    scene, points = photo_block()
    scene.add("point", "unseen", [0.0, 0.0, 0.0])
    adjustment = adjust(scene.problem(None, points), scene.start(1e-2))
    assert adjustment.outcome is Outcome.SINGULAR
    assert adjustment.iterations == ()
    assert "not determined" in adjustment.reason


def test_noise_free_data_of_one_observation_per_unknown_converge():
    scene = Scene()
    scene.add("point", "A", [0.0, 0.0, 0.0], free=False)
    scene.add("point", "B", [30.0, 40.0, 0.0], free=(True, True, False))
    scene.observe("horizontal_distance", "A", None, "B", None, sigma=1e-3)
    scene.observe("bearing", "A", None, "B", None, sigma=1e-6)
    adjustment = solve(scene, disturbed=1.0)
    np.testing.assert_allclose(coordinates(adjustment, ["B"]), [[30.0, 40.0, 0.0]], atol=1e-9)


def test_start_values_are_left_alone():
    scene, points = photo_block()
    start = scene.start(1e-2)
    before = {kind: array.copy() for kind, array in start.items()}
    adjust(scene.problem(None, points), start)
    for kind, array in before.items():
        np.testing.assert_array_equal(start[kind], array)


@pytest.mark.parametrize("factor", [1e-3, 1e3, 1e6])
def test_the_length_unit_does_not_matter(factor):
    """The same block in kilometres, millimetres and micrometres."""

    def adjusted(unit):
        scene, points = photo_block(scale_bar=True)
        problem = scene.problem(np.random.default_rng(8), points)
        start = scene.start(1e-3)
        start["point"] = start["point"] * unit
        image, bar = problem.groups
        bar = replace(bar, observed=bar.observed * unit, sigma=bar.sigma * unit)
        reference = {"point": problem.datum.reference["point"] * unit}
        problem = replace(problem, groups=(image, bar), datum=problem.datum._replace(reference=reference))
        return adjust(problem, start), points

    one, points = adjusted(1.0)
    other, _ = adjusted(factor)
    assert other.outcome is Outcome.CONVERGED
    assert sorted(other.defect.movements) == sorted(one.defect.movements)
    np.testing.assert_allclose(coordinates(other, points) / factor, coordinates(one, points), atol=1e-9)


def test_large_coordinates_do_not_matter():
    """Two networks in a plane, one of them some 5 000 km from the origin."""
    results = []
    for shift in ([0.0, 0.0, 0.0], [3.5e6, 5.4e6, 0.0]):
        scene, points = plane_network(directions=True)
        for name in points:
            scene.truth["point"][name] = scene.truth["point"][name] + shift
        adjustment = solve(scene, np.random.default_rng(5), points, disturbed=1e-3)
        assert set(adjustment.defect.movements) == {"translation X", "translation Y", "rotation Z"}
        results.append(coordinates(adjustment, points) - shift)
    np.testing.assert_allclose(results[1], results[0], atol=1e-7)


def test_a_mirrored_or_turned_object_gives_the_turned_result():
    turn = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    plain, points = photo_block(scale_bar=True)
    turned, _ = photo_block(scale_bar=True)
    for name in turned.truth["point"]:
        turned.truth["point"][name] = turn @ turned.truth["point"][name]
    for name in turned.truth["rotation"]:
        turned.truth["rotation"][name] = turned.truth["rotation"][name] @ turn.T
    results = [solve(s, np.random.default_rng(9), points, disturbed=1e-4) for s in (plain, turned)]
    expected = coordinates(results[0], points) @ turn.T
    np.testing.assert_allclose(coordinates(results[1], points), expected, atol=1e-9 * np.ptp(OBJECT_POINTS))
