"""What observations do not determine is left out, but not what an iteration that went astray does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import determinable_start, make_problem, read_document, read_network
from mor.quality import determinability
from mor.quality.outliers import Attempt
from mor.solve.datum import beside
from mor.solve.iterate import Outcome, SolverSettings, adjust

BRIDGE = Path(__file__).parents[3] / "sample_projects" / "bridge" / "project.yaml"


@pytest.mark.parametrize(("misfit", "asked"), [(1e20, False), (0.0, True)])
def test_what_is_singular_where_an_iteration_ran_away_is_not_left_out(
    misfit: float, asked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    document = read_document(BRIDGE)
    document.data["settings"] = {"undetermined": "leave_out"}
    network, start = determinable_start(read_network(document, BRIDGE.parent))
    begun = adjust(make_problem(network, start, start), start, SolverSettings(max_iterations=1))
    normals = begun.normals._replace(objective=misfit)
    ended = Attempt(begun._replace(outcome=Outcome.SINGULAR, normals=normals))
    means = determinability.Means(
        lambda some, values: make_problem(some, values, values), lambda *_: ended, lambda *_: ended, 3.3
    )
    calls: list[object] = []
    monkeypatch.setattr(determinability, "without_moved", lambda *_: calls.append(0))
    determinability.adjust_determinable(network, start, means)
    assert bool(calls) is asked


def test_a_point_that_ran_away_does_not_move_the_others_far() -> None:
    network, start = determinable_start(read_network(read_document(BRIDGE), BRIDGE.parent))
    problem = make_problem(network, start, start)
    far = {**start, "point": start["point"].copy()}
    away = int(np.flatnonzero((problem.index.columns["point"] >= 0).all(axis=1))[0])
    far["point"][away] = 1e12
    size = np.ptp(start["point"], axis=0).max()
    for values in (start, far):
        moved = np.delete(beside(problem, values)["point"] - values["point"], away, axis=0)
        assert 1e-6 * size < np.abs(moved).max() < 0.1 * size
