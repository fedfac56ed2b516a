"""Exact differences between components: limits of observed ones, relative orientations that say the same, mistakes."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mor.model.parameters import HEIGHT
from mor.model.rotations import rotation_from_angles
from mor.project.entities import BlockStore, ContradictionError, Equality, settle_equalities
from tests.scenarios.small_projects import C, mor, table, write

GON = np.pi / 200.0
ANGLES = np.array([[4.0, -7.0, 20.0], [4.0, -7.0, 20.0], [4.0, -7.0, 50.0]])
CENTRES = np.array([[0.0, 0.0, 8.0], [3.0, 0.2, 8.0], [1.5, 2.4, 8.0]])
POINTS = np.array([[x, y, 0.6 * np.sin(3 * x + y)] for x in (-1.0, 0.5, 2.0, 3.5) for y in (-1.0, 1.0, 2.5)])
PROJECT = """\
mor: 1
cameras: {K: {interior: {c: 20}}}
points:
  - {file: control.csv, fixed: [x, y, z]}
  - {file: points.csv}
images:
  - {file: images.csv}
%s
observations:
  - {type: image, file: rays.csv, values: {sigma: 2 um}}
%s
"""


def rays(seed: int = 7, noise: float = 0.002) -> list[list[Any]]:
    random = np.random.default_rng(seed)
    rows = []
    for name, angles, centre in zip("ABC", ANGLES, CENTRES, strict=True):
        star = (POINTS - centre) @ rotation_from_angles(angles * GON).T
        xy = -C * star[:, :2] / star[:, 2:] + noise * random.standard_normal((len(POINTS), 2))
        rows += [[name, f"P{i}", float(x), float(y)] for i, (x, y) in enumerate(xy)]
    return rows


def solved(folder: Path, observations: str = "", pairs: str = "", followers: bool = False) -> dict[str, Any]:
    """Results with these further observations; B and C follow A where they are stereo followers."""
    rows = [[f"P{i}", *map(float, xyz)] for i, xyz in enumerate(POINTS)]
    pose = [[*map(float, centre), *map(float, angles)] for centre, angles in zip(CENTRES, ANGLES, strict=True)]
    images = [[name, "K", *pose[k], "", ""] for k, name in enumerate("ABC")]
    if followers:
        images[1:] = [[name, "K", *[""] * 6, "A", pair] for name, pair in (("B", "AB"), ("C", "AC"))]
    header = "id,camera,x,y,z,omega,phi,kappa,leader,pair"
    path = write(
        folder,
        PROJECT % (pairs, observations),
        control=table("id,x,y,z", rows[:4]),
        points=table("id,x,y,z", rows[4:]),
        images=table(header, images),
        rays=table("image,point,x,y", rays()),
    )
    run = mor("adjust", path, "--json", "--quiet")
    assert run.code == 0, run.err
    data: dict[str, Any] = json.loads(run.out)
    assert data["redundancy_sum"] == pytest.approx(data["redundancy"], abs=1e-7)
    return data


def difference(of: str, component: str, value: float, sigma: float) -> str:
    columns = "columns: [from, to, component, value, sigma]"
    first, second = of
    row = f"[image {first}, image {second}, {component}, {value}, {sigma}]"
    return f"  - {{type: difference, {columns}, rows: [{row}]}}\n"


def numbers(data: dict[str, Any], section: str, keys: str) -> np.ndarray:
    return np.array([[row[key] for key in keys.split()] for row in data[section]])


CASES = {
    "one angle": [("AB", "omega", 0.0)],
    "kappa apart": [("AC", "kappa", 30.0)],
    "attitude": [("AB", name, 0.0) for name in ("omega", "phi", "kappa")],
    "attitude and apart": [
        *(("AB", name, 0.0) for name in ("omega", "phi", "kappa")),
        *(("BC", name, value) for name, value in (("omega", 0.0), ("phi", 0.0), ("kappa", 30.0))),
    ],
    "height apart": [("BC", "z", 0.001), ("AB", "z", 0.0)],
    "a chain told from its end": [("BC", "phi", 0.0), ("AB", "phi", 0.0)],
}


@pytest.mark.parametrize("case", CASES)
def test_exact_differences_are_the_limit_of_observed_ones(case: str, tmp_path: Path) -> None:
    exact = solved(tmp_path / "exact", "".join(difference(*row, 0.0) for row in CASES[case]))
    tight = solved(tmp_path / "tight", "".join(difference(*row, 1e-7) for row in CASES[case]))
    assert exact["unknowns"] == tight["unknowns"] - len(CASES[case])
    assert exact["redundancy"] == tight["redundancy"]
    for keys, apart in (("x y z omega phi kappa", 2e-7), ("sx sy sz somega sphi skappa", 2e-7)):
        one, other = (numbers(data, "images", keys) for data in (exact, tight))
        np.testing.assert_allclose(one, other, rtol=0, atol=apart)
    np.testing.assert_allclose(
        numbers(exact, "points", "x y z sx sy sz"), numbers(tight, "points", "x y z sx sy sz"), atol=1e-8
    )
    found = {row["id"]: row for row in exact["images"]}
    for (first, second), component, value in CASES[case]:
        assert found[second][component] - found[first][component] == pytest.approx(value, abs=1e-10)


def test_equal_attitudes_are_followers_with_a_fixed_relative_rotation(tmp_path: Path) -> None:
    rows = [(pair, name, value) for pair, kappa in (("AB", 0.0), ("AC", 30.0)) for name, value in
            (("omega", 0.0), ("phi", 0.0), ("kappa", kappa))]  # fmt: skip
    exact = solved(tmp_path / "exact", "".join(difference(*row, 0.0) for row in rows))
    pairs = """\
pairs:
  - columns: [id, bx, by, bz, omega, phi, kappa]
    rows: [[AB, 2.8, -0.9, 0.1, 0, 0, 0], [AC, 2.1, 1.7, 0.1, 0, 0, 30]]
    fixed: [omega, phi, kappa]
"""
    followers = solved(tmp_path / "followers", pairs=pairs, followers=True)
    for key in ("unknowns", "redundancy"):
        assert exact[key] == followers[key]
    assert exact["sigma0"]["aposteriori"] == pytest.approx(followers["sigma0"]["aposteriori"], rel=1e-9)
    for one, other in ((numbers(d, "points", "x y z sx sy sz") for d in (exact, followers)),):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)
    poses = (numbers(d, "images", "x y z sx sy sz omega phi kappa somega sphi skappa") for d in (exact, followers))
    np.testing.assert_allclose(*poses, rtol=0, atol=1e-8)


def turned_until_phi_is_a_quarter(monkeypatch) -> np.ndarray:
    """Turn the scene until φ is 100 gon; X is then M X."""
    turned = ANGLES + np.array([0.0, 107.0, 0.0])
    M = rotation_from_angles(turned[0] * GON).T @ rotation_from_angles(ANGLES[0] * GON)
    here = sys.modules[__name__]
    for name, value in {"ANGLES": turned, "CENTRES": CENTRES @ M.T, "POINTS": POINTS @ M.T}.items():
        monkeypatch.setattr(here, name, value)
    return M


@pytest.mark.parametrize("component", ["omega", "phi", "kappa"])
def test_no_angle_differs_exactly_by_itself_where_two_are_the_same_turn(component, tmp_path, monkeypatch) -> None:
    """The scene turned about Y until φ is 100 gon: equal attitudes are still well said, single angles are not."""
    turned_until_phi_is_a_quarter(monkeypatch)
    attitude = "".join(difference(*row, 0.0) for row in CASES["attitude"])
    assert solved(tmp_path / "whole", attitude)["unknowns"] == 39
    with pytest.raises(AssertionError, match="phi of image A is ±100 gon: omega and kappa are the same turn"):
        solved(tmp_path / "single", difference("AB", component, 0.0, 0.0))


def test_where_two_angles_are_the_same_turn_a_pair_says_the_difference(tmp_path, monkeypatch) -> None:
    """The same scene: C differs from A by 30 gon, and nothing depends on where the cameras look."""
    pairs = """\
pairs:
  - columns: [id, bx, by, bz, omega, phi, kappa]
    rows: [[AB, 2.8, -0.9, 0.1, 0, 0, 0], [AC, 2.1, 1.7, 0.1, 0, 0, 30]]
    fixed: [omega, phi, kappa]
"""
    before = solved(tmp_path / "before", pairs=pairs, followers=True)
    M = turned_until_phi_is_a_quarter(monkeypatch)
    after = solved(tmp_path / "after", pairs=pairs, followers=True)
    assert before["redundancy"] == after["redundancy"]
    assert before["sigma0"]["aposteriori"] == pytest.approx(after["sigma0"]["aposteriori"], rel=1e-8)
    one, other = (numbers(data, "images", "x y z") for data in (before, after))
    np.testing.assert_allclose(one @ M.T, other, atol=1e-8)
    attitudes = [rotation_from_angles(numbers(data, "images", "omega phi kappa") * GON) for data in (before, after)]
    np.testing.assert_allclose(attitudes[0] @ M.T, attitudes[1], atol=1e-8)
    with pytest.raises(AssertionError, match=r"difference, from 'image A'.*is phi ±100 gon there"):
        solved(tmp_path / "observed", difference("AB", "kappa", 0.0, 0.001))


def test_contradictions_are_told_with_the_row_that_contradicts(tmp_path: Path) -> None:
    rows = [("AB", "z", 0.1), ("BC", "z", 0.1), ("AC", "z", 0.3)]
    with pytest.raises(AssertionError, match=r"this contradicts other exact differences, by 0\.1"):
        solved(tmp_path, "".join(difference(*row, 0.0) for row in rows))


def heights(*values: float, free: tuple[bool, ...] = (True, True, True)) -> BlockStore:
    store = BlockStore(HEIGHT)
    column = np.array(values)[:, None]
    store.add("abc", column, np.array(free)[:, None], np.full((3, 1), np.nan))
    return store


def test_what_is_known_of_one_is_known_of_all() -> None:
    store = heights(np.nan, 2.0, np.nan, free=(True, False, True))
    settle_equalities(store, [Equality(0, 2, 1, 0.5), Equality(0, 0, 2, 1.0)])
    np.testing.assert_allclose(store.all_values()[:, 0], [0.5, 2.0, 1.5])
    assert not store.blocks().free.any()
    assert store.blocks().owner[:, 0].tolist() == [0, 0, 0]


def test_two_fixed_components_must_agree() -> None:
    store = heights(1.0, 2.0, 3.0, free=(False, False, True))
    with pytest.raises(ContradictionError, match="the fixed values of a and b"):
        settle_equalities(store, [Equality(0, 0, 1, 0.5)])
