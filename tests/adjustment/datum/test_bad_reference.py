"""Free networks whose start values are as wrong as the network is large come to rest in their datum."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mor
from mor.solve.datum import corrections
from mor.solve.iterate import _as_a_whole, _begin, _into_datum
from mor.solve.normals import objective
from tests.scenarios.mixtures.ingredients import mixture
from tests.scenarios.mixtures.trial import tried
from tests.scenarios.seeded_networks import drawn
from tests.selection import slow_after


@pytest.mark.slow
@pytest.mark.parametrize("seed", [80044, 80298])
def test_free_network_comes_to_rest_far_from_its_reference(seed: int, tmp_path: Path) -> None:
    # By the first derivatives alone they swing about their datum, at the minimum to all digits.
    trial = tried(mixture(seed), tmp_path)
    assert trial.counts
    assert trial.reached, trial.words


@pytest.mark.parametrize("kind", slow_after(3, ["distances", "polar", "plane directions", "images"]))
def test_a_movement_of_the_whole_network_changes_no_observation_however_large_it_is(kind):
    found = mor.adjust(drawn(kind, 4, rough=1e-3).project()).solved.adjustment
    columns = found.problem.index.columns["point"]
    shift = found.defect.datum @ np.random.default_rng(5).standard_normal(found.defect.datum.shape[1])
    shift *= 20.0 / np.abs(shift[columns[columns >= 0]]).max()  # of 100 m
    moved = _as_a_whole(found, found.values, shift)
    assert objective(found.plan, moved) == pytest.approx(found.normals.objective, rel=1e-6)
    used = columns >= 0
    linear = found.values["point"][used] + shift[columns[used]]
    assert np.abs(moved["point"][used] - linear).max() < 10.0
    assert np.abs(moved["point"][used] - found.values["point"][used]).max() > 5.0


@pytest.mark.parametrize("kind", slow_after(3, ["distances", "polar", "plane directions", "images"]))
def test_a_network_turned_far_from_its_datum_is_brought_there_at_once(kind):
    found = mor.adjust(drawn(kind, 4, rough=1e-3).project()).solved.adjustment
    columns, null = found.problem.index.columns["point"], found.defect.datum
    shift = null @ np.random.default_rng(6).standard_normal(null.shape[1])
    shift *= 60.0 / np.abs(shift[columns[columns >= 0]]).max()  # of 100 m
    away = _as_a_whole(found, found.values, shift)
    state = _begin(found.plan, away)
    step = state.inverse.parts_of_step(state.normals)[0]
    back = _as_a_whole(state, away, _into_datum(state, step)[0], exactly=True)
    assert objective(found.plan, back) == pytest.approx(found.normals.objective, rel=1e-6)
    there = _begin(found.plan, back)
    missing = there.constraint.normals.T @ corrections(found.problem.datum, found.problem.index, back)
    sizes = np.linalg.norm(there.constraint.normals, axis=0)
    assert np.abs(missing / sizes).max() < 1e-6
