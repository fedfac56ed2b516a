"""Image coordinates: signs of the central projection, tripod heights, eccentricity, stereo followers, all models."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.cameras import CAMERA_MODELS, LENSES
from mor.model.images import FOLLOWER_TYPES, IMAGE_TYPES
from mor.model.rotations import rotation_from_angles

POSITION, POINT = np.array([[1.0, 2.0, 10.0]]), np.array([[3.0, 1.0, 2.0]])
LEVELLED = np.eye(3)
ZERO1, ZERO3 = np.zeros((1, 1)), np.zeros((1, 3))
INTERIOR = np.array([[20.0, 0.5, -0.25, *[0.0] * 7]])
CONSTANTS = np.zeros((1, 3))


def image(position=POSITION, D=LEVELLED, height=0.0, eccentricity=ZERO3, point=POINT):
    blocks = [position, D[None], np.array([[height]]), np.asarray(eccentricity), INTERIOR, point]
    return IMAGE_TYPES["mor"].equation(blocks, CONSTANTS).values[0]


def test_a_camera_that_looks_straight_down():
    # 8 below, 2 to the right, 1 towards the lower edge; c = 20
    np.testing.assert_allclose(image(), [0.5 + 20 * 2 / 8, -0.25 - 20 * 1 / 8], rtol=1e-15)


def test_kappa_turns_the_camera_and_the_image_the_other_way():
    turned = image(D=rotation_from_angles(np.array([0.0, 0.0, np.pi / 2])))
    # camera axes x to object +Y, y to object −X
    np.testing.assert_allclose(turned, [0.5 - 20 * 1 / 8, -0.25 - 20 * 2 / 8], rtol=1e-14)


def test_height_lifts_the_rotation_centre_above_the_position():
    np.testing.assert_allclose(image(height=1.5), image(position=POSITION + np.array([0.0, 0.0, 1.5])), rtol=1e-15)


def test_eccentricity_leads_from_projection_centre_to_rotation_centre_in_image_axes():
    D = rotation_from_angles(np.array([0.4, -0.3, 1.0]))
    r = np.array([[0.05, -0.02, 0.3]])
    centre = POSITION - r @ D  # projection centre: rotation centre − Dᵀ r0*
    np.testing.assert_allclose(image(D=D, eccentricity=r), image(position=centre, D=D), rtol=1e-13)


@pytest.mark.parametrize("model", LENSES)
def test_a_follower_is_an_image_of_its_own(model):
    random = np.random.default_rng(9)
    kind = CAMERA_MODELS[model]
    interior = np.array([[20.0 if c.name in ("c", "fx", "fy") else 1e-9 for c in kind.components]])
    constants = np.array([[3.0, -4.0, *[5.0] * len(kind.constants)]])
    D = rotation_from_angles(random.uniform(-0.3, 0.3, (1, 3)))
    relative = rotation_from_angles(random.uniform(-0.3, 0.3, (1, 3)))
    base = np.array([[2.0, 0.1, -0.2]])
    height, r = np.array([[0.4]]), np.array([[0.1, 0.2, 0.3]])
    follower = FOLLOWER_TYPES[model].equation([POSITION, D, height, r, relative, base, interior, POINT], constants)
    # the follower's centre: X_A* = b*, hence X0 + h + Dᵀ (b* − r0*)
    centre = POSITION + [[0.0, 0.0, 0.4]] + (base - r) @ D[0]
    alone = IMAGE_TYPES[model].equation([centre, relative @ D, ZERO1, ZERO3, interior, POINT], constants)
    np.testing.assert_allclose(follower.values, alone.values, rtol=1e-12)


def test_every_camera_model_has_its_image_and_its_follower():
    assert set(IMAGE_TYPES) == set(FOLLOWER_TYPES) == set(CAMERA_MODELS)
    for model, kind in IMAGE_TYPES.items():
        assert kind.key == f"image/{model}"
        assert kind.constants[2:] == CAMERA_MODELS[model].constants
