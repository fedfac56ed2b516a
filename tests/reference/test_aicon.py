"""A self-calibrating close-range block (AICON, 115 images): reference adjustment, disturbed start, flat files."""

from __future__ import annotations

import csv
import gzip
import json

import numpy as np
import pytest

from mor.api.pipeline import solve_network
from mor.formats import read_foreign
from tests.reference_data import (
    image_results,
    interior_results,
    network_of,
    network_of_yaml,
    observations,
    point_results,
)

PROJECT = """
mor: 1
units: {{length: mm, angle: rad}}
cameras:
  1:
    r0: 13.488
    interior: {{c: {{free: {c}}}, xh: {{free: {x}}}, yh: {{free: {y}}}, A1: {{free: {A1}}}, A2: {{free: {A2}}}, A3: 0,
      B1: {{free: {B1}}}, B2: {{free: {B2}}}, C1: -7.00801e-05, C2: -3.12627e-05}}
images:
  - file: {images}images.csv
    values: {{camera: "1"}}
    columns: {{image: id, {camera}X0_mm: x, Y0_mm: y, Z0_mm: z, omega_rad: omega, phi_rad: phi, kappa_rad: kappa
      {drop}}}
points:
  - file: {images}points.csv
    columns: {{point: id, X_mm: x, Y_mm: y, Z_mm: z{drop_rays}}}
observations:
  - type: image
    file: observations.csv.gz
    columns: {{x_mm: x, y_mm: y, sx_mm: sigma_x, sy_mm: sigma_y}}
  - type: distance
    file: scalebars.csv
    columns: {{point_a: from, point_b: to, length_mm: distance, sigma_mm: sigma}}
datum: free
"""
PRINTED = {
    "c": 28.78507,
    "x": 0.01734892,
    "y": 0.05668731,
    "A1": -0.0001096069,
    "A2": 1.49566e-07,
    "B1": 5.798428e-06,
}
ROUGH = {**dict.fromkeys(PRINTED, 0.0), "c": 28.5}
SIGMA0 = 0.0005


def project(disturbed):
    """The block as a project file, with the start values of the reference or with rough ones."""
    given = {**(ROUGH if disturbed else PRINTED), "B2": 0.0 if disturbed else -8.64454e-06}
    return PROJECT.format(
        **given,
        images="approx_" if disturbed else "",
        camera="" if disturbed else "camera: null, ",
        drop="" if disturbed else ", n_points: null",
        drop_rays="" if disturbed else ", n_rays: null",
    )


def _solve(folder, disturbed):
    return solve_network(network_of_yaml(project(disturbed), folder))


@pytest.fixture(scope="module")
def folder(shared_data):
    return shared_data("aicon-115")


@pytest.fixture(scope="module")
def solved(folder):
    return _solve(folder, disturbed=False)


@pytest.fixture(scope="module")
def expected(folder):
    return json.loads((folder / "expected.json").read_text())["scenario"]


@pytest.fixture(scope="module")
def parameters(folder):
    """Value and a-posteriori σ by identifier and parameter."""
    with (folder / "expected" / "A_report_free_all.csv").open(newline="") as file:
        return {(r["id"], r["param"]): (float(r["value"]), float(r["sigma_post"])) for r in csv.DictReader(file)}


@pytest.fixture(scope="module")
def rays(folder):
    """Residuals (mm) and redundancy numbers by image, point and component."""
    with gzip.open(folder / "expected" / "residuals_redundancy_A.csv.gz", "rt", newline="") as file:
        rows = list(csv.DictReader(file))
    return {
        (r["image"], r["point"], component): (float(r[f"v{component}_mm"]), float(r[f"r{component}"]))
        for r in rows
        for component in "xy"
    }


def test_size_and_sigma0(solved, expected):
    assert solved.quality is not None, solved.adjustment.reason
    assert solved.adjustment.problem.observations == expected["n_observations"]
    assert solved.adjustment.problem.index.count == expected["n_unknowns"]
    assert solved.adjustment.defect.datum.shape[1] == expected["n_constraints"]
    assert solved.quality.redundancy == expected["redundancy"]
    assert solved.quality.redundancy_sum == pytest.approx(expected["redundancy"], abs=1e-6)
    assert SIGMA0 * solved.quality.sigma0 == pytest.approx(expected["sigma0_mm"], rel=1e-9)


def test_points(solved, parameters):
    for name, (coordinates, sigma) in point_results(solved).items():
        reference = np.array([parameters[f"P:{name}", f"OBJECT_COORDINATE_{c}"] for c in "XYZ"])
        np.testing.assert_allclose(coordinates, reference[:, 0], rtol=0, atol=1e-8, err_msg=name)
        np.testing.assert_allclose(solved.quality.sigma0 * sigma, reference[:, 1], rtol=1e-7, err_msg=name)


def test_images(solved, parameters):
    names = [f"CAMERA_{c}" for c in ("COORDINATE_X", "COORDINATE_Y", "COORDINATE_Z", "OMEGA", "PHI", "KAPPA")]
    for name, (pose, sigma) in image_results(solved).items():
        reference = np.array([parameters[f"I:{name}", c] for c in names])
        difference = pose - reference[:, 0]
        np.testing.assert_allclose(difference[:3], 0.0, atol=1e-8, err_msg=name)
        np.testing.assert_allclose(np.angle(np.exp(1j * difference[3:])), 0.0, atol=1e-11, err_msg=name)
        np.testing.assert_allclose(solved.quality.sigma0 * sigma, reference[:, 1], rtol=1e-7, err_msg=name)


def _check_camera(solved, expected):
    for name, (value, sigma) in interior_results(solved, "1").items():
        reference = expected["camera"][{"xh": "x0", "yh": "y0"}.get(name, name)]
        tolerance = 1e-6 * reference["sigma"]
        assert value == pytest.approx(reference["value"], rel=0, abs=tolerance), name
        assert solved.quality.sigma0 * sigma == pytest.approx(reference["sigma"], rel=1e-7), name


def _check_rays(solved, rays):
    for outcome in observations(solved):
        if outcome.type.startswith("image"):
            v, r = rays[(*outcome.references, outcome.component)]
            assert outcome.v == pytest.approx(v, rel=0, abs=2e-9), outcome
            assert outcome.r == pytest.approx(r, rel=0, abs=2e-8), outcome


def test_camera(solved, expected):
    _check_camera(solved, expected)


def test_residuals_and_redundancy_numbers(solved, rays):
    _check_rays(solved, rays)


def test_the_scale_bar_is_not_controlled(solved):
    (bar,) = (outcome for outcome in observations(solved) if outcome.type == "distance")
    assert bar.r == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(solved.quality.w[1]).all()


def test_disturbed_start_leads_to_the_same_network_in_another_datum(folder, solved, expected, rays):
    other = _solve(folder, disturbed=True)
    assert other.quality.sigma0 == pytest.approx(solved.quality.sigma0, rel=1e-9)
    _check_camera(other, expected)
    _check_rays(other, rays)
    here, there = (np.array([x for x, _ in point_results(s).values()]) for s in (solved, other))
    assert np.abs(here - there).max() > 0.1
    np.testing.assert_allclose(_distances(here), _distances(there), rtol=0, atol=1e-8)


def _distances(points):
    return np.linalg.norm(points[:, None] - points[None], axis=2)


@pytest.mark.parametrize("name", ["", "example", "example.ior", "example.phc.gz"])
def test_flat_files_are_found(folder, name):
    document = read_foreign(folder / name)
    assert [len(table["rows"]) for table in document.data["observations"]] == [9972, 1]
    assert len(document.data["images"][0]["rows"]) == 115
    assert len(document.data["points"][0]["rows"]) == 150


def test_flat_files_are_the_same_network(folder, expected, parameters):
    """With the σ of the four rays that were weighted down, the imported project is the reference adjustment."""
    document = read_foreign(folder)
    rays = document.data["observations"][0]
    del rays["values"]
    rays["columns"] = [*rays["columns"], "sigma"]
    down = {("48", "27"), ("48", "49"), ("48", "60"), ("54", "49")}
    rays["rows"] = [[*row, "0.005" if (row[0], row[1]) in down else "0.0005"] for row in rays["rows"]]
    imported = solve_network(network_of(document, folder))
    assert imported.quality.redundancy == expected["redundancy"]
    assert SIGMA0 * imported.quality.sigma0 == pytest.approx(expected["sigma0_mm"], rel=1e-5)
    for name, (coordinates, _) in point_results(imported).items():
        reference = [parameters[f"P:{name}", f"OBJECT_COORDINATE_{c}"][0] for c in "XYZ"]
        np.testing.assert_allclose(coordinates, reference, rtol=0, atol=1e-4, err_msg=name)
