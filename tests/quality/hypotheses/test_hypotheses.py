"""Hypotheses about mistakes: the right one is offered first, none where nothing is wrong, and its numbers are true."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_projects import LEVELLING, write

from mor import pipeline
from mor.adjustment.solve import adjust
from mor.quality.hypotheses.description_length import cost_of_choice, cost_of_residuals
from mor.quality.hypotheses.heights import _hypothesis, _reductions, _sights
from mor.quality.hypotheses.search import is_rejected
from mor.quality.hypotheses.situation import Situation
from mor.quality.solved import Solved
from tests.planted_mistakes.survey import survey
from tests.planted_mistakes.trial import trial

CASES = [("exchanged_in_image", 0), ("misnumbered_at_station", 1), ("offset", 1)]
"""A few that are quick; ``python -m tests.planted_mistakes`` has all kinds."""


def _solved(path: Path) -> Solved:
    document = pipeline.read_document(path)
    return pipeline.solve_network(pipeline.read_network(document, path.parent))


@pytest.mark.parametrize(("kind", "seed"), CASES)
def test_a_planted_mistake_is_the_first_hypothesis(kind: str, seed: int) -> None:
    found = trial(kind, seed)
    assert found.rejected
    assert found.place == 0, found


@pytest.mark.parametrize("name", ["bridge", "aerial_strip"])
def test_nothing_is_offered_where_nothing_is_wrong(name: str, tmp_path: Path) -> None:
    solved = _solved(survey(name).write(tmp_path))
    assert solved.quality is not None
    assert not is_rejected(solved.quality, solved.network)
    assert solved.causes == ()


def test_a_rejected_network_with_checks(tmp_path: Path) -> None:
    check = (
        "checks:\n  - {type: height_difference, columns: [from, to, dz, sigma], rows: [[A, B, 1, 0.001]]}\n"
    )
    solved = _solved(write(tmp_path, LEVELLING.replace("1.002", "1.102") + check))
    assert solved.quality is not None
    assert is_rejected(solved.quality, solved.network)


def test_the_reduction_by_a_height_is_that_of_an_adjustment_with_it(tmp_path: Path) -> None:
    solved = _solved(survey("bridge").write(tmp_path))
    network, plain = solved.network, solved.adjustment
    sights = [one for one in _sights(network) if one.things[0] in ("P4", "NE1")]
    situation = Situation(
        network, plain.start, plain.values, plain, pipeline.make_problem, lambda changed: changed.start
    )
    promised = _reductions(plain, sights)
    for one, reduction in zip(sights, promised, strict=True):
        changed = _hypothesis(situation, one, 1).change(network)
        values = {**plain.values, "height": changed.start["height"]}
        again = adjust(pipeline.make_problem(changed, plain.start, values), values)
        if not again.outcome.is_solution:
            assert reduction == 0.0, "a height that nothing else controls promises nothing"
            continue
        fallen = plain.normals.objective - again.normals.objective
        assert fallen == pytest.approx(reduction, abs=1e-4)
    assert max(promised) > 1.0


def test_residuals_cost_their_square_and_gross_errors_their_name_and_size() -> None:
    sizes = [np.array([[0.5, 2.0]]), np.array([[1e6]])]
    assert cost_of_residuals(sizes, 100) == pytest.approx(0.25 + 4.0 + 2.0 * np.log(100) + 2.0 * np.log(1e6))
    assert cost_of_choice(100, 5, 2, 0.5) == pytest.approx(2.0 * np.log(100) + 2.0 * np.log(5) - 1.0)
