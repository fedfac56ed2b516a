"""Variance components: planted factors are recovered; closed forms; the iteration ends where nothing changes."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import Scene, mixed_network

from mor.adjustment.solve import adjust
from mor.quality.assess import Levels, assess
from mor.quality.exclusion import reweighted
from mor.quality.variance_components import components, group_sums, iterated_components


def _assessed(scene, problem, start):
    return assess(adjust(problem, start))


def test_planted_factors_are_recovered():
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
            group.observed[...] = one.observed + planted.get(group.name, 1.0) * (
                group.observed - one.observed
            )
        estimate, quality = iterated_components(_assessed(scene, noisy, start), Levels(), True)
        assert estimate.settled
        assert quality.redundancy_sum == pytest.approx(quality.redundancy, abs=1e-6)
        found.append([estimate.factors[names.index(name)] for name in planted])
        sigma.append([estimate.sigma[names.index(name)] for name in planted])
    mean, spread = np.mean(found, axis=0), np.mean(sigma, axis=0)
    for k, factor in enumerate(planted.values()):
        assert abs(mean[k] - factor) < 4.0 * spread[k] / np.sqrt(25)
    # and the σ that is told is the scatter there is
    np.testing.assert_allclose(np.std(found, axis=0), spread, rtol=0.5)


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
    twisted = [
        np.full(group.observed.shape, 2.0 if k == 0 else 1.0) for k, group in enumerate(problem.groups)
    ]
    second, _ = iterated_components(
        _assessed(scene, reweighted(problem, twisted), scene.start(1e-3)), Levels(), True
    )
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
