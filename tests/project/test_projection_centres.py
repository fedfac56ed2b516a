"""Observations to rotation centres and to projection centres of eccentric cameras: closed forms."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mor.model.rotations import rotation_from_angles
from tests.scenarios.small_projects import Run, mor, write

GON = np.pi / 200.0
X0, ANGLES, HEIGHT = np.array([10.0, 20.0, 100.0]), np.array([30.0, -20.0, 70.0]), 1.5
ECCENTRICITY, BASE = np.array([0.03, -0.05, 0.12]), np.array([0.8, 0.02, -0.01])
A = np.array([4.0, 12.0, 98.0])
D = rotation_from_angles(ANGLES * GON)
ROTATION_CENTRE = X0 + np.array([0.0, 0.0, HEIGHT])
CENTRES = {
    "L": ROTATION_CENTRE,
    "centre:L": ROTATION_CENTRE - D.T @ ECCENTRICITY,
    "centre:R": ROTATION_CENTRE + D.T @ (BASE - ECCENTRICITY),
}
PROJECT = """\
mor: 1
cameras: {K: {interior: {c: 20}}}
points:
  - {columns: [id, x, y, z], rows: [[A, 4, 12, 98]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[B, 5, 12, 98]]}
pairs:
  - {columns: [id, bx, by, bz, omega, phi, kappa], rows: [[rig, BASE]], fixed: [HELD]}
images:
  - columns: [id, camera, x, y, z, omega, phi, kappa, height, rx, ry, rz]
    rows: [[L, K, 10, 20, 100, 30, -20, 70, 1.5, ECC]]
    fixed: [x, y, z, omega, phi, kappa]
    free: [FREE]
  - {columns: [id, camera, leader, pair], rows: [[R, K, L, rig]]}
observations:
  - {type: vector, columns: [from, to, dx, dy, dz, sigma], rows: [[A, B, 1, 0, 0, 0.001]]}
OBSERVATIONS
"""


BASE_HELD, BASE_FREE = "bx, by, bz, omega, phi, kappa", "omega, phi, kappa"


def text(observations: str, ecc: str = "0.03, -0.05, 0.12", free: str = "", held: str = BASE_HELD) -> str:
    words = {
        "OBSERVATIONS": observations,
        "ECC": ecc,
        "FREE": free,
        "HELD": held,
        "BASE": "0.8, 0.02, -0.01, 1, 2, 3",
    }
    result = PROJECT
    for key, value in words.items():
        result = result.replace(key, value)
    return result


def row(kind: str, columns: str, cells: list[Any]) -> str:
    return f"  - {{type: {kind}, columns: [{columns}, sigma], rows: {json.dumps([[*cells, 0.001]])}}}\n"


def adjusted(folder: Path, content: str) -> dict[str, Any]:
    run = mor("adjust", write(folder, content), "--json", "--quiet")
    assert run.code == 0, run.err
    data: dict[str, Any] = json.loads(run.out)
    return data


def vector(name: str) -> str:
    return row("vector", "from, to, dx, dy, dz", ["A", name, *map(float, CENTRES[name] - A)])


def test_a_vector_to_the_projection_centre_gives_the_eccentricity(tmp_path: Path) -> None:
    data = adjusted(tmp_path, text(vector("centre:L"), "0, 0, 0", "rx, ry, rz"))
    found = next(other for other in data["others"] if other["id"] == "image L")["components"]
    np.testing.assert_allclose([found[key]["value"] for key in ("rx", "ry", "rz")], ECCENTRICITY, atol=1e-9)


def test_a_vector_to_the_projection_centre_of_a_follower_gives_the_base(tmp_path: Path) -> None:
    data = adjusted(tmp_path, text(vector("centre:R"), held=BASE_FREE))
    np.testing.assert_allclose([data["pairs"][0][key] for key in ("bx", "by", "bz")], BASE, atol=1e-9)


OBSERVED = {
    "distance": lambda d: np.linalg.norm(d),
    "horizontal_distance": lambda d: np.hypot(d[0], d[1]),
    "bearing": lambda d: np.arctan2(d[0], d[1]) / GON,
    "zenith_angle": lambda d: np.arccos(d[2] / np.linalg.norm(d)) / GON,
    "height_difference": lambda d: d[2],
}
COMPONENTS = {"horizontal_distance": "distance", "height_difference": "dz"}


@pytest.mark.parametrize("kind", OBSERVED)
@pytest.mark.parametrize("name", CENTRES)
def test_where_an_image_is_for_every_type(kind: str, name: str, tmp_path: Path) -> None:
    value = float(OBSERVED[kind](CENTRES[name] - A)) + 0.0005
    observed = row(kind, f"from, to, {COMPONENTS.get(kind, kind)}", ["A", name, value])
    data = adjusted(tmp_path, text(observed))
    residual = next(r for r in data["residuals"] if r["type"].startswith(kind))
    assert residual["v"] == pytest.approx(-0.0005, abs=1e-9)


def test_coordinates_of_an_image_are_those_of_its_position(tmp_path: Path) -> None:
    """Of the tripod target: coordinates know no heights; those of the projection centre do."""
    for name, at in {**CENTRES, "L": X0}.items():
        observed = row("coordinates", "point, x, y, z", [name, *map(float, at)])
        loose = text(observed).replace("fixed: [x, y, z, omega,", "fixed: [omega,").replace("10, 20, 100,", "9, 9, 99,")
        (image, follower) = adjusted(tmp_path / name.replace(":", ""), loose)["images"]
        np.testing.assert_allclose([image[axis] for axis in "xyz"], X0, atol=1e-9)
        np.testing.assert_allclose([follower[axis] for axis in "xyz"], CENTRES["centre:R"], atol=1e-9)
        attitude = rotation_from_angles(np.array([follower[name] for name in ("omega", "phi", "kappa")]) * GON)
        np.testing.assert_allclose(attitude, rotation_from_angles(np.array([1, 2, 3]) * GON) @ D, atol=1e-9)


def test_a_follower_is_no_position(tmp_path: Path) -> None:
    run: Run = mor("check", write(tmp_path, text(row("distance", "from, to, distance", ["A", "R", 5.0]))))
    assert run.code == 2
    assert (
        "image 'R' follows another one and is not a position of its own; centre:R is its projection centre" in run.err
    )
