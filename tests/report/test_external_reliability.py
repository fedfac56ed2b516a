"""External reliability of points against the same network adjusted with the error put in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from mor.api.pipeline import read_document, read_network, solve_network
from mor.report.observations import observation_table
from mor.report.verdict import PARTS, external_reliability
from mor.report.view import view_of_folder
from tests.scenarios.small_projects import mor

LINES = [("A", "B"), ("B", "C"), ("C", "D"), ("A", "D"), ("A", "C"), ("B", "D"), ("D", "E"), ("C", "E")]
HEAD = """\
mor: 1
points:
  - {{columns: [id, x, y, z], rows: [[A, 0, 0, 10]]{held}}}
  - {{columns: [id, x, y, z], rows: [[B, 300, 0, 11], [C, 600, 5, 12], [D, 900, 0, 13], [E, 990, 9, 11]],
     fixed: [x, y]}}
observations:
  - type: height_difference
    columns: [from, to, dz, sigma]
    rows: {rows}
{datum}"""


def text(rows: list[list[object]], free: bool) -> str:
    held = ", fixed: [x, y]" if free else ", fixed: [x, y, z]"
    listed = "[" + ", ".join(f"[{a}, {b}, {dz!r}, {s!r}]" for a, b, dz, s in rows) + "]"
    return HEAD.format(held=held, rows=listed, datum="datum: free\n" if free else "")


def solved(folder: Path, content: str):  # type: ignore[no-untyped-def]
    path = folder / "project.yaml"
    path.write_text(content, encoding="utf-8")
    return solve_network(read_network(read_document(path), folder))


@pytest.mark.parametrize("seed", range(6))
def test_vectors_are_the_movements_of_the_spoiled_network(seed: int, tmp_path: Path) -> None:
    draw = np.random.default_rng(seed)
    heights, free = dict(zip("ABCDE", (10, 11, 12, 13, 11), strict=True)), bool(seed % 2)
    rows: list[list[object]] = []
    for a, b in LINES:
        sigma = round(float(draw.uniform(0.5e-3, 3e-3)), 6)
        rows.append([a, b, round(heights[b] - heights[a] + float(draw.normal(0.0, sigma)), 6), sigma])
    clean = solved(tmp_path, text(rows, free))
    found, table = external_reliability(clean), observation_table(clean)
    before = dict(zip("ABCDE", clean.adjustment.values["point"], strict=True))
    assert found.height == (5 if free else 4)
    for row in found.to_dicts():
        k = LINES.index((row["from"], row["to"]))
        of_point = table.filter((pl.col("from") == row["point"]) | (pl.col("to") == row["point"]))
        assert row["r"] == pytest.approx(of_point["r"].min(), rel=1e-6), "the least controlled one"
        nabla = table["nabla"][k]
        spoiled = [[*one[:2], one[2] + nabla * (n == k), one[3]] for n, one in enumerate(rows)]
        after = solved(tmp_path, text(spoiled, free)).adjustment.values["point"]
        moved = dict(zip("ABCDE", after, strict=True))[row["point"]] - before[row["point"]]
        assert [row[part] for part in PARTS] == pytest.approx(moved.tolist(), abs=1e-5 * nabla)


def test_vectors_come_back_from_disk(tmp_path: Path) -> None:
    rows = [[a, b, dz, 0.001] for (a, b), dz in zip(LINES, (1.001, 1.0, 1.0, 3.0, 2.0, 2.001, -2.0, -1.0), strict=True)]
    made = external_reliability(solved(tmp_path, text(rows, False)))
    assert mor("adjust", tmp_path / "project.yaml", "--no-html", "--quiet").code == 0
    read = view_of_folder(tmp_path / "project.results").external
    assert read["point"].to_list() == made["point"].to_list()
    assert read["dz"].to_numpy() == pytest.approx(made["dz"].to_numpy(), rel=1e-9)
