"""Every sample project: its files come out of the simulation, and the program finds the truth in them."""

from __future__ import annotations

import csv
import json
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from sample_projects import expected  # noqa: E402
from sample_projects.simulate import SCENES, simulate  # noqa: E402

FOLDER = ROOT / "sample_projects"
LARGEST = 4.5
"""Largest error in units of its σ: of some 2 000 coordinates, one in 70 runs of all samples would exceed it."""

each_sample = pytest.mark.parametrize("name", SCENES)


@cache
def solved_sample(name: str) -> Any:
    return expected.solve_sample(name)


@cache
def true_points(name: str) -> dict[str, np.ndarray]:
    with (FOLDER / name / "truth" / "points.csv").open(newline="") as file:
        return {row["id"]: np.array([float(row[c]) for c in "xyz"]) for row in csv.DictReader(file)}


def moved_onto(points: np.ndarray, target: np.ndarray, with_scale: bool) -> np.ndarray:
    """Points (n, 3) after the least-squares similarity that brings them closest to the target (Kabsch, Umeyama)."""
    centre, target_centre = points.mean(axis=0), target.mean(axis=0)
    one, other = points - centre, target - target_centre
    left, sizes, right = np.linalg.svd(other.T @ one)
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    scale = (sizes * np.diag(sign)).sum() / (one**2).sum() if with_scale else 1.0
    return scale * one @ (left @ sign @ right).T + target_centre


@each_sample
def test_simulation_reproduces_the_files(name: str) -> None:
    files = simulate(name)
    for file, text in files.items():
        assert (FOLDER / name / file).read_bytes() == text.encode(), f"{name}/{file}"
    tables = {str(path.relative_to(FOLDER / name)) for path in (FOLDER / name).rglob("*.csv")}
    assert tables == set(files), "tables that the simulation does not make"


@each_sample
def test_sample_folder_is_complete_and_small(name: str) -> None:
    files = [path for path in (FOLDER / name).rglob("*") if path.is_file()]
    names = {path.name for path in files}
    assert {"project.yaml", "README.md", "expected.json"} <= names
    assert all(path.stat().st_size < 200_000 for path in files)


@each_sample
def test_sample_converges_with_all_redundancy_accounted_for(name: str) -> None:
    solved = solved_sample(name)
    assert solved.adjustment.outcome.value == "converged", solved.adjustment.reason
    quality = solved.quality
    assert quality.redundancy > 0
    assert quality.redundancy_sum == pytest.approx(quality.redundancy, abs=1e-6)


@each_sample
def test_sigma0_is_what_the_noise_makes_it(name: str) -> None:
    quality = solved_sample(name).quality
    lower, upper = chi2.ppf([0.0005, 0.9995], quality.redundancy) / quality.redundancy
    assert lower < quality.sigma0**2 < upper


@each_sample
def test_points_are_where_they_truly_are(name: str) -> None:
    solved, truth = solved_sample(name), true_points(name)
    results = expected.point_results(solved)
    assert set(results) == set(truth)
    found = np.array([results[point][:3] for point in truth])
    sigma = np.array([results[point][3:] for point in truth])
    true = np.stack(list(truth.values()))
    movements = solved.adjustment.defect.movements
    if movements:
        assert len(movements) in (6, 7)
        found = moved_onto(found, true, with_scale="scale" in movements)
    known = sigma > 0.0
    ratio = (found - true)[known] / sigma[known]
    assert np.abs(ratio).max() < LARGEST
    assert 0.6 < np.sqrt(np.mean(ratio**2)) < 1.5, "errors and σ do not fit each other"


@each_sample
def test_cameras_are_what_they_truly_are(name: str) -> None:
    path = FOLDER / name / "truth" / "cameras.csv"
    if not path.is_file():
        pytest.skip("this sample has no camera")
    with path.open(newline="") as file:
        truth = {(row["camera"], row["component"]): float(row["value"]) for row in csv.DictReader(file)}
    for camera, components in expected.camera_results(solved_sample(name)).items():
        for component, (value, sigma) in components.items():
            assert abs(value - truth.get((camera, component), 0.0)) < LARGEST * sigma, (camera, component)


@each_sample
def test_results_are_those_written_down(name: str) -> None:
    written = json.loads((FOLDER / name / "expected.json").read_text(encoding="utf-8"))
    _compare(expected.summary(solved_sample(name)), written, name)


def _compare(found: Any, written: Any, where: str) -> None:
    if isinstance(written, dict):
        assert list(found) == list(written), where
        for key in written:
            _compare(found[key], written[key], f"{where}: {key}")
    elif isinstance(written, list):
        assert len(found) == len(written), where
        for k, (one, other) in enumerate(zip(found, written, strict=True)):
            _compare(one, other, f"{where}[{k}]")
    elif isinstance(written, float):
        assert found == pytest.approx(written, rel=1e-6, abs=1e-12), where
    else:
        assert found == written, where
