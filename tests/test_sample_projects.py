"""Every sample project: its files come out of the simulation, and the program finds the truth in them."""

from __future__ import annotations

import csv
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

ROOT = Path(__file__).resolve().parents[1]
from sample_projects import expected  # noqa: E402
from sample_projects.simulate import SCENES, content, simulate  # noqa: E402
from tests.scenarios.small_projects import mor  # noqa: E402
from tests.selection import slow_but  # noqa: E402

FOLDER = ROOT / "sample_projects"
LARGEST = 4.5
"""Largest error in units of its σ: of some 2 000 coordinates, one in 70 runs of all samples would exceed it."""

each_sample = pytest.mark.parametrize("name", SCENES)
with_parameters = pytest.mark.parametrize(
    "name", [name for name in SCENES if (FOLDER / name / "truth" / "parameters.csv").is_file()]
)


@cache
def solved_sample(name: str) -> Any:
    return expected.solve_sample(name)


@cache
def true_points(name: str) -> dict[str, np.ndarray]:
    with (FOLDER / name / "truth" / "points.csv").open(newline="") as file:
        rows = csv.reader(file)
        next(rows)  # x, y, z, or on the earth east, north, height
        return {name: np.array([float(cell) for cell in place]) for name, *place in rows}


def sample_files(name: str) -> list[Path]:
    """Files of a sample, without the results that somebody may have had written beside them."""
    folder = FOLDER / name
    return [path for place in (folder, folder / "truth") for path in place.iterdir() if path.is_file()]


def moved_onto(points: np.ndarray, target: np.ndarray, movements: tuple[str, ...]) -> np.ndarray:
    """Points (n, 3) after the least-squares similarity that brings them closest to the target (Kabsch, Umeyama)."""
    centre, target_centre = points.mean(axis=0), target.mean(axis=0)
    one, other = points - centre, target - target_centre
    with_scale = "scale" in movements
    if "rotation X" not in movements:
        turn = np.angle(np.sum((one[:, 0] - 1j * one[:, 1]) * (other[:, 0] + 1j * other[:, 1])))
        about_z = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
        level: np.ndarray = one @ about_z.T + target_centre
        return level
    left, sizes, right = np.linalg.svd(other.T @ one)
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    scale = (sizes * np.diag(sign)).sum() / (one**2).sum() if with_scale else 1.0
    moved: np.ndarray = scale * one @ (left @ sign @ right).T + target_centre
    return moved


@pytest.mark.parametrize("name", slow_but(set(SCENES) - {"drone_block", "three_line_strip", "dam"}, SCENES))
def test_simulation_reproduces_the_files(name: str) -> None:
    files = simulate(name)
    for file, found in files.items():
        assert (FOLDER / name / file).read_bytes() == content(found), f"{name}/{file}"
    tables = {
        path.relative_to(FOLDER / name).as_posix() for path in sample_files(name) if path.suffix in (".csv", ".gtx")
    }
    assert tables == set(files), "tables that the simulation does not make"


@each_sample
def test_sample_folder_is_complete_and_small(name: str) -> None:
    files = sample_files(name)
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
        assert len(movements) in (4, 6, 7)
        found = moved_onto(found, true, tuple(movements))
    known = sigma > 0.0
    ratio = (found - true)[known] / sigma[known]
    assert np.abs(ratio).max() < LARGEST
    assert 0.6 < np.sqrt(np.mean(ratio**2)) < 1.5, "errors and σ do not fit each other"


@each_sample
def test_cameras_are_what_they_truly_are(name: str) -> None:
    with (FOLDER / name / "truth" / "cameras.csv").open(newline="") as file:
        truth = {(row["camera"], row["component"]): float(row["value"]) for row in csv.DictReader(file)}
    for camera, components in expected.camera_results(solved_sample(name)).items():
        for component, (value, sigma) in components.items():
            assert abs(value - truth.get((camera, component), 0.0)) < LARGEST * sigma, (camera, component)


WIDEST = {"refraction": 0.05, "position shift": 0.06, "time offset": 0.005}
"""Largest σ of parameters by kind; 0.003 of all others."""


@with_parameters
def test_further_parameters_are_what_they_truly_are(name: str) -> None:
    with (FOLDER / name / "truth" / "parameters.csv").open(newline="") as file:
        truth = {(row["kind"], row["block"], row["component"]): float(row["value"]) for row in csv.DictReader(file)}
    results = expected.parameter_results(solved_sample(name))
    for key, true in truth.items():
        value, sigma = results[key]
        assert 0.0 < sigma < WIDEST.get(key[0], 0.003), key
        assert abs(value - true) < LARGEST * sigma, key


@each_sample
def test_results_are_those_written_down(name: str) -> None:
    written = json.loads((FOLDER / name / "expected.json").read_text(encoding="utf-8"))
    _compare(expected.summary(solved_sample(name)), written, name)


@pytest.mark.parametrize("name", slow_but(("bridge", "facade", "panorama"), SCENES))
def test_command_line_gives_the_same(name: str, tmp_path: Path) -> None:
    outcome = mor("adjust", FOLDER / name / "project.yaml", "-o", tmp_path / "results", "-q")
    assert outcome.code == 0, outcome.err
    results = json.loads((tmp_path / "results" / "results.json").read_text(encoding="utf-8"))
    quality = solved_sample(name).quality
    assert results["outcome"] == "converged"
    assert results["redundancy"] == quality.redundancy
    assert results["sigma0"]["aposteriori"] == pytest.approx(quality.sigma0, rel=1e-9)
    assert {point["id"] for point in results["points"]} == set(true_points(name))


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
        coordinate = where[-3:] in (": x", ": y", ": z")
        assert found == pytest.approx(written, rel=0.0 if coordinate else 1e-6, abs=1e-6 if coordinate else 1e-12), (
            where
        )
    else:
        assert found == written, where
