"""Long tables in YAML, which are written apart from all else, are those that its own writer makes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import yaml

from mor.project import document as writing
from tests.selection import slow_after

NAMES = ["A", "b_1", "12", "0", "x", "Infinity", "_", None]
NUMBERS = ["1.5", "-3e-5", "1E5", "0", "-0.0", "12345678.123456789", None]
STRANGE = ["n", "Yes", "007", "+4", ".5", "a b", "1_000", "1:30", "Ü", "=", "0x1f", "true"]


def document(draw: np.random.Generator, strange: bool, first: bool) -> dict[str, Any]:
    columns = ["from", "to", "dx", "sigma", "cluster"]
    kinds = [NAMES, NAMES, NUMBERS, NUMBERS, NAMES]
    rows = [[kind[draw.integers(len(kind))] for kind in kinds] for _ in range(30)]
    if strange:
        rows[draw.integers(30)][draw.integers(5)] = STRANGE[draw.integers(len(STRANGE))]
    said = {"columns": columns, "type": "vector"}
    table = {"rows": rows, **said} if first else {**said, "rows": rows, "covariance": [[1.0, 0.5], [0.5, 2.0]]}
    return {"mor": "1", "observations": [table, {**said, "rows": rows[:3]}], "alone": {**said, "rows": rows}}


@pytest.mark.slow
@pytest.mark.parametrize("strange", slow_after(1, [True, False]))
@pytest.mark.parametrize("first", slow_after(1, [False, True]))
def test_long_tables_are_written_as_yaml_writes_them(
    monkeypatch: pytest.MonkeyPatch, strange: bool, first: bool
) -> None:
    draw = np.random.default_rng(7)
    documents = [document(draw, strange, first) for _ in range(60)]
    fast = [writing.yaml_text(data, width=120) for data in documents]
    monkeypatch.setattr(writing, "_simple_rows", lambda rows, width: None)
    assert fast == [writing.yaml_text(data, width=120) for data in documents]
    assert all(yaml.safe_load(text)["observations"][0]["columns"][0] == "from" for text in fast)


def test_they_are_written_apart() -> None:
    data = document(np.random.default_rng(7), False, False)
    tables: list[list[str]] = []
    writing._plain(data, "", tables, 120)
    assert [len(lines) for lines in tables] == [30, 30]
