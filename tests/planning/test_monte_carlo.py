"""Monte Carlo: the same sums whoever works them out; what is wrong with σ is found, what is right agrees."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from fractions import Fraction
from functools import partial

import numpy as np
import pytest

from mor.api.simulation import CHUNK, SimulationTask, by_processes, chunk_of, prepared, run_trial
from mor.cli import run
from mor.errors import InputError
from mor.plan.simulation import Finding, coverage_intervals, errors, findings, interval_noise, one_run
from tests.scenarios.batch_scenes import PLAN


@pytest.fixture
def trial(tmp_path):
    path = tmp_path / "project.yaml"
    path.write_text(PLAN, encoding="utf-8")
    return SimulationTask(path, "", 1)


def _told(count):
    pass


def _by_name(found) -> dict[str, Finding]:
    return {one.name: one for one in found}


@pytest.mark.slow
def test_theory_and_simulation_agree_where_the_sigmas_are_right(trial):
    ready = prepared(trial)
    tally = chunk_of(ready, 0, 400)
    found = _by_name(findings(ready.truth, tally))
    assert [name for name, one in found.items() if not one.agrees] == []
    assert found["coverage"].upper - found["coverage"].lower < 0.06
    assert found["power"].upper - found["power"].lower < 0.15


@pytest.mark.slow
def test_sigmas_that_are_too_small_are_found(trial):
    ready = prepared(trial)
    truth = ready.truth
    wrong = replace(
        truth,
        problem=replace(
            truth.problem,
            groups=tuple(replace(group, sigma=group.sigma * 1.5) for group in truth.problem.groups),
        ),
    )
    total = None
    for number in range(60):
        from mor.solve.iterate import adjust

        one = one_run(wrong, 1, number, lambda problem: adjust(_with_sigma_of(problem, truth.problem), truth.place))
        total = one if total is None else total + one
    found = _by_name(findings(truth, total))
    assert not found["variance"].agrees
    assert found["variance"].found == pytest.approx(2.25, rel=0.15)
    assert not found["coverage"].agrees
    assert found["coverage after"].agrees


def _with_sigma_of(problem, other):
    pairs = zip(problem.groups, other.groups, strict=True)
    return replace(problem, groups=tuple(replace(a, sigma=b.sigma) for a, b in pairs))


def test_errors_have_the_covariances_of_the_project(trial):
    ready = prepared(trial)
    problem = ready.truth.problem
    from mor.solve.problem import CorrelatedObservations

    covariance = 4e-6 * (0.5 * np.eye(10) + 0.5)
    problem = replace(problem, clusters=(CorrelatedObservations(np.arange(10), covariance),))
    generator = np.random.default_rng(5)
    drawn = np.array([errors(problem, generator)[0].ravel() for _ in range(4000)])
    assert np.allclose(np.cov(drawn.T), covariance, atol=4e-7)


@pytest.mark.slow
def test_bytes_are_the_same_whatever_the_jobs_and_however_often_interrupted(trial, tmp_path):
    path, more = str(trial.path), ["--runs", str(3 * CHUNK), "-q"]
    assert run(["simulate", path, "-o", str(tmp_path / "one"), *more]) == 0
    assert run(["simulate", path, "-o", str(tmp_path / "two"), *more, "--jobs", "2"]) == 0
    shutil.copytree(tmp_path / "one", tmp_path / "part")
    chunks = sorted((tmp_path / "part" / "runs").glob("*.npz"))
    assert len(chunks) == 3
    chunks[1].unlink()
    assert run(["simulate", path, "-o", str(tmp_path / "part"), *more]) == 0
    for name in ("montecarlo.json", "montecarlo.txt"):
        texts = {(tmp_path / folder / name).read_bytes() for folder in ("one", "two", "part")}
        assert len(texts) == 1
    data = json.loads((tmp_path / "one" / "montecarlo.json").read_text())
    assert data["runs"] == data["solved"] == 3 * CHUNK
    assert data["agrees"]
    assert {point["id"] for point in data["points"]} == set("ABCDE")
    assert all(one["interval"][0] < 0.0 < one["interval"][1] for one in data["unknowns"])
    assert "JCGM 101:2008" in (tmp_path / "one" / "montecarlo.txt").read_text()


def test_coverage_intervals_are_those_of_the_sorted_corrections(trial):
    """Ranks by JCGM 101:2008, 7.7.2, counted here with fractions; ends near ±1.96 σ, as chance allows."""
    ready = prepared(trial)
    tally = chunk_of(ready, 0, 41)
    intervals = coverage_intervals(tally)
    q = int(Fraction(95, 100) * 41 + Fraction(1, 2))
    r = (41 - q + 1) // 2 if (41 - q) % 2 else (41 - q) // 2
    for column in np.flatnonzero(ready.truth.sigma):
        ordered = sorted(tally.drawn[:, column].tolist())
        assert intervals[column].tolist() == [ordered[r - 1], ordered[r + q - 1]]
    ends = np.abs(np.abs(intervals[ready.truth.sigma > 0.0]) - 1.959964)
    assert 0.0 < ends.max() < 5.0 * interval_noise(41)
    assert coverage_intervals(replace(tally, drawn=tally.drawn[:39])) is None


def test_noise_of_intervals_is_that_of_simulated_normal_variables():
    drawn = np.random.default_rng(3).normal(size=(1000, 1000))
    tallies = [np.sort(column)[24] for column in drawn.T]
    assert np.std(tallies) == pytest.approx(interval_noise(1000), rel=0.1)


def test_runs_of_something_else_are_never_mixed_in(trial, tmp_path):
    ready, alone = prepared(trial), partial(by_processes, jobs=1)
    run_trial(ready, 2, alone, tmp_path / "runs", {}, _told)
    other = ready._replace(trial=trial._replace(seed=2))
    with pytest.raises(InputError, match="of other input or of another seed"):
        run_trial(other, 2, alone, tmp_path / "runs", {}, _told)


def test_start_values_are_worked_out_anew_where_that_is_wanted(trial):
    ready = prepared(trial._replace(starts=True))
    tally = chunk_of(ready, 0, 3)
    assert float(tally.runs) == 3
    assert float(tally.solved) <= 3


def test_a_plan_without_solution_is_told(trial, capfd):
    trial.path.write_text(PLAN.replace("[A, E], [B, E], [C, E], [D, E]", "[A, E]"), encoding="utf-8")
    assert run(["simulate", str(trial.path), "--runs", "5"]) == 4
    assert "mor design says why" in capfd.readouterr().err
