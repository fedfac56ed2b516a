"""The GNU Gama networks: read directly, adjusted, and compared with an independent computation number by number."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
from reference_data import network_of, observations, point_results, reference_files

from mor.formats import read_foreign
from mor.pipeline import solve_network

NETWORKS = pytest.mark.parametrize("path", reference_files("gama", "*.gkf"))
KINDS = {
    "directions": "direction",
    "horizontal_distance": "distance",
    "distance": "s-distance",
    "zenith_angle": "z-angle",
    "bearing": "azimuth",
    "height_difference": "dh",
    "angle": "angle",
}


@cache
def _expected(path):
    return json.loads(path.with_suffix(".expected.json").read_text())


def _turn(path):
    """Signs that take coordinates of the file to the neutral frame of the expected values."""
    return np.array([1.0, _expected(path)["y_sign"], 1.0])


@cache
def _solved(path):
    return solve_network(network_of(read_foreign(path), path.parent))


@NETWORKS
def test_network_has_the_expected_size(path):
    solved, expected = _solved(path), _expected(path)
    assert solved.quality is not None, solved.adjustment.reason
    assert solved.adjustment.problem.observations == expected["n_observations"]
    assert solved.adjustment.defect.datum.shape[1] == expected["datum_defect"]
    assert solved.quality.redundancy == expected["dof"]
    assert solved.quality.redundancy_sum == pytest.approx(expected["dof"], abs=1e-7)


@NETWORKS
def test_sigma0_agrees(path):
    assert _solved(path).quality.sigma0 == pytest.approx(_expected(path)["sigma0_ratio"], rel=1e-8, abs=1e-9)


@NETWORKS
def test_points_agree_in_the_axes_of_the_file(path):
    expected, results = _expected(path), point_results(_solved(path))
    tolerance = 1e-6 if expected["datum_defect"] else 1e-8
    for name, point in expected["points"].items():
        coordinates, sigma = results[name]
        for k, component in enumerate("xyz"):
            if component in point:
                neutral = coordinates[k] * _turn(path)[k]
                assert neutral == pytest.approx(point[component], rel=0, abs=tolerance), (name, component)
                assert sigma[k] == pytest.approx(point[f"s{component}"], rel=1e-7, abs=1e-12), (
                    name,
                    component,
                )
    for name, point in expected["fixed"].items():
        for component, value in point.items():
            k = "xyz".index(component)
            assert results[name][0][k] * _turn(path)[k] == pytest.approx(value, rel=0, abs=1e-12)


@NETWORKS
def test_residuals_and_reliability_agree(path):
    expected, outcomes = _expected(path)["observations"], observations(_solved(path))
    assert [KINDS.get(o.type, o.component) for o in outcomes] == [o["type"] for o in expected]
    for outcome, o in zip(outcomes, expected, strict=True):
        sign = _turn(path)[1] if outcome.component in ("y", "dy") else 1.0
        difference = sign * outcome.observed - o.get("azimuth_from_north", o["observed"])
        if o["type"] in ("direction", "angle", "azimuth"):
            difference = np.angle(np.exp(1j * difference))
        assert difference == pytest.approx(0.0, abs=1e-12), outcome
        assert sign * outcome.v == pytest.approx(o["v"], rel=0, abs=2e-9), outcome
        assert outcome.r == pytest.approx(o["r"], rel=0, abs=1e-8), outcome
        assert outcome.s == pytest.approx(o["s_adjusted"], rel=1e-7, abs=1e-12), outcome
        if o["w"] and o["r"] > 1e-6 and abs(o["v"]) > 1e-9:
            assert sign * outcome.w == pytest.approx(o["w"], rel=1e-5), outcome


@NETWORKS
def test_observations_left_out_are_named(path):
    assert len(read_foreign(path).notes) == len(_expected(path)["observations_not_used"])
