"""The end of an iteration: where nothing is left to do, and not before; slow convergence is followed, noise is not."""

from __future__ import annotations

import numpy as np
import pytest

from mor.solve.iterate import (
    ACCURACY,
    Iteration,
    Outcome,
    Patience,
    SolverSettings,
    adjust,
    left_after,
    round_off,
    settles,
    stands_still,
    without_progress,
)
from mor.solve.normals import build_normals, make_plan
from tests.scenarios.scenes import mixed_network, photo_block, plane_network


def _history(*changes, objective=100.0, damping=0.0):
    return tuple(Iteration(k, objective, change, damping, 10) for k, change in enumerate(changes, start=1))


class _State:
    def __init__(self, *changes, damping=0.0):
        self.iterations = _history(*changes, damping=damping)


@pytest.mark.parametrize("rate", [0.1, 0.5, 0.9])
def test_what_is_left_bounds_the_sum_of_all_further_steps(rate):
    steps = 1e-4 * rate ** np.arange(400)
    for k in range(1, 20):
        assert left_after(_State(*steps[:k]), steps[k]) >= steps[k + 1 :].sum()


def test_without_a_rate_nothing_is_promised():
    assert left_after(_State(), 1e-5) == np.inf
    assert left_after(_State(1e-3, damping=1e-4), 1e-5) == np.inf
    assert left_after(_State(), 0.1 * ACCURACY) <= ACCURACY


def test_steps_that_halve_are_followed_to_the_end():
    """4e-4 σ that still halves is no end: half of it is still to come."""
    assert left_after(_State(8e-4), 4e-4) > 1e-4


def test_a_standstill_is_twenty_iterations_that_lead_nowhere():
    assert stands_still(_history(*[3.0] * 20))
    period = np.tile([1.0, 0.5, 0.2, 0.02, 0.1], 4)
    assert settles(_history(*(0.05 * 0.9 ** np.arange(20) * period)))
    assert not settles(_history(*(0.05 * period)))
    assert not settles(_history(*(5.0 * 0.9 ** np.arange(20) * period)))
    falling = [Iteration(k, 100.0, 4.0, 1e-6 * 0.9**k, 10) for k in range(10)]
    assert settles(tuple(falling))
    assert settles((*falling[:-1], falling[-1]._replace(damping=0.0)))
    assert not settles((*falling[:-1], falling[-1]._replace(damping=0.6e-6)))
    assert not stands_still(_history(*[3.0] * 19))
    assert not stands_still(_history(*(100.0 * 0.8 ** np.arange(20))))
    assert not stands_still(_history(*(1e-3 * 0.9 ** np.arange(20))))
    assert stands_still(_history(*(100.0 * 0.95 ** np.arange(20))))
    assert stands_still(_history(*[3.0] * 12), Patience(6))
    assert not stands_still(_history(*[3.0] * 11), Patience(6))


def test_at_absurd_sums_of_squares_a_gain_of_a_twentieth_is_a_standstill():
    creeping = [step._replace(objective=1e9 * 0.998**step.number) for step in _history(*[3.0] * 20)]
    assert stands_still(tuple(creeping))
    assert not stands_still(tuple(step._replace(objective=1e-6 * step.objective) for step in creeping))


def test_an_iteration_whose_damping_falls_does_not_stand_still():
    falling = [step._replace(damping=1e-4 * 0.7**step.number) for step in _history(*[3.0] * 20)]
    assert not stands_still(tuple(falling))


def test_only_iterations_without_progress_count():
    steps = _history(*[3.0] * 100)
    assert without_progress(steps) == 100
    assert without_progress(()) == 0
    halving = tuple(step._replace(objective=100.0 * 0.9**step.number) for step in steps)
    assert without_progress(halving) == 1
    assert (
        without_progress(halving[:40] + tuple(one._replace(objective=halving[39].objective) for one in steps[:7])) == 8
    )


def test_round_off_is_that_of_the_steps_of_disturbed_coordinates():
    """Coordinates moved by their last digit change the next step by no more than the estimate, far from the origin."""
    scene, points = plane_network(directions=True)
    for name in points:
        scene.truth["point"][name] = scene.truth["point"][name] + [3.5e6, 5.4e6, 0.0]
    problem = scene.problem(np.random.default_rng(5), points)
    solution = adjust(problem, scene.start(1e-3))
    assert solution.outcome is Outcome.CONVERGED
    plan = make_plan(problem)
    normals = build_normals(plan, solution.values)
    estimate = round_off(plan, solution.values, normals, solution.inverse.weak)
    random = np.random.default_rng(7)
    changes = []
    for _ in range(20):
        values = {kind: array.copy() for kind, array in solution.values.items()}
        values["point"] *= 1.0 + np.finfo(float).eps * random.choice([-1.0, 0.0, 1.0], values["point"].shape)
        values["point"][:, 2] = 0.0
        there = build_normals(plan, values)
        step = solution.inverse.step(there)
        changes.append(float(np.sqrt(max(step @ there.rhs, 0.0))))
    assert max(changes) <= 2.0 * estimate
    assert estimate <= 1e3 * max(changes)


@pytest.mark.parametrize("make", [mixed_network, photo_block, plane_network])
def test_a_solution_is_a_solution_at_once(make):
    scene, points = make()
    free = points if make is not mixed_network else None
    problem = scene.problem(np.random.default_rng(1), free)
    first = adjust(problem, scene.start(1e-3))
    again = adjust(problem, first.values, SolverSettings(max_iterations=3))
    assert again.outcome is Outcome.CONVERGED
    assert len(again.iterations) <= 2
    np.testing.assert_allclose(again.values["point"], first.values["point"], atol=1e-10)
