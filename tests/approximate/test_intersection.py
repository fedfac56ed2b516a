"""Spatial intersection from images and theodolites."""

import numpy as np
import pytest

from mor.start.bundle import direction_bundle, image_bundle
from mor.start.intersection import IntersectionOutcome, intersect, nearest_point


def rays_to(scenes, point, cameras, noise=0.0, rng=None):
    return np.concatenate([scenes.image(point[None], *each, noise, rng) for each in cameras])


def frames(cameras):
    return np.stack([x for x, _ in cameras]), np.stack([d for _, d in cameras])


def test_point_is_found_exactly(scenes):
    for seed in range(20):
        made = scenes.scene(seed, n=8, images=2 + seed % 4)
        for point in made.points[:3]:
            found = intersect(image_bundle(rays_to(scenes, point, made.cameras), 1e-3), *frames(made.cameras))
            assert found.outcome is IntersectionOutcome.DETERMINED
            np.testing.assert_allclose(found.point, point, atol=1e-10)


def test_lines_from_one_place_meet_there():
    place, rays = np.array([3.0, -2.0, 5.0]), np.array([[0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [0.0, 0.6, -0.8]])
    np.testing.assert_allclose(nearest_point(np.tile(place, (3, 1)), rays), place, atol=1e-15)


def test_covariance_describes_the_scatter(scenes):
    made = scenes.scene(3, n=8, images=3)
    rng = np.random.default_rng(2)
    values, sums = [], []
    for _ in range(200):
        rays = rays_to(scenes, made.points[0], made.cameras, 0.004, rng)
        found = intersect(image_bundle(rays, 0.004), *frames(made.cameras))
        d = found.point - made.points[0]
        values.append(d @ np.linalg.inv(found.covariance) @ d)
        sums.append(found.sigma0**2)
    assert np.mean(values) == pytest.approx(3.0, abs=4 * np.sqrt(6 / 200))
    assert np.mean(sums) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 3 / 200))


def test_nearest_point_of_two_skew_lines_is_the_middle():
    found = nearest_point(np.array([[0, 0, 1.0], [0, 0, -1.0]]), np.array([[1.0, 0, 0], [0, 1.0, 0]]))
    np.testing.assert_allclose(found, 0.0, atol=1e-12)


def test_theodolites_may_look_any_way():
    positions = np.array([[0, 0, 0], [10, 0, 1], [3, 8, -2.0]])
    point = np.array([4.0, -5.0, 2.0])
    found = intersect(direction_bundle(point - positions, 1e-5), positions, np.tile(np.eye(3), (3, 1, 1)))
    np.testing.assert_allclose(found.point, point, atol=1e-12)
    assert found.angle > 1.0


def test_parallel_rays_and_too_few_are_named():
    positions, same = np.array([[0, 0, 0], [1.0, 0, 0]]), np.tile(np.eye(3), (2, 1, 1))
    parallel = direction_bundle(np.array([[0, 0, -1.0], [0, 0, -1.0]]), 1e-4)
    assert intersect(parallel, positions, same).outcome is IntersectionOutcome.PARALLEL
    hardly = direction_bundle(np.array([[0, 0, -1.0], [-3.2e-4, 0, -1.0]]), 1e-4)
    assert intersect(hardly, positions, same).outcome is IntersectionOutcome.PARALLEL
    along = direction_bundle(np.array([[1.0, 0, 0], [1.0, 0, 1e-5]]), 1e-4)
    assert intersect(along, positions, same).outcome is IntersectionOutcome.PARALLEL
    assert intersect(parallel.take(np.arange(1)), positions[:1], same[:1]).outcome is IntersectionOutcome.TOO_FEW


def test_rays_that_meet_behind_or_not_at_all_are_named():
    positions, same = np.array([[0, 0, 0], [1.0, 0, 0]]), np.tile(np.eye(3), (2, 1, 1))
    apart = direction_bundle(np.array([[-0.1, 0, -1.0], [0.1, 0, -1.0]]), 1e-4)
    assert intersect(apart, positions, same).outcome is IntersectionOutcome.BEHIND
    skew = direction_bundle(np.array([[0.1, 0.2, -1.0], [-0.1, -0.2, -1.0]]), 1e-4)
    assert intersect(skew, positions, same).outcome is IntersectionOutcome.DOES_NOT_MEET
