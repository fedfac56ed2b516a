"""Undetermined objects is named, left out on request, and changes nothing of the rest; far points are directions."""

from __future__ import annotations

import json

import numpy as np
import polars as pl
import pytest

from tests.scenarios.small_projects import mor
from tests.scenarios.undeterminable.plantings import write
from tests.scenarios.undeterminable.street import street
from tests.scenarios.undeterminable.trial import trial
from tests.selection import slow_after


@pytest.mark.parametrize("seed", slow_after(1, range(6)))
def test_what_was_planted_is_named_and_the_rest_is_as_without_it(seed, tmp_path):
    assert trial(seed, tmp_path).mistakes == ()


def _adjusted(folder, world, undetermined="refuse"):
    project = write(folder, world, undetermined)
    run = mor("adjust", project, "--no-html", "--force")
    assert run.code == 0, run.err
    return json.loads((folder / "project.results" / "results.json").read_text())


@pytest.mark.parametrize("free", slow_after(1, [True, False]))
def test_many_two_ray_points_come_through_and_the_far_ones_are_at_infinity(free, tmp_path):
    world, far = street(3, images=10, pairs=120, far=20, free=free)
    held = _adjusted(tmp_path / "held", world)
    assert {row["id"] for row in held["undeterminable"]} == far
    assert held["redundancy_sum"] == pytest.approx(held["redundancy"], abs=1e-6)
    for row in held["undeterminable"]:
        assert row["treatment"] == "at infinity"
        assert np.hypot(row["dx"], row["dz"]) < 0.5 * row["dy"]  # into the street, where they were planted
    again = mor("adjust", tmp_path / "held" / "project.results" / "adjusted.yaml", "--no-html", "--json")
    assert json.loads(again.out)["iterations"] <= 2
    assert {row["id"] for row in json.loads(again.out)["undeterminable"]} == far


def _at_a_distance(folder, world, direction, reach):
    """The far points as ordinary ones, one coordinate held at a distance, the other two free."""
    project = write(folder, world, "refuse")
    rows = [f"{name},{','.join(map(repr, (reach * d / d[1]).tolist()))}" for name, d in direction.items()]
    (folder / "distant.csv").write_text("\n".join(["id,x,y,z", *rows]) + "\n")
    points = pl.read_csv(folder / "points.csv", infer_schema=False)
    points.filter(~pl.col("id").is_in(sorted(direction))).write_csv(folder / "points.csv")
    text = "  - {file: points.csv}\n  - {file: distant.csv, fixed: [y]}\n"
    project.write_text(project.read_text().replace("  - {file: points.csv}\n", text))
    run = mor("adjust", project, "--no-html")
    assert run.code == 0, run.err
    return json.loads((folder / "project.results" / "results.json").read_text())


def _apart(one, other):
    """Largest difference of coordinates in units of σ, and largest relative difference of σ."""
    rows = {row["id"]: row for row in other["points"]}
    pairs = [
        (row[axis] - rows[row["id"]][axis], row[f"s{axis}"], rows[row["id"]][f"s{axis}"])
        for row in one["points"]
        if row["status"] == "free"
        for axis in "xyz"
    ]
    return max(abs(d) / s for d, s, _ in pairs), max(abs(s / t - 1.0) for _, s, t in pairs)


@pytest.mark.slow
def test_at_infinity_is_the_limit_of_points_held_ever_farther_away(tmp_path):
    """Equivalent formulation: the difference falls with the distance, to nothing."""
    world, _ = street(5, images=8, pairs=60, far=6, free=False)
    held = _adjusted(tmp_path / "held", world)
    direction = {row["id"]: np.array([row["dx"], row["dy"], row["dz"]]) for row in held["undeterminable"]}
    near, distant = (_at_a_distance(tmp_path / f"{r:g}", world, direction, r) for r in (1e4, 1e5))
    assert distant["redundancy"] == held["redundancy"]
    (difference, of_sigma), (before, _) = _apart(held, distant), _apart(held, near)
    assert before > 1e-3
    assert difference < 0.11 * before
    assert of_sigma < 1e-2


def test_more_than_a_screen_without_start_values_is_named_in_a_table(tmp_path):
    world, _ = street(4, images=6, pairs=10, far=0, free=True)
    world.given = False
    for k in range(40):
        world.points[f"LOST{k}"] = np.zeros(3)
    run = mor("adjust", write(tmp_path, world, "refuse"), "--no-html")
    assert run.code == 2
    table = pl.read_csv(tmp_path / "project.results" / "undetermined.csv")
    assert {f"LOST{k}" for k in range(40)} <= set(table["id"])
    assert "undetermined.csv" in run.err


def test_nobody_is_told_to_leave_out_what_is_left_out_already(tmp_path):
    project = tmp_path / "project.yaml"
    project.write_text(
        "mor: 1\npoints:\n  - {columns: [id, x, y, z], rows: [[A, 0, 0, 0], [B, 10, 0, 1], [C, 5, 8, 2]]}\n"
        "datum: free\nsettings: {undetermined: leave_out}\nobservations:\n"
        "  - {type: distance, values: {sigma: 0.001}, columns: [from, to, distance], rows: [[A, B, 10.05]]}\n",
        encoding="utf-8",
    )
    run = mor("adjust", project)
    assert run.code == 2
    assert "leave_out" not in run.err
    assert "too few observations" in run.err.splitlines()[0]


def test_a_point_with_a_height_of_no_use_is_left_out_and_the_rest_is_as_without_it(tmp_path):
    whole = """mor: 1
datum: fixed
settings: {undetermined: leave_out}
points:
  - {columns: [id, x, y, z], fixed: [x, y, z], rows: [[A, 0, 0, 0], [B, 80, 60, 0]]}
  - {columns: [id, x, y, z], rows: [[P, 60, -80, 0], [Q, 40, -30, 9]]}
observations:
  - type: horizontal_distance
    values: {sigma: 0.001}
    columns: [from, to, distance]
    rows: [[A, P, 100.001], [B, P, 141.421], [A, Q, 50], [B, Q, 98.489]]
  - type: height_difference
    columns: [from, to, dz, sigma]
    rows: [[A, P, 0, 5000], [A, Q, 9, 0.001], [B, Q, 9.003, 0.001]]
"""
    rest = whole
    for row in ("[P, 60, -80, 0], ", "[A, P, 100.001], [B, P, 141.421], ", "[A, P, 0, 5000], "):
        rest = rest.replace(row, "")
    found = {}
    for name, text in (("whole", whole), ("rest", rest), ("refused", whole.replace("leave_out", "refuse"))):
        project = tmp_path / f"{name}.yaml"
        project.write_text(text, encoding="utf-8")
        found[name] = mor("adjust", project)
    assert (found["whole"].code, found["rest"].code, found["refused"].code) == (0, 0, 4)
    left = pl.read_csv(tmp_path / "whole.results" / "undetermined.csv").row(0, named=True)
    reason = "its standard deviations are too large to be useful"
    assert [left[key] for key in ("id", "reason", "observations")] == ["P", reason, 3]
    with_it, without_it = (
        pl.read_csv(tmp_path / f"{name}.results" / "points.csv").filter(id="Q").drop("id") for name in ("whole", "rest")
    )
    for column in ("x", "y", "z", "sx", "sz"):
        assert with_it[column][0] == pytest.approx(without_it[column][0], abs=1e-9)


@pytest.mark.parametrize(
    ("lost", "code", "words"), [(4, 2, "too few observations"), (1, 4, "the datum is not defined")]
)
def test_what_is_left_out_is_the_reason_where_it_is_most(tmp_path, lost, code, words):
    """Two images see the same points, others two points each; nothing ties the two to control either."""
    rng = np.random.default_rng(7)
    X = rng.uniform([-4, -4, -1], [4, 4, 1], (9, 3))
    places = np.array([[-2.0, 0.0, 10.0], [2.0, 0.5, 10.0], *rng.uniform([-3, -3, 9], [3, 3, 11], (lost, 3))])
    rays = []
    for k, place in enumerate(places):
        for j in range(9) if k < 2 else (2 * k - 4, 2 * k - 3):
            x, y, z = X[j] - place
            rays.append([f"I{k}", f"P{j}", float(-20 * x / z), float(-20 * y / z)])
    rows = json.dumps([[f"I{k}", "K"] for k in range(2 + lost)])
    project = tmp_path / "project.yaml"
    project.write_text(
        "mor: 1\ndatum: fixed\nsettings: {undetermined: leave_out}\n"
        "cameras: {K: {interior: {c: {fixed: 20}, xh: {fixed: 0}, yh: {fixed: 0}}}}\n"
        f"images: [{{columns: [id, camera], rows: {rows}}}]\n"
        f"points: [{{columns: [id], rows: {json.dumps([[f'P{j}'] for j in range(9)])}}}]\n"
        "observations: [{type: image, columns: [image, point, x, y], values: {sigma: 0.001}, "
        f"rows: {json.dumps(rays)}}}]\n",
        encoding="utf-8",
    )
    run = mor("adjust", project)
    assert run.code == code
    assert words in run.out + run.err
