"""Batches: one table for all, whatever becomes of some; what was kept is compared; the same whatever the jobs."""

from __future__ import annotations

import json
from xml.etree import ElementTree

import pytest

from mor.api.workers import Task, run_tasks
from mor.cli import run
from tests.scenarios.batch_scenes import act, write_project


@pytest.mark.slow
def test_what_dies_hangs_or_raises_takes_nothing_along(tmp_path):
    deeds = ["ok", "die", "ok", "hang", "raise", "leave", "ok"]
    tasks = [Task((deed,), tmp_path / f"{k}.txt") for k, deed in enumerate(deeds)]
    done = {one.number: one for one in run_tasks(act, tasks, 2, 8.0)}
    assert [done[k].code for k in range(7)] == [0, None, 0, None, 70, None, 0]
    assert done[1].death == "killed by SIGKILL"
    assert done[3].death == "ended after 8 s"
    assert done[5].death == "its process left with 7"
    assert "RuntimeError: broken" in (tmp_path / "4.txt").read_text()
    assert (tmp_path / "6.txt").read_text() == "done\n"


@pytest.fixture(scope="module")
def batch(tmp_path_factory):
    folder = tmp_path_factory.mktemp("batch")
    write_project(folder / "blocks", "good", "100.003")
    write_project(folder / "blocks", "deep/better", "100.004")
    write_project(folder / "blocks", "wrong", text="mor: 1\npoints: nothing\n")
    write_project(folder / "blocks", "bad", "100.200")
    code = run(["batch", str(folder / "blocks/**/project.yaml"), "-o", str(folder / "kept"), "--strict", "-q"])
    return folder, code


def test_one_table_of_all(batch):
    folder, code = batch
    data = json.loads((folder / "kept" / "batch.json").read_text())
    status = {row["name"]: row["status"] for row in data["projects"]}
    assert code == 1
    assert status == {"bad": "rejected", "deep/better": "accepted", "good": "accepted", "wrong": "input"}
    assert data["failed"] == 2
    assert (folder / "kept" / "deep" / "better" / "report.txt").is_file()
    assert "points" in (folder / "kept" / "wrong" / "log.txt").read_text()
    suite = ElementTree.parse(folder / "kept" / "junit.xml").getroot()
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("4", "2", "0")
    assert {case.get("name") for case in suite if len(case)} == {"bad", "wrong"}
    page = (folder / "kept" / "batch.html").read_text()
    assert 'href="deep/better/report.txt"' in page
    assert page.count("class=fails") == 2


@pytest.mark.slow
def test_what_differs_from_what_was_kept_fails_and_the_jobs_change_nothing(batch, tmp_path):
    folder, _ = batch
    pattern = str(folder / "blocks/**/project.yaml")
    assert run(["batch", pattern, "-o", str(tmp_path / "again"), "--strict", "-q", "--jobs", "2"]) == 1
    one, other = ((place / "batch.json").read_bytes() for place in (folder / "kept", tmp_path / "again"))
    assert one == other
    path = folder / "blocks" / "good" / "project.yaml"
    text = path.read_text()
    path.write_text(text.replace("80.001", "80.002"))
    code = run(["batch", pattern, "-o", str(tmp_path / "now"), "--against", str(folder / "kept"), "-q"])
    path.write_text(text)
    rows = {row["name"]: row for row in json.loads((tmp_path / "now" / "batch.json").read_text())["projects"]}
    assert code == 1
    assert rows["good"]["differences"] > 0
    assert rows["good"]["fails"]
    assert rows["deep/better"]["differences"] == 0
    assert not rows["deep/better"]["fails"]
    assert rows["bad"]["differences"] == 0


def test_a_pattern_of_nothing_is_a_mistake(tmp_path, capfd):
    assert run(["batch", str(tmp_path / "*.yaml")]) == 2
    assert "no project file matches this name" in capfd.readouterr().err
