"""Reliability columns of other programs: JAG3D networks, test values of a commercial bundle, textbook snooping."""

from __future__ import annotations

import csv
import gzip
from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import snooped, solve_network
from mor.quality.deformation import pair_movement
from mor.quality.global_tests import fixed_point_tests
from mor.quality.test_statistics import chi2_level
from mor.report.observations import gross_errors, observation_table
from tests.reference import test_aicon
from tests.reference_data import (
    NETWORKS,
    expected_values,
    network_name,
    network_of_yaml,
    solved_network,
    table,
)

FOLDER = Path(__file__).parent / "networks"
JAG3D = pytest.mark.parametrize("path", [path for path in NETWORKS if path.parent.name == "jag3d"], ids=network_name)


@pytest.fixture
def jag3d(path):
    """Solved network, our residual table, JAG3D's columns in the same order, expected values."""
    expected = expected_values(path)
    rows = table(expected, "observations")
    columns = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    solved = solved_network(path)
    return solved, observation_table(solved), columns, expected


def _close(found, expected, floor):
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=floor)


@JAG3D
def test_detectable_and_estimated_errors(jag3d):
    _, found, columns, _ = jag3d
    _close(found["nabla"].to_numpy(), columns["mdb"], 0.0)
    _close(found["error"].to_numpy(), columns["error"], 1e-13)
    assert np.abs(columns["r"] - found["r"].to_numpy()).max() < 1e-9


@JAG3D
def test_influence_on_points(jag3d):
    _, found, columns, _ = jag3d
    _close(found["influence"].to_numpy(), columns["influence"], 1e-13)


@JAG3D
def test_test_values_and_probabilities(jag3d):
    _, found, columns, _ = jag3d
    _close(found["w"].to_numpy() ** 2, columns["t_prio"], 1e-12)
    _close(found["t2"].to_numpy(), columns["t_post"], 1e-12)
    _close(np.log(found["p"].to_numpy()), columns["log_p_prio"], 1e-9)
    _close(np.log(found["p_t"].to_numpy()), columns["log_p_post"], 1e-9)


@JAG3D
def test_levels_of_the_b_method(jag3d):
    solved, _, _, expected = jag3d
    quality = solved.quality
    for row in table(expected, "levels"):
        above, below = row["test"][2:-1].split(",")
        if below != "inf":
            continue  # mor has no such test
        limit = chi2_level(float(above), quality.noncentrality, quality.levels.power)
        # the degrees of freedom of variance components are printed with three decimals
        tolerance = 1e-4 if "." in above else 1e-7
        assert quality.noncentrality == pytest.approx(row["noncentrality"], rel=1e-10)
        assert limit.critical / float(above) == pytest.approx(row["quantile"], rel=tolerance)
        assert limit.level == pytest.approx(row["alpha"], rel=10 * tolerance)


@JAG3D
def test_variance_components_of_the_groups(jag3d):
    solved, _, _, expected = jag3d
    found = solved.treatment.components.factors**2
    np.testing.assert_allclose(found, expected["variance_components"], rtol=1e-8)


@JAG3D
def test_global_test(jag3d):
    solved, _, _, expected = jag3d
    if "global_test_accepted" in expected:
        assert solved.quality.global_test.accepted == expected["global_test_accepted"]


def test_test_values_of_a_commercial_bundle(shared_data):
    folder = shared_data("aicon-115")
    solved = test_aicon._solve(folder, disturbed=False)
    rays = observation_table(solved).filter(type="image")
    found = {
        (row["from"], row["to"], row["component"]): (abs(row["tau"]), row["r"])
        for row in rays.select("from", "to", "component", "tau", "r").to_dicts()
    }
    with gzip.open(folder / "expected" / "residuals_redundancy_A.csv.gz", "rt", newline="") as file:
        rows = list(csv.DictReader(file))
    assert 2 * len(rows) == len(found) == 2 * 9972
    sigma = 0.0005 * solved.quality.sigma0
    for row in rows:
        for component in "xy":
            tau, r = found[row["image"], row["point"], component]
            printed = float(row[f"aicon_T{component}"])
            # half a unit of the print, and residuals that stopped 1.1e-6 mm short of convergence
            assert abs(tau - printed) <= 0.005 + 1.2e-6 / (sigma * np.sqrt(r)), (row, tau)


def _snooped(name):
    """A network adjusted with data snooping."""
    path = FOLDER / name
    return solve_network(snooped(network_of_yaml(path.read_text(encoding="utf-8"), path.parent)))


def test_two_blunders_are_snooped_out():
    solved = _snooped("worked-examples/two-blunders-1.yaml")
    first, second = gross_errors(solved)["snooping"]["steps"]
    assert (first["names"]["at"], {first["names"]["from"], first["names"]["to"]}) == ("P2", {"A", "P1"})
    assert abs(first["w"]) == pytest.approx(9.15361591, abs=1e-5)
    assert second["names"] == {"from": "P1", "to": "B"}
    assert second["w"] == pytest.approx(9.068272639, abs=1e-5)
    final = expected_values(FOLDER / "worked-examples/two-blunders-3.yaml")
    assert solved.treatment.snooping.clean
    assert solved.quality.redundancy == final["dof"]
    assert solved.quality.sigma0 == pytest.approx(final["sigma0"], rel=1e-7)
    found = observation_table(solved)
    assert found.filter(flag="excluded")["component"].to_list() == ["angle", "distance"]
    inside, rows = found.filter(flag=""), table(final, "observations")
    np.testing.assert_allclose(inside["w"], [row["w"] for row in rows], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(inside["r"], [row["r"] for row in rows], atol=1e-7)


def test_each_adjustment_names_the_observation_that_the_next_one_is_without():
    paths = [FOLDER / f"worked-examples/two-blunders-{step}.yaml" for step in (1, 2, 3)]
    names = [[(r["type"], r["names"]) for r in table(expected_values(p), "observations")] for p in paths]
    for k in (0, 1):
        w = np.abs(observation_table(solved_network(paths[k]))["w"].to_numpy())
        assert {names[k][int(np.argmax(w))]} == set(names[k]) - set(names[k + 1])
    last = solved_network(paths[2])
    assert np.abs(observation_table(last)["w"].to_numpy()).max() < last.quality.critical


def test_a_textbook_network_is_snooped_out():
    solved = _snooped("textbook/ghilani-21-10-distance-angle-fix.yaml")
    (step,) = gross_errors(solved)["snooping"]["steps"]
    assert step["names"] == {"at": "D", "from": "A", "to": "B"}
    assert abs(step["w"]) == pytest.approx(29.193343539, rel=1e-6)
    assert solved.quality.sigma0 == pytest.approx(1.0930379457, rel=1e-7)


def test_fixed_points_that_moved():
    path = FOLDER / "jag3d/net2d-fixed.yaml"
    solved = solved_network(path)
    rows = {row["point"]: row for row in table(expected_values(path), "fixed_point_tests")}
    points = solved.network.blocks["point"].ids
    tests = {points[test.point]: test for test in fixed_point_tests(solved.quality)}
    assert tests.keys() == rows.keys()
    for name, row in rows.items():
        test = tests[name]
        # JAG3D divides by the two coordinates; only the distance between the two fixed points is controlled, the turn
        # of one about the other is not, hence one degree of freedom here
        assert test.freedom == 1
        assert 0.5 * test.statistic == pytest.approx(row["t_prio"], rel=1e-8)
        omega, f = solved.quality.omega, solved.quality.redundancy
        theirs = 0.5 * test.statistic / ((omega - test.statistic) / (f - 2))
        assert theirs == pytest.approx(row["t_post"], rel=1e-8)
        assert test.ratio == pytest.approx(test.statistic / ((omega - test.statistic) / (f - 1)), rel=1e-8)


def test_movements_between_two_epochs_of_one_adjustment():
    path = FOLDER / "jag3d/lev5-congruence.yaml"
    solved = solved_network(path)
    points, rows = solved.network.things["point"], table(expected_values(path), "movements")
    assert len(rows) == 2
    for row in rows:
        blocks = (points.part(row[name], "position") for name in ("from", "to"))
        test = pair_movement(solved.quality, *blocks)
        assert test.movement[2] == pytest.approx(row["dz"], abs=1e-10)
        assert test.sigma[2] == pytest.approx(row["sigma"], rel=1e-9)
        assert test.statistic == pytest.approx(row["t_prio"], rel=1e-8)
        assert test.ratio == pytest.approx(row["t_post"], rel=1e-8)
