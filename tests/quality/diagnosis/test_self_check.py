"""A converged solution that is none: Σ r that is not the redundancy, unknowns with a σ beyond any use."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mor.quality.assessment import BEYOND_USE, REDUNDANCY_LOST, assess, checked, standard_deviations
from mor.solve.iterate import Outcome
from tests.scenarios.scenes import Scene, mixed_network, photo_block, solve


def test_a_sound_solution_stays_what_it_is():
    for scene, datum in ((mixed_network()[0], None), photo_block()):
        adjustment = solve(scene, np.random.default_rng(2), datum)
        assert checked(assess(adjustment)) is adjustment


def test_a_wrong_sum_of_redundancy_numbers_is_no_solution():
    adjustment = solve(mixed_network()[0], np.random.default_rng(2))
    quality = assess(adjustment)
    found = checked(replace(quality, redundancy_sum=quality.redundancy + 0.4))
    assert found.outcome is Outcome.NOT_CONVERGED
    assert found.reason == REDUNDANCY_LOST
    assert not checked(replace(quality, redundancy_sum=float("nan"))).outcome.is_solution


def _with_a_far_point(sigma: float) -> Scene:
    """Bearings from two stations 30 m apart to a point 40 km away."""
    scene = Scene()
    for name, xy in (("A", (0.0, 0.0)), ("B", (30.0, 0.0)), ("C", (10.0, 40.0)), ("D", (25.0, 30.0))):
        scene.add("point", name, [*xy, 0.0], free=name in "CD" and (True, True, False))
    for name in "CD":
        for station in "AB":
            scene.observe("bearing", station, None, name, None, sigma=1e-5)
            scene.observe("horizontal_distance", station, None, name, None, sigma=1e-3)
    scene.add("point", "far", [15.0, 4e4, 0.0], free=(True, True, False))
    for station in "AB":
        scene.observe("bearing", station, None, "far", None, sigma=sigma)
    return scene


@pytest.mark.parametrize("seed", range(8))
def test_the_point_of_two_parallel_lines_is_named(seed):
    found = checked(assess(solve(_with_a_far_point(1e-3), np.random.default_rng(seed), disturbed=1e-3)))
    assert found.outcome is Outcome.SINGULAR
    assert found.reason == BEYOND_USE
    assert {unknown[1] for one in found.defect.undetermined for unknown in one.unknowns} == {"far"}


@pytest.mark.parametrize("seed", range(8))
def test_a_far_point_with_a_sigma_beyond_the_rest_but_far_less_than_its_distance_is_determined(seed):
    adjustment = solve(_with_a_far_point(1e-5), np.random.default_rng(seed), disturbed=1e-3)
    quality = assess(adjustment, aposteriori=False)
    sigma = standard_deviations(quality, "point")[-1, 1]
    assert 500.0 < sigma < 1000.0
    assert checked(quality) is adjustment
    assert abs(adjustment.values["point"][-1, 1] - 4e4) < 4.0 * sigma
