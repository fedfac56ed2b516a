"""The same measurements said in two ways give the same network: coordinates, vᵀPv, redundancy, cofactors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mor.model.contract import wrap
from mor.model.rotations import rotation_from_angles
from mor.quality.assessment import assess
from mor.solve.iterate import Outcome, adjust
from mor.solve.problem import Problem
from tests.scenarios.scenes import (
    CAMERA_STATIONS,
    Scene,
    add_image,
    add_object_points,
    coordinates,
    photo_block,
    solve,
)

CONTROL = ("P0", "P5", "P10")


def with_control(control=CONTROL) -> tuple[Scene, list[str]]:
    """Twelve points, some of them fixed, and two images."""
    scene = Scene()
    points = add_object_points(scene)
    for name in control:
        scene.free["point"][name] = np.zeros(3, dtype=bool)
    for number in (0, 2):
        add_image(scene, f"I{number}", CAMERA_STATIONS[number], points)
    return scene, points


def assert_equal_networks(one, other, points, *, atol=1e-9, rtol=1e-9, cofactors=1e-7):
    np.testing.assert_allclose(coordinates(one, points), coordinates(other, points), atol=atol)
    assert one.normals.objective == pytest.approx(other.normals.objective, rel=rtol)
    first, second = assess(one), assess(other)
    assert first.redundancy == second.redundancy
    assert first.redundancy_sum == pytest.approx(second.redundancy_sum, abs=1e-8)
    Q, R = (
        quality.cofactors["point"][[ids.index(name) for name in points]]
        for quality, ids in (
            (quality, quality.adjustment.problem.index.blocks["point"].ids) for quality in (first, second)
        )
    )
    np.testing.assert_allclose(Q, R, atol=cofactors * np.abs(R).max())
    return first, second


def replaced(problem: Problem, name: str, observed) -> Problem:
    """A problem with other observed values in one group."""
    groups = tuple(replace(g, observed=observed) if g.name == name else g for g in problem.groups)
    return replace(problem, groups=groups)


# --- a theodolite against a camera ---------------------------------------------------------------------------------

TO_CAMERA = rotation_from_angles(np.array([np.pi / 2, 0.0, 0.0]))
"""From theodolite axes (z up, looking along +y) to camera axes (y up, looking along −z)."""


def test_theodolite_axes_to_camera_axes():
    np.testing.assert_allclose(TO_CAMERA @ [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], atol=1e-15)
    np.testing.assert_allclose(TO_CAMERA @ [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], atol=1e-15)


def _bundle_scene(as_image):
    scene, points = with_control()
    station = scene.add("point", "T", [3.0, -7.0, 1.0])
    D = rotation_from_angles(np.array([0.05, -0.03, 0.15]))
    scene.add("rotation", "T", TO_CAMERA @ D if as_image else D)
    for point in points:
        if as_image:
            scene.add("interior/mor", "c", [20.0, *[0.0] * 9], free=False)
            scene.observe("image/mor", station, "T", None, None, "c", point, sigma=1.0, group="bundle")
        else:
            scene.observe("directions", station, "T", None, point, sigma=1e-6, group="bundle")
    return scene, points


def test_a_theodolite_bundle_is_an_image_of_the_same_rays():
    theodolite, points = _bundle_scene(as_image=False)
    image, _ = _bundle_scene(as_image=True)
    problem = theodolite.problem(np.random.default_rng(1))
    r_h, r_v = problem.groups[1].observed.T
    # ray (sin h cos v, cos h cos v, sin v) in theodolite axes; camera axes (x, z, −y): image c x/y, c z/y
    xy = 20.0 * np.stack([np.tan(r_h), np.tan(r_v) / np.cos(r_h)], axis=1)
    J = np.zeros((len(xy), 2, 2))
    J[:, 0, 0] = 20.0 / np.cos(r_h) ** 2
    J[:, 1, 0] = 20.0 * np.tan(r_v) * np.sin(r_h) / np.cos(r_h) ** 2
    J[:, 1, 1] = 20.0 / np.cos(r_v) ** 2 / np.cos(r_h)
    for row in range(len(xy)):
        image.correlate([("bundle", row, 0), ("bundle", row, 1)], 1e-12 * J[row] @ J[row].T)
    same_noise = image.problem()
    groups = (problem.groups[0], replace(same_noise.groups[1], observed=xy))
    two = adjust(replace(same_noise, groups=groups), image.start(1e-3))
    one = adjust(problem, theodolite.start(1e-3))
    assert one.outcome is two.outcome is Outcome.CONVERGED
    assert_equal_networks(one, two, [*points, "T", "I0"], rtol=1e-5, cofactors=1e-4)
    turned = TO_CAMERA @ one.values["rotation"][-1]
    np.testing.assert_allclose(two.values["rotation"][-1], turned, atol=1e-9)


# --- directions against angles --------------------------------------------------------------------------------------


def _set_of_directions(as_angles):
    scene, points = with_control()
    seen = points[1:9]
    scene.add("point", "T", [3.0, -7.0, 1.0])
    if not as_angles:
        scene.add("rotation", "T", [0.0, 0.0, 2.9], free=(False, False, True))
    for point in points:
        scene.observe("vertical_direction", "T", None, point, None, None, sigma=1e-4)
    if as_angles:
        for point in seen[1:]:
            scene.observe("angle", "T", seen[0], point, sigma=1.0)
    else:
        for point in seen:
            scene.observe("directions", "T", "T", None, point, sigma=1e-4, only=(0,))
    return scene, points, seen


def test_directions_with_an_orientation_are_correlated_angles():
    directions, points, seen = _set_of_directions(as_angles=False)
    angles, _, _ = _set_of_directions(as_angles=True)
    problem = directions.problem(np.random.default_rng(2))
    readings = problem.groups[2].observed[:, 0]
    difference = np.hstack([-np.ones((len(seen) - 1, 1)), np.eye(len(seen) - 1)])
    covariance = 1e-8 * difference @ difference.T
    angles.correlate([("angle", row, 0) for row in range(len(seen) - 1)], covariance)
    other = angles.problem()
    groups = (*problem.groups[:2], replace(other.groups[2], observed=wrap(difference @ readings)[:, None]))
    one = adjust(problem, directions.start(1e-3))
    two = adjust(replace(other, groups=groups), angles.start(1e-3))
    assert_equal_networks(one, two, [*points, "T", "I0"], cofactors=1e-9)
    assert one.normals.objective > 1.0


# --- the same block named twice -------------------------------------------------------------------------------------


@pytest.mark.parametrize("type_key", ["distance", "bearing", "zenith_angle", "vector"])
def test_an_observation_from_a_station_is_one_from_the_point_it_stands_on(type_key):
    # a block with a name of its own that shares its components with the station, and the station itself
    results = []
    for name in ("I0", "mark"):
        scene, points = with_control()
        scene.add("point", "mark", CAMERA_STATIONS[0], shares={0: "I0", 1: "I0", 2: "I0"})
        for point in points[:4]:
            scene.observe(type_key, name, None, point, None, sigma=1e-4)
        results.append(solve(scene, np.random.default_rng(3), disturbed=1e-3))
    assert_equal_networks(*results, [*points, "I0", "mark"], atol=1e-12)


def test_an_instrument_height_is_a_point_above_the_mark():
    results = []
    for with_height in (True, False):
        scene, points = with_control()
        scene.add("height", "h", [1.6], free=False)
        scene.add("point", "mark", [3.0, -7.0, -0.6])
        if with_height:
            scene.observe("distance", "mark", "h", points[3], None, sigma=1e-4)
            scene.observe("distance", "mark", "h", points[8], None, sigma=1e-4)
            scene.observe("distance", "mark", "h", points[11], None, sigma=1e-4)
        else:
            scene.add("point", "axis", [3.0, -7.0, 1.0])
            for point in (points[3], points[8], points[11]):
                scene.observe("distance", "axis", None, point, None, sigma=1e-4)
            scene.observe("vector", "mark", None, "axis", None, sigma=1e-8)
        scene.observe("observed/point", "mark", sigma=1e-3)
        results.append(scene)
    one = results[0].problem(np.random.default_rng(4))
    two = results[1].problem(None)
    observed = {group.name: group.observed for group in one.groups}
    groups = tuple(replace(g, observed=observed.get(g.name, g.observed)) for g in two.groups)
    first = adjust(one, results[0].start(1e-3))
    second = adjust(replace(two, groups=groups), results[1].start(1e-3))
    assert_equal_networks(first, second, [*points, "mark"], rtol=1e-6)


# --- stereo followers -----------------------------------------------------------------------------------------------


def _stereo(as_follower):
    scene = Scene()
    points = add_object_points(scene)
    for name in CONTROL:
        scene.free["point"][name] = np.zeros(3, dtype=bool)
    for pair, (a, b) in enumerate(((0, 1), (3, 4))):
        add_image(scene, f"I{a}", CAMERA_STATIONS[a], points)
        if not as_follower:
            add_image(scene, f"I{b}", CAMERA_STATIONS[b], points, group="followers")
            continue
        trial = Scene()
        add_image(trial, f"I{b}", CAMERA_STATIONS[b], [])
        D_A, D_B = scene.truth["rotation"][f"I{a}"], trial.truth["rotation"][f"I{b}"]
        scene.add("rotation", f"pair {pair}", D_B @ D_A.T)
        scene.add("base", f"pair {pair}", D_A @ (CAMERA_STATIONS[b] - CAMERA_STATIONS[a]))
        for point in points:
            blocks = (f"I{a}", f"I{a}", None, None, f"pair {pair}", f"pair {pair}", "camera", point)
            scene.observe("follower/mor", *blocks, sigma=1e-3, group="followers")
    return scene, points


def test_a_stereo_follower_with_free_relative_orientation_is_a_single_image():
    results = [
        solve(scene, np.random.default_rng(5), disturbed=1e-3)
        for scene, _ in (_stereo(as_follower=True), _stereo(as_follower=False))
    ]
    points = [f"P{i}" for i in range(12)]
    first, second = assert_equal_networks(*results, points)
    for one, other in zip(first.groups, second.groups, strict=True):
        np.testing.assert_allclose(one.v, other.v, atol=1e-10)
        np.testing.assert_allclose(one.r, other.r, atol=1e-9)


# --- zenith angles, faces -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("face", [1.0, 2.0])
def test_zenith_angles_in_either_face_are_vertical_directions(face):
    results = []
    for zenith in (True, False):
        scene, points = with_control()
        scene.add("refraction", "air", [0.13])
        scene.observe("observed/refraction", "air", sigma=0.05)
        for point in points:
            if zenith:
                scene.observe("zenith_angle", "I0", None, point, None, "air", sigma=1e-4, constants=(50.0, face))
            else:
                scene.observe("vertical_direction", "I0", None, point, None, "air", sigma=1e-4, constants=(50.0,))
        results.append((scene, points))
    one = results[0][0].problem(np.random.default_rng(6))
    zenith = one.groups[-1].observed
    vertical = zenith - 1.5 * np.pi if face == 2.0 else 0.5 * np.pi - zenith
    two = replaced(results[1][0].problem(), "vertical_direction", vertical)
    two = replace(two, groups=(*one.groups[:2], two.groups[-1]))
    first, second = (adjust(p, scene.start(1e-3)) for p, (scene, _) in zip((one, two), results, strict=True))
    assert_equal_networks(first, second, [*results[0][1], "I0"])
    np.testing.assert_allclose(first.values["refraction"], second.values["refraction"], atol=1e-9)


@pytest.mark.parametrize("type_key", ["directions", "zenith_directions"])
def test_face_one_is_face_two(type_key):
    results = []
    for face in (1.0, 2.0):
        scene, points = with_control()
        scene.add("point", "T", [3.0, -7.0, 1.0])
        scene.add("rotation", "T", [0.0, 0.0, 2.9], free=(False, False, True))
        for point in points:
            scene.observe(type_key, "T", "T", None, point, sigma=1e-4, constants=(6_371_000.0, face))
        results.append((scene, points))
    one, two = (scene.problem(None) for scene, _ in results)
    noise = 1e-4 * np.random.default_rng(7).standard_normal(one.groups[-1].observed.shape)
    one.groups[-1].observed[...] += noise
    # what is too high in face one reads too small a zenith angle, and too large a one in face two
    two.groups[-1].observed[...] += noise * [1.0, -1.0]
    first, second = (adjust(p, scene.start(1e-3)) for p, (scene, _) in zip((one, two), results, strict=True))
    assert_equal_networks(first, second, [*points, "T"])
    assert first.normals.objective > 1.0


# --- local systems --------------------------------------------------------------------------------------------------


def test_a_local_system_with_as_many_unknowns_as_observations_changes_nothing():
    results = []
    for with_system in (True, False):
        scene, points = with_control()
        if with_system:
            scene.add("point", "origin", [1.0, 0.5, -0.3])
            scene.add("rotation", "system", [0.2, -0.3, 0.7])
            scene.add("scale", "system", [1.1])
            for number, point in enumerate(points[1:4]):
                only = (0, 1, 2) if number < 2 else (2,)
                scene.observe("local", "origin", "system", "system", None, point, sigma=1e-2, only=only)
        results.append(solve(scene, np.random.default_rng(8), disturbed=1e-3))
    first, _ = assert_equal_networks(*results, [*points, "I0"], rtol=1e-7)
    local = first.groups[1]
    np.testing.assert_allclose(local.v[np.isfinite(local.v)], 0.0, atol=1e-10)
    np.testing.assert_allclose(local.r[np.isfinite(local.r)], 0.0, atol=1e-8)
    assert np.isnan(first.w[1]).all()


def test_points_of_a_plane_with_a_tiny_sigma_end_up_in_a_plane():
    scene, points = with_control(control=("P0", "P5", "P10", "P7"))
    normal = rotation_from_angles(np.array([0.4, -0.5, 0.2]))[2]
    for name in points[:5]:
        scene.truth["point"][name] = scene.truth["point"][name] - normal * (normal @ scene.truth["point"][name] - 1.0)
    scene.add("point", "origin", [0.0, 0.0, 0.0], free=False)
    scene.add("rotation", "plane", [0.4, -0.5, 0.2], free=(True, True, False), about_axes=True)
    scene.add("eccentricity", "plane", [0.0, 0.0, -1.0], free=(False, False, True))
    for point in points[:5]:
        scene.observe("local", "origin", "plane", None, "plane", point, sigma=1e-8, only=(2,))
    adjustment = solve(scene, np.random.default_rng(9), disturbed=1e-3)
    xyz = coordinates(adjustment, points[:5])
    centred = xyz - xyz.mean(axis=0)
    assert np.linalg.svd(centred, compute_uv=False)[-1] < 1e-7
    assert np.abs(xyz - [scene.truth["point"][name] for name in points[:5]]).max() > 1e-5


# --- σ → 0 ----------------------------------------------------------------------------------------------------------


def test_fixed_is_observed_with_a_vanishing_sigma():
    results = []
    for observed in (True, False):
        scene = photo_block()[0]
        points = [f"P{i}" for i in range(12)]
        if observed:
            for name in CONTROL:
                scene.observe("observed/point", name, sigma=1e-9)  # a millionth of what the block yields
        else:
            for name in CONTROL:
                scene.free["point"][name] = np.zeros(3, dtype=bool)
        results.append(scene)
    problems = [scene.problem() for scene in results]
    noise = 1e-3 * np.random.default_rng(10).standard_normal(problems[0].groups[0].observed.shape)
    for problem in problems:
        problem.groups[0].observed[...] += noise
    first, second = (adjust(p, scene.start(1e-3)) for p, scene in zip(problems, results, strict=True))
    assert first.outcome is second.outcome is Outcome.CONVERGED
    assert_equal_networks(first, second, points, rtol=1e-8, cofactors=1e-6)


def test_a_shared_component_is_one_whose_difference_is_observed_with_a_vanishing_sigma():
    results = []
    for shared in (True, False):
        scene, points = photo_block(scale_bar=True)
        for name in CONTROL:
            scene.free["point"][name] = np.zeros(3, dtype=bool)
        scene.free["interior/mor"]["camera"] = np.array([True, True, True, *[False] * 7])
        shares = dict.fromkeys(range(10), "camera") if shared else {}
        free = (True, True, True, *[False] * 7)
        scene.add("interior/mor", "second", [20.0, *[0.0] * 9], free=free, shares=shares)
        rows = scene.groups["image/mor"]
        rows.names = [
            tuple("second" if (part, row[0]) == ("camera", "I3") else part for part in row) for row in rows.names
        ]
        if not shared:
            scene.observe("difference/interior/mor", "camera", "second", sigma=1e-9, only=(0, 1, 2))
        results.append(scene)
    problems = [scene.problem() for scene in results]
    noise = 1e-3 * np.random.default_rng(11).standard_normal(problems[0].groups[0].observed.shape)
    for problem in problems:
        problem.groups[0].observed[...] += noise
    first, second = (adjust(p, scene.start(1e-4)) for p, scene in zip(problems, results, strict=True))
    assert_equal_networks(first, second, points, rtol=1e-8, cofactors=1e-6)
    interiors = second.values["interior/mor"]
    np.testing.assert_allclose(interiors[0], interiors[1], atol=1e-9)
    np.testing.assert_allclose(first.values["interior/mor"], interiors, atol=1e-8)


def test_a_vector_with_covariance_is_three_uncorrelated_combinations():
    # correlated (dx, dy, dz) against the same vector turned into its principal axes by a local system of known attitude
    factor = np.array([[1.0, 0.0, 0.0], [0.6, 0.9, 0.0], [-0.4, 0.3, 1.4]]) * 1e-3
    covariance = factor @ factor.T
    variances, axes = np.linalg.eigh(covariance)
    axes = axes * np.sign(np.linalg.det(axes))
    plain, points = with_control()
    group, row = plain.observe("vector", "P0", None, "P3", None, sigma=1.0)
    plain.correlate([(group, row, k) for k in range(3)], covariance)
    problem = plain.problem(np.random.default_rng(12))
    turned, _ = with_control()
    turned.add("rotation", "principal", axes.T, free=False)
    turned.observe("local", "P0", "principal", None, None, "P3", sigma=np.sqrt(variances))
    other = turned.problem()
    groups = (problem.groups[0], replace(other.groups[1], observed=problem.groups[1].observed @ axes))
    first = adjust(problem, plain.start(1e-3))
    second = adjust(replace(other, groups=groups), turned.start(1e-3))
    assert_equal_networks(first, second, points)
