"""The tests themselves, against tabulated distributions; and the statistics of seeded repetitions of a network."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats

from mor.quality.assessment import assess
from mor.quality.test_statistics import (
    ObservationQuality,
    comparable,
    critical_value,
    global_test,
    normalised_residuals,
)
from mor.solve.iterate import Outcome, adjust
from tests.scenarios.scenes import Scene, mixed_network


def test_critical_values_of_the_normal_distribution():
    assert critical_value(0.001) == pytest.approx(3.2905, abs=1e-4)
    assert critical_value(0.05) == pytest.approx(1.9600, abs=1e-4)


def test_sizes_that_differ_by_noise_compare_equal():
    sizes = np.array([3.29, 41.7, 1.3e6, 2e-4, 0.73])
    for noise in (1e-11, -1e-11):
        np.testing.assert_array_equal(comparable(sizes * (1.0 + noise)), comparable(sizes))
    np.testing.assert_allclose(comparable(sizes), sizes, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(comparable(np.array([0.0, np.nan, np.inf])), [0.0, np.nan, np.inf])
    assert comparable(np.array([3.290001]))[0] > comparable(np.array([3.29]))[0]


@pytest.mark.parametrize("redundancy", [1, 5, 50, 20_000])
def test_limits_of_the_global_test(redundancy):
    test = global_test(float(redundancy), redundancy, 0.05)
    assert test.lower == pytest.approx(scipy.stats.chi2.ppf(0.025, redundancy), rel=1e-9)
    assert test.upper == pytest.approx(scipy.stats.chi2.ppf(0.975, redundancy), rel=1e-9)
    assert test.accepted
    assert not global_test(0.999 * test.lower, redundancy, 0.05).accepted
    assert not global_test(1.001 * test.upper, redundancy, 0.05).accepted


def test_without_redundancy_there_is_nothing_to_test():
    assert global_test(0.0, 0, 0.05).accepted


def test_normalised_residuals_only_where_something_controls():
    v = np.array([[3e-3, 1.0, np.nan]])
    absorbed = np.array([[0.75, 1.0 - 1e-9, np.nan]])
    nothing = np.full((1, 3), np.nan)
    sigma, out = np.array([[2e-3, 1.0, 1.0]]), np.zeros((1, 3), bool)
    joint, freedom = np.full(1, np.nan), np.zeros(1, dtype=np.int8)
    w = normalised_residuals(ObservationQuality(v, absorbed, nothing, joint, freedom, sigma, out))
    assert w[0, 0] == pytest.approx(3.0)
    assert np.isnan(w[0, 1:]).all()


def test_a_gross_error_is_found_where_it_is():
    scene, _ = mixed_network()
    problem = scene.problem(np.random.default_rng(2))
    distances = next(group for group in problem.groups if group.name == "distance")
    distances.observed[5] += 20e-3  # twenty times its σ
    quality = assess(adjust(problem, scene.start(1e-3)))
    assert not quality.global_test.accepted
    largest = [np.nanmax(np.abs(w)) for w in quality.w]
    group = int(np.argmax(largest))
    assert problem.groups[group].name == "distance"
    assert int(np.nanargmax(np.abs(quality.w[group]))) == 5
    assert quality.flagged[group][5, 0]


REPETITIONS = 200


@pytest.fixture(scope="module")
def repetitions():
    """σ0², normalised residuals, and errors of the unknowns in units of their σ, over seeded repetitions."""
    scene, _ = mixed_network()
    truth = scene.values()["point"]
    variances, errors, normalised = [], [], []
    start = scene.start(1e-6)
    for seed in range(REPETITIONS):
        adjustment = adjust(scene.problem(np.random.default_rng(1000 + seed)), start)
        assert adjustment.outcome is Outcome.CONVERGED
        quality = assess(adjustment)
        variances.append(quality.sigma0**2)
        cofactors = np.diagonal(quality.cofactors["point"], axis1=1, axis2=2)
        free = cofactors > 0.0
        errors.append((adjustment.values["point"] - truth)[free] / np.sqrt(cofactors[free]))
        normalised.append(np.concatenate([w.ravel() for w in quality.w]))
    return quality.redundancy, np.array(variances), np.array(errors), np.array(normalised)


@pytest.mark.slow
def test_sigma0_is_one_within_its_own_uncertainty(repetitions):
    redundancy, variances, _, _ = repetitions
    uncertainty = np.sqrt(2.0 / redundancy / REPETITIONS)
    assert abs(variances.mean() - 1.0) < 3.0 * uncertainty
    # and it scatters as χ²/f does
    assert scipy.stats.kstest(redundancy * variances, "chi2", args=(redundancy,)).pvalue > 0.01


def test_errors_in_units_of_sigma_are_standard_normal(repetitions):
    _, _, errors, _ = repetitions
    # unknown by unknown: neither a bias nor a wrong σ, at a level that some fifty unknowns together allow
    level = 1e-3 / errors.shape[1]
    for column in errors.T:
        assert scipy.stats.kstest(column, "norm").pvalue > level
    assert errors.std() == pytest.approx(1.0, abs=0.03)
    assert abs(errors.mean()) < 0.05


def test_normalised_residuals_are_standard_normal(repetitions):
    *_, normalised = repetitions
    tested = np.isfinite(normalised).all(axis=0)
    assert tested.sum() > 100
    spread = normalised[:, tested].std(axis=0)
    # σ of a standard deviation from 200 values is 5 %
    assert np.abs(spread - 1.0).max() < 0.25
    assert spread.mean() == pytest.approx(1.0, abs=0.01)


def test_the_global_test_rejects_as_often_as_it_says(repetitions):
    redundancy, variances, _, _ = repetitions
    rejected = sum(not global_test(redundancy * s, redundancy, 0.05).accepted for s in variances)
    assert scipy.stats.binomtest(rejected, REPETITIONS, 0.05).pvalue > 0.01


def test_a_network_without_redundancy():
    scene = Scene()
    scene.add("point", "A", [0.0, 0.0, 0.0], free=False)
    scene.add("point", "B", [3.0, 4.0, 1.0])
    scene.observe("vector", "A", None, "B", None, sigma=1e-3)
    quality = assess(adjust(scene.problem(np.random.default_rng(1)), scene.start(0.1)))
    assert quality.redundancy == 0
    assert quality.sigma0 == 1.0
    assert quality.global_test.accepted
    assert np.isnan(quality.w[0]).all()
    np.testing.assert_allclose(np.diagonal(quality.cofactors["point"][1]), 1e-6, rtol=1e-12)
