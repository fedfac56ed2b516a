"""The independent computation: it repeats the expected values of the reduced blocks, and a published result."""

from __future__ import annotations

import ast
import csv
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.reference import dense_bundle
from tests.reference_data import NETWORKS, expected_values, network_name, table

BLOCKS = [path for path in NETWORKS if "dense_bundle" in expected_values(path)["expected_from"]]


def test_it_shares_no_code_with_mor():
    tree = ast.parse(Path(dense_bundle.__file__).read_text(encoding="utf-8"))
    imports = {
        name.split(".")[0]
        for node in ast.walk(tree)
        if isinstance(node, (ast.Import, ast.ImportFrom))
        for name in ([node.module or ""] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names])
    }
    assert imports == {"__future__", "json", "sys", "pathlib", "numpy", "yaml"}


@pytest.mark.parametrize("path", BLOCKS, ids=network_name)
def test_it_repeats_the_expected_values(path):
    expected = expected_values(path)
    found = dense_bundle.adjust(yaml.safe_load(path.read_text(encoding="utf-8")))
    assert all(found[key] == expected[key] for key in ("n", "u", "defect", "dof"))
    assert found["sigma0"] == pytest.approx(expected["sigma0"], rel=1e-11)
    for name in ("cameras", "images", "points", "observations"):
        for row, reference in zip(table(found, name), table(expected, name), strict=True):
            for column, value in reference.items():
                if isinstance(value, float):
                    value = pytest.approx(value, rel=1e-6, abs=0.0 if name == "cameras" else 1e-11)
                assert row[column] == value, (name, row, column)


def _rows(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_it_gives_the_published_result_of_the_whole_calibration(shared_data):
    folder = shared_data("camcal")
    tables = {}
    for row in _rows(folder / "points.csv"):
        role = tables.setdefault(row["role"], {"columns": ["id", "x", "y", "z"], "rows": []})
        role["rows"].append([row["point_id"], *(float(row[c]) for c in "XYZ")])
    tables["control_fixed"]["fixed"] = ["x", "y", "z"]
    pose = ("X0", "Y0", "Z0", "omega_deg", "phi_deg", "kappa_deg")
    images = [[row["image_id"], *(float(row[c]) for c in pose)] for row in _rows(folder / "images.csv")]
    rays = [
        [row["image_id"], row["point_id"], float(row["x_px"]), float(row["y_px"])]
        for row in _rows(folder / "observations.csv")
    ]
    names = ("xh", "yh", "K1", "K2", "K3", "P1", "P2", "b1")
    (camera,) = _rows(folder / "cameras.csv")
    width, height = int(camera["width_px"]), int(camera["height_px"])
    pixel = float(camera["pixel_mm"])
    project = {
        "cameras": {
            1: {
                "model": "brown",
                "image": {"width": width, "height": height, "pixel": pixel},
                "interior": {"c": {"free": 7.3}, **{name: {"free": 0} for name in names}},
            }
        },
        "images": [{"columns": ["id", "x", "y", "z", "omega", "phi", "kappa"], "rows": images}],
        "points": list(tables.values()),
        "observations": [{"values": {"sigma": 0.1}, "rows": rays}],
    }
    found = dense_bundle.adjust(project)
    expected = json.loads((folder / "expected.json").read_text(encoding="utf-8"))
    published, reference = expected["published_report_model3"], expected["reference_model3"]
    assert (found["n"], found["u"], found["dof"]) == (4148, 423, 3725)
    assert found["sigma0"] == pytest.approx(published["sigma0"], rel=1e-4)
    assert found["sigma0"] == pytest.approx(reference["sigma0"], rel=1e-9)
    for row in table(found, "cameras"):
        name = {"xh": "xp", "yh": "yp"}.get(row["component"], row["component"])
        value = {"xp": row["value"] + width * pixel / 2, "yp": height * pixel / 2 - row["value"]}.get(
            name, row["value"]
        )
        given = reference["camera"][name]
        assert value == pytest.approx(given["value"], rel=0, abs=1e-5 * given["std"]), name
        assert row["sigma"] == pytest.approx(given["std"], rel=1e-7), name
    points = {(row["point"], row["component"]): row for row in table(found, "points")}
    for name, numbers in reference["points"].items():
        rows = [points[name, c] for c in "xyz"]
        np.testing.assert_allclose([row["value"] for row in rows], numbers[:3], rtol=0, atol=1e-9)
        np.testing.assert_allclose([row["sigma"] for row in rows], numbers[3:], rtol=1e-7)
