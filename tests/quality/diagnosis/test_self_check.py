"""A converged solution that is none: Σ r that is not the redundancy, unknowns with a σ beyond any use."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mor.quality.assessment import BEYOND_USE, REDUNDANCY_LOST, assess, checked
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


@pytest.mark.parametrize("seed", range(8))
def test_the_point_of_two_parallel_lines_is_named(seed):
    """Bearings from two stations to a point so far along their base that they tell of no distance."""
    scene = Scene()
    for name, xy in (("A", (0.0, 0.0)), ("B", (30.0, 0.0)), ("C", (10.0, 40.0)), ("D", (25.0, 30.0))):
        scene.add("point", name, [*xy, 0.0], free=name in "CD" and (True, True, False))
    for name in "CD":
        for station in "AB":
            scene.observe("bearing", station, None, name, None, sigma=1e-5)
            scene.observe("horizontal_distance", station, None, name, None, sigma=1e-3)
    scene.add("point", "far", [15.0, 4e4, 0.0], free=(True, True, False))
    for station in "AB":
        scene.observe("bearing", station, None, "far", None, sigma=1e-3)
    found = checked(assess(solve(scene, np.random.default_rng(seed), disturbed=1e-3)))
    assert found.outcome is Outcome.SINGULAR
    assert found.reason == BEYOND_USE
    assert {unknown[1] for one in found.defect.undetermined for unknown in one.unknowns} == {"far"}
