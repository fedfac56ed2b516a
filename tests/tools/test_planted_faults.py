"""The faults of ``tools/planted_faults.yaml`` fit the source."""

from __future__ import annotations

from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]


def test_every_text_that_a_fault_replaces_occurs_once():
    faults = yaml.safe_load((ROOT / "tools/planted_faults.yaml").read_text(encoding="utf-8"))
    counts = {one["fault"]: (ROOT / one["file"]).read_text(encoding="utf-8").count(one["old"]) for one in faults}
    assert {fault: count for fault, count in counts.items() if count != 1} == {}
