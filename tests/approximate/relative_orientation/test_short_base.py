"""Bases so short that parallaxes are few σ: the least of all minima, and σ only where they hold."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.rotations import exponential
from mor.start.bundle import image_bundle
from mor.start.image_pair import relative_orientation, turn_without_base
from mor.start.relative_orientation import (
    RelativeOutcome,
    adjust_coplanarity,
    minima_over_directions,
    sigma_hold,
)

NOISE = 0.002


def short_base(scenes, seed, length, n=35):
    rng = np.random.default_rng(seed)
    made = scenes.scene(seed, 0.0, n=n)
    position, rotation = made.cameras[0]
    way = rng.normal(size=3)
    other = position + length * way / np.linalg.norm(way), exponential(rng.normal(0, 0.05, 3)) @ rotation
    rays = [scenes.image(made.points, *camera, NOISE, rng) for camera in (made.cameras[0], other)]
    truth = scenes.relative_truth([made.cameras[0], other])
    return *(image_bundle(one, NOISE) for one in rays), *truth


@pytest.mark.parametrize("length", [0.003, 0.01])
def test_the_least_minimum_is_found(scenes, length):
    """Started at the truth the adjustment reaches nothing that is better by more than the bottom of a flat valley."""
    for seed in range(8):
        a, b, base, rotation = short_base(scenes, seed, length)
        found = relative_orientation(a, b)
        if not found.outcome.usable:
            continue
        from_truth = adjust_coplanarity(a, b, base, rotation)
        least = min(
            adjust_coplanarity(a, b, *one).objective for one in minima_over_directions(a, b, turn_without_base(a, b)[0])
        )
        assert least <= from_truth.objective + 1.0
        assert found.sigma0**2 * (len(a) - 5) <= from_truth.objective + 25.0


@pytest.mark.slow
def test_what_is_determined_is_within_its_sigma(scenes):
    outcomes = []
    for seed in range(20):
        a, b, base, _ = short_base(scenes, seed, 0.006)
        found = relative_orientation(a, b)
        outcomes.append(found.outcome)
        if found.outcome is RelativeOutcome.DETERMINED:
            assert np.all(np.abs(found.base - base) < 5 * found.sigma_base)
    assert outcomes.count(RelativeOutcome.DETERMINED) > 3
    assert outcomes.count(RelativeOutcome.WEAK) > 0


def test_sigma_of_a_long_base_hold_and_inflated_ones_do_not(scenes):
    made = scenes.scene(2, NOISE, n=20)
    a, b = (image_bundle(rays, NOISE) for rays in made.rays)
    found = relative_orientation(a, b)
    chosen = adjust_coplanarity(a, b, found.base, found.rotation)
    assert sigma_hold(a, b, chosen, found.covariance)
    assert not sigma_hold(a, b, chosen, 0.3 * found.covariance)
    assert not sigma_hold(a, b, chosen, 1e8 * found.covariance)


def test_the_base_has_a_sigma_along_itself(scenes):
    """In axes with the base found as x, its x of one has no error of first order; of second order it has."""
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform(-1, 1, (40, 2)), rng.uniform(-3, -2, 40)])
    cameras = [(np.zeros(3), np.eye(3)), (np.array([0.2, 0.0, 0.0]), np.eye(3))]
    errors = []
    for _ in range(30):
        rays = [scenes.image(points, *camera, 0.01, rng) for camera in cameras]
        found = relative_orientation(*(image_bundle(one, 0.01) for one in rays))
        errors.append((found.base[0] - 1.0) / np.sqrt(found.base @ found.covariance[:3, :3] @ found.base))
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.6


@pytest.mark.parametrize("seed", [22871, 23536, 28940])
def test_the_linear_system_alone_would_lead_to_another_minimum(scenes, seed):
    rng = np.random.default_rng(seed + 10**7)
    rng.choice(5)
    noise, count = float(rng.choice([0.001, 0.002, 0.005])), int(rng.integers(9, 51))
    made = scenes.scene(seed, noise, n=count)
    position, rotation = made.cameras[0]
    length, way = 10.0 ** rng.uniform(-3, -1), rng.normal(size=3)
    other = position + length * way / np.linalg.norm(way), exponential(rng.normal(0, 0.05, 3)) @ rotation
    rays = made.rays[0], scenes.image(made.points, *other, noise, rng)
    a, b = (image_bundle(one, noise) for one in rays)
    from_truth = adjust_coplanarity(a, b, *scenes.relative_truth([made.cameras[0], other]))
    found = relative_orientation(a, b)
    assert found.sigma0**2 * (count - 5) < from_truth.objective + 5.0
    assert found.outcome is not RelativeOutcome.DETERMINED
