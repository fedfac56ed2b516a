"""Variance components: planted factors are recovered; closed forms; the iteration ends where nothing changes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mor.quality import helmert
from mor.quality import variance_components as simplified
from mor.quality.assessment import Levels, assess
from mor.quality.helmert import helmert_system
from mor.quality.robust_estimation import exclude, reweighted
from mor.quality.variance_components import components, group_sums, iterated_components
from mor.solve.iterate import adjust
from tests.dense_reference import dense_system
from tests.scenarios.reliability_scenes import correlated_everywhere
from tests.scenarios.scenes import Scene, mixed_network, photo_block, plane_network
from tests.scenarios.small_projects import mor


def _assessed(scene, problem, start):
    return assess(adjust(problem, start))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["simplified", "helmert"])
def test_planted_factors_are_recovered(method):
    # image coordinates half as noisy as said, distances three times; mean of repetitions within its own uncertainty
    scene, _ = mixed_network()
    start = scene.start(1e-6)
    names = [group.name for group in scene.problem().groups]
    planted = {"image/mor": 0.5, "distance": 3.0, "zenith_directions": 1.0}
    found, sigma = [], []
    for seed in range(25):
        clean = scene.problem()
        noisy = scene.problem(np.random.default_rng(50 + seed))
        for one, group in zip(clean.groups, noisy.groups, strict=True):
            group.observed[...] = one.observed + planted.get(group.name, 1.0) * (group.observed - one.observed)
        estimate, quality = iterated_components(_assessed(scene, noisy, start), Levels(), True, method)
        assert estimate.settled
        assert estimate.method == method
        assert quality.redundancy_sum == pytest.approx(quality.redundancy, abs=1e-6)
        found.append([estimate.factors[names.index(name)] for name in planted])
        sigma.append([estimate.sigma[names.index(name)] for name in planted])
    mean, spread = np.mean(found, axis=0), np.mean(sigma, axis=0)
    for k, factor in enumerate(planted.values()):
        assert abs(mean[k] - factor) < 4.0 * spread[k] / np.sqrt(25)
    # and the σ that is told is the scatter there is
    np.testing.assert_allclose(np.std(found, axis=0), spread, rtol=0.5)


def test_the_sigma_of_a_simplified_factor_is_its_scatter():
    redundancy = np.full(40_000, 50.0)
    omega = np.random.default_rng(8).chisquare(redundancy)
    found = simplified._told(simplified._simplified(omega, redundancy, redundancy > 0.0))
    assert np.std(found.factors) == pytest.approx(np.mean(found.sigma), rel=0.03)


def test_the_iteration_ends_where_each_group_has_the_variance_factor_one():
    scene, _ = mixed_network()
    problem = scene.problem(np.random.default_rng(3))
    estimate, quality = iterated_components(_assessed(scene, problem, scene.start(1e-3)), Levels(), True)
    omega, redundancy = group_sums(quality)
    tested = np.isfinite(estimate.sigma)
    np.testing.assert_allclose(omega[tested] / redundancy[tested], 1.0, rtol=1e-4)
    # weights that are right from the start: nothing to iterate
    factors = [estimate.of(group, k) for k, group in enumerate(problem.groups)]
    again = components(_assessed(scene, reweighted(problem, factors), scene.start(1e-3)))
    np.testing.assert_allclose(again.factors[tested], 1.0, rtol=1e-4)


def test_start_weights_do_not_matter():
    scene, _ = mixed_network()
    problem = scene.problem(np.random.default_rng(4))
    first, _ = iterated_components(_assessed(scene, problem, scene.start(1e-3)), Levels(), True)
    tested = np.isfinite(first.sigma)
    twisted = [np.full(group.observed.shape, 2.0 if k == 0 else 1.0) for k, group in enumerate(problem.groups)]
    second, _ = iterated_components(_assessed(scene, reweighted(problem, twisted), scene.start(1e-3)), Levels(), True)
    ratio = second.factors / first.factors
    assert ratio[0] == pytest.approx(0.5, rel=1e-4)
    np.testing.assert_allclose(ratio[tested][1:], 1.0, rtol=1e-4)


def test_repeated_measurements_in_closed_form():
    # two heights, each measured repeatedly by its own group: the sample variances
    scene = Scene()
    scene.add("point", "A", [0.0, 0.0, 0.0], free=False)
    samples = {"coarse": [1.0, 1.4, 0.7, 1.1], "fine": [2.001, 1.999, 2.002]}
    for name, values in samples.items():
        scene.add("point", name, [1.0, 0.0, values[0]], free=(False, False, True))
        for value in values:
            scene.observe("height_difference", "A", None, name, None, sigma=0.01, observed=value, group=name)
    quality = _assessed(scene, scene.problem(), scene.start(0.0))
    expected = [np.std(values, ddof=1) / 0.01 for values in samples.values()]
    np.testing.assert_allclose(components(quality).factors, expected, rtol=1e-9)
    estimate, after = iterated_components(quality, Levels(), True)
    np.testing.assert_allclose(estimate.factors, expected, rtol=1e-9)
    assert after.sigma0 == pytest.approx(1.0, rel=1e-9)


def test_a_group_that_controls_nothing_keeps_its_sigma():
    scene = Scene()
    scene.add("point", "A", [0.0, 0.0, 0.0], free=False)
    scene.add("point", "B", [3.0, 4.0, 1.0])
    scene.observe("vector", "A", None, "B", None, sigma=1e-3)
    estimate = components(_assessed(scene, scene.problem(np.random.default_rng(1)), scene.start(0.0)))
    np.testing.assert_array_equal(estimate.factors, 1.0)
    assert np.isnan(estimate.sigma).all()


def _two_cameras():
    scene, points = photo_block()
    for k, name in enumerate(points[:4]):
        xyz = scene.truth["point"][name]
        scene.observe("observed/point", name, sigma=1e-3, observed=xyz, group=f"control {k % 2}")
    return scene, None


SCENES = {
    "mixed": lambda: (mixed_network()[0], None),
    "correlated": lambda: (correlated_everywhere()[0], None),
    "plane": lambda: plane_network(directions=True),
    "control": _two_cameras,
}


def _dense_helmert(problem, values, defect):
    """S and Ω with V_g as they stand, none of them whitened: tr(W V_g W V_h), W = P − P A N⁻ Aᵀ P."""
    dense = dense_system(problem, values)
    V = dense.covariance
    lower = np.linalg.cholesky(V)
    white = np.linalg.solve(lower, dense.A)
    U = np.linalg.svd(white / np.linalg.norm(white, axis=0), full_matrices=False)[0]
    U = U[:, : dense.A.shape[1] - defect]
    root = np.linalg.inv(lower)
    W = root.T @ (np.eye(len(V)) - U @ U.T) @ root
    number = np.concatenate([np.full(int(g.mask.sum()), k) for k, g in enumerate(problem.groups)])
    out = np.concatenate([group.left_out[group.mask] for group in problem.groups])
    parts = [0.5 * (V * (here[:, None] + 1.0 * here[None, :])) for here in _members(problem, number, out)]
    system = np.array([[np.trace(W @ one @ W @ other) for other in parts] for one in parts])
    return system, np.array([dense.l @ W @ one @ W @ dense.l for one in parts])


def _members(problem, number, out):
    return [1.0 * ((number == k) & ~out) for k in range(len(problem.groups))]


@pytest.mark.parametrize("excluded", [False, True])
@pytest.mark.parametrize("name", SCENES)
def test_helmerts_system_against_dense_algebra(name, excluded):
    scene, datum = SCENES[name]()
    problem = scene.problem(np.random.default_rng(8), datum)
    masks = tuple(np.zeros(group.observed.shape, dtype=bool) for group in problem.groups)
    if excluded:
        masks[0][5, 0] = True
        problem = exclude(problem, masks)
    quality = _assessed(scene, problem, scene.start(1e-4))
    system, omega = _dense_helmert(problem, quality.adjustment.values, quality.adjustment.defect.datum.shape[1])
    found, sums = helmert_system(quality), group_sums(quality)
    np.testing.assert_allclose(found, system, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.sum(axis=1), sums[1], atol=1e-6)
    np.testing.assert_allclose(sums[0], omega, rtol=1e-5, atol=1e-6)
    used = sums[1] >= 0.5
    variances = np.linalg.solve(system[np.ix_(used, used)], omega[used] - system[np.ix_(used, ~used)].sum(axis=1))
    estimate = components(quality, "helmert")
    assert estimate.method == "helmert"
    told = used & np.isfinite(estimate.sigma)
    np.testing.assert_allclose(estimate.factors[told] ** 2, variances[told[used]], rtol=1e-4, atol=1e-6)
    assert (variances[~told[used]] < 0.0).all()


@pytest.mark.slow
def test_one_step_of_helmerts_system_is_unbiased_where_groups_mix():
    # distances three times as bad as said draw the simplified factor of the directions upwards
    scene, points = plane_network(directions=True)
    names = [group.name for group in scene.problem(None, points).groups]
    planted = np.array([{"horizontal_distance": 3.0, "directions": 0.5}[name] for name in names])
    variances = {"simplified": [], "helmert": []}
    clean = scene.problem(None, points)
    for seed in range(150):
        noisy = scene.problem(np.random.default_rng(seed), points)
        for one, group, factor in zip(clean.groups, noisy.groups, planted, strict=True):
            group.observed[...] = one.observed + factor * (group.observed - one.observed)
        quality = _assessed(scene, noisy, scene.start(1e-6))
        omega, redundancy = group_sums(quality)
        variances["simplified"].append(omega / redundancy)
        variances["helmert"].append(np.linalg.solve(helmert_system(quality), omega))
    for method, found in variances.items():
        mean, uncertain = np.mean(found, axis=0), np.std(found, axis=0) / np.sqrt(150)
        off = np.abs(mean - planted**2) / uncertain
        assert off.max() < 3.5 if method == "helmert" else off.max() > 6.0


def test_both_methods_iterate_to_the_same():
    scene, _ = mixed_network()
    quality = _assessed(scene, scene.problem(np.random.default_rng(6)), scene.start(1e-3))
    simple, _ = iterated_components(quality, Levels(), True)
    full, _ = iterated_components(quality, Levels(), True, "helmert")
    np.testing.assert_allclose(full.factors, simple.factors, rtol=1e-5)
    assert full.settled
    told = np.isfinite(simple.sigma)
    assert (full.sigma[told] > 0.99 * simple.sigma[told]).all()  # what the groups cannot be told apart comes in


def test_what_is_too_large_for_helmerts_system_says_that_it_was_simplified(monkeypatch):
    scene, _ = mixed_network()
    quality = _assessed(scene, scene.problem(np.random.default_rng(6)), scene.start(1e-3))
    monkeypatch.setattr(helmert, "MOST_UNKNOWNS", 10)
    estimate, simple = components(quality, "helmert"), components(quality)
    assert estimate.method == "simplified"
    np.testing.assert_array_equal(estimate.factors, simple.factors)


def test_groups_that_cannot_be_told_apart_get_the_simplified_estimate():
    # two height differences between the same two points, each the only one of its group
    scene = Scene()
    scene.add("point", "A", [0.0, 0.0, 0.0], free=False)
    scene.add("point", "B", [1.0, 0.0, 2.0], free=(False, False, True))
    for name, value in (("one", 2.001), ("two", 1.998)):
        scene.observe("height_difference", "A", None, "B", None, sigma=1e-3, observed=value, group=name)
    estimate = components(_assessed(scene, scene.problem(), scene.start(0.0)), "helmert")
    assert estimate.method == "simplified"
    np.testing.assert_allclose(estimate.factors, 3.0 / np.sqrt(2.0), rtol=1e-9)


def test_a_group_whose_part_is_negative_keeps_its_sigma(tmp_path):
    # Two groups share a covariance: the simplified component of one of them comes out negative.
    case = Path(__file__).parents[2] / "cases" / "shared_covariance_crash.yaml"
    project = tmp_path / "project.yaml"
    project.write_text(case.read_text() + "settings: {variance_components: iterate}\n")
    assert mor("adjust", project, "--quiet", "--no-html").code in (0, 1)
    results = json.loads((tmp_path / "project.results" / "results.json").read_text())
    assert results["redundancy_sum"] == pytest.approx(results["redundancy"])
