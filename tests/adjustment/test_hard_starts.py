"""An iteration ends at a minimum where scipy finds one: contradicting observations, bent valleys, far start values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mor
from mor.api.pipeline import determinable_start, make_problem, read_document, read_network
from mor.model.parameters import move
from mor.quality.assessment import assess, checked
from mor.quality.solution import Solved
from mor.report.summary import summary
from mor.solve.iterate import Outcome, adjust
from tests.scenarios.hard_starts import by_scipy, hard_start
from tests.scenarios.seeded_networks import drawn
from tools.far_start_trials import _dense


@pytest.mark.parametrize("first", [0, *(pytest.param(first, marks=pytest.mark.slow) for first in range(20, 500, 20))])
def test_an_adjustment_converges_where_scipy_does(first):
    ended, lower = [], 0
    for seed in range(first, first + 20):
        case = hard_start(seed)
        converges, expected = by_scipy(case.problem, case.start)
        if not converges:
            continue
        with np.errstate(all="ignore"):
            found = adjust(case.problem, case.start)
        ended.append(found.outcome is Outcome.CONVERGED)
        lower += found.normals.objective <= expected * (1.0 + 1e-9) + 1e-9
    assert sum(ended) >= len(ended) - 1
    assert lower >= len(ended) - 2


CASES = Path(__file__).parents[1] / "cases"


def _adjusted(project):
    network = read_network(read_document(project), project.parent)
    with np.errstate(all="ignore"):
        network, start = determinable_start(network)
        return adjust(make_problem(network, start, start), start)


@pytest.mark.slow
def test_a_bent_valley_takes_no_fifty_iterations():
    found = _adjusted(CASES / "mixture_in_a_bent_valley.yaml")
    assert found.outcome is Outcome.CONVERGED
    assert found.normals.objective == pytest.approx(259.316547, rel=1e-8)
    assert len(found.iterations) < 20


def test_a_point_that_a_touching_distance_holds_is_a_solution_with_all_redundancy():
    """The distance is as long as the perpendicular to the line of the point: it holds the point to second order."""
    found = _adjusted(CASES / "line_control" / "project.yaml")
    assert found.outcome is Outcome.CONVERGED
    quality = assess(found)
    assert quality.redundancy_sum == pytest.approx(139.0, abs=1e-6)
    assert checked(quality).outcome is Outcome.CONVERGED


def test_an_iteration_whose_steps_alternate_goes_on_to_the_minimum():
    """There a movement changes no observation to first order. What binds it is the curvature of the sum of squares."""
    found = _adjusted(CASES / "fixed_components" / "project.yaml")
    assert found.outcome is Outcome.CONVERGED
    assert found.normals.objective == pytest.approx(425.614452870, rel=1e-10)
    quality = assess(found)
    assert quality.redundancy == 391
    assert quality.redundancy_sum == pytest.approx(391.0, abs=1e-6)
    assert checked(quality).outcome is Outcome.CONVERGED
    network = read_network(read_document(CASES / "fixed_components" / "project.yaml"), CASES / "fixed_components")
    data = summary(Solved(network, found, quality))
    assert data["redundancy"] == data["observations"] - data["unknowns"] + data["defect"]
    assert len(data["movements"]) == data["defect"] == 1


def test_what_the_curvature_binds_has_its_standard_deviation_from_the_sum_of_squares():
    """Along the movement, v'Pv rises by 1 at one standard deviation, all other unknowns adjusted to it."""
    found = _adjusted(CASES / "fixed_components" / "project.yaml")
    weak = found.inverse.weak[:, 0]
    column = int(np.argmax(np.abs(weak)))
    rises = []
    for sign in (1.0, -1.0):
        start = move(found.problem.index, found.values, 0.3 * sign * weak)
        rises.append(_constrained(found, start, column))
    assert np.mean(rises) == pytest.approx(0.09, rel=0.1)


def _constrained(found, values, column):
    """What v'Pv rises by where one unknown is held and the others are adjusted, by dense Gauss-Newton steps."""
    others = np.delete(np.arange(found.problem.index.count), column)
    for _ in range(6):
        misclosures, J = _dense(found.problem, values)
        step = np.zeros(found.problem.index.count)
        step[others] = np.linalg.lstsq(J[:, others], -misclosures, rcond=None)[0]
        values = move(found.problem.index, values, step)
    return float(np.sum(_dense(found.problem, values)[0] ** 2)) - found.normals.objective


def test_places_that_coincide_where_the_adjustment_starts_are_moved_apart():
    network = drawn("plane directions and distances", 1, rough=1e-3)
    network.given[1] = network.given[0]
    apart, expected = (
        mor.adjust(network.project()),
        mor.adjust(drawn("plane directions and distances", 1).project()),
    )
    assert apart.converged
    assert apart.solved.adjustment.normals.objective == pytest.approx(expected.solved.adjustment.normals.objective)
