"""Reliability columns of other programs: JAG3D networks, test values of a commercial bundle, textbook snooping."""

from __future__ import annotations

import csv
import gzip
import json

import numpy as np
import pytest
from reference import test_aicon, test_jag3d
from reference_data import network_of, network_of_yaml

from mor.formats import read_foreign
from mor.pipeline import snooped, solve_network
from mor.quality.deformation.congruence import pair_movement
from mor.quality.tests.fixed_coordinates import fixed_point_tests
from mor.quality.tests.levels import chi2_level, f_level
from mor.report.tables.observations import observation_table
from mor.report.tables.reliability import gross_errors

JAG3D = pytest.mark.parametrize(
    ("name", "scenario"),
    [
        ("jag3d-net2d", "free_all"),
        ("jag3d-net2d", "fixed"),
        ("jag3d-lev5", "epoch0"),
        ("jag3d-lev5", "congruence"),
    ],
)


@pytest.fixture
def jag3d(shared_data, name, scenario):
    """Solved network, our residual table and JAG3D's rows in the same order, expected levels."""
    folder = shared_data(name)
    make = test_jag3d._net2d if name == "jag3d-net2d" else test_jag3d._lev5
    solved, measured = make(folder, scenario)
    with (folder / "expected" / f"{scenario}-observations.csv").open(newline="") as file:
        rows = {row["id"]: row for row in csv.DictReader(file)}
    expected = json.loads((folder / "expected.json").read_text())["scenarios"][scenario]
    columns = {
        key: np.array([float(rows[o["id"]][key]) for o in measured]) for key in rows["1"] if key != "id"
    }
    return solved, observation_table(solved), columns, expected


def _close(found, expected, floor):
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=floor)


@JAG3D
def test_detectable_and_estimated_errors(jag3d):
    _, table, columns, _ = jag3d
    _close(table["nabla"].to_numpy(), np.abs(columns["mdb"]), 0.0)
    _close(table["error"].to_numpy(), columns["gross_error_nabla_jag"], 1e-13)
    assert np.abs(columns["redundancy"] - table["r"].to_numpy()).max() < 1e-9


@JAG3D
def test_influence_on_points(jag3d):
    _, table, columns, _ = jag3d
    _close(table["influence"].to_numpy(), columns["ep_m"], 1e-13)


@JAG3D
def test_test_values_and_probabilities(jag3d):
    _, table, columns, _ = jag3d
    _close(table["w"].to_numpy() ** 2, columns["t_prio"], 1e-12)
    _close(table["t2"].to_numpy(), columns["t_post"], 1e-12)
    _close(np.log(table["p"].to_numpy()), columns["log_p_prio"], 1e-9)
    _close(np.log(table["p_t"].to_numpy()), columns["log_p_post"], 1e-9)


@JAG3D
def test_levels_of_the_b_method(jag3d):
    solved, _, _, expected = jag3d
    quality = solved.quality
    for key, quantile in expected["test_quantiles"].items():
        above, below = key[2:-1].split(",")
        if below == "inf":
            limit = chi2_level(float(above), quality.noncentrality, quality.levels.power)
            critical = limit.critical / float(above)
        else:
            limit = f_level(float(above), float(below), quality.noncentrality, quality.levels.power)
            critical = limit.critical
        # the degrees of freedom of variance components are printed with three decimals
        tolerance = 1e-4 if "." in above else 1e-7
        assert quality.noncentrality == pytest.approx(quantile["ncp"], rel=1e-10)
        assert critical == pytest.approx(quantile["quantile"], rel=tolerance)
        assert limit.level == pytest.approx(quantile["alpha"], rel=10 * tolerance)


@JAG3D
def test_variance_components_of_the_groups(jag3d):
    solved, _, _, expected = jag3d
    found = solved.treatment.components.factors**2
    if len(found) == 2:
        components = [
            expected["vce_DIRECTION_COMPONENT"]["vf"],
            expected["vce_HORIZONTAL_DISTANCE_COMPONENT"]["vf"],
        ]
    else:
        components = [expected["vce_LEVELING_COMPONENT"]["vf"]]
    np.testing.assert_allclose(found, components, rtol=1e-8)


def test_test_values_of_a_commercial_bundle(shared_data):
    folder = shared_data("aicon-115")
    solved = test_aicon._solve(folder, disturbed=False)
    table = observation_table(solved).filter(type="image")
    found = {
        (row["from"], row["to"], row["component"]): (abs(row["tau"]), row["r"])
        for row in table.select("from", "to", "component", "tau", "r").to_dicts()
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


def _two_blunders(example):
    """The network as a project: angles at the middle point, turned so that they count clockwise."""
    rows = json.dumps
    places = {**example["control"], **example["approximate"]}
    angles = []
    for line in example["angles_dms"]:
        names, *dms = line.split()
        first, at, second = names.split("_")
        vectors = [np.subtract(places[name], places[at]) for name in (first, second)]
        turn = np.arctan2(*vectors[1]) - np.arctan2(*vectors[0])
        ends = (first, second) if turn % (2.0 * np.pi) < np.pi else (second, first)
        angles.append([at, *ends, "-".join(dms)])
    distances = [[*line.split()[0].split("_"), line.split()[1]] for line in example["distances"]]
    return f"""
mor: 1
units: {{length: m, angle: dms}}
points:
  - {{columns: [id, x, y], fixed: [x, y], rows: {rows([[k, *v] for k, v in example["control"].items()])}}}
  - {{columns: [id, x, y], rows: {rows([[k, *v] for k, v in example["approximate"].items()])}}}
observations:
  - {{type: angle, columns: [at, from, to, angle], values: {{sigma: 1.5 arcsec}}, rows: {rows(angles)}}}
  - {{type: horizontal_distance, columns: [from, to, distance], values: {{sigma: "0.02"}}, rows: {rows(distances)}}}
settings: {{dimensions: xy, snooping: true}}
"""


def test_two_blunders_are_snooped_out(shared_data, tmp_path):
    example = json.loads((shared_data("textbook") / "small_examples.json").read_text())["two_blunders_2d"]
    solved = solve_network(network_of_yaml(_two_blunders(example), tmp_path))
    first, second = gross_errors(solved)["snooping"]["steps"]
    assert (first["names"]["at"], {first["names"]["from"], first["names"]["to"]}) == ("P2", {"A", "P1"})
    assert abs(first["w"]) == pytest.approx(9.15361591, abs=1e-5)
    assert second["names"] == {"from": "P1", "to": "B"}
    assert second["w"] == pytest.approx(9.068272639, abs=1e-5)
    final = example["adjustments"][2]
    assert solved.treatment.snooping.clean
    assert solved.quality.redundancy == final["dof"]
    assert solved.quality.sigma0 == pytest.approx(final["sigma0"], rel=1e-7)
    table = observation_table(solved)
    excluded = table.filter(flag="excluded")
    assert excluded["component"].to_list() == ["angle", "distance"]
    inside = table.filter(flag="")
    np.testing.assert_allclose(np.abs(inside["w"]), np.abs(final["w_apriori"]), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(inside["r"], final["r"], atol=1e-7)


def test_a_textbook_network_is_snooped_out(shared_data):
    path = shared_data("textbook") / "2D" / "Ghilani21_10_DistanceAngle_fix.dat"
    solved = solve_network(snooped(network_of(read_foreign(path), path.parent)))
    (step,) = gross_errors(solved)["snooping"]["steps"]
    assert step["names"] == {"at": "D", "from": "A", "to": "B"}
    assert abs(step["w"]) == pytest.approx(29.193343539, rel=1e-6)
    assert solved.quality.sigma0 == pytest.approx(1.0930379457, rel=1e-7)


def test_fixed_points_that_moved(shared_data):
    folder = shared_data("jag3d-net2d")
    solved, _ = test_jag3d._net2d(folder, "fixed")
    with (folder / "expected" / "fixed-points.csv").open(newline="") as file:
        rows = {row["point"]: row for row in csv.DictReader(file) if row["type"] == "fixed"}
    points = solved.network.blocks["point"].ids
    tests = {points[test.point]: test for test in fixed_point_tests(solved.quality)}
    assert tests.keys() == rows.keys()
    for name, row in rows.items():
        test = tests[name]
        # JAG3D divides by the two coordinates; only the distance between the two fixed points is controlled, the turn
        # of one about the other is not, hence one degree of freedom here
        assert test.freedom == 1
        assert 0.5 * test.statistic == pytest.approx(float(row["t_prio"]), rel=1e-8)
        omega, f = solved.quality.omega, solved.quality.redundancy
        theirs = 0.5 * test.statistic / ((omega - test.statistic) / (f - 2))
        assert theirs == pytest.approx(float(row["t_post"]), rel=1e-8)
        assert test.ratio == pytest.approx(test.statistic / ((omega - test.statistic) / (f - 1)), rel=1e-8)


def test_movements_between_two_epochs_of_one_adjustment(shared_data):
    folder = shared_data("jag3d-lev5")
    solved, _ = test_jag3d._lev5(folder, "congruence")
    expected = json.loads((folder / "expected.json").read_text())["scenarios"]["congruence"]
    points = solved.network.things["point"]
    for one, other in (("4_0", "4_1"), ("5_0", "5_1")):
        row = expected[f"congruence_{one}_{other}"]
        test = pair_movement(solved.quality, *(points.part(name, "position") for name in (one, other)))
        assert test.movement[2] == pytest.approx(row["dz"], abs=1e-10)
        assert test.sigma[2] == pytest.approx(row["sz"], rel=1e-9)
        assert test.statistic == pytest.approx(row["tprio"], rel=1e-8)
        assert test.ratio == pytest.approx(row["tpost"], rel=1e-8)
