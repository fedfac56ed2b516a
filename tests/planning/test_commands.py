"""The commands before the measurement: what they write, their exit codes, what they say of mistakes."""

from __future__ import annotations

import json

import polars as pl
import pytest

from mor.cli import run

PLAN = """mor: 1
title: a plan
points:
- columns: [id, x, y, z]
  rows: [[A, 0, 0, 0], [B, 120, 10, 2], [C, 60, 90, 5], [D, 55, 30, 1]]
observations:
- type: distance
  columns: [from, to]
  values: {sigma: 2 mm}
  rows: [[A, B], [B, C], [C, A], [A, D], [B, D], [C, D]]
- type: height_difference
  columns: [from, to]
  values: {sigma: 1 mm}
  rows: [[A, B], [B, C], [C, A], [A, D], [D, B]]
candidates:
- type: distance
  name: again
  columns: [from, to]
  values: {sigma: 2 mm}
  rows: [[A, B], [B, C], [C, A], [A, D], [B, D], [C, D]]
datum: free
require:
  sigma: {points: ["*"], xy: 3 mm}
  reliability: {r: LIMIT}
variants:
  again: {candidates: [again]}
  without heights: {without: {groups: ["height*"]}}
  without D: {without: {points: [D]}}
"""


def _plan(folder, limit=0.1, text=PLAN):
    path = folder / "plan.yaml"
    path.write_text(text.replace("LIMIT", str(limit)), encoding="utf-8")
    return str(path)


def test_a_plan_is_said_to_be_one_and_judged(tmp_path, capfd):
    assert run(["design", _plan(tmp_path), "--rank", "--greedy", "8"]) == 1
    folder = tmp_path / "plan.design"
    text = (folder / "design.txt").read_text(encoding="utf-8")
    assert "PLAN: nothing has been measured" in text
    assert "IT DOES NOT MEET 1 of 2 requirements." in text
    assert "sigma0 a posteriori" not in text
    assert "vTPv" not in text
    assert max(map(len, text.splitlines())) <= 100
    data = json.loads((folder / "design.json").read_text(encoding="utf-8"))
    assert data["plan"]
    assert not data["fulfilled"]
    assert [row["met"] for row in data["require"]] == [True, False]
    variants = {row["name"]: row for row in data["variants"]}
    assert variants["again"]["fulfilled"]
    assert variants["without heights"]["redundancy"] == 0
    assert not variants["without heights"]["fulfilled"]
    assert variants["without D"]["left_out"] == [["point", "D"]]
    planned = pl.read_csv(folder / "planned.csv")
    assert planned.height == 11
    assert float(planned["r"].sum()) == pytest.approx(data["redundancy"])
    ranking = pl.read_csv(folder / "ranking.csv")
    assert dict(ranking.group_by("kind").len().iter_rows())["add"] == 6
    last = ranking.filter(pl.col("kind") == "greedy").tail(1)
    assert float(last["shortfall"][0]) == 0.0
    assert float(last["smallest_r"][0]) >= 0.1
    assert "IT DOES NOT MEET" in capfd.readouterr().err


def test_exit_code_says_whether_all_is_reached(tmp_path, capfd):
    assert run(["design", _plan(tmp_path, 0.001), "--json", "--lang", "de"]) == 0
    printed = capfd.readouterr()
    assert json.loads(printed.out)["fulfilled"]
    assert "Sie erfüllt alle Forderungen (2)." in printed.err
    assert not (tmp_path / "plan.design").exists()


def test_a_plan_that_leaves_something_open_has_no_solution(tmp_path, capfd):
    text = PLAN.replace("[A, D], [B, D], [C, D]]\n- type: height", "[A, D]]\n- type: height")
    text = text.replace("variants:", "settings: {}\nvariants:")
    assert run(["design", _plan(tmp_path, text=text)]) == 4
    assert "point D is not determined" in capfd.readouterr().err
    assert json.loads((tmp_path / "plan.design" / "design.json").read_text())["fulfilled"] is False


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('points: ["*"]', "points: [E]", "there is no point 'E'"),
        ("xy: 3 mm", "xy: 3 kg", "unit 'kg' does not fit a length"),
        ("r: LIMIT", "r: 1.5", "expected a number below 1"),
        ("r: LIMIT", "r: 0.1, groups: [distanc]", "there is no group of observations 'distanc'"),
        ("[D, 55, 30, 1]", '[D, 55, 30, ""]', "point D: no place"),
        (
            "candidates: [again]",
            "candidates: [agan]",
            "there is no table of candidates 'agan'; did you mean",
        ),
        ("points: [D]", "points: [F]", "there is no point 'F'"),
        ("  name: again\n", "  name: again\n  cluster: x\n", "candidates are uncorrelated"),
    ],
)
def test_mistakes_are_told_in_words(tmp_path, capfd, old, new, words):
    assert old in PLAN
    assert run(["design", _plan(tmp_path, text=PLAN.replace(old, new))]) == 2
    assert words in capfd.readouterr().err


def test_what_is_simulated_can_be_adjusted_and_knows_its_truth(tmp_path):
    path = _plan(tmp_path)
    assert run(["simulate", path, "--seed", "4", "-q"]) == 0
    folder = tmp_path / "plan.simulated"
    assert run(["adjust", str(folder / "project.yaml"), "--no-html", "-q"]) == 0
    assert run(["adjust", path, "-q"]) == 2, "nothing is measured"
    truth = pl.read_csv(folder / "truth.csv").filter(pl.col("kind") == "point")
    points = pl.read_csv(folder / "project.results" / "points.csv")
    assert truth["id"].unique().sort().to_list() == ["A", "B", "C", "D"]
    for axis in "xyz":
        true = truth.filter(pl.col("component") == axis)["value"].to_numpy()
        assert abs(points[axis].to_numpy() - true).max() < 0.02


def test_what_is_planted_does_not_go_with_runs(tmp_path, capfd):
    assert run(["simulate", _plan(tmp_path), "--runs", "5", "--gross", "1", "--offset", "a=1"]) == 2
    said = capfd.readouterr().err
    assert "--gross: " in said
    assert "--offset or --ppm: " in said
