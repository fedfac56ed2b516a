"""What tells a unit or a σ: the controlled part of the observations that are changed, and the start values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from mor.api import pipeline
from mor.api.pipeline import make_problem
from mor.diagnose.control import control_hypotheses, control_tables, sigma_hypotheses
from mor.diagnose.hypothesis import Hypothesis, NetworkFit, Situation, controlled_part, with_group
from mor.diagnose.search import SolvedHypothesis, _beginnings, _in_order, promises
from mor.project.network import Network
from mor.quality.solution import Solved
from mor.solve.iterate import adjust
from tests.scenarios.planted_mistakes.survey import survey
from tests.scenarios.small_projects import LEVELLING, write


def _network(path: Path) -> Network:
    return pipeline.read_network(pipeline.read_document(path), path.parent)


def _situation(solved: Solved) -> Situation:
    begin = lambda changed: changed.start  # noqa: E731
    plain, network = solved.adjustment, solved.network
    return Situation(network, plain.start, plain.values, plain, make_problem, begin)


def _with_sigma(number: int, rows: slice, factor: float) -> Callable[[Network], Network]:
    def change(network: Network) -> Network:
        sigma = network.groups[number].sigma.copy()
        sigma[rows] *= factor
        return with_group(network, number, replace(network.groups[number], sigma=sigma))

    return change


def test_what_a_factor_of_sigma_costs_is_the_part_that_is_controlled(tmp_path: Path) -> None:
    """−2 ln of how likely observations are, whatever the unknowns: Σ ln σ² + ln det N + vᵀPv, from dense matrices."""
    solved = pipeline.solve_network(_network(write(tmp_path, LEVELLING)))
    situation, factor = _situation(solved), 1.1
    changed = _with_sigma(0, slice(0, 2), factor)(solved.network)
    after = adjust(make_problem(changed, situation.start, situation.values), situation.values)
    a = np.array([[1.0, 0.0], [-1.0, 1.0], [0.0, -1.0]])  # A is held: B - A, C - B, A - C

    def cost(network: Network) -> float:
        sigma = network.groups[0].sigma[:, 0]
        return float(np.sum(np.log(sigma**2)) + np.linalg.slogdet(a.T @ (a / sigma[:, None] ** 2))[1])

    stretch = -2.0 * np.log(factor) * controlled_part(situation, changed, after)
    assert -2.0 * stretch == pytest.approx(cost(changed) - cost(solved.network), rel=2e-3)


def test_control_that_nothing_else_measures_is_as_good_in_any_unit(tmp_path: Path) -> None:
    solved = pipeline.solve_network(_network(survey("single_station").write(tmp_path)))
    situation = _situation(solved)
    control = next(c for c in control_tables(situation) if c.observed)
    hypotheses = [h for h in control_hypotheses(situation) if h.cause == "control unit"]
    assert all(h.stretch != 0.0 for h in hypotheses)
    assert max(promises(situation, hypotheses)) < 0.0, "the start values fit as they are"
    feet = next(h for h in hypotheses if h.things[1] == "m for ft")
    wrong = feet.change(solved.network)
    situation = replace(situation, network=wrong, start=wrong.start)
    back = control_hypotheses(situation)
    best = back[int(np.argmax(promises(situation, back)))]
    assert (best.cause, best.things) == ("control unit", (control.label, "ft for m"))


def test_fixed_control_is_no_observation(tmp_path: Path) -> None:
    fixed = LEVELLING.replace("[B, 0, 0, 11], ", "").replace("[A, 0, 0, 10]", "[A, 0, 0, 10], [B, 0, 0, 11]")
    solved = pipeline.solve_network(_network(write(tmp_path, fixed)))
    hypotheses = control_hypotheses(_situation(solved))
    assert hypotheses
    assert all(h.stretch == 0.0 for h in hypotheses)


@pytest.mark.slow
def test_the_factor_of_sights_that_all_else_follows_is_told_by_their_redundancy(tmp_path: Path) -> None:
    sound = pipeline.solve_network(_network(survey("building").write(tmp_path)))
    groups = enumerate(sound.network.groups)
    number = next(k for k, g in groups if g.name == "directions to plates")
    wrong, there = _with_sigma(number, slice(None), 1e-3)(sound.network), sound.adjustment.values
    plain = adjust(make_problem(wrong, there, there), there)
    assert plain.outcome.is_solution
    situation = replace(_situation(sound), network=wrong, values=plain.values, solution=plain)
    found = [h for h in sigma_hypotheses(situation) if h.things == ("directions to plates",)]
    assert [h.line.split()[-1] for h in found] == ["1000"]


def test_what_start_values_speak_for_or_does_not_fit_itself_begins_from_new_ones(tmp_path: Path) -> None:
    solved = pipeline.solve_network(_network(write(tmp_path, LEVELLING)))
    unknown = solved.network.start["point"].copy()
    unknown[2, 2] = np.nan  # not all start values are given: they would have to be worked out
    network = replace(solved.network, start={**solved.network.start, "point": unknown})
    anew = {"marked": unknown}
    situation = replace(_situation(solved), network=network, begin=lambda changed: anew)
    situation.__dict__["misfitting"] = (np.array([[True], [False], [False]]),)

    def begins_anew(rows: slice, afresh: bool = True, spoken_for: bool = False) -> bool:
        hypothesis = Hypothesis("sigma unit", (), _with_sigma(0, rows, 2.0), "", afresh=afresh)
        changed = hypothesis.change(network)
        return any(begin is anew for begin in _beginnings(situation, changed, hypothesis, True, spoken_for))

    assert begins_anew(slice(0, 1)), "none of its rows fits"
    assert not begins_anew(slice(0, 3))
    assert begins_anew(slice(0, 3), spoken_for=True)
    assert not begins_anew(slice(0, 3), afresh=False, spoken_for=True)


def test_of_explanations_that_are_alike_the_start_values_choose() -> None:
    def hypothesis(cause: str) -> Hypothesis:
        return Hypothesis(cause, (), lambda network: network, "")

    fits = [NetworkFit({}, 1.0, 1, length, 1.0) for length in (10.0, 12.0, 40.0)]
    tried = [
        SolvedHypothesis(hypothesis("sigma unit"), fits[0], 0.0),
        SolvedHypothesis(hypothesis("control unit"), fits[1], 600.0),
        SolvedHypothesis(hypothesis("axes exchanged"), fits[2], 900.0),
    ]
    situation = partial(Situation, make=make_problem, begin=lambda changed: None)
    empty = situation(None, {}, {}, None)  # type: ignore[arg-type]
    empty.__dict__["fit"] = NetworkFit({}, 1e3, 1, 1000.0, 1.0)
    order = [one.hypothesis.cause for one in _in_order(empty, tried)]
    assert order == ["control unit", "sigma unit", "axes exchanged"]
