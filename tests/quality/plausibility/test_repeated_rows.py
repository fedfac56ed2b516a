"""The same file in two places of a project is refused; equal rows are noted if chance does not explain them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mor
from mor.errors import InputError
from tests.scenarios.small_projects import write

CASES = Path(__file__).parents[2] / "cases" / "counted_twice"
POINTS = "\n".join(
    ["points:"]
    + ["  - {columns: [id, x, y, z], rows: [[P0, 0, 0, 10]], fixed: [x, y, z]}"]
    + [f"  - {{columns: [id, x, y, z], rows: [[P{k}, {k}, 0, {10 + k}]], fixed: [x, y]}}" for k in range(1, 11)]
)


def notes(folder: Path, *tables: str) -> list[str]:
    """Return the notes on repeated rows in a levelling project with some tables."""
    groups = "\n".join(f"  - {{type: height_difference, file: t{k}.csv}}" for k in range(len(tables)))
    files = {f"t{k}": text for k, text in enumerate(tables)}
    path = write(folder, f"mor: 1\n{POINTS}\nobservations:\n{groups}\n", **files)
    return [str(note) for note in mor.read(path).network.notes if "repeat" in str(note)]


def run(random: np.random.Generator, digits: int, sigma: float) -> str:
    """Return a table of 20 levelled height differences."""
    lines = ["from,to,dz,sigma"]
    for k in range(20):
        first, step = k % 10, 1 + k // 10
        last = min(first + step, 10)
        first = last - step
        lines.append(f"P{first},P{last},{step + sigma * random.standard_normal():.{digits}f},{sigma}")
    return "\n".join(lines) + "\n"


def test_second_table_with_the_same_rows_is_noted_with_its_effect(tmp_path: Path) -> None:
    table = run(np.random.default_rng(1), 4, 5e-4)
    (note,) = notes(tmp_path, table, table)
    assert "t1.csv:2: 20 of 20 rows repeat rows of" in note
    assert "add 20 to the redundancy" in note


def test_block_of_rows_that_stands_twice_in_one_table_is_noted(tmp_path: Path) -> None:
    table = run(np.random.default_rng(1), 4, 5e-4)
    lines = table.splitlines()
    (note,) = notes(tmp_path, "\n".join([*lines, *lines[4:12]]) + "\n")
    assert "8 of 28 rows repeat" in note


@pytest.mark.parametrize("digits", [3, 4, 5])
def test_two_runs_of_one_line_are_not_noted(digits: int, tmp_path: Path) -> None:
    # 20 differences twice, σ 0.5 mm: rounded to 1 mm, a third of the values agree by chance.
    random = np.random.default_rng(digits)
    found = [notes(tmp_path / str(k), *(run(random, digits, 5e-4) for _ in range(2))) for k in range(20)]
    assert sum(map(len, found)) <= 1


def test_values_of_zero_are_not_noted(tmp_path: Path) -> None:
    table = "from,to,dz,sigma\n" + "".join(f"P{k},P{k + 1},0,0.001\n" for k in range(9))
    assert notes(tmp_path, table, table) == []


def test_same_file_twice_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"twice.yaml:7: file 'dh.csv' is read already in line 6"):
        mor.read(CASES / "twice.yaml")
    assert mor.read(CASES / "once.yaml").network.observations == 3


def test_same_file_through_a_link_is_refused(tmp_path: Path) -> None:
    (tmp_path / "dh.csv").write_bytes((CASES / "dh.csv").read_bytes())
    (tmp_path / "other.csv").symlink_to(tmp_path / "dh.csv")
    text = (CASES / "twice.yaml").read_text()
    path = tmp_path / "link.yaml"
    path.write_text("other.csv".join(text.rsplit("dh.csv", 1)))
    with pytest.raises(InputError, match="would count twice"):
        mor.read(path)


def test_one_file_may_have_observations_of_two_types(tmp_path: Path) -> None:
    (tmp_path / "o.csv").write_text("from,to,dz,distance,sigma\nA,B,1,10,0.01\nB,C,1,10,0.01\n")
    path = tmp_path / "p.yaml"
    path.write_text(
        "mor: 1\npoints:\n  - {columns: [id, x, y, z], rows: [[A, 0, 0, 0], [B, 9, 0, 1], [C, 18, 0, 2]]}\n"
        "observations:\n  - {type: height_difference, file: o.csv, columns: {distance: null}}\n"
        "  - {type: distance, file: o.csv, columns: {dz: null}}\n"
    )
    assert len(mor.read(path).network.groups) == 2
