"""A camera calibration (DBAT's ``camcal``): both directions of the distortion, free network, failures, import."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

from mor.api.pipeline import solve_network
from mor.formats import read_foreign
from mor.solve.iterate import Outcome
from tests.reference_data import (
    image_results,
    interior_results,
    network_of,
    network_of_yaml,
    point_results,
    reference_folder,
)

WIDTH, HEIGHT, PIXEL = 2272, 1704, 0.0031911032863849768
PROJECT = """
mor: 1
units: {{length: m, angle: deg}}
cameras:
  1:
    model: {model}
    image: {{width: {WIDTH}, height: {HEIGHT}, pixel: {PIXEL} mm}}
    coordinates: corner
    interior: {{c: {{free: 7.3}}, xh: {{free: 0}}, yh: {{free: 0}}, {distortion}}}
images:
  - file: images.csv
    columns: {{image_id: id, camera_id: camera, name: null, X0: x, Y0: y, Z0: z, omega_deg: omega, phi_deg: phi,
      kappa_deg: kappa, sX0: null, sY0: null, sZ0: null}}
points:
  - file: points.csv
    columns: {{point_id: id, X: x, Y: y, Z: z, role: null, label: null, {sigmas}}}
observations:
  - type: image
    file: {observations}
    columns: {{image_id: image, point_id: point, x_px: x, y_px: y, sx_px: sigma_x, sy_px: sigma_y}}
datum: {datum}
"""
KNOWN = "sX: sigma_x, sY: sigma_y, sZ: sigma_z"
UNKNOWN = "sX: null, sY: null, sZ: null"
FREE = "{free: all, movements: reference}"
"""The reference takes G and X0 from the approximate coordinates."""
CASES = pytest.mark.parametrize("case", ["reference_model3", "reference_model_forward", "free_network_model3"])


def project(case, observations="observations.csv"):
    forward, free = case == "reference_model_forward", case == "free_network_model3"
    names = ("K1", "K2", "K3", "P1", "P2") if forward else ("K1", "K2", "K3", "P1", "P2", "b1")
    return PROJECT.format(
        model="brown-forward" if forward else "brown",
        distortion=", ".join(f"{name}: {{free: 0}}" for name in names),
        sigmas=UNKNOWN if free else KNOWN,
        datum=FREE if free else "fixed",
        observations=observations,
        WIDTH=WIDTH,
        HEIGHT=HEIGHT,
        PIXEL=PIXEL,
    )


@pytest.fixture
def folder(shared_data):
    return shared_data("camcal")


@cache
def _solved(case):
    folder = reference_folder("camcal")
    return solve_network(network_of_yaml(project(case), folder))


@cache
def _expected(case):
    return json.loads((reference_folder("camcal") / "expected.json").read_text())[case]


def _reported(name, value):
    """Value of a component as the reference reports it: principal point from the upper left corner, y down."""
    return {"xh": value + 0.5 * WIDTH * PIXEL, "yh": 0.5 * HEIGHT * PIXEL - value}.get(name, value)


@CASES
def test_size_and_sigma0(folder, case):
    solved, expected = _solved(case), _expected(case)
    assert solved.quality is not None, solved.adjustment.reason
    assert solved.adjustment.problem.observations == expected["n_observations"]
    assert solved.adjustment.problem.index.count == expected["n_unknowns"]
    assert solved.quality.redundancy == expected["redundancy"]
    assert solved.adjustment.defect.datum.shape[1] == expected.get("datum_defect", 0)
    assert solved.quality.sigma0 == pytest.approx(expected["sigma0"], rel=1e-9)
    norm = np.sqrt(solved.adjustment.normals.objective)
    assert norm == pytest.approx(expected["weighted_residual_norm"], rel=1e-9)


@CASES
def test_camera(folder, case):
    solved, expected = _solved(case), _expected(case)["camera"]
    for name, (value, sigma) in interior_results(solved, "1").items():
        reference = expected[{"xh": "xp", "yh": "yp"}.get(name, name)]
        tolerance = 1e-8 if name in ("c", "xh", "yh") else 1e-5 * (reference["std"] or 0.0)
        assert _reported(name, value) == pytest.approx(reference["value"], rel=0, abs=tolerance), name
        if reference["std"] is not None:
            assert solved.quality.sigma0 * sigma == pytest.approx(reference["std"], rel=1e-7), name


@CASES
def test_points(folder, case):
    solved, expected = _solved(case), _expected(case)["points"]
    for name, (coordinates, sigma) in point_results(solved).items():
        if name not in expected:
            assert (sigma == 0.0).all(), name
            continue
        np.testing.assert_allclose(coordinates, expected[name][:3], rtol=0, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(solved.quality.sigma0 * sigma, expected[name][3:], rtol=1e-7, err_msg=name)


@CASES
def test_images(folder, case):
    solved, expected = _solved(case), _expected(case)["images"]
    for name, (pose, sigma) in image_results(solved).items():
        reference = np.array(expected[name]["value"])
        np.testing.assert_allclose(pose[:3], reference[:3], rtol=0, atol=1e-8, err_msg=name)
        turn = np.angle(np.exp(1j * (pose[3:] - np.radians(reference[3:]))))
        np.testing.assert_allclose(np.degrees(turn), 0.0, atol=1e-7, err_msg=name)
        std = solved.quality.sigma0 * np.concatenate([sigma[:3], np.degrees(sigma[3:])])
        np.testing.assert_allclose(std, expected[name]["std"], rtol=2e-7, err_msg=name)


def _without(folder, tmp_path, drop):
    """Solve with some of the rays left out."""
    header, *rows = (folder / "observations.csv").read_text().splitlines()
    kept = [row for row in rows if not drop(*row.split(",")[:2])]
    path = tmp_path / "observations.csv"
    path.write_text("\n".join([header, *kept]) + "\n")
    return solve_network(network_of_yaml(project("reference_model3", str(path)), folder)).adjustment


def test_a_point_with_one_ray_is_named(folder, tmp_path):
    adjustment = _without(folder, tmp_path, lambda image, point: point == "88" and image != "1")
    assert adjustment.outcome is Outcome.SINGULAR
    assert adjustment.defect.datum.shape[1] == 0
    (direction,) = adjustment.defect.undetermined
    assert {block for _, block, _ in direction.unknowns} == {"88"}


def test_points_without_rays_are_named(folder, tmp_path):
    adjustment = _without(folder, tmp_path, lambda image, point: point in ("13", "60"))
    assert adjustment.outcome is Outcome.SINGULAR
    assert len(adjustment.defect.undetermined) == 6
    named = {block for direction in adjustment.defect.undetermined for _, block, _ in direction.unknowns}
    assert named == {"13", "60"}


def test_without_control_the_missing_datum_is_named(folder):
    text = project("free_network_model3").replace(FREE, "fixed")
    adjustment = solve_network(network_of_yaml(text, folder)).adjustment
    assert adjustment.outcome is Outcome.SINGULAR
    assert len(adjustment.defect.movements) == 7
    assert "scale" in adjustment.defect.movements


def test_photomodeler_export_is_the_same_network(folder):
    """The export has the rays and the start values; with b1 free its free network has the reference's camera."""
    document = read_foreign(folder / "camcal-pmexport.txt")
    (name,) = document.data["cameras"]
    document.data["cameras"][name]["interior"]["b1"] = {"free": "0"}
    solved, expected = solve_network(network_of(document, folder)), _expected("free_network_model3")
    assert solved.adjustment.problem.observations == expected["n_observations"]
    assert solved.quality.redundancy == expected["redundancy"]
    assert solved.quality.sigma0 == pytest.approx(expected["sigma0"], rel=1e-9)
    camera = {
        {"xh": "xp", "yh": "yp"}.get(name, name): _reported(name, value)
        for name, (value, _) in interior_results(solved, name).items()
    }
    for component in ("c", "xp", "yp"):
        assert camera[component] == pytest.approx(expected["camera"][component]["value"], rel=0, abs=1e-8)
