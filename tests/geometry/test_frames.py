"""The frame kernel against the equation written out point by point, and its chains against differences."""

from __future__ import annotations

import numpy as np

from mor.model.rotations import by_point, by_rotation, follow, into_frame, rotate, rotation_from_angles

RANDOM = np.random.default_rng(8)
N = 6
POSITION, POINT = RANDOM.standard_normal((2, N, 3))
D = rotation_from_angles(RANDOM.uniform(-1.4, 1.4, (N, 3)))
HEIGHT, TARGET = RANDOM.uniform(0.2, 2.0, (2, N, 1))
ECCENTRICITY = RANDOM.standard_normal((N, 3))


def _frame(position=POSITION, D=D, height=HEIGHT, point=POINT, target=TARGET, eccentricity=ECCENTRICITY):
    return into_frame(position, D, height, point, target, eccentricity)


def test_a_point_in_a_frame_is_the_equation_written_out():
    frame = _frame()
    for i in range(N):
        vector = POINT[i] - POSITION[i]
        vector[2] += TARGET[i, 0] - HEIGHT[i, 0]
        np.testing.assert_allclose(frame.lever[i], D[i] @ vector, atol=1e-14)
        np.testing.assert_allclose(frame.star[i], D[i] @ vector + ECCENTRICITY[i], atol=1e-14)


def test_without_target_height_and_eccentricity():
    plain = into_frame(POSITION, D, HEIGHT, POINT)
    zero = into_frame(POSITION, D, HEIGHT, POINT, np.zeros((N, 1)), np.zeros((N, 3)))
    np.testing.assert_allclose(plain.star, zero.star, atol=1e-15)
    np.testing.assert_array_equal(plain.star, plain.lever)


def test_the_arguments_are_left_as_they_were():
    arguments = [a.copy() for a in (POSITION, D, HEIGHT, POINT, TARGET, ECCENTRICITY)]
    for argument in arguments:
        argument.setflags(write=False)
    _frame(*arguments)


def test_the_eccentricity_is_not_turned_by_the_rotation():
    # the chain on to the rotation takes the lever from the rotation centre, not the star
    h = 1e-6
    axes = np.broadcast_to(np.eye(3), (N, 3, 3))
    analytic = by_rotation(axes, _frame().lever)
    for k in range(3):
        delta = np.broadcast_to(h * np.eye(3)[k], (N, 3))
        numeric = (_frame(D=rotate(D, delta)).star - _frame(D=rotate(D, -delta)).star) / (2 * h)
        np.testing.assert_allclose(analytic[:, :, k], numeric, atol=1e-9)


def test_chain_on_to_the_point_against_differences():
    h = 1e-6
    weights = RANDOM.standard_normal((N, 2, 3))
    analytic = by_point(weights, _frame())
    for k in range(3):
        shift = h * np.eye(3)[k]
        change = (_frame(point=POINT + shift).star - _frame(point=POINT - shift).star) / (2 * h)
        np.testing.assert_allclose(analytic[:, :, k], np.einsum("nms,ns->nm", weights, change), atol=1e-8)


def test_a_follower_is_a_frame_of_its_own():
    # X_B* = D* (X_A* − b*) is the frame with the rotation D* D at the position X0 + Dᵀ b*.
    leader = into_frame(POSITION, D, np.zeros((N, 1)), POINT)
    relative = rotation_from_angles(RANDOM.uniform(-0.5, 0.5, (N, 3)))
    base = RANDOM.standard_normal((N, 3))
    position = POSITION + np.einsum("nji,nj->ni", D, base)
    alone = into_frame(position, relative @ D, np.zeros((N, 1)), POINT)
    np.testing.assert_allclose(follow(leader.star, relative, base).star, alone.star, atol=1e-14)
