"""Valid projects that nobody writes often: parts without connection, dimensions, covariances next to singular."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from mor.quality import singularity as singularities
from mor.report.language import words_of
from mor.report.text_findings import sentences
from mor.solve.datum import NOTHING_KNOWN, WeakTurn
from tests.scenarios.small_projects import LEVELLING, mor, write

HEIGHTS = """\
mor: 1
points:
  - {columns: [id, z], rows: [[A, 10]], fixed: [z]}
  - {columns: [id, z], rows: [[B, ""], [C, ""], [D, ""], [Q1, ""], [Q2, ""], [Q3, ""], [Q4, ""]]}
settings: {dimensions: z, undetermined: leave_out}
observations:
  - type: height_difference
    columns: [from, to, dz]
    rows: [[A, B, 1.0], [B, C, 1.0], [C, A, -2.0], [A, B, 1.0], [B, C, 1.0], [C, D, 1.0]]
    values: {sigma: 0.01}
  - type: height_difference
    name: another part
    columns: [from, to, dz]
    rows: [[Q1, Q2, 1.0], [Q2, Q3, 1.0], [Q3, Q4, 1.0], [Q4, Q1, -3.0], [Q1, Q3, 2.0], [Q2, Q4, 2.0]]
    values: {sigma: 0.01}
"""
"""Residuals smaller than σ, a point at the end of a spur, and a table that is left out as a whole."""


def test_a_table_of_which_everything_is_left_out(tmp_path: Path) -> None:
    project = write(tmp_path, HEIGHTS)
    run = mor("adjust", project, "-o", tmp_path / "one")
    assert run.code == 0, run.err
    assert "4 objects are LEFT OUT" in run.err
    assert "residuals are smaller" in run.err


def test_an_adjusted_project_of_heights_alone_is_read_again(tmp_path: Path) -> None:
    mor("adjust", write(tmp_path, HEIGHTS), "-o", tmp_path / "one")
    again = mor("adjust", tmp_path / "one" / "adjusted.yaml", "-o", tmp_path / "two")
    assert again.code == 0, again.err
    one, two = (json.loads((tmp_path / name / "results.json").read_text()) for name in ("one", "two"))
    assert two["redundancy"] == one["redundancy"]
    assert [point["z"] for point in two["points"]] == pytest.approx([point["z"] for point in one["points"]])


def test_names_with_braces_are_compared(tmp_path: Path) -> None:
    for name in ("x", "y"):
        text = LEVELLING.replace("type: height_difference", f"type: height_difference\n    name: 'of {{{name}}}'")
        assert mor("adjust", write(tmp_path / name, text), "-o", tmp_path / name / "r").code == 0
    run = mor("compare", tmp_path / "x" / "r", tmp_path / "y" / "r")
    assert run.code == 1
    assert "of {x} | of {y}" in run.out


PLAN = """\
mor: 1
settings: {dimensions: xy}
datum: {free: [A, B]}
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 1], [B, 100, 0, 2], [C, 100, 80, 3], [D, 0, 80, 4]]}
observations:
  - type: distance
    columns: [from, to, distance]
    rows: [[A, B, 100.007], [B, C, 80.004], [C, D, 100.008], [D, A, 80.057], [A, C, 128.076], [B, D, 128.078]]
    values: {sigma: 5 mm}
  - type: height_difference
    columns: [from, to, dz]
    rows: [[A, B, 1.002]]
    values: {sigma: 5 mm}
"""


def test_heights_of_a_network_of_the_plane_stay_in_another_datum(tmp_path: Path) -> None:
    """They are no coordinates of the network, so that another datum does not let them go."""
    assert mor("adjust", write(tmp_path, PLAN), "-o", tmp_path / "r", "-q").code == 0
    run = mor("datum", tmp_path / "r", "--to", "free", "-o", tmp_path / "free")
    assert run.code == 0, run.err
    direct = write(tmp_path / "direct", PLAN.replace("{free: [A, B]}", "free"))
    assert mor("adjust", direct, "-o", tmp_path / "other", "-q").code == 0
    one, other = (json.loads((tmp_path / name / "results.json").read_text()) for name in ("free", "other"))
    for point, expected in zip(one["points"], other["points"], strict=True):
        assert point["x"] == pytest.approx(expected["x"], abs=1e-9)
        assert point["sx"] == pytest.approx(expected["sx"], rel=1e-6)


NARROW = """\
mor: 1
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 0]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[B, 100, 0, 0], [C, 0, 100, 5]]}
observations:
  - type: vector
    columns: [from, to, dx, dy, dz]
    rows: [[A, B, 100.001, 0.002, 0.0], [A, C, 0.002, 100.001, 5.0], [B, C, -100.002, 100.0, 5.001]]
    values: {sigma: 3 mm}
  - type: vector
    columns: [from, to, dx, dy, dz]
    rows: [[A, B, 100.01, 0.01, 0.01]]
    covariance: [[VAR, 1.0e-6, 1.0e-6], [1.0e-6, VAR, 1.0e-6], [1.0e-6, 1.0e-6, VAR]]
"""


@pytest.mark.parametrize("variance", ["1.000000000001e-6", "1.00000001e-6", "1.01e-6"])
def test_a_covariance_next_to_singular_leaves_no_value_that_is_none(tmp_path: Path, variance: str) -> None:
    """Redundancy numbers of correlated observations do not tell whether anything controls them."""
    project = write(tmp_path, NARROW.replace("VAR", variance))
    run = mor("adjust", project, "-o", tmp_path / "r")
    assert run.code == 0, run.err
    assert "Warning" not in run.err
    with (tmp_path / "r" / "external_reliability.csv").open() as file:
        for row in csv.DictReader(file):
            assert np.isfinite([float(row[part]) for part in ("dx", "dy", "dz")]).all()


@pytest.mark.parametrize(("sigma", "told"), [(1e-8, False), (0.5, True)])
def test_a_turn_that_is_known_well_is_not_called_hardly_determined(
    monkeypatch: pytest.MonkeyPatch, sigma: float, told: bool
) -> None:
    turn = WeakTurn(np.array([0.0, 0.0, 1.0]), sigma)
    assert sigma < NOTHING_KNOWN
    monkeypatch.setattr(singularities, "weak_turns", lambda *_: (turn,))
    monkeypatch.setattr(singularities, "held_by_an_angle", lambda *_: [])
    monkeypatch.setattr(singularities, "_tilts_as_angles", lambda *_: False)
    inverse = SimpleNamespace(weak=None)
    adjustment = SimpleNamespace(inverse=inverse, problem=None, values=None)
    project = SimpleNamespace(units=SimpleNamespace(angle="gon"))
    solved = SimpleNamespace(adjustment=adjustment, network=SimpleNamespace(project=project))
    assert bool(singularities.turned_about(solved)) == told  # type: ignore[arg-type]


def test_lines_of_a_loop_in_german() -> None:
    said = words_of("de").told("levelling A - B: the loop has a misclosure of 0.1 m (5 sigma); its lines: 7, 9")
    assert said == "Nivellement A - B: der Schleifenschluss ist 0.1 m (5 Sigma); ihre Zeilen: 7, 9"


def test_a_suspect_in_an_image_is_called_so_once() -> None:
    row = {"type": "image", "names": {"image": "I4", "point": "P8"}, "component": "x"}
    data = {"outcome": "not converged", "iterations": 9, "count": 1, "observations": [row]}
    assert sentences(data)[-1].endswith("The worst: image I4, point P8, x.")


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_standard_streams_may_be_closed(tmp_path: Path, closed: str) -> None:
    project = write(tmp_path, LEVELLING)
    command = f'"{sys.executable}" -m mor adjust project.yaml -o results {closed}'
    run = subprocess.run(["sh", "-c", command], cwd=project.parent, check=False)
    assert run.returncode == 0
    assert json.loads((tmp_path / "results" / "results.json").read_text())["outcome"] == "converged"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux only")
def test_words_that_cannot_be_written_have_an_exit_code(tmp_path: Path) -> None:
    project = write(tmp_path, LEVELLING)
    command = f'"{sys.executable}" -m mor adjust project.yaml -o results 2> /dev/full'
    run = subprocess.run(["sh", "-c", command], cwd=project.parent, check=False)
    assert run.returncode == 2


def test_a_datum_of_too_few_coordinates_is_called_so(tmp_path: Path) -> None:
    text = PLAN.replace("{free: [A, B]}", "{minimal: {xy: A}}")
    run = mor("adjust", write(tmp_path, text), "-o", tmp_path / "r")
    assert run.code == 4
    assert "The datum has 2 free coordinates, and the network has 3 free movements: " in run.err
    german = mor("adjust", write(tmp_path / "de", text), "-o", tmp_path / "de" / "r", "--lang", "de")
    assert "Das Datum hat 2 freie Koordinaten, und das Netz hat 3 freie Bewegungen: " in german.err


def test_a_camera_alone_without_any_point(tmp_path: Path) -> None:
    """It ended in an internal error: all that follows asks where something is."""
    text = "mor: 1\ncameras: {K: {interior: {c: {observed: 20, sigma: 0.01}, xh: {fixed: 0}, yh: {fixed: 0}}}}\n"
    run = mor("adjust", write(tmp_path, text))
    assert run.code == 2
    assert "there are no points" in run.err
