"""The textbook networks: read directly, adjusted, compared with the books and with an independent computation."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
from reference_data import network_of, observations, point_results, reference_files

from mor.formats import read_foreign
from mor.pipeline import solve_network

NETWORKS = pytest.mark.parametrize("path", reference_files("textbook", "?D/*.dat"))
KINDS = {
    "directions": "direction",
    "horizontal_distance": "distance",
    "distance": "s-distance",
    "zenith_angle": "z-angle",
    "vertical_direction": "vertical-angle",
    "bearing": "azimuth",
    "height_difference": "dh",
    "angle": "angle",
    "coordinates": "coordinate",
}


@cache
def _expected(path):
    everything = json.loads((path.parents[1] / "recomputed.json").read_text())
    return everything["networks"][f"{path.parent.name}/{path.stem}"]


@cache
def _solved(path):
    return solve_network(network_of(read_foreign(path), path.parent))


def _estimated(path):
    """Numbers of the components that are estimated."""
    return {"1D": [2], "2D": [0, 1], "3D": [0, 1, 2]}[path.parent.name]


@NETWORKS
def test_network_has_the_expected_size_and_sigma0(path):
    solved, expected = _solved(path), _expected(path)
    assert solved.quality is not None, solved.adjustment.reason
    assert solved.adjustment.problem.observations == expected["n"]
    assert solved.adjustment.problem.index.count == expected["u"]
    assert solved.adjustment.defect.datum.shape[1] == expected["datum_defect"]
    assert solved.quality.redundancy == expected["dof"]
    assert solved.quality.sigma0 == pytest.approx(expected["sigma0_ratio"], rel=1e-6)


@NETWORKS
def test_points_agree_with_the_computation(path):
    expected, results, sigma0 = _expected(path), point_results(_solved(path)), _solved(path).quality.sigma0
    tolerance = 5e-7 if expected["datum_defect"] > 3 else 1e-7 if sigma0 > 5.0 else 1e-8
    for name, point in expected["points"].items():
        coordinates, sigma = (array[_estimated(path)] for array in results[name])
        np.testing.assert_allclose(coordinates, point["coordinates"], rtol=0, atol=tolerance, err_msg=name)
        if "s" in point:
            np.testing.assert_allclose(sigma0 * sigma, point["s"], rtol=1e-6, err_msg=name)


@NETWORKS
def test_residuals_and_redundancy_numbers_agree_with_the_computation(path):
    expected = sorted(_expected(path)["observations"], key=_key_of_expected)
    outcomes = sorted(observations(_solved(path)), key=_key_of_outcome)
    assert [_key_of_outcome(o) for o in outcomes] == [_key_of_expected(o) for o in expected]
    for outcome, o in zip(outcomes, expected, strict=True):
        assert outcome.v == pytest.approx(o["v"], rel=1e-6, abs=2e-8), outcome
        assert outcome.r == pytest.approx(o["r"], rel=0, abs=1e-7), outcome


def _key_of_expected(o):
    return (o["type"], *(o[key] for key in ("from", "bs", "fs", "to") if key in o))


def _key_of_outcome(outcome):
    kind = outcome.component if outcome.type == "vector" else KINDS[outcome.type]
    return (kind, *outcome.references)


def _published(path):
    """Numbers of an .adj file by point: coordinates and their σ in metres."""
    unit = 1e-3 if path.parent.name == "1D" else 1e-2
    size = len(_estimated(path))
    result = {}
    for line in path.with_suffix(".adj").read_text(encoding="utf-8").splitlines():
        words = line.replace("\N{MINUS SIGN}", "-").split("#")[0].split()
        if words:
            numbers = [float(word) for word in words[1 : 1 + 3 * size]]
            result[words[0]] = np.array(numbers[0::3]), unit * np.array(numbers[2::3])
    return result


@NETWORKS
def test_points_agree_with_the_book(path):
    results, sigma0 = point_results(_solved(path)), _solved(path).quality.sigma0
    published = _published(path)
    assert published
    for name, (coordinates, sigma) in published.items():
        mine, s = (array[_estimated(path)] for array in results[name])
        np.testing.assert_allclose(mine, coordinates, rtol=0, atol=6e-5, err_msg=name)
        np.testing.assert_allclose(sigma0 * s, sigma, rtol=0, atol=6e-6, err_msg=name)
