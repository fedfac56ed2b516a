"""The rigorous adjustment: derivatives, minimum, precision."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from mor.model.rotations import exponential, rotate
from mor.start.bundle import direction_bundle, image_bundle
from mor.start.image_pair import orientation_covariance
from mor.start.relative_orientation import (
    adjust_coplanarity,
    auxiliary_unknowns,
    first_order_residuals,
    in_front,
    misfit,
)


def bundles(made):
    return [image_bundle(rays, made.sigma) for rays in made.rays]


def test_adjusted_rays_meet_and_corrections_are_the_smallest(scenes):
    made = scenes.scene(1, 0.005, n=9)
    a, b = bundles(made)
    base, rotation = scenes.relative_truth(made.cameras)
    found = misfit(a, b, base, rotation)
    ik = auxiliary_unknowns(base, rotation)
    assert np.abs(np.einsum("ni,ik,nk->n", found.rays_a, ik, found.rays_b)).max() < 1e-11
    np.testing.assert_allclose(found.residuals**2, np.sum(found.corrections**2, axis=1), rtol=1e-9)
    np.testing.assert_allclose(found.rays_a[:, :2] - a.rays[:, :2], found.corrections[:, :2] * made.sigma, atol=1e-15)
    # Any other pair of meeting rays costs more: intersect freely and compare.
    for k in range(len(a)):

        def cost(point, k=k):
            q = rotation @ (point - base)
            xy = np.concatenate([-scenes.c * point[:2] / point[2], -scenes.c * q[:2] / q[2]])
            return (xy - np.concatenate([a.rays[k, :2], b.rays[k, :2]])) / made.sigma

        (x1, d1), (x2, _) = made.cameras
        start = d1 @ (made.points[k] - x1) / np.linalg.norm(x2 - x1)
        best = least_squares(cost, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        assert 2 * best.cost == pytest.approx(found.residuals[k] ** 2, rel=1e-5, abs=1e-9)


def test_first_order_residuals_are_close_to_the_strict_ones(scenes):
    made = scenes.scene(2, 0.005, n=12)
    a, b = bundles(made)
    orientation = scenes.relative_truth(made.cameras)
    strict = misfit(a, b, *orientation).residuals
    quick = first_order_residuals(a, b, auxiliary_unknowns(*orientation)[None])[0]
    np.testing.assert_allclose(quick, np.abs(strict), rtol=1e-2, atol=1e-4)


@pytest.mark.parametrize("seed", range(6))
def test_adjustment_reaches_the_minimum_from_afar(scenes, seed):
    made = scenes.scene(seed, 0.002, n=15)
    a, b = bundles(made)
    base, rotation = scenes.relative_truth(made.cameras)
    rng = np.random.default_rng(seed)
    moved = exponential(0.05 * rng.normal(size=3)) @ base
    result = adjust_coplanarity(a, b, moved, rotate(rotation, 0.05 * rng.normal(size=3)))
    assert result.converged
    # No small change of the five parameters makes it better.
    for _ in range(20):
        step = 1e-4 * rng.normal(size=3)
        near = exponential(1e-4 * rng.normal(size=3)) @ result.base
        other = misfit(a, b, near, rotate(result.rotation, step)).residuals
        assert other @ other > result.objective


def test_without_noise_the_truth_is_reached_exactly(scenes):
    made = scenes.scene(3, n=10)
    a, b = bundles(made)
    base, rotation = scenes.relative_truth(made.cameras)
    result = adjust_coplanarity(a, b, exponential(np.full(3, 0.02)) @ base, rotate(rotation, np.full(3, 0.02)))
    np.testing.assert_allclose(result.base, base, atol=1e-12)
    np.testing.assert_allclose(result.rotation, rotation, atol=1e-12)


def test_covariance_describes_the_scatter_of_repeated_measurements(scenes):
    made = scenes.scene(11, n=25)
    base, rotation = scenes.relative_truth(made.cameras)
    rng = np.random.default_rng(0)
    sigma, normalised, objectives = 0.003, [], []
    for _ in range(150):
        noisy = [rays + np.column_stack([sigma * rng.normal(size=(25, 2)), np.zeros(25)]) for rays in made.rays]
        a, b = (image_bundle(rays, sigma) for rays in noisy)
        result = adjust_coplanarity(a, b, base, rotation)
        turn = result.rotation @ rotation.T
        delta = -np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
        error = np.concatenate([result.base - base, delta])
        normalised.append(error @ np.linalg.pinv(orientation_covariance(result), rcond=1e-9) @ error)
        objectives.append(result.objective)
    # chi² with 5 and with n − 5 degrees of freedom; the means of 150 draws to four standard deviations.
    assert np.mean(normalised) == pytest.approx(5.0, abs=4 * np.sqrt(10 / 150))
    assert np.mean(objectives) == pytest.approx(20.0, abs=4 * np.sqrt(40 / 150))


def test_points_in_front_are_told_from_points_behind(scenes):
    made = scenes.scene(4, n=8)
    a, b = bundles(made)
    base, rotation = scenes.relative_truth(made.cameras)
    assert np.all(in_front(a, b, base, rotation))
    assert not np.any(in_front(a, b, -base, rotation))
    twisted = rotation @ (2 * np.outer(base, base) - np.eye(3))
    assert not np.any(np.all(in_front(a, b, base, twisted), axis=1))


def test_directions_of_theodolites_all_round_are_adjusted_alike(scenes):
    rng = np.random.default_rng(6)
    points = rng.uniform(-10, 10, size=(20, 3))
    base = np.array([0.6, 0.8, 0.0])
    rotation = scenes.random_rotation(rng)
    a = direction_bundle(points, 1e-5)
    b = direction_bundle((points - base) @ rotation.T, 1e-5)
    result = adjust_coplanarity(a, b, exponential(np.full(3, 0.03)) @ base, rotate(rotation, np.full(3, -0.03)))
    np.testing.assert_allclose(result.base, base, atol=1e-10)
    np.testing.assert_allclose(result.rotation, rotation, atol=1e-10)
    assert np.all(in_front(a, b, result.base, result.rotation))
