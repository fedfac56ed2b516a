"""Points that only observations name: free on request, never for a slip of the pen, and never unsaid."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mor.project.rows import alike
from tests.scenarios.small_projects import BLOCK, block, mor, table, write, write_block

SETTING = "settings: {undeclared_points: free}\n"
NETWORK = """\
mor: 1
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 10], [B, 100, 0, 11]], fixed: [x, y, z]}
observations:
  - type: zenith_directions
    columns: [station, to, horizontal, zenith]
    rows: %s
    values: {sigma: 1 mgon}
  - type: distance
    columns: [from, to, distance]
    rows: %s
    values: {sigma: 2 mm}
"""
DIRECTIONS = [
    ["A", "B", 0.0, 99.3634],
    ["A", "Q7", 350.0, 99.0],
    ["B", "A", 100.0, 100.6366],
    ["B", "Q7", 150.0, 99.5],
]
DISTANCES = [["A", "Q7", 70.72], ["B", "Q7", 70.72]]


def network(
    folder: Path, directions: list[list[object]], distances: list[list[object]], setting: str = SETTING
) -> Path:
    return write(folder, NETWORK % (json.dumps(directions), json.dumps(distances)) + setting)


def test_without_the_setting_they_are_mistakes(tmp_path: Path) -> None:
    run = mor("check", network(tmp_path, DIRECTIONS, DISTANCES, ""))
    assert run.code == 2
    assert "'Q7' does not exist" in run.err


def test_free_points_are_those_that_a_table_would_have_declared(tmp_path: Path) -> None:
    path = network(tmp_path / "a", DIRECTIONS, DISTANCES)
    free = mor("adjust", path, "--json")
    declared = "  - {columns: [id, x, y, z], rows: [[Q7, '', '', '']]}\nobservations:"
    text = path.read_text().replace(SETTING, "").replace("observations:", declared)
    table_ = mor("adjust", write(tmp_path / "b", text), "--json", "--quiet")
    assert free.code == table_.code == 0, free.err + table_.err
    one, other = (json.loads(run.out) for run in (free, table_))
    assert one.pop("identity") != other.pop("identity")  # they are two files
    assert one.pop("notes")
    assert all("curvature" in note["message"] for note in other.pop("notes"))
    assert one == other
    assert "1 point that only observations name: free" in free.err


def test_tie_points_of_a_block_and_a_free_station(tmp_path: Path) -> None:
    rows = block()
    project = write_block(
        tmp_path,
        BLOCK.replace("datum: free", "") + SETTING,
        rows,
        points=table("id,x,y,z,sigma", [[*row, 0.001] for row in rows.points[:4]]),
    )
    run = mor("adjust", project, "--json")
    assert run.code == 0, run.err
    assert len(json.loads(run.out)["points"]) == 12
    assert "8 points that only observations name" in run.err
    assert "point 'P4' is in no table of points and is therefore free; 'P0' is" in run.err


def test_a_slip_of_the_pen_stays_a_mistake(tmp_path: Path) -> None:
    """Q8, named once beside a declared Q7, is no new point."""
    slip = [[*row[:1], "Q8" if k == 1 else row[1], *row[2:]] for k, row in enumerate(DIRECTIONS)]
    text = network(tmp_path, slip, DISTANCES).read_text()
    declared = "  - {columns: [id, x, y, z], rows: [[Q7, 50, 50, 12]]}\nobservations:"
    run = mor("check", write(tmp_path, text.replace("observations:", declared)))
    assert run.code == 2
    assert "point 'Q8' occurs only in this row and in no table of points; did you mean 'Q7'?" in run.err


def test_a_prefix_says_what_a_name_is(tmp_path: Path) -> None:
    run = mor("check", network(tmp_path, DIRECTIONS, [["A", "image:I9", 70.0]]))
    assert run.code == 2
    assert "'image:I9' does not exist" in run.err


@pytest.mark.parametrize("slip", ["P12", "p112", "P11", "P1112", "P121", "P211", "P113"])
def test_names_that_one_slip_makes_of_another(slip: str) -> None:
    assert alike([slip], ["P112", "far away"]) == {slip: "P112"}


def test_other_names_are_notalike() -> None:
    assert alike(["P1", "Q12", "tower"], ["P1234", "north"]) == {}


def test_several_unknown_points_are_answered_with_the_setting_once(tmp_path: Path) -> None:
    distances = [["A", name, 70.0] for name in ("Q7", "R8", "S9")]
    run = mor("check", network(tmp_path, DIRECTIONS, distances, ""))
    assert run.code == 2
    assert run.err.count("settings: {undeclared_points: free}") == 1
    few = mor("check", network(tmp_path, DIRECTIONS, DISTANCES, ""))
    assert "undeclared_points" not in few.err
