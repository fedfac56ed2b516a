"""Residuals, redundancy numbers and cofactors of observations against dense computations, correlated or not."""

from __future__ import annotations

import numpy as np
import pytest

from mor.linalg import compilation
from mor.quality.assessment import assess
from mor.solve.problem import misclosures
from tests.dense_reference import dense_system
from tests.scenarios.scenes import Scene, levelling_network, mixed_network, photo_block, plane_network, solve


def correlated_everywhere() -> tuple[Scene, list[str]]:
    """A mixed network in which observations of several groups, and parts of rows, are correlated."""
    scene, points = mixed_network()
    scene.observe("observed/point", "P9", sigma=1.0)
    entries = [
        ("observed/point", 0, 0),
        ("observed/point", 0, 1),
        ("zenith_directions", 3, 0),
        ("distance", 3, 0),
        ("image/mor", 20, 1),
    ]
    sigma = np.array([1e-3, 1e-3, 2e-5, 1e-3, 1e-3])
    factor = np.tril(np.random.default_rng(3).uniform(-0.6, 0.6, (5, 5))) + np.eye(5)
    covariance = factor @ factor.T * np.outer(sigma, sigma)
    scene.correlate(entries, covariance)
    return scene, points


NETWORKS = {
    "mixed": (mixed_network, False),
    "correlated": (correlated_everywhere, False),
    "plane, distances": (plane_network, True),
    "plane, directions": (lambda: plane_network(distances=False, directions=True), True),
    "levelling": (levelling_network, True),
    "bundle": (photo_block, True),
    "bundle with a scale bar": (lambda: photo_block(scale_bar=True), True),
}


@pytest.fixture(params=NETWORKS)
def network(request):
    make, free = NETWORKS[request.param]
    scene, points = make()
    adjustment = solve(scene, np.random.default_rng(4), points if free else None)
    return assess(adjustment), dense_system(adjustment.problem, adjustment.values)


def flat(quality, name, dense):
    arrays = [getattr(group, name).ravel() for group in quality.groups]
    return np.concatenate(arrays)[dense.entries]


def test_redundancy_numbers_add_up_to_the_redundancy(network):
    quality, dense = network
    rank = np.linalg.matrix_rank(dense.A / np.linalg.norm(dense.A, axis=0), tol=1e-9)
    assert quality.redundancy == len(dense.A) - rank
    assert quality.redundancy_sum == pytest.approx(quality.redundancy, abs=1e-9)


def test_redundancy_numbers_against_the_dense_projector(network):
    quality, dense = network
    np.testing.assert_allclose(flat(quality, "r", dense), dense.redundancy_numbers(), atol=1e-9)


def test_cofactors_of_adjusted_observations_and_of_residuals(network):
    quality, dense = network
    lower = np.linalg.cholesky(dense.covariance)
    white = np.linalg.solve(lower, dense.A)
    white = white / np.linalg.norm(white, axis=0)
    adjusted = lower @ white @ np.linalg.pinv(white, rcond=1e-9) @ lower.T
    variance = np.diagonal(dense.covariance)
    np.testing.assert_allclose(
        flat(quality, "q_adjusted", dense) / variance, np.diagonal(adjusted) / variance, atol=1e-9
    )
    residual = np.diagonal(dense.covariance - adjusted)
    np.testing.assert_allclose(flat(quality, "q_residual", dense) / variance, residual / variance, atol=1e-9)


def test_residuals_are_adjusted_minus_observed(network):
    quality, dense = network
    np.testing.assert_allclose(flat(quality, "v", dense), -dense.l, atol=1e-12)
    assert quality.sigma0**2 * quality.redundancy == pytest.approx(dense.l @ dense.weights @ dense.l, rel=1e-9)


def test_weighted_residuals_share_out_the_objective(network):
    quality, dense = network
    weighted = flat(quality, "weighted", dense)
    np.testing.assert_allclose(weighted, -dense.weights @ dense.l, atol=1e-9 * np.abs(weighted).max())


def test_what_is_not_observed_has_no_quality():
    scene, points = plane_network(distances=False, directions=True)
    quality = assess(solve(scene, np.random.default_rng(5), points))
    (directions,) = quality.groups
    for name in (
        "v",
        "r",
        "q_adjusted",
        "q_residual",
        "weighted",
        "precision",
        "q_weighted",
        "joint",
        "freedom",
    ):
        array = getattr(directions, name)
        assert np.isnan(array[:, 1]).all()
        assert np.isfinite(array[:, 0]).all()
    assert np.isnan(quality.w[0][:, 1]).all()
    assert not quality.flagged[0][:, 1].any()


def test_a_single_scale_bar_controls_nothing_and_nothing_controls_it():
    scene, points = photo_block(scale_bar=True)
    quality = assess(solve(scene, np.random.default_rng(6), points))
    bar, w = quality.groups[1], quality.w[1]
    assert abs(bar.r[0, 0]) < 1e-9
    assert abs(bar.v[0, 0]) < 1e-9
    assert np.isnan(w[0, 0])
    assert not quality.flagged[1].any()
    assert bar.q_adjusted[0, 0] == pytest.approx(1e-8, rel=1e-8)  # its own variance, (1e-4)²


def test_two_equal_scale_bars_control_each_other_by_half():
    scene, points = photo_block(scale_bar=True)
    scene.observe("distance", "P0", None, "P10", None, sigma=1e-4)
    quality = assess(solve(scene, np.random.default_rng(7), points))
    # a little more than half: the images hold nothing of the scale
    np.testing.assert_allclose(quality.groups[1].r, 0.5, atol=1e-9)


def test_repeated_levelling_in_closed_form():
    # one height from n equal height differences: r = 1 − 1/n
    scene = Scene()
    scene.add("point", "A", [0.0, 0.0, 10.0], free=False)
    scene.add("point", "B", [5.0, 0.0, 12.0], free=(False, False, True))
    for _ in range(5):
        scene.observe("height_difference", "A", None, "B", None, sigma=2e-3)
    quality = assess(solve(scene, np.random.default_rng(8)))
    np.testing.assert_allclose(quality.groups[0].r, 0.8, rtol=1e-12)
    assert quality.cofactors["point"][1, 2, 2] == pytest.approx(4e-6 / 5, rel=1e-12)


@pytest.mark.kernels
def test_without_a_compiler_the_numbers_are_the_same(monkeypatch):
    scene, _ = correlated_everywhere()
    results = []
    for available in (True, False):
        monkeypatch.setattr(compilation, "available", available)
        results.append(assess(solve(scene, np.random.default_rng(9))))
    for one, other in zip(results[0].groups, results[1].groups, strict=True):
        np.testing.assert_allclose(one.r, other.r, atol=1e-10)


def test_residuals_of_a_group_do_not_touch_its_observations():
    scene, points = plane_network()
    adjustment = solve(scene, np.random.default_rng(10), points)
    group = adjustment.problem.groups[0]
    before = group.observed.copy()
    np.testing.assert_array_equal(misclosures(group, adjustment.values), -assess(adjustment).groups[0].v)
    np.testing.assert_array_equal(group.observed, before)
