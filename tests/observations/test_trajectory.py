"""Poses between knots: derivatives against differences, interpolation in closed form, scanners by halving."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mor.model import trajectory as steadiness
from mor.model.cameras import CAMERA_MODELS
from mor.model.contract import ObservationType
from mor.model.images import FOLLOWER_TYPES, IMAGE_TYPES, line_scanner, shutter_on_trajectory
from mor.model.motion import cubic_weights, linear_weights, pose_at, small_rotations
from mor.model.rotations import exponential, rotate, rotation_from_angles
from mor.model.trajectory import on_trajectory, trajectory_attitude, trajectory_position

N = 8


def clock(knots: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times of the knots (n, k), the knot before first; time since it (n,); constants (n, 1 + k²)."""
    times = np.sort(random.uniform(0.0, 8.0, (N, 4)), axis=1) + 2.0 * np.arange(4)
    place = random.integers(0, 3, N) if knots == 4 else np.ones(N, dtype=np.int64)
    order = np.array([[p, *(k for k in range(4) if k != p)] for p in place])
    rows = np.arange(N)
    interval = times[rows, place + 1] - times[rows, place]
    if knots == 4:
        weights = np.take_along_axis(cubic_weights(times, place), order[:, :, None], axis=1)
        own = np.take_along_axis(times, order, axis=1)
    else:
        weights, own = linear_weights(interval), times[:, 1:3]
    since = random.uniform(0.0, 1.0, N) * interval
    return own, since, np.concatenate([since[:, None], weights.reshape(N, -1)], axis=1)


def flight(knots: int, random: np.random.Generator) -> tuple[list[np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    """Blocks of knots, their clock, and points below the pose with what they are seen in."""
    times, since, constants = clock(knots, random)
    places = np.stack([50.0 * times, random.normal(0, 3, times.shape), 1000 + random.normal(0, 3, times.shape)], -1)
    turns = rotation_from_angles(random.normal(0.0, 0.1, (N, knots, 3)) + np.array([0.0, 0.0, -1.2]))
    pose = pose_at(places, turns, constants[:, 1:].reshape(N, knots, knots), since)
    star = np.stack([random.uniform(-200, 200, N), random.uniform(-1, 1, N), np.full(N, -1000.0)], axis=1)
    points = pose.position + np.einsum("nji,nj->ni", pose.rotation, star)
    return [*places.swapaxes(0, 1), *turns.swapaxes(0, 1)], constants, points, pose.position


def worst(type_: ObservationType, blocks: list[np.ndarray], constants: np.ndarray) -> float:
    """Largest difference of the Jacobians from central differences, relative to the largest of each slot."""
    computed = type_.equation(blocks, constants)
    found = 0.0
    for k, block in enumerate(blocks):
        step_of_block = 1e-6 * (1.0 if block.ndim == 3 else max(1.0, float(np.abs(block).max())))
        for j in range(3 if block.ndim == 3 else block.shape[1]):
            slope = max(float(np.abs(computed.jacobians[k][:, :, j]).max()), 1e-9)
            h = min(step_of_block, 1e-3 / slope)
            sides = []
            for sign in (1.0, -1.0):
                step = np.zeros((len(block), 3 if block.ndim == 3 else block.shape[1]))
                step[:, j] = sign * h
                moved = list(blocks)
                moved[k] = rotate(block, step) if block.ndim == 3 else block + step
                sides.append(type_.equation(moved, constants).values)
            difference = (sides[0] - sides[1]) / (2.0 * h)
            size = max(float(np.abs(computed.jacobians[k]).max()), 1e-9)
            found = max(found, float(np.abs(difference - computed.jacobians[k][:, :, j]).max()) / size)
    return found


@pytest.mark.parametrize("knots", [2, 4])
@pytest.mark.parametrize("model", ["mor", "brown", "opencv", "fisheye"])
def test_derivatives_of_image_coordinates(model: str, knots: int) -> None:
    random = np.random.default_rng(7)
    blocks, clocks, points, _ = flight(knots, random)
    own = CAMERA_MODELS[model]
    interior = np.zeros((N, len(own.components)))
    interior[:, :2] = 60.0 if model in ("opencv", "fisheye") else np.array([60.0, 0.1])
    others = [random.normal(0, 1, (N, 1)), random.normal(0, 0.1, (N, 3)), interior, points]
    plain = np.zeros((N, 2 + len(own.constants)))
    assert worst(on_trajectory(IMAGE_TYPES[model], knots), [*blocks, *others], np.hstack([plain, clocks])) < 1e-6
    row = np.stack([random.uniform(-5, 5, N), np.full(N, -0.5)], axis=1)
    assert worst(line_scanner(model, knots), [*blocks, *others], np.hstack([plain, row, clocks])) < 2e-6
    shutter = np.concatenate([plain, np.tile([0.004, -0.006, 0.002], (N, 1)), clocks], axis=1)
    shutter[:, :2] = random.uniform(-30.0, 30.0, (N, 2))
    read_out = [*blocks, *others[:2], np.full((N, 1), 0.3), *others[2:]]
    assert worst(shutter_on_trajectory(model, knots), read_out, shutter) < 1e-6
    pair = [rotation_from_angles(random.normal(0, 0.05, (N, 3))), random.normal(0, 1, (N, 3))]
    followed = [*blocks, *others[:2], *pair, *others[2:]]
    assert worst(on_trajectory(FOLLOWER_TYPES[model], knots), followed, np.hstack([plain, clocks])) < 1e-6


@pytest.mark.parametrize("knots", [2, 4])
def test_derivatives_of_navigation_and_steadiness(knots: int) -> None:
    random = np.random.default_rng(8)
    blocks, clocks, _, _ = flight(knots, random)
    since, offset = random.normal(0, 3, (N, 1)), random.normal(0, 0.1, (N, 1))
    arm, shift = random.normal(0, 1, (N, 3)), random.normal(0, 0.1, (N, 6))
    constants = np.hstack([since, clocks])
    assert worst(trajectory_position(knots), [*blocks, arm, shift, offset], constants) < 1e-6
    boresight = rotation_from_angles(random.normal(0, 0.1, (N, 3)))
    assert worst(trajectory_attitude(knots), [*blocks, boresight, shift, offset], constants) < 1e-6
    intervals = random.uniform(1.0, 3.0, (N, 2))
    turns = rotation_from_angles(random.normal(0, 0.3, (3, N, 3)))
    places = random.normal(0, 10, (3, N, 3))
    for type_ in (steadiness.STEADINESS[key, "position"] for key in ("constancy", "smoothness")):
        count = len(type_.slots)
        assert worst(type_, list(places[:count]), intervals[:, : count - 1]) < 1e-7
    for type_ in (steadiness.STEADINESS[key, "attitude"] for key in ("constancy", "smoothness")):
        count = len(type_.slots)
        assert worst(type_, list(turns[:count]), intervals[:, : count - 1]) < 1e-7


def test_cubic_is_cubic_convolution_at_a_spacing_and_exact_for_parabolas() -> None:
    u = 0.3
    weights = cubic_weights(np.array([[-1.0, 0.0, 1.0, 2.0]]), np.array([1]))[0] @ u ** np.arange(4)
    keys = [-0.5 * u**3 + u**2 - 0.5 * u, 1.5 * u**3 - 2.5 * u**2 + 1, -1.5 * u**3 + 2 * u**2 + 0.5 * u]
    assert weights == pytest.approx([*keys, 0.5 * u**3 - 0.5 * u**2], abs=1e-14)
    random = np.random.default_rng(9)
    times, since, constants = clock(4, random)
    powers = since[:, None] ** np.arange(4)
    curve: Callable[[np.ndarray], np.ndarray] = lambda t: 3.0 + 2.0 * t - 0.3 * t * t  # noqa: E731
    found = np.einsum("nkd,nd,nk->n", constants[:, 1:].reshape(N, 4, 4), powers, curve(times))
    assert found == pytest.approx(curve(times[:, 0] + since), rel=1e-11)


def test_linear_attitude_turns_at_a_steady_rate() -> None:
    axis = np.array([0.3, -0.5, 0.8])
    first = rotation_from_angles(np.array([[0.4, -0.2, 2.0]]))
    second = exponential(-axis[None]) @ first
    assert small_rotations(first, second)[0] == pytest.approx(axis, abs=1e-14)
    pose = pose_at(
        np.zeros((1, 2, 3)),
        np.stack([first, second], axis=1),
        linear_weights(np.array([4.0])),
        np.array([1.0]),
    )
    assert pose.rotation[0] == pytest.approx((exponential(-axis[None] / 4.0) @ first)[0], abs=1e-14)
    assert pose.rate[0] == pytest.approx(axis / 4.0, abs=1e-14)


def test_a_scanner_sees_a_point_when_it_crosses_the_line() -> None:
    """Against halving the time in a straight flight: row and column, whichever row was observed."""
    start, speed, c, line, rate = np.array([0.0, 0.0, 1000.0]), 70.0, 60.0, 12.0, -2.5e-4
    point = np.array([[300.0, -150.0, 40.0]])
    early, late = -10.0, 10.0
    for _ in range(60):
        time = 0.5 * (early + late)
        star = point[0] - (start + np.array([0.0, speed * time, 0.0]))
        early, late = (time, late) if -c * star[1] / star[2] > line else (early, time)
    knots = [np.array([[0.0, -700.0, 1000.0]]), np.array([[0.0, 700.0, 1000.0]])]
    turns = [np.eye(3)[None]] * 2
    weights = linear_weights(np.array([20.0])).reshape(1, -1)
    interior = np.zeros((1, len(CAMERA_MODELS["brown"].components)))
    interior[:, 0] = c
    for off in (-3.0, 0.0, 2.0):
        constants = np.concatenate([[[0.0, line, (early + off) / rate, rate, 10.0 + early + off]], weights], axis=1)
        blocks = [*knots, *turns, np.zeros((1, 1)), np.zeros((1, 3)), interior, point]
        found = line_scanner("brown", 2).equation(blocks, constants).values[0]
        assert found == pytest.approx([-c * star[0] / star[2], early / rate], rel=1e-9)
