"""Local coordinates and levels against similarity transformations and tilts written out."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.coordinates import LEVEL, LOCAL
from mor.model.observation_types import ALL_TYPES
from mor.model.rotations import rotation_from_angles

ORIGIN = np.array([[5.0, -3.0, 2.0]])
OFFSET = np.array([[0.1, 0.2, -0.3]])


def local(point, angles=(0.3, -0.5, 1.2), scale=1.0, offset=OFFSET):
    blocks = [
        ORIGIN,
        rotation_from_angles(np.array([angles])),
        np.array([[scale]]),
        offset,
        np.atleast_2d(point),
    ]
    return LOCAL.equation(blocks, np.zeros((1, 0))).values[0]


def test_local_coordinates_are_a_similarity_transformation():
    point = np.array([7.0, 1.0, -4.0])
    D = rotation_from_angles(np.array([0.3, -0.5, 1.2]))
    np.testing.assert_allclose(local(point, scale=1.3), 1.3 * D @ (point - ORIGIN[0]) + OFFSET[0], rtol=1e-14)


def test_the_origin_has_the_offset_for_its_coordinates():
    np.testing.assert_allclose(local(ORIGIN[0], scale=2.5), OFFSET[0], atol=1e-15)


def test_points_of_a_plane_have_one_local_z():
    normal = rotation_from_angles(np.array([0.3, -0.5, 1.2]))[2]
    across = np.linalg.svd(normal[None])[2][1:]
    heights = [local(ORIGIN[0] + a * across[0] + b * across[1])[2] for a, b in ((0, 0), (3, 1), (-2, 7))]
    np.testing.assert_allclose(heights, OFFSET[0, 2], atol=1e-14)
    assert local(ORIGIN[0] + 0.5 * normal)[2] == pytest.approx(OFFSET[0, 2] + 0.5, abs=1e-14)


def level(D):
    return LEVEL.equation([np.atleast_3d(D).reshape(-1, 3, 3)], np.zeros((1, 0)))


def test_a_levelled_frame_reads_zero_whatever_its_orientation():
    for kappa in (0.0, 1.0, -2.0):
        np.testing.assert_array_equal(level(rotation_from_angles(np.array([0.0, 0.0, kappa]))).values, [[0.0, 0.0]])


def test_the_level_shows_the_tilt_in_the_axes_of_the_instrument():
    tilt = 1e-3
    about_object_x = rotation_from_angles(np.array([tilt, 0.0, 0.0]))
    np.testing.assert_allclose(level(about_object_x).values, [[0.0, np.sin(tilt)]], atol=1e-15)
    # the same tilt after a quarter turn of the instrument shows on the other axis
    quarter = rotation_from_angles(np.array([tilt, 0.0, np.pi / 2]))
    np.testing.assert_allclose(level(quarter).values, [[np.sin(tilt), 0.0]], atol=1e-15)


def test_a_turn_about_the_vertical_moves_no_level():
    # exact: D → D Rz for every D, tilted or not; the tangent of it is D e_Z itself
    D = rotation_from_angles(np.array([0.2, -0.4, 0.9]))
    turned = D @ rotation_from_angles(np.array([0.0, 0.0, 0.7]))
    np.testing.assert_allclose(level(turned).values, level(D).values, atol=1e-16)
    (jacobian,) = level(D).jacobians
    np.testing.assert_allclose(jacobian[0] @ D[:, 2], 0.0, atol=1e-17)


def test_observed_coordinates_are_the_coordinates():
    positions = np.arange(6.0).reshape(2, 3)
    computed = ALL_TYPES["coordinates"].equation([positions], np.zeros((2, 0)))
    np.testing.assert_array_equal(computed.values, positions)
    np.testing.assert_array_equal(computed.jacobians[0], np.broadcast_to(np.eye(3), (2, 3, 3)))
