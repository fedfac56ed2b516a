"""Reference networks of this repository: adjusted, and compared number by number with other programs and books.

Each network is a project (``networks/SOURCE/NAME.yaml``) with the expected values beside it (``NAME.expected.json``).
``networks/README.md`` describes the format, the sources and the tolerances.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.reference_data import (
    NETWORKS,
    expected_values,
    image_results,
    interior_results,
    network_name,
    observations,
    point_results,
    solved_network,
    table,
)

AT_LEAST = 60


def _networks(key=""):
    """Parametrise a test with the networks whose expected values have this key."""
    chosen = [path for path in NETWORKS if not key or key in expected_values(path)]
    return pytest.mark.parametrize("path", chosen, ids=network_name)


every_network = _networks()


def _sigma(path: Path) -> float:
    """Factor from a standard deviation for σ0 = 1 to the expected one."""
    return solved_network(path).quality.sigma0 if expected_values(path)["sigmas"] == "a posteriori" else 1.0


def test_there_are_enough_networks():
    assert len(NETWORKS) >= AT_LEAST
    for path in NETWORKS:
        assert expected_values(path)["source"], path
        assert expected_values(path)["expected_from"], path


@every_network
def test_size_redundancy_and_sigma0(path):
    solved, expected = solved_network(path), expected_values(path)
    assert solved.quality is not None, solved.adjustment.reason
    assert solved.adjustment.problem.observations == expected["n"]
    assert solved.adjustment.problem.index.count == expected["u"]
    assert solved.adjustment.defect.datum.shape[1] == expected["defect"]
    assert solved.quality.redundancy == expected["dof"] == expected["n"] - expected["u"] + expected["defect"]
    assert solved.quality.redundancy_sum == pytest.approx(expected["dof"], abs=1e-7)
    tolerance = expected["tolerance"]["sigma0"]
    assert solved.quality.sigma0 == pytest.approx(expected["sigma0"], rel=tolerance, abs=1e-9)


def _compare_points(path, rows, tolerance):
    results = point_results(solved_network(path))
    for row in rows:
        coordinates, sigma = results[row["point"]]
        k, where = "xyz".index(row["component"]), (row["point"], row["component"])
        assert coordinates[k] == pytest.approx(row["value"], rel=0, abs=tolerance["coordinate"]), where
        yield where, _sigma(path) * sigma[k], row["sigma"]


@every_network
def test_points(path):
    expected = expected_values(path)
    tolerance = expected["tolerance"]
    for where, sigma, reference in _compare_points(path, table(expected, "points"), tolerance):
        assert sigma == pytest.approx(reference, rel=tolerance["sigma"], abs=1e-12), where


@_networks("published")
def test_points_as_printed_in_the_book(path):
    expected = expected_values(path)
    tolerance = expected["published"]["tolerance"]
    for where, sigma, reference in _compare_points(path, table(expected, "published"), tolerance):
        assert sigma == pytest.approx(reference, rel=0, abs=tolerance["sigma"]), where


@_networks("images")
def test_images_and_cameras(path):
    solved, expected = solved_network(path), expected_values(path)
    tolerance, results = expected["tolerance"], image_results(solved)
    for row in table(expected, "images"):
        pose, sigma = results[row["image"]]
        position, angles = ([row[c] for c in names] for names in ("xyz", ("omega", "phi", "kappa")))
        np.testing.assert_allclose(pose[:3], position, rtol=0, atol=tolerance["position"])
        turn = np.degrees(np.angle(np.exp(1j * (pose[3:] - np.radians(angles)))))
        np.testing.assert_allclose(turn, 0.0, atol=tolerance["angle"])
        found = _sigma(path) * np.concatenate([sigma[:3], np.degrees(sigma[3:])])
        for value, name in zip(found, ("sx", "sy", "sz", "somega", "sphi", "skappa"), strict=True):
            if row[name] is not None:
                assert value == pytest.approx(row[name], rel=tolerance["sigma"], abs=1e-15), name
    for row in table(expected, "cameras"):
        value, sigma = interior_results(solved, row["camera"])[row["component"]]
        # a value is compared in parts of its own standard deviation
        limit = tolerance["camera"] * row["sigma"]
        assert value == pytest.approx(row["value"], rel=0, abs=limit), row
        assert _sigma(path) * sigma == pytest.approx(row["sigma"], rel=tolerance["sigma"]), row


@every_network
def test_observations(path):
    solved, expected = solved_network(path), expected_values(path)
    tolerance, rows, outcomes = expected["tolerance"], table(expected, "observations"), observations(solved)
    names = [(o.type.split("/")[0], o.component, " ".join(o.references)) for o in outcomes]
    assert names == [(row["type"], row["component"], row["names"]) for row in rows]
    for outcome, row in zip(outcomes, rows, strict=True):
        if row.get("v") is not None:
            assert outcome.v == pytest.approx(row["v"], rel=0, abs=tolerance["v"]), row
        if row.get("r") is not None:
            assert outcome.r == pytest.approx(row["r"], rel=0, abs=tolerance["r"]), row
        if row.get("s") is not None:
            assert _sigma(path) * outcome.s == pytest.approx(row["s"], rel=tolerance["s"], abs=1e-12), row
        if row.get("w") is not None:
            assert outcome.w == pytest.approx(row["w"], rel=tolerance["w"], abs=1e-6), row
    if all("r" in row for row in rows):
        assert sum(row["r"] for row in rows) == pytest.approx(expected["dof"], abs=1e-6)
