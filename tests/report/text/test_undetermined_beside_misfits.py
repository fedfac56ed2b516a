"""Reports doubt what is not determined if the values do not fit the observations."""

from __future__ import annotations

from typing import Any

import pytest

import mor

LINKAGE: dict[str, Any] = {
    "mor": 1,
    "points": [
        {"columns": ["id", "x", "y", "z"], "rows": [["A", 0, 0, 0], ["B", 10, 0, 0]], "fixed": ["x", "y", "z"]},
        {"columns": ["id", "x", "y", "z"], "rows": [["P", 3, 4, 0], ["Q", 0, 8, 0]], "fixed": ["z"]},
    ],
}
"""P and Q turn about A."""


@pytest.mark.parametrize(("known", "doubted"), [(10.0, False), (910.0, True)])
def test_doubt_is_told_where_observations_do_not_fit(known: float, doubted: bool) -> None:
    rows = [["A", "B", known], ["A", "P", 5.0], ["A", "Q", 8.0], ["P", "Q", 5.0]]
    distances = {
        "type": "distance",
        "columns": ["from", "to", "distance"],
        "rows": rows,
        "values": {"sigma": "1 mm"},
    }
    said = mor.adjust({**LINKAGE, "observations": [distances]}).report()
    assert "The movement concerns point P, point Q." in said
    assert ("values that do not fit the observations" in said) is doubted
