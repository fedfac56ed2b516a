"""Clusters of rows in one table against a table with a matrix for each; what is wrong with them is told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from mor.api.pipeline import read_document, read_network, solve_network
from mor.quality.solution import Solved
from tests.scenarios.small_projects import mor, write

AXES = ["dx", "dy", "dz"]
COLUMNS = ["from", "to", *AXES]


def clusters(seed: int, sizes: tuple[int, ...] = (1, 3, 2, 3, 5, 2)) -> list[tuple[list[list[Any]], np.ndarray]]:
    """Vectors between 6 points with a matrix for each cluster; of some rows components are missing."""
    draw = np.random.default_rng(seed)
    places = draw.uniform(0.0, 100.0, (6, 3))
    found = []
    for size in sizes:
        rows: list[list[Any]] = []
        seen = []
        for _ in range(size):
            a = sum(len(rows) for rows, _ in found) + len(rows)
            a, b = a % 6, (a + 1 + a // 6) % 6
            here = [True] * 3 if draw.uniform() < 0.7 else [True, False, True]
            values = places[b] - places[a] + 0.003 * draw.standard_normal(3)
            cells = [float(v) if there else None for v, there in zip(values, here, strict=True)]
            rows.append([f"P{a}", f"P{b}", *cells])
            seen += here
        root = 0.003 * (np.eye(3 * size) + 0.3 * draw.standard_normal((3 * size, 3 * size)))
        found.append((rows, (root @ root.T)[np.ix_(seen, seen)]))
    points = [[f"P{k}", *place] for k, place in enumerate(places.tolist())]
    return [(points, np.zeros((0, 0))), *found]


def project(observations: list[dict[str, Any]], points: list[list[Any]], xy: str) -> str:
    columns = ["id", "x", "y", "z"]
    return json.dumps(
        {
            "mor": 1,
            "units": {"length": "mm"},
            "axes": {"xy": xy},
            "points": [
                {"columns": columns, "rows": points[:1], "fixed": ["x", "y", "z"], "units": "m"},
                {"columns": columns, "rows": points[1:], "units": "m"},
            ],
            "observations": observations,
        }
    )


def one_table(found: list[tuple[list[list[Any]], np.ndarray]], order: np.ndarray) -> dict[str, Any]:
    """All clusters as one table, rows in any order."""
    rows = [[*row, f"session {k}"] for k, (rows, _) in enumerate(found) for row in rows]
    lines = [[np.flatnonzero([cell is not None for cell in row[2:]]).size for row in rows] for rows, _ in found]
    blocks: list[list[list[float]]] = []
    for counts, (_, Q) in zip(lines, found, strict=True):
        ends = np.cumsum(counts)
        blocks += [Q[end - count : end].tolist() for count, end in zip(counts, ends, strict=True)]
    matrix = [line for k in order.tolist() for line in blocks[k]]
    return {
        "type": "vector",
        "units": "m",
        "columns": [*COLUMNS, "cluster"],
        "rows": [rows[k] for k in order.tolist()],
        "covariance": matrix,
    }


def solved(folder: Path, text: str) -> Solved:
    path = write(folder, text)
    return solve_network(read_network(read_document(path), folder))


@pytest.mark.parametrize("xy", ["en", "ne"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_one_table_is_as_good_as_many(tmp_path: Path, seed: int, xy: str) -> None:
    (points, _), *found = clusters(seed)
    tables = [
        {"type": "vector", "units": "m", "columns": COLUMNS, "rows": rows, "covariance": Q.tolist()}
        for rows, Q in found
    ]
    apart = solved(tmp_path / "apart", project(tables, points, xy))
    # rows of different clusters in turns, those of one in their order
    owner = np.repeat(np.arange(len(found)), [len(rows) for rows, _ in found])
    turn = np.concatenate([np.arange(np.count_nonzero(owner == k)) for k in range(len(found))])
    order = np.lexsort((owner, turn))
    together = solved(tmp_path / "together", project([one_table(found, order)], points, xy))
    assert together.quality.sigma0 == pytest.approx(apart.quality.sigma0, rel=1e-11)
    assert together.quality.redundancy == apart.quality.redundancy
    for name in ("v", "r", "weighted", "q_weighted", "q_residual", "joint", "carried"):
        one, *apart_from_it = (
            getattr(group.at(np.arange(group.v.shape[0])), name)
            for group in (*together.quality.groups, *apart.quality.groups)
        )
        np.testing.assert_allclose(one, np.concatenate(apart_from_it)[order], rtol=1e-8, atol=1e-10, err_msg=name)


def _many(count: int) -> tuple[list[list[Any]], list[tuple[list[list[Any]], np.ndarray]]]:
    (points, _), *found = clusters(5, (3,) * count)
    return points, found


def test_large_matrices_stand_beside_the_adjusted_project(tmp_path: Path) -> None:
    points, found = _many(6)
    table = one_table(found, np.arange(18))
    path = write(tmp_path, project([table], points, "en"))
    first = mor("adjust", path, "-o", tmp_path / "first", "--no-html")
    again = mor("adjust", tmp_path / "first" / "adjusted.yaml", "-o", tmp_path / "again", "--no-html")
    assert first.code == again.code == 0, first.err + again.err
    text = (tmp_path / "first" / "adjusted.yaml").read_text()
    assert "covariance: given_covariance_1.csv" in text
    matrix = [
        [float(cell) for cell in line.split(",")]
        for line in (tmp_path / "first" / "given_covariance_1.csv").read_text().splitlines()
    ]
    assert matrix == table["covariance"]
    one, other = (pl.read_csv(tmp_path / name / "residuals.csv") for name in ("first", "again"))
    np.testing.assert_allclose(one["v"].to_numpy(), other["v"].to_numpy(), atol=1e-12)


def _without(key: str, table: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in table.items() if name != key}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda t: _without("covariance", t),
            "column cluster: it needs the covariances of this table",
        ),
        (lambda t: {**t, "cluster": "all"}, "column cluster: it needs the covariances of this table"),
        (lambda t: {**t, "covariance": t["covariance"][:-1]}, "expected"),
        (
            lambda t: {**t, "covariance": [t["covariance"][0][:-1], *t["covariance"][1:]]},
            "values in row 1, expected",
        ),
        (
            lambda t: {**t, "covariance": [[-v for v in row] for row in t["covariance"]]},
            "cluster 'session 0': the covariance matrix is not positive definite",
        ),
        (lambda t: {**t, "rows": [[*t["rows"][0][:-1], ""], *t["rows"][1:]]}, "cluster is empty"),
    ],
)
def test_mistakes_are_told(tmp_path: Path, change: Any, words: str) -> None:
    points, found = _many(2)
    table = change(one_table(found, np.arange(6)))
    told = mor("check", write(tmp_path, project([table], points, "en")))
    assert told.code == 2
    assert words in told.err


def test_a_plan_is_simulated_with_its_clusters(tmp_path: Path) -> None:
    points, found = _many(6)
    table = one_table(found, np.arange(18))
    path = write(tmp_path, project([table], points, "en"))
    made = mor("simulate", path, "-o", tmp_path / "made", "--seed", 1)
    assert made.code == 0, made.err
    names = [file.name for file in (tmp_path / "made").iterdir() if file.suffix == ".yaml"]
    told = mor("adjust", tmp_path / "made" / names[0], "-o", tmp_path / "out", "--no-html")
    assert told.code in (0, 1), told.err
    rows = pl.read_csv(tmp_path / "out" / "residuals.csv")
    assert rows.height == len(table["covariance"])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_x_north_is_y_north_with_all_swapped(tmp_path: Path, seed: int) -> None:
    (points, _), *found = clusters(seed)
    every = np.arange(sum(len(rows) for rows, _ in found))
    east = solved(tmp_path / "east", project([one_table(found, every)], points, "en"))
    swapped = []
    for rows, Q in found:
        turned, order = [], []
        for start, end, dx, dy, dz in rows:
            first, seen = len(order), [axis for axis in (0, 1, 2) if (dx, dy, dz)[axis] is not None]
            order += [first + seen.index(axis) for axis in (1, 0, 2) if axis in seen]
            turned.append([start, end, dy, dx, dz])
        swapped.append((turned, Q[np.ix_(order, order)]))
    places = [[name, y, x, z] for name, x, y, z in points]
    north = solved(tmp_path / "north", project([one_table(swapped, every)], places, "ne"))
    assert north.quality.sigma0 == pytest.approx(east.quality.sigma0, rel=1e-10)
    np.testing.assert_allclose(north.quality.groups[0].r, east.quality.groups[0].r, atol=1e-9)
