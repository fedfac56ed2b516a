"""σ models in closed form: a ⊕ b·d, and centring errors along and across the sight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mor.model.contract import SetUpSigmas, with_sigma_model
from tests.scenarios.scenes import Scene


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
    assert sigma_of("distance", 1e-3, centring=SetUpSigmas(2e-3, 2e-3)) == pytest.approx(3e-3, rel=1e-12)


def test_centring_across_a_sight_acts_with_the_distance():
    found = sigma_of("bearing", 1e-6, centring=SetUpSigmas(3e-3, 4e-3))
    assert found == pytest.approx(np.hypot(1e-6, 5e-3 / 500.0), rel=1e-12)


def test_centring_does_not_touch_height_differences():
    assert sigma_of("height_difference", 1e-3, centring=SetUpSigmas(5e-3, 5e-3)) == pytest.approx(1e-3, rel=1e-12)


def test_centring_of_an_angle_by_its_closed_form():
    """σ² = e_t² (1/a² + 1/b²) + e_i² c²/(a b)² (Jäger), legs a and b, targets c apart."""
    scene = Scene()
    for name, place in (("A", [0.0, 0.0, 0.0]), ("B", [40.0, 30.0, 2.0]), ("C", [-60.0, 80.0, -1.0])):
        scene.add("point", name, place)
    scene.observe("angle", "A", "B", "C", sigma=1e-9)
    group = replace(scene.problem().groups[0], centring=SetUpSigmas(2e-3, 3e-3))
    a, b, c = 50.0, 100.0, np.hypot(100.0, 50.0)
    expected = np.sqrt(3e-3**2 * (1 / a**2 + 1 / b**2) + 2e-3**2 * c**2 / (a * b) ** 2)
    assert with_sigma_model(group, scene.values()).sigma[0, 0] == pytest.approx(expected, rel=1e-9)


def test_errors_of_height_act_on_zenith_angles_and_height_differences():
    upright = SetUpSigmas(instrument_height=3e-3, target_height=4e-3)
    assert sigma_of("height_difference", 1e-3, centring=upright) == pytest.approx(np.hypot(1e-3, 5e-3), rel=1e-12)
    assert sigma_of("zenith_angle", 1e-6, centring=upright) == pytest.approx(np.hypot(1e-6, 5e-3 / 500.0), rel=1e-9)
    assert sigma_of("distance", 1e-3, centring=upright) == pytest.approx(1e-3, rel=1e-12)
