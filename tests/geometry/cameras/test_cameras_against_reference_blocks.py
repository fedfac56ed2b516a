"""Residuals of published adjustments, recomputed from their solutions by the camera models."""

from __future__ import annotations

import csv
import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mor.model.cameras import CAMERA_MODELS
from mor.types import FloatArray


def rows(path: Path) -> list[dict[str, str]]:
    content = path.read_bytes()
    text = (gzip.decompress(content) if path.suffix == ".gz" else content).decode()
    return list(csv.DictReader(text.splitlines()))


def columns(table: list[dict[str, str]], *names: str) -> FloatArray:
    return np.array([[float(row[name]) for name in names] for row in table])


def to_image_system(points: FloatArray, poses: FloatArray) -> FloatArray:
    """(Rx(ω) Ry(φ) Rz(κ))ᵀ (X − X0) for points (n, 3) and poses (n, 6) = X0, Y0, Z0, ω, φ, κ in radians."""
    difference = points - poses[:, :3]
    for axis, angle in enumerate(poses[:, 3:].T):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        turned = difference.copy()
        turned[:, first] = np.cos(angle) * difference[:, first] + np.sin(angle) * difference[:, second]
        turned[:, second] = np.cos(angle) * difference[:, second] - np.sin(angle) * difference[:, first]
        difference = turned
    return difference


AICON_ORDER = (
    ("PRINCIPAL_DISTANCE", ""),
    ("PRINCIPAL_POINT_X", ""),
    ("PRINCIPAL_POINT_Y", ""),
    ("RADIAL_POLYNOMIAL_A", "1"),
    ("RADIAL_POLYNOMIAL_A", "2"),
    ("RADIAL_POLYNOMIAL_A", "3"),
    ("TANGENTIAL_DISTORTION_Bx", ""),
    ("TANGENTIAL_DISTORTION_By", ""),
    ("AFFINITY_AND_SHEAR_Cx", ""),
    ("AFFINITY_AND_SHEAR_Cy", ""),
)


def test_mor_reproduces_the_residuals_of_9972_image_points(shared_data: Callable[[str], Path]) -> None:
    folder = shared_data("aicon-115")
    solution: dict[str, dict[tuple[str, str], float]] = {}
    for row in rows(folder / "expected" / "A_report_free_all.csv"):
        solution.setdefault(row["id"], {})[row["param"], row["order"]] = float(row["value"])
    observed = rows(folder / "observations.csv.gz")
    reference = rows(folder / "expected" / "residuals_redundancy_A.csv.gz")
    assert [(r["image"], r["point"]) for r in observed] == [(r["image"], r["point"]) for r in reference]

    points = np.array([list(solution[f"P:{row['point']}"].values()) for row in observed])
    poses = np.array([list(solution[f"I:{row['image']}"].values()) for row in observed])
    interior = np.tile([solution["C:1"][key] for key in AICON_ORDER], (len(observed), 1))
    constants = np.full((len(observed), 1), float(rows(folder / "cameras.csv")[0]["r0_mm"]))
    measured = columns(observed, "x_mm", "y_mm")
    star = to_image_system(points, poses)
    v = CAMERA_MODELS["mor"].project(star, interior, constants, measured).xy - measured
    # the table gives v to 1e-9 mm
    np.testing.assert_allclose(v, columns(reference, "vx_mm", "vy_mm"), atol=2e-9)


def camcal_residuals(folder: Path, key: str, expected: dict[str, Any]) -> FloatArray:
    """Residuals in px, y up, of the camera calibration at the reference solution."""
    sheet = rows(folder / "cameras.csv")[0]
    pixel, width, height = (float(sheet[name]) for name in ("pixel_mm", "sensor_w_mm", "sensor_h_mm"))
    observed = rows(folder / "observations.csv")
    known = {row["point_id"]: columns([row], "X", "Y", "Z")[0] for row in rows(folder / "points.csv")}
    known.update({name: np.array(values[:3]) for name, values in expected["points"].items()})
    points = np.array([known[row["point_id"]] for row in observed])
    poses = np.array([expected["images"][row["image_id"]]["value"] for row in observed])
    poses[:, 3:] = np.radians(poses[:, 3:])

    camera = {name: entry["value"] for name, entry in expected["camera"].items()}
    # x right, y down from the corner becomes x right, y up from the centre
    camera["xh"], camera["yh"] = camera["xp"] - width / 2, height / 2 - camera["yp"]
    model = CAMERA_MODELS[key]
    interior = np.tile([camera[component.name] for component in model.components], (len(observed), 1))
    measured = columns(observed, "x_px", "y_px") * [pixel, -pixel] + [-width / 2, height / 2]
    star = to_image_system(points, poses)
    return (model.project(star, interior, np.empty((len(star), 0)), measured).xy - measured) / pixel


@pytest.mark.parametrize(
    ("key", "block"), [("brown", "reference_model3"), ("brown-forward", "reference_model_forward")]
)
def test_brown_reproduces_the_camera_calibration(key: str, block: str, shared_data: Callable[[str], Path]) -> None:
    folder = shared_data("camcal")
    expected = json.loads((folder / "expected.json").read_text())[block]
    v = camcal_residuals(folder, key, expected)
    assert len(v) == 2074
    # sigma is 0.1 px throughout
    np.testing.assert_allclose(np.linalg.norm(v) / 0.1, expected["weighted_residual_norm"], rtol=1e-9)
    vector_rms = np.sqrt(np.mean(np.sum(v * v, axis=1)))
    np.testing.assert_allclose(vector_rms, expected["rms_px"]["point_vector"], rtol=1e-9)
    largest = np.hypot(*v.T).max()
    np.testing.assert_allclose(largest, expected["rms_px"]["max_point"], rtol=1e-7)
