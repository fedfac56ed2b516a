"""Wrong arguments of every command: one line in plain words, exit code 2, never a traceback, nothing written."""

from __future__ import annotations

from pathlib import Path

import pytest

from mor.cli import compare
from mor.report.summary import SCHEMA
from tests.scenarios.small_projects import LEVELLING, mor, write


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a project, its results and some tables, to stand in."""
    write(tmp_path, LEVELLING)
    monkeypatch.chdir(tmp_path)
    assert mor("adjust", "project.yaml", "--quiet", "--no-html").code == 0
    (tmp_path / "empty").mkdir()
    homologous = "\n".join(f"{k},{k},{k % 3},{k + 0.1},{k % 4}" for k in range(9))
    (tmp_path / "homologous.csv").write_text(f"id,x1,y1,x2,y2\n{homologous}\n")
    (tmp_path / "twice.csv").write_text(f"id,x1,y1,x2,y2\n{homologous}\n3,1,2,3,4\n,1,2,3,4\n")
    (tmp_path / "pairs.csv").write_text("one,other\nA,B\nA,Bx\n")
    (tmp_path / "empty.csv").write_text("one,other\n")
    (tmp_path / "other.json").write_text("[1]")
    return tmp_path


RESULTS = "project.results"
MISTAKES = [
    ("adjst project.yaml", "there is no command 'adjst'; did you mean 'adjust'?"),
    (
        "adjust empty",
        "empty: this is a folder without a project file, expected a project file, or a folder in one of the formats",
    ),
    (
        "check pairs.csv",
        "pairs.csv: this is a table, expected a project file; mor new begins one from tables",
    ),
    (
        "datum project.results --to fre",
        "--to: datum: found 'fre', expected 'fixed' or 'free'; did you mean 'free'?",
    ),
    ("datum project.results --to free:[A,B]", "a blank is missing after a colon"),
    ("covariance project.results --points , -o a.csv", "--points: found ',', expected names of points A,B,…"),
    ("covariance project.results --points Bx -o a.csv", "point 'Bx' does not exist"),
    (
        "covariance project.results --blocks -o project.results/reference.csv --force",
        "project.results/reference.csv: this file is an input of the same command, and nothing is written over it",
    ),
    ("compare project.results", "found 1, expected two to compare"),
    (
        "compare project.results project.results --pairs pairs.csv",
        "found 2, expected one folder of results with --pairs",
    ),
    ("compare project.results project.results --tol -1", "--tol: found -1, expected 0 or more"),
    ("compare project.results project.results --epochs --pairs pairs.csv", "choose one of --epochs, --pairs"),
    ("compare project.results pairs.csv", "pairs.csv: expected a folder of results, or its results.json"),
    ("compare project.results other.json", "other.json: expected a folder of results, or its results.json"),
    ("compare project.results --pairs pairs.csv", "pairs.csv:3: point 'Bx' does not exist"),
    ("compare project.results --pairs empty.csv", "empty.csv: expected two columns of points below a header"),
    (
        "convert project.yaml -o a.yaml",
        "project.yaml: this is a project file already; mor adjust takes it as it is",
    ),
    ("convert nothing -o a.yaml", "nothing: this file does not exist"),
    ("new a.yaml nothing.csv", "nothing.csv: this file does not exist"),
    ("orient relative homologous.csv -c 20 --sigma 0", "Invalid value for '--sigma'"),
    (
        "orient planar homologous.csv -c 20 --length 1 1 3",
        "--length takes two different points and a positive length",
    ),
    (
        "orient planar homologous.csv -c 20 --length 1 2 -3",
        "--length takes two different points and a positive length",
    ),
    (
        "orient relative twice.csv -c 20",
        "twice.csv:11: id '3' is given twice (first in line 5)\ntwice.csv:12: id is empty",
    ),
]


@pytest.mark.parametrize(("arguments", "words"), MISTAKES, ids=[arguments for arguments, _ in MISTAKES])
def test_it_is_told_what_is_wrong(here: Path, arguments: str, words: str) -> None:
    before = {path: path.read_bytes() for path in here.rglob("*") if path.is_file()}
    run = mor(*arguments.split())
    assert (run.code, run.out) == (2, "")
    assert words in run.err
    assert "internal error" not in run.err
    assert {path: path.read_bytes() for path in here.rglob("*") if path.is_file()} == before


def test_results_may_be_named_by_their_file(here: Path) -> None:
    same = mor("compare", "project.results/results.json", RESULTS, "--epochs")
    assert same.code == 0
    assert "nothing has moved" in same.err
    assert compare.SCHEMA == SCHEMA


def test_rows_that_one_of_two_results_lacks(here: Path) -> None:
    fewer = LEVELLING.replace(", [C, 0, 0, 12]", "").replace(", [B, C, 1.002, 0.001], [C, A, -2.001, 0.001]", "")
    assert mor("adjust", write(here / "fewer", fewer), "--quiet", "--no-html").code == 0
    run = mor("compare", RESULTS, "fewer/project.results")
    assert run.code == 1
    assert "points.C: there | missing" in run.out.splitlines()
    assert max(map(len, run.out.splitlines())) < 100


def test_a_datum_that_the_observations_settle(here: Path) -> None:
    text = LEVELLING.replace("units: {length: m}\n", "units: {length: m}\n")
    assert "note" not in mor("datum", RESULTS, "--to", "free: {z: [A, B]}").err
    observed = text.replace(
        "columns: [id, x, y, z], rows: [[A, 0, 0, 10]], fixed: [x, y, z]",
        "columns: [id, x, y, z, sigma_z], rows: [[A, 0, 0, 10, 0.001]], fixed: [x, y]",
    )
    assert mor("adjust", write(here / "observed", observed), "--quiet", "--no-html").code == 0
    run = mor("datum", "observed/project.results", "--to", "free: {z: [A, B]}")
    assert run.code == 0
    assert run.err.startswith("note: the observations define the datum themselves (defect 0)")
