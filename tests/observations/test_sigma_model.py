"""σ models in closed form: a ⊕ b·d, and centring errors along and across the sight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import Scene

from mor.observations.sigma import with_sigma_model


def sigma_of(type_key, sigma, **model):
    scene = Scene()
    scene.add("point", "A", [0.0, 0.0, 0.0])
    scene.add("point", "B", [300.0, 400.0, 0.0])
    scene.observe(type_key, "A", None, "B", None, sigma=sigma)
    group = replace(scene.problem().groups[0], **model)
    return with_sigma_model(group, scene.values()).sigma[0, 0]


def test_without_a_model_sigma_stays():
    assert sigma_of("distance", 1e-3) == 1e-3


def test_the_part_that_grows_with_the_distance_is_added_in_squares():
    assert sigma_of("distance", 3e-3, ppm=8.0) == pytest.approx(np.hypot(3e-3, 8e-6 * 500.0), rel=1e-12)


def test_centring_along_a_distance():
    assert sigma_of("distance", 1e-3, centring=(2e-3, 2e-3)) == pytest.approx(3e-3, rel=1e-12)


def test_centring_across_a_sight_acts_with_the_distance():
    found = sigma_of("bearing", 1e-6, centring=(3e-3, 4e-3))
    assert found == pytest.approx(np.hypot(1e-6, 5e-3 / 500.0), rel=1e-12)
