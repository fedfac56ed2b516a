"""Tilts observed as angles of the object: the turn of a free network is determined by their own small size, or hardly.

Turning the network by θ turns the tilts (ω, φ) of all its stations by θ. Directions tell the tilts relative to each
other far better than the observed angles (σ) do, so that the turn is told by a = tilts minus their mean alone:
σ(θ) = σ / |a|. The angles observed are o; the best turn is the one that brings a closest to o minus its mean.
"""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.rotations import angles_from_rotation, rotation_from_angles
from mor.solve.datum import NOTHING_KNOWN, weak_turns
from mor.solve.iterate import A_WEAK_TURN, Outcome, adjust
from tests.dense_reference import dense_system
from tests.scenarios.datum_scenes import theodolites
from tests.scenarios.scenes import coordinates
from tests.scenarios.small_projects import mor, table, write
from tests.selection import slow_after

SIGMA = 1e-4


def _network(tilt, seed):
    """Three theodolites with tilts of about ``tilt``, observed as angles with noise; directions with noise."""
    scene, points = theodolites("angles")
    random = np.random.default_rng(100 + seed)
    for k in range(3):
        angles = np.array([*(tilt * random.standard_normal(2)), 0.3 + k])
        scene.truth["rotation"][f"S{k}"] = rotation_from_angles(angles)
    return scene, points, scene.problem(np.random.default_rng(seed), points)


def _tilts(values):
    angles = angles_from_rotation(values["rotation"])[:, :2]
    return (angles - angles.mean(axis=0)).ravel()


@pytest.mark.parametrize("start", [1e-6, 1e-3])
@pytest.mark.parametrize("seed", slow_after(1, range(4)))
@pytest.mark.parametrize("tilt", [2e-4, 1e-3])
def test_a_turn_with_a_sigma_of_up_to_half_a_radian_is_found(tilt, seed, start):
    scene, _, problem = _network(tilt, seed)
    adjustment = adjust(problem, scene.start(start))
    assert adjustment.outcome is Outcome.CONVERGED
    assert len(adjustment.iterations) <= 30
    (turn,) = weak_turns(adjustment.inverse.weak, problem, adjustment.values)
    np.testing.assert_allclose(np.abs(turn.axis), [0.0, 0.0, 1.0], atol=2e-3)
    assert turn.sigma == pytest.approx(SIGMA / np.linalg.norm(_tilts(adjustment.values)), rel=1e-2)
    # the gradient vanishes, along the turn as well
    dense = dense_system(problem, adjustment.values)
    gradient = dense.A.T @ dense.weights @ dense.l
    assert np.abs(gradient @ adjustment.inverse.weak).max() < 1e-3
    # no turn brings the tilts closer to what was observed
    group = next(group for group in problem.groups if group.type.key == "observed/rotation")
    observed = group.observed[:, :2] - group.observed[:, :2].mean(axis=0)
    found = _tilts(adjustment.values).reshape(3, 2)
    across = np.stack([-found[:, 1], found[:, 0]], axis=1)
    best = np.arctan2(np.sum(across * observed), np.sum(found * observed))
    assert abs(best) < 1e-2


@pytest.mark.parametrize("seed", slow_after(1, [2, 3]))
@pytest.mark.parametrize("start", [1e-6, 1e-3])
def test_a_turn_that_is_known_worse_than_not_at_all_is_no_result(seed, start):
    scene, points, problem = _network(0.0, seed)
    adjustment = adjust(problem, scene.start(start))
    assert adjustment.outcome is Outcome.SINGULAR
    assert adjustment.reason == A_WEAK_TURN
    assert np.isfinite(coordinates(adjustment, points)).all()
    (turn,) = weak_turns(adjustment.inverse.weak, problem, adjustment.values)
    assert turn.sigma > 10.0
    assert turn.sigma > NOTHING_KNOWN


def test_an_angle_of_which_nothing_is_known_has_the_sigma_of_the_whole_circle():
    angles = np.linspace(-np.pi, np.pi, 200_001)
    assert pytest.approx(np.std(angles), rel=1e-4) == NOTHING_KNOWN


PROJECT = """\
mor: 1
title: theodolites whose tilts were written down as angles
points:
  - file: points.csv
stations:
  - file: stations.csv
    values: {sigma_omega: 6 mgon, sigma_phi: 6 mgon}
    level: free
observations:
  - type: directions
    file: directions.csv
    values: {sigma: 0.1 mgon}
datum: {free: [P0, P1, P2, P3, P4, P5, P6, P7, P8, P9, P10, P11]}
"""


def _project(folder, tilt, text=PROJECT):
    scene, points, problem = _network(tilt, 2)
    group = next(group for group in problem.groups if group.type.key == "directions")
    gon = np.pi / 200.0
    sets = [[*names, *map(float, row / gon)] for names, row in zip(_names(scene), group.observed, strict=True)]
    at = {name: list(map(float, scene.truth["point"][name])) for name in scene.truth["point"]}
    stations = []
    for k in range(3):
        kappa = float(angles_from_rotation(scene.truth["rotation"][f"S{k}"][None])[0, 2] / gon)
        stations.append([f"S{k}", *at[f"S{k}"], 0.0, 0.0, kappa])
    return write(
        folder,
        text,
        points=table("id,x,y,z", [[name, *at[name]] for name in points]),
        stations=table("id,x,y,z,omega,phi,kappa", stations),
        directions=table("station,to,horizontal,vertical", sets),
    )


def _names(scene):
    return [(row[1], row[3]) for row in scene.groups["directions"].names]


def test_the_user_reads_which_turn_it_is_and_what_would_help(tmp_path):
    run = mor("adjust", _project(tmp_path, 0.0))
    assert run.code == 4
    assert "a rotation of the whole network is not usefully determined" in run.err
    assert "The rotation of the whole network about Z is poorly determined: its standard deviation is" in run.err
    assert "(that of an unobserved angle is 115 gon)" in run.err
    assert "Observe them as level" in run.err
    report = (tmp_path / "project.results" / "report.txt").read_text()
    assert "The rotation of the whole network about Z is poorly determined" in report


def test_what_helps_does_help(tmp_path):
    project = _project(
        tmp_path,
        0.0,
        PROJECT.replace("level: free", "level: 6 mgon").replace("    values: {sigma_o", "    # {sigma_o"),
    )
    run = mor("adjust", project, "-o", tmp_path / "results")
    assert run.code == 0, run.err
    assert "oorly determined" not in (tmp_path / "results" / "report.txt").read_text()
