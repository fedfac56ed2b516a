"""The order in which hypotheses are tried."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mor.api import pipeline
from mor.api.pipeline import make_problem
from mor.diagnose.angles import circle_hypotheses
from mor.diagnose.heights import _reductions_of_lines
from mor.diagnose.hypothesis import Situation, with_observed
from mor.diagnose.names import _alone, _cost, _exchanged
from mor.diagnose.search import promises
from mor.model.observation_types import PLAIN_TYPES
from mor.model.parameters import index_unknowns
from mor.project.network import Network
from mor.quality.plausibility import beyond_any_instrument
from mor.quality.solution import Solved
from mor.solve.iterate import adjust
from tests.scenarios.planted_mistakes.survey import Survey, survey
from tests.scenarios.small_projects import mor


def _network(of: Survey, folder: Path) -> Network:
    path = of.write(folder)
    return pipeline.read_network(pipeline.read_document(path), folder)


def _situation(solved: Solved) -> Situation:
    """That of a solved network, whatever fits or not."""
    plain = solved.adjustment
    make = make_problem
    return Situation(solved.network, plain.start, plain.values, plain, make, lambda n: n.start)


def _elevations_at(station: str) -> Survey:
    """The bridge with elevations for zenith angles at one of its pillars."""
    bridge = survey("bridge")
    for row in bridge.tables["directions.csv"]:
        if row["station"] == station:
            row["zenith"] = f"{(100.0 - float(row['zenith'])) % 400.0:.4f}"
    return bridge


@pytest.mark.slow
def test_the_station_with_elevations_for_zenith_angles_is_named(tmp_path: Path) -> None:
    _, found = pipeline.diagnose_network(_network(_elevations_at("P1"), tmp_path), lambda _: True)
    first = found.offered[0].hypothesis
    assert first.cause == "elevation for zenith"
    assert "P1" in first.things


def test_the_station_that_does_not_fit_is_changed_before_all_of_them(tmp_path: Path) -> None:
    solved = pipeline.solve_network(_network(survey("bridge"), tmp_path))
    directions = solved.network.groups[0]
    mine = np.array([name == "P2" for name in directions.references[0]])
    situation = _situation(solved)
    own, *others = situation.misfitting
    wrong = (own | mine[:, None], *others)
    situation.__dict__["misfitting"] = wrong
    hypotheses = [h for h in circle_hypotheses(situation) if h.cause == "circle sense"]
    assert {h.things[0] for h in hypotheses} == {"P2", directions.name}
    best = hypotheses[int(np.argmax(promises(situation, hypotheses)))]
    assert best.things[0] == "P2"


def test_the_reduction_by_the_other_sign_is_that_of_an_adjustment_with_it(tmp_path: Path) -> None:
    solved = pipeline.solve_network(_network(survey("building"), tmp_path))
    network, plain = solved.network, solved.adjustment
    groups = enumerate(network.groups)
    number = next(k for k, g in groups if g.type == PLAIN_TYPES["height_difference"])
    promised = _reductions_of_lines(_situation(solved), number, network.groups[number])
    row = int(np.argmin(np.abs(network.groups[number].observed[:, 0])))
    changed = with_observed(network, number, np.array([row]), np.negative)
    again = adjust(make_problem(changed, plain.start, plain.values), plain.values)
    assert again.outcome.is_solution
    rise = again.normals.objective - plain.normals.objective
    assert rise > 1e3
    assert rise == pytest.approx(-promised[row], rel=3e-3)  # to first order


def test_a_station_alone_is_where_the_network_has_it_and_an_exchange_spoils_it(tmp_path: Path) -> None:
    solved = pipeline.solve_network(_network(survey("bridge"), tmp_path))
    situation = _situation(solved)
    alone = _alone(solved.adjustment.problem, situation, "P3")
    group = alone.problem.groups[0]
    assert all(name == "P3" for name in group.references[0])
    sound = _cost(situation, alone.problem)
    assert sound < 2.0 * group.observed.size
    swapped = _exchanged(alone.problem, 0, (0, 3))
    assert _cost(situation, swapped) > sound + 30.0
    assert _cost(situation, _exchanged(swapped, 0, (0, 3))) == pytest.approx(sound)


def test_an_exchange_at_a_station_that_is_held(tmp_path: Path) -> None:
    solved = pipeline.solve_network(_network(survey("bridge"), tmp_path))
    problem = solved.adjustment.problem
    held = {kind: blocks._replace(free=np.zeros_like(blocks.free)) for kind, blocks in problem.index.blocks.items()}
    alone = _alone(replace(problem, index=index_unknowns(held)), _situation(solved), "P3")
    assert alone.problem.index.count == 0
    sound = _cost(_situation(solved), alone.problem)
    assert np.isfinite(sound)
    assert _cost(_situation(solved), _exchanged(alone.problem, 0, (0, 3))) > sound + 30.0


@pytest.mark.parametrize(("factor", "expected"), [(1.0, 0), (1e-3, 1), (1e4, -1)])
def test_sigmas_that_no_instrument_has(factor: float, expected: int, tmp_path: Path) -> None:
    network = _network(survey("aerial_strip"), tmp_path)
    group = replace(network.groups[0], sigma=network.groups[0].sigma * factor)
    network = replace(network, groups=(group, *network.groups[1:]))
    assert beyond_any_instrument(network, group) == expected


def test_what_the_observations_cannot_tell_apart_is_said_and_the_smaller_edit_comes_first(
    tmp_path: Path,
) -> None:
    """The height of an instrument at a pillar, or that of every target there and the height of the pillar itself."""
    wrong = survey("bridge")
    heights = {row["id"]: row for row in wrong.rows(wrong.entries("stations")[0])}
    heights["P5"]["height"] = "0.5"
    run = mor("diagnose", wrong.write(tmp_path), "--json", "-q")
    instrument, target = json.loads(run.out)["offered"][:2]
    assert (instrument["cause"], target["cause"]) == ("instrument height", "target height")
    assert instrument["things"] == target["things"] == ["P5"]
    assert instrument["vtpv_after"] == pytest.approx(target["vtpv_after"], abs=1e-3)
    assert (instrument["like_the_first"], target["like_the_first"]) == (False, True)
