"""Ports of underwater housings: against rays traced by other code, textbook formulas, differences; limit cases."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.cameras import CAMERA_MODELS, LENSES
from mor.model.ports import DOME_PORT, FLAT_PORT, apparent_points
from tests.scenarios.ports import DOME, FLAT, in_water
from tests.selection import slow_but

BOTH = pytest.mark.parametrize(("port", "given"), [(FLAT_PORT, FLAT), (DOME_PORT, DOME)], ids=["flat", "dome"])
CENTRAL = sorted(set(LENSES) - {"panorama"})


def rows(values, n):
    return np.tile(np.array(list(values), dtype=float), (n, 1))


def lens_values(lens, n):
    sizes = {0: 1e-3, 1: 0.05, -1: 1e-6, -2: 1e-6, -4: 1e-9, -6: 1e-12}
    values = [20.0 if c.name in ("c", "f", "fx", "fy") else sizes[c.quantity.image] for c in lens.components]
    return rows(values, n), np.full((n, len(lens.constants)), 3.0)


@BOTH
def test_rays_that_other_code_traces_come_back(port, given):
    random = np.random.default_rng(2)
    directions = np.column_stack([random.uniform(-1.2, 1.2, (200, 2)), np.full(200, -1.0)])
    points = []
    for direction, far in zip(directions, np.exp(random.uniform(-2.0, 4.0, 200)), strict=True):
        at, ray = in_water(direction, given)
        points.append(at + far * ray)
    lens, model = LENSES["mor"], CAMERA_MODELS[f"mor+{port.key}"]
    interior, constants = lens_values(lens, 200)
    expected = lens.project(directions, interior, constants, np.zeros((200, 2))).xy
    whole = np.concatenate([interior, rows(given.values(), 200)], axis=1)
    assert [c.name for c in port.components] == list(given)
    found = model.project(np.array(points), whole, constants, np.zeros((200, 2))).xy
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("key", CENTRAL)
@BOTH
def test_with_equal_indices_it_is_the_plain_camera(port, given, key):
    random = np.random.default_rng(3)
    star = random.uniform(-1.0, 1.0, (50, 3)) - [0.0, 0.0, 2.5]
    lens, model = LENSES[key], CAMERA_MODELS[f"{key}+{port.key}"]
    interior, constants = lens_values(lens, 50)
    measured = lens.project(star, interior, constants, np.zeros((50, 2))).xy
    port_values = rows({**given, "n_air": 1.3, "n_glass": 1.3, "n_water": 1.3}.values(), 50)
    plain = lens.project(star, interior, constants, measured)
    found = model.project(star, np.concatenate([interior, port_values], axis=1), constants, measured)
    own = len(lens.components)
    np.testing.assert_allclose(found.xy, plain.xy, rtol=1e-12)
    np.testing.assert_allclose(found.by_star, plain.by_star, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.by_interior[:, :, :own], plain.by_interior, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("key", slow_but(["brown"], CENTRAL))
@BOTH
def test_derivatives_are_those_of_differences(port, given, key, assert_derivatives):
    random = np.random.default_rng(4)
    star = random.uniform(-0.7, 0.7, (20, 3)) - [0.0, 0.0, 2.5]
    model = CAMERA_MODELS[f"{key}+{port.key}"]
    interior, constants = lens_values(LENSES[key], 20)
    whole = np.concatenate([interior, rows(given.values(), 20)], axis=1)
    measured = model.project(star, whole, constants, np.zeros((20, 2))).xy
    assert_derivatives(model, star, whole, constants, measured)


def test_a_flat_port_magnifies_by_the_index_of_water():
    angle = np.linspace(0.001, 0.8, 9)
    star = 1e6 * np.column_stack([np.sin(angle), np.zeros(9), -np.cos(angle)])
    thin = rows([0.0, 0.0, 1e-3, 1e-4, 1.0, 1.5, 1.333], 9)
    found = apparent_points(FLAT_PORT, star, thin).star
    # far away only the direction matters: sin(air) = n sin(water); near the axis n itself
    np.testing.assert_allclose(-found[:, 0] / found[:, 2], np.tan(np.arcsin(1.333 * np.sin(angle))), rtol=1e-6)
    assert found[0, 0] / found[0, 2] / (star[0, 0] / star[0, 2]) == pytest.approx(1.333, rel=1e-5)


def test_near_the_axis_layers_seem_as_thick_as_divided_by_their_index():
    star = np.array([[1e-4, 0.0, -0.57]])
    port = rows([0.0, 0.0, 0.05, 0.02, 1.0, 1.5, 1.333], 1)
    found = apparent_points(FLAT_PORT, star, port).star[0]
    assert -found[0] / found[2] == pytest.approx(1e-4 / (0.05 + 0.02 / 1.5 + 0.5 / 1.333), rel=1e-6)


def test_a_dome_round_the_projection_centre_changes_nothing():
    star = np.random.default_rng(5).uniform(-1.0, 1.0, (50, 3)) - [0.0, 0.0, 2.5]
    port = rows([0.0, 0.0, 0.0, 0.08, 0.006, 1.0, 1.52, 1.341], 50)
    found = apparent_points(DOME_PORT, star, port)
    np.testing.assert_allclose(found.star, star, rtol=1e-12)
    assert not found.by_port[:, :, 3:].any()  # exactly: radius and indices are not determined
    assert np.abs(found.by_port[:, :, :3]).max() > 1.0


def test_a_point_that_no_ray_reaches_has_no_image():
    beyond = 1e3 * np.array([np.sin(0.9), 0.0, -np.cos(0.9)])  # of the critical angle, 0.85
    star = np.array([beyond, [0.3, 0.1, -1.0]])
    found = apparent_points(FLAT_PORT, star, rows([0.0, 0.0, 0.05, 0.01, 1.0, 1.5, 1.333], 2)).star
    assert np.isnan(found[0]).all()
    assert np.isfinite(found[1]).all()


def test_only_through_a_dome_a_fisheye_sees_behind():
    assert CAMERA_MODELS["fisheye+dome-port"].sees_behind
    assert not CAMERA_MODELS["fisheye+flat-port"].sees_behind
