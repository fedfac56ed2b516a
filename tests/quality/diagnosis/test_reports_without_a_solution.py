"""Not converged, diverged, singular: a report all the same, marked as no solution, in words that fit the case."""

from __future__ import annotations

import json

import pytest

from tests.scenarios.small_projects import mor, write

IMPOSSIBLE = """\
mor: 1
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 0], [B, 100, 0, 0]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[P, 50, 0.001, 0]], fixed: [z]}
observations:
  - type: distance
    columns: [from, to, distance, sigma]
    rows: [[A, P, 30, 0.001], [B, P, 40, 0.001]]
"""
"""Circles that do not meet."""
COLLINEAR_START = """\
mor: 1
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 0], [B, 100, 0, 0]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[P, 50, 0, 0]], fixed: [z]}
observations:
  - type: distance
    columns: [from, to, distance, sigma]
    rows: [[A, P, 80, 0.001], [B, P, 70, 0.001]]
"""
"""P is determined by its distances, but not from start values on the line through A and B."""


def _results(project):
    return json.loads((project.parent / "project.results" / "results.json").read_text())


@pytest.mark.parametrize(("language", "marked"), [("en", "NOT A SOLUTION"), ("de", "KEINE LÖSUNG")])
def test_report_and_page_say_what_fits_worst_and_what_moves(tmp_path, language, marked):
    project = write(tmp_path, IMPOSSIBLE)
    run = mor("adjust", project, "--lang", language)
    assert run.code == 3
    data = _results(project)
    assert data["solution"] is False
    assert data["sigma0"] is None
    assert [row["id"] for row in data["failure"]["moving"]] == ["P", "P"]
    worst = data["failure"]["worst"]
    assert [abs(row["v"]) for row in worst] == pytest.approx([20.0, 10.0], abs=1e-6)
    assert [row["misfit"] for row in worst] == pytest.approx([2e4, 1e4], rel=1e-6)
    assert all(row["r"] is None and row["w"] is None for row in worst)
    for name in ("report.txt", "report.html"):
        assert marked in (tmp_path / "project.results" / name).read_text()


def test_an_iteration_that_was_cut_short_shows_its_steps(tmp_path):
    text = COLLINEAR_START.replace("[P, 50, 0, 0]", "[P, 50, 0.5, 0]")
    project = write(tmp_path, text + "settings: {max_iterations: 1}\n")
    run = mor("adjust", project)
    assert run.code == 3
    moving = _results(project)["failure"]["moving"]
    assert {(row["id"], row["component"]) for row in moving} == {("P", "x"), ("P", "y")}
    assert all(len(row["steps"]) >= 1 for row in moving)
    assert "Iterations" in (tmp_path / "project.results" / "report.txt").read_text()


def test_singular_at_the_start_is_not_undetermined_by_the_observations(tmp_path):
    run = mor("adjust", write(tmp_path, COLLINEAR_START))
    assert run.code == 4
    assert "singular at the start values" in run.err
    assert mor("adjust", write(tmp_path / "beside", COLLINEAR_START.replace("50, 0, 0", "50, 5, 0"))).code == 0
