"""Points of a plane among others: the collineation of four, and what each point adds to a fit."""

from __future__ import annotations

import numpy as np
import pytest

from mor.start.bundle import image_bundle
from mor.start.killian import (
    fit_homography,
    homographies_of_four,
    linear_homography,
    misfits,
    significance_of_points,
)
from mor.start.plane_object import carried_over

NOISE = 0.002


def bundles_of(made):
    return [image_bundle(rays, NOISE) for rays in made.rays]


def test_collineations_of_four_are_those_of_the_linear_system(scenes):
    a, b = bundles_of(scenes.plane_scene(5, NOISE, n=12))
    samples = np.array([[0, 1, 2, 3], [4, 5, 6, 7], [0, 0, 1, 2]])
    found = homographies_of_four(a.directions[samples], b.directions[samples])
    for sample, matrix in zip(samples[:2], found[:2], strict=True):
        linear = linear_homography(a.take(sample), b.take(sample))
        ratio = matrix / linear
        np.testing.assert_allclose(ratio, ratio[0, 0], rtol=1e-9)
    there = misfits(a, b, found)
    assert np.max(there[0, :4]) < 1e-12
    assert np.all(np.isinf(there[2]))
    fitted = fit_homography(a, b)
    np.testing.assert_allclose(misfits(a, b, fitted.matrix[None])[0], fitted.residuals**2, atol=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_what_a_point_adds_is_what_the_fit_loses_without_it(scenes, seed):
    a, b = bundles_of(scenes.plane_scene(seed, NOISE, n=9))
    everything = np.ones(9, dtype=bool)
    whole = fit_homography(a, b)
    inside = significance_of_points(a, b, whole, everything)
    for k in range(9):
        kept = np.arange(9) != k
        without = fit_homography(a.take(kept), b.take(kept))
        lost = whole.objective - without.objective
        assert inside[k] == pytest.approx(lost, rel=0.02, abs=2e-3)
        assert significance_of_points(a, b, without, kept)[k] == pytest.approx(lost, rel=0.02, abs=2e-3)


def test_a_point_off_is_found_and_none_of_the_plane_with_it(scenes):
    """Oblique images: what one image's error does in the other depends on the direction."""
    for seed in range(20):
        made = scenes.plane_scene(seed, 0.0, n=20, normal_free=0.15)
        rng = np.random.default_rng(seed)
        side = np.sign((made.cameras[0][0] - made.points[0]) @ made.normal)
        points = np.vstack([made.points, made.points[:2] + 0.1 * side * made.normal])
        rays = [scenes.image(points, *camera, NOISE, rng) for camera in made.cameras]
        kept = carried_over(*(image_bundle(one, NOISE) for one in rays))
        assert kept.tolist() == [True] * 20 + [False] * 2


def test_points_near_the_plane_that_hide_each_other_are_found(scenes):
    """Two of twenty, side by side: with both in the fit one fits. σ that are three times too small tell none."""
    made = scenes.plane_scene(4, 0.0, n=20)
    rng = np.random.default_rng(4)
    rays = [scenes.image(made.points, *camera, NOISE, rng) for camera in made.cameras]
    beside = np.argsort(rays[1][:, 0])[-2:]
    rays[1][beside, 1] += 7.0 * NOISE * np.sqrt(2.0)
    kept = carried_over(*(image_bundle(one, NOISE) for one in rays))
    assert np.flatnonzero(~kept).tolist() == sorted(beside.tolist())
    plain = [scenes.image(made.points, *camera, NOISE, rng) for camera in made.cameras]
    assert np.all(carried_over(*(image_bundle(one, NOISE / 3.0) for one in plain)))


def test_what_a_collineation_carries_nowhere_does_not_stop_the_fit():
    """Six rays, all but one of them to one direction in one image, to one direction in the other."""
    generator = np.random.default_rng(3)
    apart = np.column_stack([generator.normal(0.0, 20.0, (6, 2)), np.full(6, -50.0)])
    together = np.tile(apart[:1], (6, 1))
    alike = image_bundle(together, NOISE)
    for a, b in (
        (image_bundle(apart, NOISE), alike),
        (alike, image_bundle(apart, NOISE)),
        (alike, alike),
    ):
        fitted = fit_homography(a, b)
        assert fitted.residuals.shape == (6,)
        assert not np.isnan(fitted.residuals).any()
