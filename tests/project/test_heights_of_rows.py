"""One rule for the height of a row and the height of the station it names: that of the row replaces the other."""

from __future__ import annotations

from typing import Any

import pytest

import mor


def adjusted(columns: list[str], row: list[Any]) -> tuple[float, list[str]]:
    """Adjusted distance from station S (12 m above A) to B or back, all points fixed, and what was noted of heights."""
    ends, heights = {"A": (0, 0, 0), "B": (3, 4, 0), "C": (9, 1, 0)}, columns[3:]
    project = {
        "mor": 1,
        "points": [
            {
                "columns": ["id", "x", "y", "z"],
                "rows": [[n, *p] for n, p in ends.items()],
                "fixed": ["x", "y", "z"],
            }
        ],
        "stations": [{"columns": ["id", "point", "height"], "rows": [["S", "A", 12]]}],
        "observations": [
            {"type": "distance", "columns": columns, "rows": [row], "values": {"sigma": 0.01}},
            {
                "type": "zenith_directions",
                "columns": ["station", "to", "horizontal"],
                "rows": [["S", "B", 0.0], ["S", "C", 52.17]],
                "values": {"sigma": 0.01},
            },
        ],
    }
    assert set(heights) <= {"from_height", "to_height"}
    result = mor.adjust(project)
    frame = result.observations.frame
    (value,) = frame.filter(frame["type"] == "distance")["adjusted"]
    notes = [note["message"] for note in result.to_dict()["notes"]]
    return value, [note for note in notes if "of this row counts" in note]


DISTANCE = ["from", "to", "distance"]


@pytest.mark.parametrize(
    ("columns", "row", "squares", "said"),
    [
        (DISTANCE, ["S", "B", 13.0], 25 + 144, ""),
        ([*DISTANCE, "from_height"], ["S", "B", 13.0, ""], 25 + 144, ""),
        ([*DISTANCE, "from_height"], ["S", "B", 13.0, 12], 25 + 144, ""),
        ([*DISTANCE, "from_height"], ["S", "B", 5.0, 0], 25, "from_height 0 m"),
        ([*DISTANCE, "from_height"], ["S", "B", 5.0, 1.5], 25 + 2.25, "from_height 1.5 m"),
        ([*DISTANCE, "to_height"], ["S", "B", 13.0, 2], 25 + 100, ""),
        ([*DISTANCE, "to_height"], ["B", "S", 5.0, 0], 25, "to_height 0 m"),
        ([*DISTANCE, "from_height"], ["A", "B", 13.0, 12], 25 + 144, ""),
    ],
)
def test_the_height_of_the_row_replaces_that_of_the_station(
    columns: list[str], row: list[Any], squares: float, said: str
) -> None:
    """An empty cell leaves the height of the station, a number replaces it, also 0; a note says it if they differ."""
    value, notes = adjusted(columns, row)
    assert value == pytest.approx(squares**0.5, abs=1e-9)
    assert len(notes) == bool(said)
    for note in notes:
        assert note.startswith(said)
        assert "height of station 'S', which is 12 m" in note
