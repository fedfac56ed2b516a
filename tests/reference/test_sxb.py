"""A small aerial block with weighted control (DBAT's ``sxb``, experiment S4)."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mor.api.pipeline import solve_network
from tests.reference_data import image_results, network_of_yaml, point_results

PROJECT = """
mor: 1
units: {length: m, angle: deg}
cameras:
  1:
    image: {width: 8858, height: 12996, pixel: 0.006 mm}
    coordinates: corner
    interior: {c: 123.939, xh: 0.003, yh: 0.177}
images:
  - file: images.csv
    columns: {image_id: id, camera_id: camera, name: null, X0: x, Y0: y, Z0: z, omega_deg: omega, phi_deg: phi,
      kappa_deg: kappa, sX0: null, sY0: null, sZ0: null}
points:
  - file: points.csv
    columns: {point_id: id, X: x, Y: y, Z: z, role: null, sX: sigma_x, sY: sigma_y, sZ: sigma_z, label: null}
observations:
  - type: image
    file: observations.csv
    columns: {image_id: image, point_id: point, x_px: x, y_px: y, sx_px: sigma_x, sy_px: sigma_y}
"""
"""xp = 26.577, yp = 38.811 mm from the corner: xh = xp − 8858/2 px, yh = 12996/2 px − yp."""


@pytest.fixture(scope="module")
def block(shared_data):
    folder = shared_data("sxb-s4")
    expected = json.loads((folder / "expected.json").read_text())["reference"]
    return solve_network(network_of_yaml(PROJECT, folder)), expected


def test_size_and_sigma0(block):
    solved, expected = block
    assert solved.quality is not None, solved.adjustment.reason
    assert solved.adjustment.problem.observations == expected["n_observations"]
    assert solved.adjustment.problem.index.count == expected["n_unknowns"]
    assert solved.quality.redundancy == expected["redundancy"]
    assert solved.quality.sigma0 == pytest.approx(expected["sigma0"], rel=1e-9)
    norm = np.sqrt(solved.adjustment.normals.objective)
    assert norm == pytest.approx(expected["weighted_residual_norm"], rel=1e-9)


def test_points(block):
    solved, expected = block
    for name, (coordinates, sigma) in point_results(solved).items():
        reference = np.array(expected["points"][name])
        np.testing.assert_allclose(coordinates, reference[:3], rtol=0, atol=1e-6, err_msg=name)
        np.testing.assert_allclose(solved.quality.sigma0 * sigma, reference[3:], rtol=1e-7, err_msg=name)


def test_images(block):
    solved, expected = block
    for name, (pose, sigma) in image_results(solved).items():
        reference = np.array(expected["images"][name]["value"])
        np.testing.assert_allclose(pose[:3], reference[:3], rtol=0, atol=1e-5, err_msg=name)
        turn = np.angle(np.exp(1j * (pose[3:] - np.radians(reference[3:]))))
        np.testing.assert_allclose(turn, 0.0, atol=3e-10, err_msg=name)  # the reference is reproducible to 2e-10
        std = solved.quality.sigma0 * np.concatenate([sigma[:3], np.degrees(sigma[3:])])
        np.testing.assert_allclose(std, expected["images"][name]["std"], rtol=2e-7, err_msg=name)
