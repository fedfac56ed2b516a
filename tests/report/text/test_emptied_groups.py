"""A group of which every observation was taken out is no reason to accept anything: the verdict says so."""

from __future__ import annotations

import json
from pathlib import Path

from tests.scenarios.small_projects import LEVELLING, mor, write

WRONG = """
  - type: height_difference
    name: wrong line
    columns: [from, to, dz, sigma]
    rows: [[A, B, 7.0, 0.001]]
settings: {snooping: true}
"""


def test_the_verdict_names_a_group_that_is_gone(tmp_path: Path) -> None:
    run = mor("adjust", write(tmp_path, LEVELLING + WRONG))
    results = json.loads((tmp_path / "project.results" / "results.json").read_text(encoding="utf-8"))
    gone = next(row for row in results["groups"] if "wrong" in row["name"])
    assert (gone["observations"], gone["excluded"]) == (0, 1)
    line = f"Nothing is left of {gone['name']}: all its observations were excluded (1)."
    assert line in run.err
    assert line in (tmp_path / "project.results" / "report.html").read_text(encoding="utf-8")
