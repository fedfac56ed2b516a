from __future__ import annotations

import numpy as np
import pytest

from mor.model.cameras import CAMERA_MODELS, LENSES, CameraModel
from mor.units import IMAGE

MODELS = pytest.mark.parametrize("model", LENSES.values(), ids=LENSES.keys())


def test_the_models_are_found_under_their_own_keys() -> None:
    assert set(LENSES) == {
        "mor",
        "brown",
        "brown-4",
        "brown-5",
        "brown-forward",
        "opencv",
        "fisheye",
        "metashape",
        "thin-prism-fisheye",
        "rad-tan-thin-prism-fisheye",
        "fov",
        "panorama",
    }
    ports = {f"{key}+{port}" for key in set(LENSES) - {"panorama"} for port in ("flat-port", "dome-port")}
    assert set(CAMERA_MODELS) == set(LENSES) | ports
    assert all(key == model.key for key, model in CAMERA_MODELS.items())


@MODELS
def test_the_first_component_is_the_camera_constant(model: CameraModel) -> None:
    # x = −c X*/Z* near the axis, whatever the model calls c
    assert model.components[0].quantity == IMAGE
    interior = np.zeros((1, len(model.components)))
    interior[:, 0] = 10.0
    star = np.array([[1e-9, 0.0, -2.0]])
    xy = model.project(star, interior, np.zeros((1, len(model.constants))), np.zeros((1, 2))).xy
    np.testing.assert_allclose(xy, [[5e-9, 0.0]], rtol=1e-12)


@MODELS
def test_component_names_are_unique(model: CameraModel) -> None:
    names = [component.name for component in (*model.components, *model.constants)]
    assert len(set(names)) == len(names)


@MODELS
def test_shapes_and_independence_of_rows(model: CameraModel) -> None:
    random = np.random.default_rng(5)
    n, k, q = 7, len(model.components), len(model.constants)
    star = np.column_stack((random.uniform(-1.0, 1.0, (n, 2)), random.uniform(-3.0, -2.0, n)))
    interior = random.uniform(0.01, 0.02, (n, k))
    constants, measured = random.uniform(0.1, 0.2, (n, q)), random.uniform(-1.0, 1.0, (n, 2))
    together = model.project(star, interior, constants, measured)
    assert [part.shape for part in together] == [(n, 2), (n, 2, 3), (n, 2, k)]
    for i in range(n):
        row = slice(i, i + 1)
        alone = model.project(star[row], interior[row], constants[row], measured[row])
        for whole, part in zip(together, alone, strict=True):
            np.testing.assert_allclose(whole[row], part, rtol=1e-14)


@MODELS
def test_a_broadcast_interior_and_no_points_at_all_are_served(model: CameraModel) -> None:
    k, q = len(model.components), len(model.constants)
    star, measured = np.array([[0.3, -0.2, -2.0]] * 3), np.full((3, 2), 0.1)
    interior = np.linspace(1.0, 0.01, k)
    broadcast = model.project(star, np.broadcast_to(interior, (3, k)), np.zeros((3, q)), measured)
    plain = model.project(star, np.tile(interior, (3, 1)), np.zeros((3, q)), measured)
    for left, right in zip(broadcast, plain, strict=True):
        np.testing.assert_array_equal(left, right)
    empty = model.project(star[:0], np.empty((0, k)), np.empty((0, q)), measured[:0])
    assert [part.shape for part in empty] == [(0, 2), (0, 2, 3), (0, 2, k)]


@MODELS
def test_the_arguments_are_left_as_they_were(model: CameraModel) -> None:
    k, q = len(model.components), len(model.constants)
    arguments = (np.full((2, 3), -1.5), np.full((2, k), 0.3), np.full((2, q), 0.2), np.full((2, 2), 0.1))
    for argument in arguments:
        argument.setflags(write=False)
    together = model.project(*arguments)  # writing into an argument would raise
    for part in together:
        assert not any(np.shares_memory(part, argument) for argument in arguments)


@MODELS
def test_only_fisheyes_and_panoramas_see_behind(model: CameraModel) -> None:
    assert model.sees_behind == model.key.endswith(("fisheye", "panorama"))
