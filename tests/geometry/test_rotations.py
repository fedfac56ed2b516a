"""Rotations against elementary rotations multiplied out, matrix exponentials by series, and differences."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from mor.model.rotations import (
    angles_by_tangent,
    angles_from_rotation,
    cross_matrix,
    exponential,
    rotate,
    rotation_from_angles,
    tangent_of_angles,
)

ANGLES = np.random.default_rng(3).uniform([-np.pi, -1.5, -np.pi], [np.pi, 1.5, np.pi], (50, 3))


def _by_elementary_rotations(omega, phi, kappa):
    so, co, sp, cp, sk, ck = (f(a) for a in (omega, phi, kappa) for f in (np.sin, np.cos))
    about_x = np.array([[1, 0, 0], [0, co, -so], [0, so, co]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[ck, -sk, 0], [sk, ck, 0], [0, 0, 1]])
    return (about_x @ about_y @ about_z).T


def test_rotation_is_the_transposed_product_of_elementary_rotations():
    expected = [_by_elementary_rotations(*angles) for angles in ANGLES]
    np.testing.assert_allclose(rotation_from_angles(ANGLES), expected, atol=1e-15)


def test_rotations_are_orthonormal_and_right_handed():
    D = rotation_from_angles(ANGLES)
    np.testing.assert_allclose(D @ np.swapaxes(D, 1, 2), np.broadcast_to(np.eye(3), D.shape), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(D), 1.0, atol=1e-14)


def test_kappa_turns_bearings_as_a_horizontal_circle_does():
    # A frame with κ sees a point of bearing t in the direction t + κ (MOR eq. 7).
    bearing, kappa = 0.7, 0.4
    star = rotation_from_angles(np.array([0.0, 0.0, kappa])) @ [np.sin(bearing), np.cos(bearing), 0.0]
    assert np.arctan2(star[0], star[1]) == pytest.approx(bearing + kappa, abs=1e-15)


def test_angles_round_trip():
    np.testing.assert_allclose(angles_from_rotation(rotation_from_angles(ANGLES)), ANGLES, atol=1e-13)


@pytest.mark.parametrize("phi", [np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-12, -np.pi / 2 + 3e-10])
def test_gimbal_lock_loses_no_attitude(phi):
    angles = np.stack([np.linspace(-3.0, 3.0, 7), np.full(7, phi), np.linspace(2.0, -2.0, 7)], axis=1)
    D = rotation_from_angles(angles)
    read = angles_from_rotation(D)
    np.testing.assert_array_equal(read[:, 2], 0.0)
    np.testing.assert_allclose(rotation_from_angles(read), D, atol=2e-9)


@pytest.mark.parametrize("distance", [1e-3, 1e-6, 1e-8])
def test_close_to_gimbal_lock_angles_still_give_the_attitude(distance):
    angles = np.array([[0.3, np.pi / 2 - distance, -1.1], [0.3, -np.pi / 2 + distance, 2.1]])
    D = rotation_from_angles(angles)
    np.testing.assert_allclose(rotation_from_angles(angles_from_rotation(D)), D, atol=1e-15)


def test_cross_matrix_is_the_cross_product():
    q, a = np.random.default_rng(1).standard_normal((2, 9, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", cross_matrix(q), a), np.cross(q, a), atol=1e-15)


@pytest.mark.parametrize("length", [0.0, 1e-300, 1e-12, 1e-8, 1e-4, 0.1, 2.0, np.pi, 6.0])
def test_exponential_is_the_matrix_exponential(length):
    vector = length * np.array([2.0, -1.0, 2.0]) / 3.0
    np.testing.assert_allclose(exponential(vector), scipy.linalg.expm(cross_matrix(vector)), atol=4e-15)


def test_exponential_of_tiny_vectors_keeps_every_digit():
    for length in (1e-5, 1e-9, 1e-17, 1e-200):
        vector = length * np.array([0.6, 0.0, -0.8])
        turned = exponential(vector)
        skew = [turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]
        np.testing.assert_allclose(np.array(skew) / 2.0, vector, rtol=2e-11, atol=0)
        # what is of second order: δδᵀ/2, alone where the vector has no y
        assert turned[0, 2] == pytest.approx(vector[0] * vector[2] / 2.0, rel=1e-9, abs=0.0)


def test_rotate_applies_the_vector_in_the_axes_of_the_frame():
    D = rotation_from_angles(ANGLES)
    delta = np.random.default_rng(2).uniform(-0.5, 0.5, ANGLES.shape)
    expected = [scipy.linalg.expm(-cross_matrix(d)) @ R for d, R in zip(delta, D, strict=True)]
    np.testing.assert_allclose(rotate(D, delta), expected, atol=5e-15)


def test_ten_thousand_updates_stay_orthonormal():
    random = np.random.default_rng(4)
    D = np.eye(3)[None]
    for _ in range(10_000):
        D = rotate(D, 0.3 * random.standard_normal((1, 3)))
    np.testing.assert_allclose(D[0] @ D[0].T, np.eye(3), atol=1e-15)


def test_tangent_of_angles_against_differences():
    step = 1e-5
    for k in range(3):
        shift = step * np.eye(3)[k]
        after, before = rotation_from_angles(ANGLES + shift), rotation_from_angles(ANGLES - shift)
        turn = after @ np.swapaxes(before, 1, 2)  # ≈ exp(−[2 h δ]×)
        skew = (turn - np.swapaxes(turn, 1, 2)) / 2.0
        delta = -np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1) / (2.0 * step)
        np.testing.assert_allclose(tangent_of_angles(ANGLES)[:, :, k], delta, atol=1e-9)


def test_the_two_tangents_are_inverse_to_each_other():
    product = tangent_of_angles(ANGLES) @ angles_by_tangent(ANGLES)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=1e-12)


def test_angles_by_tangent_is_not_finite_at_gimbal_lock_and_does_not_warn():
    E = angles_by_tangent(np.array([[0.2, np.pi / 2, 0.7]]))[0]
    assert not np.isfinite(E[0]).all()
    assert np.isfinite(E[1]).all()


def test_single_angles_and_stacks_of_stacks_are_served():
    stacked = ANGLES.reshape(5, 10, 3)
    D = rotation_from_angles(ANGLES)
    np.testing.assert_array_equal(rotation_from_angles(ANGLES[0]), D[0])
    for function, argument in (
        (rotation_from_angles, stacked),
        (tangent_of_angles, stacked),
        (angles_by_tangent, stacked),
        (exponential, stacked),
    ):
        np.testing.assert_array_equal(
            function(argument).reshape(-1, 3, 3), function(argument.reshape(-1, 3)), err_msg=function.__name__
        )
