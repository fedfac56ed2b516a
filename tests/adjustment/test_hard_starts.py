"""An iteration ends at a minimum where scipy finds one: contradicting observations, bent valleys, far start values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.adjustment.solve import adjust
from mor.adjustment.state import SINGULAR_MINIMUM, Outcome
from mor.pipeline import read_document, read_network
from mor.preparation import determinable_start, make_problem
from mor.quality.assess import assess
from mor.quality.diagnosis.self_check import checked
from tests.scenarios.hard_starts import by_scipy, hard_start


@pytest.mark.parametrize(
    "first", [0, *(pytest.param(first, marks=pytest.mark.slow) for first in range(20, 500, 20))]
)
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
    """At the minimum a turn of the network changes no observation, and that is the outcome."""
    found = _adjusted(CASES / "fixed_components" / "project.yaml")
    assert found.normals.objective == pytest.approx(425.614452870, rel=1e-10)
    assert found.reason == SINGULAR_MINIMUM
