"""``mor adjust --events``: JSON Lines that a program can follow."""

from __future__ import annotations

import json
from pathlib import Path

from mor.cli import run

SAMPLES = Path(__file__).parents[2] / "sample_projects"
PROJECT = SAMPLES / "facade" / "project.yaml"


def test_iterations_are_counted_on_where_sigma_settles(tmp_path: Path) -> None:
    """Distances with ppm: adjusted again with the σ of the result, the numbers go on as in the log."""
    log, folder = tmp_path / "events.jsonl", tmp_path / "r"
    project = str(SAMPLES / "building" / "project.yaml")
    assert run(["adjust", project, "-o", str(folder), "--quiet", "--no-html", "--events", str(log)]) == 0
    events = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    expected = json.loads((folder / "results.json").read_text(encoding="utf-8"))["iteration_log"]
    assert [e["number"] for e in events if e["event"] == "iteration"] == [e["number"] for e in expected]


def test_events_tell_phases_iterations_and_the_end(tmp_path: Path) -> None:
    log, folder = tmp_path / "events.jsonl", tmp_path / "r"
    arguments = ["adjust", str(PROJECT), "-o", str(folder), "--quiet", "--no-html", "--events", str(log)]
    assert run([*arguments, "--strict"]) == 1
    events = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    assert [e["name"] for e in events if e["event"] == "phase"] == [
        "reading",
        "adjusting",
        "precision and reliability",
        "writing",
    ]
    steps = [e for e in events if e["event"] == "iteration"]
    expected = json.loads((folder / "results.json").read_text(encoding="utf-8"))["iteration_log"]
    assert [{k: v for k, v in step.items() if k != "event"} for step in steps] == expected
    assert events[-1] == {"event": "done", "outcome": "converged", "exit_code": 1, "folder": str(folder)}
