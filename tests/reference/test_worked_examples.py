"""Small worked examples of the textbook set: levelling, a free network, data snooping, a resection."""

from __future__ import annotations

import json

import numpy as np
import pytest
from reference_data import (
    image_results,
    network_of,
    network_of_yaml,
    observations,
    point_results,
)

from mor.formats import read_foreign
from mor.pipeline import solve_network


@pytest.fixture(scope="module")
def examples(shared_data):
    return json.loads((shared_data("textbook") / "small_examples.json").read_text())


def _rows(rows):
    return json.dumps([[str(cell) for cell in row] for row in rows])


def _levelling(example, fixed, tmp_path):
    rows = [[a, b, dh, 0.0007 * length] for a, b, dh, length in example["observations"]]
    heights = dict(example["approximate_heights"])
    held = [["4", heights.pop("4")]] if fixed else []
    text = f"""
mor: 1
points:
  - {{columns: [id, z], rows: {_rows(heights.items())}}}
"""
    if held:
        text += f"  - {{columns: [id, z], fixed: [z], rows: {_rows(held)}}}\n"
    text += f"""
observations:
  - {{type: height_difference, columns: [from, to, dz, sigma], rows: {_rows(rows)}}}
settings: {{dimensions: z}}
datum: {"fixed" if fixed else "free"}
"""
    return solve_network(network_of_yaml(text, tmp_path))


def test_levelling_with_a_fixed_point(examples, tmp_path):
    example = examples["levelling"]
    solved, expected = _levelling(example, True, tmp_path), example["fixed_4"]
    results = point_results(solved)
    assert solved.quality.sigma0 == pytest.approx(expected["sigma0"], rel=1e-9)
    for name, height in expected["H_m"].items():
        assert results[name][0][2] == pytest.approx(height, rel=0, abs=1e-10)
        assert 1e3 * solved.quality.sigma0 * results[name][1][2] == pytest.approx(
            expected["s_mm"][name], rel=1e-8
        )
    outcomes = observations(solved)
    np.testing.assert_allclose([1e3 * o.v for o in outcomes], expected["v_mm"], atol=1e-8)
    np.testing.assert_allclose([o.r for o in outcomes], expected["r"], atol=1e-10)
    np.testing.assert_allclose([o.w for o in outcomes], expected["w_apriori"], atol=1e-8)


def test_levelling_as_a_free_network(examples, tmp_path):
    example = examples["levelling"]
    solved, expected = _levelling(example, False, tmp_path), example["free_all"]
    results = point_results(solved)
    assert solved.adjustment.defect.datum.shape[1] == expected["datum_defect"]
    for name, height in expected["H_m"].items():
        assert results[name][0][2] == pytest.approx(height, rel=0, abs=1e-10)
        assert 1e3 * solved.quality.sigma0 * results[name][1][2] == pytest.approx(
            expected["s_mm"][name], rel=1e-8
        )
    np.testing.assert_allclose([o.r for o in observations(solved)], example["fixed_4"]["r"], atol=1e-10)


def test_free_network_of_directions_and_distances(examples, tmp_path):
    example = examples["free_2d_gon"]
    expected = example["result"]
    points = [[name, *yx] for name, yx in example["approximate_coordinates_YX"].items()]
    text = f"""
mor: 1
units: {{length: m, angle: gon}}
points: [{{columns: [id, x, y], rows: {_rows(points)}}}]
observations:
  - {{type: horizontal_distance, columns: [from, to, distance], values: {{sigma: "{example["sigma"]["distance_m"]}"}},
     rows: {_rows(example["distances"])}}}
  - {{type: directions, columns: [station, to, horizontal], values: {{sigma: "{example["sigma"]["direction_gon"]}"}},
     rows: {_rows(example["directions_gon"])}}}
settings: {{dimensions: xy}}
datum: free
"""
    solved = solve_network(network_of_yaml(text, tmp_path))
    assert solved.quality.redundancy == expected["dof"]
    assert solved.quality.sigma0 == pytest.approx(expected["sigma0_ratio"], rel=1e-8)
    for name, (coordinates, sigma) in point_results(solved).items():
        np.testing.assert_allclose(coordinates[:2], expected["coordinates_YX"][name], rtol=0, atol=1e-9)
        s = solved.quality.sigma0 * sigma[:2]
        np.testing.assert_allclose(s, expected["s_YX_m"][name], rtol=1e-6)
    outcomes = observations(solved)
    by_type = [[o for o in outcomes if o.type == kind] for kind in ("horizontal_distance", "directions")]
    np.testing.assert_allclose([o.v for o in by_type[0]], expected["v_distances_m"], atol=1e-10)
    gon = [np.degrees(o.v) / 0.9 for o in by_type[1]]
    np.testing.assert_allclose(gon, expected["v_directions_gon"], atol=1e-9)


def _two_blunders(example, adjustment, tmp_path):
    """Angles at the middle point; where the turn from the first to the third is the larger one they are swapped."""
    places = {**example["control"], **example["approximate"]}
    angles = []
    for number, line in enumerate(example["angles_dms"], start=1):
        names, *dms = line.split()
        first, at, second = names.split("_")
        vectors = [np.subtract(places[name], places[at]) for name in (first, second)]
        turn = np.arctan2(vectors[1][0], vectors[1][1]) - np.arctan2(vectors[0][0], vectors[0][1])
        ends = (first, second) if turn % (2.0 * np.pi) < np.pi else (second, first)
        if number not in adjustment["without"]:
            angles.append([at, *ends, "-".join(dms)])
    distances = []
    for number, line in enumerate(example["distances"], start=13):
        names, value = line.split()
        if number not in adjustment["without"]:
            distances.append([*names.split("_"), value])
    text = f"""
mor: 1
units: {{length: m, angle: dms}}
points:
  - {{columns: [id, x, y], fixed: [x, y], rows: {_rows([[k, *v] for k, v in example["control"].items()])}}}
  - {{columns: [id, x, y], rows: {_rows([[k, *v] for k, v in example["approximate"].items()])}}}
observations:
  - {{type: angle, columns: [at, from, to, angle], values: {{sigma: 1.5 arcsec}}, rows: {_rows(angles)}}}
  - {{type: horizontal_distance, columns: [from, to, distance], values: {{sigma: "0.02"}}, rows: {_rows(distances)}}}
settings: {{dimensions: xy}}
"""
    return solve_network(network_of_yaml(text, tmp_path))


@pytest.mark.parametrize("step", [0, 1, 2])
def test_two_blunders_are_found_one_after_the_other(examples, tmp_path, step):
    example = examples["two_blunders_2d"]
    adjustment = example["adjustments"][step]
    solved = _two_blunders(example, adjustment, tmp_path)
    assert solved.quality.redundancy == adjustment["dof"]
    assert solved.quality.sigma0 == pytest.approx(adjustment["sigma0"], rel=1e-7)
    results = point_results(solved)
    for name in ("P1", "P2"):
        np.testing.assert_allclose(results[name][0][:2], adjustment[name], rtol=0, atol=1e-7)
    outcomes = observations(solved)
    order = [o for kind in ("angle", "horizontal_distance") for o in outcomes if o.type == kind]
    np.testing.assert_allclose([o.r for o in order], adjustment["r"], atol=1e-7)
    w = np.array([o.w for o in order])
    np.testing.assert_allclose(np.abs(w), np.abs(adjustment["w_apriori"]), rtol=1e-5, atol=1e-6)
    worst = adjustment["ids"][int(np.argmax(np.abs(w)))]
    if step < 2:
        assert {worst, *adjustment["without"]} == set(example["adjustments"][step + 1]["without"])
    else:
        assert np.abs(w).max() < solved.quality.critical


def test_snooping_of_a_textbook_network(examples, shared_data):
    example = examples["data_snooping_ghilani_21_10"]
    path = shared_data("textbook") / "2D" / "Ghilani21_10_DistanceAngle_fix.dat"
    for step, dropped in (("step_1", None), ("step_2", ("D", "A", "B"))):
        document = read_foreign(path)
        angles = next(table for table in document.data["observations"] if table["type"] == "angle")
        angles["rows"] = [row for row in angles["rows"] if tuple(row[:3]) != dropped]
        solved = solve_network(network_of(document, path.parent))
        assert solved.quality.redundancy == example[step]["dof"]
        assert solved.quality.sigma0 == pytest.approx(example[step]["sigma0_ratio"], rel=1e-7)
        w = {o.references: o.w for o in observations(solved)}
        expected = {tuple(o["stations"]): o["w"] for o in example[step]["w_apriori"]}
        assert w.keys() == expected.keys()
        for stations, value in expected.items():
            assert w[stations] == pytest.approx(value, rel=1e-6, abs=1e-6)
        worst = max(w, key=lambda stations: abs(w[stations]))
        assert (worst == ("D", "A", "B")) == (step == "step_1")


def test_resection(examples, tmp_path):
    example = examples["resection_wolf_dewitt"]
    expected = example["result"]
    points = [[name, *xyz] for name, xyz in zip(example["points"], example["object_XYZ_m"], strict=True)]
    rays = [["1", name, *xy] for name, xy in zip(example["points"], example["image_xy_mm"], strict=True)]
    text = f"""
mor: 1
units: {{length: m, angle: deg}}
cameras: {{1: {{interior: {{c: {example["f_mm"]}}}}}}}
images:
  - {{columns: [id, camera, x, y, z, omega, phi, kappa], rows: {_rows([["1", "1", *example["approximate"]]])}}}
points: [{{columns: [id, x, y, z], fixed: [x, y, z], rows: {_rows(points)}}}]
observations:
  - {{type: image, columns: [image, point, x, y], values: {{sigma: "1"}}, rows: {_rows(rays)}}}
"""
    solved = solve_network(network_of_yaml(text, tmp_path))
    assert solved.quality.sigma0 == pytest.approx(expected["sigma0_mm"], rel=1e-8)
    pose, sigma = image_results(solved)["1"]
    np.testing.assert_allclose(pose[:3], expected["X0_m"], rtol=0, atol=1e-8)
    np.testing.assert_allclose(np.degrees(pose[3:]), expected["omega_phi_kappa_deg"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(solved.quality.sigma0 * sigma[:3], expected["s_X0_m"], rtol=1e-7)
    angles = solved.quality.sigma0 * np.degrees(sigma[3:])
    np.testing.assert_allclose(angles, expected["s_omega_phi_kappa_deg"], rtol=1e-7)
    outcomes = observations(solved)
    np.testing.assert_allclose([o.v for o in outcomes], expected["v_mm"], atol=1e-9)
    np.testing.assert_allclose([o.r for o in outcomes], expected["r"], atol=1e-8)
