"""Error ellipses against closed forms, and those of pairs against the joint covariance."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.stats import chi2, f

from mor.quality.precision import confidence_factor, error_ellipses, error_ellipsoids
from tests.scenarios.small_projects import mor


def test_an_ellipse_is_turned_to_the_azimuth_of_its_larger_axis():
    azimuth = np.radians([0.0, 30.0, 90.0, 120.0, 179.0])
    along = np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
    across = np.stack([np.cos(azimuth), -np.sin(azimuth)], axis=-1)
    covariance = 9.0 * along[:, :, None] * along[:, None] + 4.0 * across[:, :, None] * across[:, None]
    found = error_ellipses(covariance)
    assert found.a == pytest.approx(3.0)
    assert found.b == pytest.approx(2.0)
    assert np.sin(found.azimuth - azimuth) == pytest.approx(0.0, abs=1e-12)
    assert ((found.azimuth >= 0.0) & (found.azimuth < np.pi + 1e-12)).all()


def test_the_directions_of_an_ellipsoid_span_its_covariance():
    draw = np.random.default_rng(4)
    square = draw.standard_normal((20, 3, 3))
    covariance = square @ np.swapaxes(square, 1, 2)
    axes, azimuths, elevations = error_ellipsoids(covariance)
    level = np.cos(elevations)
    directions = np.stack([level * np.sin(azimuths), level * np.cos(azimuths), np.sin(elevations)], axis=-1)
    assert np.einsum("nk,nki,nkj->nij", axes**2, directions, directions) == pytest.approx(covariance)
    assert (np.diff(axes) <= 0.0).all()


@pytest.mark.parametrize("k", [2, 3])
def test_factors_of_confidence(k):
    assert confidence_factor(k, None) ** 2 == pytest.approx(chi2.ppf(0.95, k))
    assert confidence_factor(k, 7.0) ** 2 == pytest.approx(k * f.ppf(0.95, k, 7))


PROJECT = """\
mor: 1
units: {length: m, angle: gon}
axes: {xy: ne}
report: {relative: [[P, Q]%s]}
settings: {dimensions: xy, sigma: apriori}
points:
  - {columns: [id, x, y], rows: [[A, 0, 0], [B, 100, 0], [C, 60, 90]], fixed: [x, y]}
  - {columns: [id, x, y], rows: [[P, 40, 30], [Q, 70, 50]]}
observations:
  - type: horizontal_distance
    columns: [from, to, distance, sigma]
    rows: [[A, P, 50, 0.003], [B, P, 67.0820393, 0.004], [C, P, 63.2455532, 0.002], [A, Q, 86.0232527, 0.003],
           [B, Q, 58.309519, 0.002], [P, Q, 36.0555128, 0.001]]
"""


def test_the_relative_ellipse_is_that_of_the_joint_covariance(tmp_path):
    project = tmp_path / "project.yaml"
    project.write_text(PROJECT % "")
    assert mor("adjust", project, "--quiet", "--full", "--lang", "de").code == 0
    results = json.loads((tmp_path / "project.results" / "results.json").read_text())
    (pair,) = results["relative"]
    assert mor("covariance", project, "--points", "P,Q", "-o", tmp_path / "c.npz").code == 0
    joint = np.load(tmp_path / "c.npz")["covariance"]
    difference = np.hstack([-np.eye(2), np.eye(2)])
    q = difference @ joint @ difference.T
    values, vectors = np.linalg.eigh(q)
    assert (pair["a"], pair["b"]) == pytest.approx(tuple(np.sqrt(values[::-1])))
    # x is north, y east, so atan2(y, x) is the bearing.
    assert np.sin(pair["azimuth"] * np.pi / 200 - np.arctan2(*vectors[::-1, 1])) == pytest.approx(0.0, abs=1e-9)
    along = np.array([30.0, 20.0]) / np.hypot(30.0, 20.0)
    assert pair["sdistance"] == pytest.approx(np.sqrt(along @ q @ along), rel=1e-6)
    report = (tmp_path / "project.results" / "report.txt").read_text()
    assert "Abstände und relative Fehlerellipsen" in report
    assert "mal 2,45 " in report
    assert "Ellipsoide" not in report
    page = (tmp_path / "project.results" / "report.html").read_text()
    assert "relative Fehlerellipsen" in page


def test_pairs_of_unknown_points_are_refused(tmp_path):
    project = tmp_path / "project.yaml"
    project.write_text(PROJECT % ", [P, Qx], [A, A]")
    run = mor("adjust", project)
    assert run.code == 2
    assert "project.yaml:4: point 'Qx' does not exist; did you mean 'Q'?" in run.err
    assert "a pair of one point" in run.err
