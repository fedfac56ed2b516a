"""Observed coordinates with covariances in turned axes, and a datum that differs from point to point."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mor.api.pipeline import solve_network
from mor.errors import InputError
from tests.reference_data import network_of_yaml, point_results


def _project(axes, rows, columns, covariance, more=""):
    return f"""
mor: 1
axes: {{xy: {axes}}}
points: [{{columns: [id, x, y, z], rows: [[A, "10", "20", "30"], [B, "11", "22", "33"]]}}]
observations:
  - type: coordinates
    columns: {json.dumps(columns)}
    rows: {json.dumps(rows)}
    covariance: {json.dumps(covariance)}
{more}
"""


@pytest.mark.parametrize("axes", ["en", "ne", "nw", "sw", "ws"])
def test_coordinates_that_are_simply_observed_come_back_with_their_covariances(tmp_path, axes):
    random = np.random.default_rng(4)
    root = random.normal(size=(6, 6))
    covariance = root @ root.T + np.eye(6)
    rows = [["A", "10.5", "20", "30"], ["B", "11", "22.5", "33"]]
    text = _project(axes, rows, ["point", "x", "y", "z"], covariance.tolist())
    results = point_results(solve_network(network_of_yaml(text, tmp_path)))
    np.testing.assert_allclose(results["A"][0], [10.5, 20, 30], atol=1e-12)
    np.testing.assert_allclose(results["B"][0], [11, 22.5, 33], atol=1e-12)
    sigma = np.concatenate([results["A"][1], results["B"][1]])
    np.testing.assert_allclose(sigma, np.sqrt(np.diag(covariance)), rtol=1e-9)


@pytest.mark.parametrize("axes", ["en", "nw"])
def test_only_some_components_observed(tmp_path, axes):
    """x of A and z of B: the matrix is in the order of rows and components as given, also where axes are turned."""
    rows = [["A", "10.5", None, None], ["B", None, None, "33.5"]]
    more = "  - {type: coordinates, columns: [point, y, sigma], rows: [[A, 20, 1], [B, 22, 1]]}\n"
    more += "  - {type: coordinates, columns: [point, z, sigma], rows: [[A, 30, 1]]}\n"
    more += "  - {type: coordinates, columns: [point, x, sigma], rows: [[B, 11, 1]]}\n"
    text = _project(axes, rows, ["point", "x", "y", "z"], [[4, 1.5], [1.5, 9]], more)
    results = point_results(solve_network(network_of_yaml(text, tmp_path)))
    np.testing.assert_allclose(results["A"][1], [2, 1, 1], rtol=1e-9)
    np.testing.assert_allclose(results["B"][1], [1, 1, 3], rtol=1e-9)
    assert results["A"][0][0] == pytest.approx(10.5, abs=1e-12)


@pytest.mark.parametrize("axes", ["en", "nw"])
def test_the_datum_may_differ_from_point_to_point(tmp_path, axes):
    """A vector only: x of A, y of both and z of B stay where they are, in the sense of least corrections."""
    text = f"""
mor: 1
axes: {{xy: {axes}}}
points: [{{columns: [id, x, y, z], rows: [[A, "0", "0", "0"], [B, "1", "2", "3"]]}}]
observations:
  - {{type: vector, columns: [from, to, dx, dy, dz, sigma], rows: [[A, B, "1.5", "2.5", "3.5", "1"]]}}
datum: {{free: {{x: [A], y: [A, B], z: [B]}}}}
"""
    results = point_results(solve_network(network_of_yaml(text, tmp_path)))
    np.testing.assert_allclose(results["A"][0], [0, -0.25, -0.5], atol=1e-12)
    np.testing.assert_allclose(results["B"][0], [1.5, 2.25, 3], atol=1e-12)
    np.testing.assert_allclose(results["A"][1] ** 2, [0, 0.25, 1], atol=1e-14)  # σ of zero is the root of round-off


FIXED = """
mor: 1
axes: {xy: AXES}
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 0], [B, 10, 0, 0], [C, 0, 10, 0]], fixed: [x, y, z]}
  - {columns: [id, x, y, z, sigma_y], rows: [[E, 3, 4, 5, 0], [F, 3, 6, 5, 0.1]]}
stations: [{columns: [id, point], rows: [[S, E]], level: LEVEL}]
observations:
  - {type: distance, columns: [from, to, distance], rows: [[A, B, 10.01]], values: {sigma: 0.01}}
  - type: zenith_directions
    columns: [station, to, horizontal, zenith]
    rows: [[S, A, 240.97, 158.26], [S, B, 133.05, 143.20], [S, C, 370.48, 149.00]]
    values: {sigma: 1 mgon}
  - type: coordinates
    columns: [point, x, y, z]
    rows: [[A, 0, null, null], [E, 3, 4, 5], [F, 3, 4, 5]]
    values: {sigma: 0.01}
  - {type: level, columns: [frame, tilt_x, tilt_y], rows: [[S, 0, 0]], values: {sigma: 1 mgon}}
"""


@pytest.mark.parametrize("axes", ["en", "ne", "sw"])
@pytest.mark.parametrize("level", ["fixed", "free"])
def test_what_is_fixed_cannot_be_observed_by_itself(axes, level, tmp_path):
    """Counted with r = 1 it would only make the rest look better; the distance between fixed points checks them."""
    with pytest.raises(InputError) as found:
        network_of_yaml(FIXED.replace("AXES", axes).replace("LEVEL", level), tmp_path)
    told = [problem.message.partition(":")[0] for problem in found.value.problems]
    tilts = ["tilt_x, tilt_y of frame 'S' are fixed"] if level == "fixed" else []
    assert told == ["x of point 'A' is fixed", "y of point 'E' is fixed", *tilts]


def test_a_common_sigma_is_that_of_the_coordinates_given(tmp_path):
    points = '[[A, "", "", "30", 0.01], [B, "11", "22", "", 0.02], [C, "", "", "", ""]]'
    text = "mor: 1\npoints: [{columns: [id, x, y, z, sigma], rows: ROWS}]\ndatum: free\nobservations:\n"
    text += "  - {type: distance, columns: [from, to, distance], rows: [[A, B, 5], [B, C, 5]], values: {sigma: 1}}"
    network = network_of_yaml(text.replace("ROWS", points), tmp_path)
    nan = np.nan
    np.testing.assert_equal(network.sigma["point"], [[nan, nan, 0.01], [0.02, 0.02, nan], [nan, nan, nan]])
    with pytest.raises(InputError, match="x has a σ but no value"):
        network_of_yaml(text.replace("ROWS", points.replace('"", ""]]', '"", 0.01]]')), tmp_path)
