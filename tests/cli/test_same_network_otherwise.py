"""The same network with other names and all rows in another order, from nothing: the same results."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mor.types import FloatArray
from tests.scenarios.mixtures.ingredients import mixture
from tests.scenarios.mixtures.project_file import write_project
from tests.scenarios.mixtures.surveys.composed import composed
from tests.scenarios.small_projects import mor
from tests.selection import slow_after

NAMED = ("id", "point", "image", "station", "at", "from", "to")
"""Columns of names."""


def otherwise(folder: Path, draw: np.random.Generator) -> dict[str, str]:
    """Give everything in a project another name, and its rows another order; the new name of each."""
    document = yaml.safe_load((folder / "project.yaml").read_text(encoding="utf-8"))
    files = {}
    for path in folder.glob("*.csv"):
        with path.open(encoding="utf-8") as stream:
            files[path] = list(csv.reader(stream))
    named: set[str] = set()
    for columns, rows in [*_tables(document), *((rows[0], rows[1:]) for rows in files.values())]:
        named |= {str(row[columns.index(one)]) for one in NAMED if one in columns for row in rows} - {""}
    new = {name: f"n{number}" for name, number in zip(sorted(named), draw.permutation(len(named)), strict=True)}
    (folder / "project.yaml").write_text(json.dumps(_renamed(document, new, draw)), encoding="utf-8")
    for path, (heading, *rows) in files.items():
        mixed = [[new.get(cell, cell) for cell in rows[k]] for k in draw.permutation(len(rows))]
        with path.open("w", encoding="utf-8", newline="") as stream:
            csv.writer(stream).writerows([heading, *mixed])
    return new


def _tables(node: object) -> list[tuple[list[str], list[list[object]]]]:
    if isinstance(node, dict):
        own = [(node["columns"], node["rows"])] if isinstance(node.get("rows"), list) else []
        return own + [table for value in node.values() for table in _tables(value)]
    return [table for value in node for table in _tables(value)] if isinstance(node, list) else []


def _renamed(node: object, new: dict[str, str], draw: np.random.Generator) -> object:
    if isinstance(node, dict):
        found = {
            key: value if key in ("columns", "type", "title") else _renamed(value, new, draw)
            for key, value in node.items()
        }
        if isinstance(found.get("rows"), list):
            of_names = [column in NAMED for column in found["columns"]]
            rows = [
                [new.get(str(cell), cell) if name else cell for cell, name in zip(row, of_names, strict=True)]
                for row in found["rows"]
            ]
            found["rows"] = [rows[k] for k in draw.permutation(len(rows))]
        return found
    if isinstance(node, list):
        return [_renamed(value, new, draw) for value in node]
    return new.get(node, node) if isinstance(node, str) else node


def adjusted(folder: Path) -> tuple[dict[str, Any], dict[str, FloatArray]]:
    """``results.json``, and the coordinates of every point and their σ (6,)."""
    options = ["--quiet", "--no-html", "--table-format", "csv", "-o", folder / "results"]
    told = mor("adjust", folder / "project.yaml", *options)
    assert told.code in (0, 1), told.err
    found = json.loads((folder / "results" / "results.json").read_text(encoding="utf-8"))
    with (folder / "results" / "points.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    columns = ("x", "y", "z", "sx", "sy", "sz")
    return found, {row["id"]: np.array([float(row[one] or "nan") for one in columns]) for row in rows}


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        *slow_after(1, [("mixture", seed) for seed in (9100001, 9100002, 9100003, 9100005)]),
        *slow_after(0, [("composed", seed) for seed in (9200001, 9200003, 9200004, 9200005)]),
    ],
)
def test_results_depend_on_neither_names_nor_order(kind, seed, tmp_path):
    for name in ("one", "other"):
        if kind == "mixture":
            write_project(mixture(seed), tmp_path / name)
        else:
            composed(seed).write(tmp_path / name)
        (tmp_path / name / "truth.yaml").unlink()
    new = otherwise(tmp_path / "other", np.random.default_rng(seed))
    (told, points), (of_other, points_of_other) = (adjusted(tmp_path / name) for name in ("one", "other"))
    for key in ("outcome", "observations", "unknowns", "redundancy", "flagged", "uncontrolled"):
        assert told[key] == of_other[key]
    np.testing.assert_allclose(of_other["sigma0"]["aposteriori"], told["sigma0"]["aposteriori"], rtol=1e-7)
    assert points_of_other.keys() == {new[name] for name in points}
    if told["datum"] == "fixed":  # from nothing, a free network lies anywhere
        for name, values in points.items():
            sigma = np.where(values[3:] > 0.0, values[3:], 1.0)
            there = points_of_other[new[name]]
            np.testing.assert_allclose(there[:3] / sigma, values[:3] / sigma, atol=1e-3)
            np.testing.assert_allclose(there[3:] / sigma, values[3:] / sigma, atol=1e-3)
