"""The JAG3D networks: results, reliability and tests of every observation."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from reference_data import network_of_yaml, observations, point_results

from mor.pipeline import solve_network


def _rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def _table(rows, *columns):
    return json.dumps([[row[column] for column in columns] for row in rows])


def _number(text):
    return float(text)


def net2d_project(folder, scenario):
    """The plane network as a project file, and its observations in the order of the groups."""
    points, measured = _rows(folder / "points.csv"), _rows(folder / "observations.csv")
    role = f"type_{scenario}"
    fixed = [p for p in points if p[role] == "fixed"]
    others = [p for p in points if p[role] != "fixed"]
    datum = [p["point"] for p in points if p[role] == "datum"]
    groups = {
        kind: [o for o in measured if o["type"] == kind] for kind in ("direction", "horizontal_distance")
    }
    text = f"""
mor: 1
units: {{length: m, angle: rad}}
axes: {{xy: ne}}
points:
  - {{columns: [id, x, y], rows: {_table(others, "point", "x0_m", "y0_m")}}}
"""
    if fixed:
        text += (
            f"  - {{columns: [id, x, y], fixed: [x, y], rows: {_table(fixed, 'point', 'x0_m', 'y0_m')}}}\n"
        )
    text += f"""
observations:
  - type: directions
    columns: [station, to, horizontal, sigma]
    rows: {_table(groups["direction"], "from", "to", "value", "sigma")}
  - type: horizontal_distance
    columns: [from, to, distance, sigma]
    rows: {_table(groups["horizontal_distance"], "from", "to", "value", "sigma")}
settings: {{dimensions: xy}}
datum: {json.dumps({"free": datum}) if datum else "fixed"}
"""
    return text, [o for group in groups.values() for o in group]


def _net2d(folder, scenario):
    text, measured = net2d_project(folder, scenario)
    return solve_network(network_of_yaml(text, folder)), measured


def lev5_project(folder, scenario):
    """The levelling network as a project file, and its observations."""
    role = f"type_{scenario}"
    points = [p for p in _rows(folder / "points.csv") if p[role] != "unused"]
    measured = [
        o for o in _rows(folder / "observations.csv") if scenario == "congruence" or o["epoch"] == "0"
    ]
    datum = [p["point"] for p in points if p[role] == "datum"]
    text = f"""
mor: 1
units: {{length: m, angle: rad}}
points:
  - {{columns: [id, z], rows: {_table(points, "point", "z0_m")}}}
observations:
  - type: height_difference
    columns: [from, to, dz, sigma]
    rows: {_table(measured, "from", "to", "value", "sigma")}
settings: {{dimensions: z}}
datum: {{free: {{z: {json.dumps(datum)}}}}}
"""
    return text, measured


def _lev5(folder, scenario):
    text, measured = lev5_project(folder, scenario)
    return solve_network(network_of_yaml(text, folder)), measured


CASES = pytest.mark.parametrize(
    ("name", "scenario"),
    [
        ("jag3d-net2d", "free_all"),
        ("jag3d-net2d", "fixed"),
        ("jag3d-lev5", "epoch0"),
        ("jag3d-lev5", "congruence"),
    ],
)


@pytest.fixture
def case(shared_data, name, scenario):
    folder = shared_data(name)
    expected = json.loads((folder / "expected.json").read_text())["scenarios"][scenario]
    solved, measured = (_net2d if name == "jag3d-net2d" else _lev5)(folder, scenario)
    return folder / "expected", solved, measured, expected


@CASES
def test_size_and_variance_factor(case):
    _, solved, _, expected = case
    assert solved.adjustment.problem.observations == expected["n"]
    assert solved.adjustment.defect.datum.shape[1] == expected["datum_defect"]
    assert solved.quality.redundancy == expected["dof"]
    assert solved.quality.sigma0**2 == pytest.approx(expected["variance_factor_aposteriori"], rel=1e-9)


@CASES
def test_points(case, name, scenario):
    folder, solved, _, _ = case
    results, sigma0 = point_results(solved), solved.quality.sigma0
    tolerance = 1e-9 if name == "jag3d-net2d" else 1e-10
    for row in _rows(folder / f"{scenario}-points.csv"):
        coordinates, sigma = results[row["point"]]
        for k, component in enumerate("xyz"):
            if np.isfinite(_number(row[f"{component}_m"])):
                assert coordinates[k] == pytest.approx(_number(row[f"{component}_m"]), rel=0, abs=tolerance)
                assert sigma0 * sigma[k] == pytest.approx(
                    _number(row[f"sigma_{component}_m"]), rel=1e-8, abs=1e-14
                )


@CASES
def test_observations(case, scenario):
    folder, solved, measured, _ = case
    rows = {row["id"]: row for row in _rows(folder / f"{scenario}-observations.csv")}
    quality = solved.quality
    outcomes = _in_table_order(solved)
    assert len(outcomes) == len(measured)
    for outcome, observation in zip(outcomes, measured, strict=True):
        row = rows[observation["id"]]
        names = [name.split("/")[0] for name in outcome.references]
        assert names == [observation["from"], observation["to"]]
        assert outcome.v == pytest.approx(_number(row["residual_adj_minus_obs"]), rel=0, abs=1e-11)
        assert outcome.r == pytest.approx(_number(row["redundancy"]), rel=0, abs=1e-9)
        post = _number(row["sigma_adjusted_post"])
        if post > 0.0:
            assert quality.sigma0 * outcome.s == pytest.approx(post, rel=1e-8)
        assert outcome.w**2 == pytest.approx(_number(row["t_prio"]), rel=1e-8, abs=1e-9)


def _in_table_order(solved):
    """Rows of all groups; inline rows of one line keep their order."""
    kinds = [group.type.key for group in solved.network.groups]
    return sorted(observations(solved), key=lambda outcome: kinds.index(outcome.type))


@pytest.mark.parametrize(("name", "scenario"), [("jag3d-net2d", "fixed"), ("jag3d-net2d", "free_all")])
def test_global_test_decides_as_expected(case, scenario):
    assert case[1].quality.global_test.accepted == (scenario == "free_all")
