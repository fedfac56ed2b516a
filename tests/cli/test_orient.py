"""``mor orient``: simulated images with known truth, through the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mor.cli import run


def rotation(omega: float, phi: float, kappa: float) -> np.ndarray:
    def turn(axis: int, angle: float) -> np.ndarray:
        c, s = np.cos(angle), np.sin(angle)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        R = np.eye(3)
        R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
        return R

    return (turn(0, omega) @ turn(1, phi) @ turn(2, kappa)).T


def image_of(points: np.ndarray, position: np.ndarray, D: np.ndarray, c: float) -> np.ndarray:
    star = (points - position) @ D.T
    return -c * star[:, :2] / star[:, 2:]


def write(path: Path, ids: list[str], *images: np.ndarray) -> Path:
    header = ",".join(["id", *(f"{axis}{k}" for k in range(1, len(images) + 1) for axis in "xy")])
    rows = [
        ",".join([name, *(repr(float(x)) for x in np.concatenate(row))])
        for name, row in zip(ids, zip(*images, strict=True), strict=True)
    ]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_relative_orientation_of_a_simulated_pair(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(11)
    points = rng.uniform([-4, -3, -12], [4, 3, -7], (20, 3))
    D, base = rotation(0.1, -0.3, 1.2), np.array([0.8, 0.1, -0.2])
    table = write(
        tmp_path / "pairs.csv",
        [f"{k:03d}" for k in range(20)],
        image_of(points, np.zeros(3), np.eye(3), 28.8),
        image_of(points, base, D, 35.0),
    )
    assert run(["orient", "relative", str(table), "-c", "28.8", "-c", "35", "--json", "--angles", "rad"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["outcome"] == "determined"
    np.testing.assert_allclose(data["base"], base / np.linalg.norm(base), atol=1e-9)
    np.testing.assert_allclose(
        [data["angles"][n] for n in ("omega", "phi", "kappa")], [0.1, -0.3, 1.2], atol=1e-9
    )
    assert max(abs(r["coplanarity"]) for r in data["residuals"]) < 1e-6
    assert data["residuals"][0]["id"] == "000"


def test_plane_quadrilateral_with_a_length(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    corners = np.array([[0.0, 0.0, 0.0], [2.5, 0.0, 0.0], [2.7, 1.6, 0.0], [-0.2, 1.9, 0.0]])
    centres = [np.array([0.3, -1.0, 4.0]), np.array([2.9, 0.7, 3.2]), np.array([1.0, 3.0, 4.4])]
    turns = [rotation(0.25, 0.1, 0.4), rotation(-0.1, 0.35, 2.0), rotation(-0.4, 0.0, -1.0)]
    images = [image_of(corners, centre, D, 50.0) for centre, D in zip(centres, turns, strict=True)]
    table = write(tmp_path / "corners.csv", list("ABCD"), *images)
    assert run(["orient", "planar", str(table), "-c", "50", "--length", "A", "B", "2.5", "--json"]) == 0
    solution = json.loads(capsys.readouterr().out)["solutions"][0]
    found = np.array([[p[c] for c in "xyz"] for p in solution["points"]])
    np.testing.assert_allclose(found, corners, atol=1e-6)
    np.testing.assert_allclose([[i[c] for c in "xyz"] for i in solution["images"]], centres, atol=1e-5)


def test_text_has_units_and_the_convention(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform([-4, -3, -12], [4, 3, -7], (12, 3))
    second = image_of(points, np.array([1.0, 0, 0]), np.eye(3), 30.0)
    table = write(
        tmp_path / "p.csv",
        [str(k) for k in range(12)],
        image_of(points, np.zeros(3), np.eye(3), 30.0),
        second,
    )
    assert run(["orient", "relative", str(table), "-c", "30"]) == 0
    text = capsys.readouterr().out
    assert "gon" in text
    assert "X_B* = D* (X_A* - b*)" in text


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("id,x1,y1\n1,0,0\n", "expected the columns id, x1, y1, x2, y2"),
        ("id,x1,y1,x2,y2\n1,0,zero,0,0\n", "y1: found 'zero', expected a number"),
    ],
)
def test_mistakes_are_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str, words: str
) -> None:
    path = tmp_path / "p.csv"
    path.write_text(content)
    assert run(["orient", "relative", str(path), "-c", "30"]) == 2
    assert words in capsys.readouterr().err


def test_seven_points_are_too_few_and_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform([-4, -3, -12], [4, 3, -7], (7, 3))
    images = [image_of(points, np.array(p), np.eye(3), 30.0) for p in ([0.0, 0, 0], [1.0, 0, 0])]
    table = write(tmp_path / "p.csv", [str(k) for k in range(7)], *images)
    assert run(["orient", "relative", str(table), "-c", "30"]) == 4
    assert "fewer than eight homologous points" in capsys.readouterr().out
