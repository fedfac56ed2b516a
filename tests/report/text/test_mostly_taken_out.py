"""What the report says of a point that lost most of its observations."""

from __future__ import annotations

import json
from pathlib import Path

from tests.scenarios.small_projects import mor, write

HEIGHTS = """\
mor: 1
units: {length: m}
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 10], [B, 0, 0, 11], [W, 0, 0, 12.5]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[P, 0, 0, 12], [Q, 0, 0, 13], [R, 0, 0, 14]], fixed: [x, y]}
observations:
  - type: height_difference
    columns: [from, to, dz, sigma]
    rows:
      - [A, P, 2.0001, 0.001]
      - [B, P, 0.9996, 0.001]
      - [A, Q, 3.0004, 0.001]
      - [B, Q, 2.0002, 0.001]
      - [A, R, 3.9998, 0.001]
      - [B, R, 2.9997, 0.001]
      - [W, P, 0.0003, 0.001]
      - [W, Q, 1.0001, 0.001]
      - [W, R, 1.9997, 0.001]
settings: {snooping: true}
"""


def test_a_bench_mark_with_a_wrong_height_is_named(tmp_path: Path) -> None:
    """W is given half a metre too high: each of its three height differences goes, and none of the others."""
    run = mor("adjust", write(tmp_path, HEIGHTS), "-o", tmp_path / "results")
    data = json.loads((tmp_path / "results" / "results.json").read_text(encoding="utf-8"))
    expected = {"of": "point", "id": "W", "excluded": 3, "observations": 3}
    assert data["gross_errors"]["snooping"]["mostly_out"] == [expected], run.err
    line = "Most observations of point W (3 of 3) were excluded"
    assert line in (tmp_path / "results" / "report.txt").read_text(encoding="utf-8")
    assert line in (tmp_path / "results" / "report.html").read_text(encoding="utf-8")
