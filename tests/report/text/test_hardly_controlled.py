"""What the report says of an observation that next to nothing controls."""

from __future__ import annotations

from pathlib import Path

import pytest

from mor.report import text_tables as residuals
from tests.scenarios.small_projects import mor, write

TWICE = """\
mor: 1
units: {length: m}
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 10]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[B, 0, 0, 11]], fixed: [x, y]}
observations:
  - type: height_difference
    columns: [from, to, dz, sigma]
    rows: [[A, B, 1.0, 0.001], [A, B, 6.0, 0.000005]]
"""


def test_what_a_list_leaves_out_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(residuals, "SHOWN_RESIDUALS", 1)
    sights = [f"[A, {name}, 1.0, 0.001], [A, {name}, 1.0, 0.000005]" for name in ("B", "C", "D")]
    text = TWICE.replace("[[A, B, 1.0, 0.001], [A, B, 6.0, 0.000005]]", f"[{', '.join(sights)}]")
    text = text.replace("[[B, 0, 0, 11]]", "[[B, 0, 0, 11], [C, 0, 0, 11], [D, 0, 0, 11]]")
    assert mor("adjust", write(tmp_path, text), "-o", tmp_path / "results").code == 0
    report = (tmp_path / "results" / "report.txt").read_text(encoding="utf-8")
    assert "and 2 more in the table of residuals" in report


def test_no_movement_through_the_whole_network_is_stated(tmp_path: Path) -> None:
    assert mor("adjust", write(tmp_path, TWICE), "-o", tmp_path / "results").code == 0
    report = (tmp_path / "results" / "report.txt").read_text(encoding="utf-8")
    report = report.replace("\n    ", " ")  # sentences that are broken
    lines = [line for line in report.splitlines() if line.lstrip().startswith("height_difference from A")]
    assert len(lines) == 3  # the uncontrolled one is in the reliability map, too
    assert sum("r = 2.5e-05: it is controlled too weakly" in line for line in lines) == 1
    assert sum("would move" in line and "in Z" in line for line in lines) == 1
