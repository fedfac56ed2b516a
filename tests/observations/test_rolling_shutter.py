"""Rolling shutters: against a simulation that shares no code, against frame images; what a row has to do with time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mor.model.cameras import CAMERA_MODELS, Projection
from mor.model.images import IMAGE_TYPES, MOVING_TYPES, meet
from mor.model.motion import inverse_right_jacobian, right_jacobian, turn_by
from mor.model.rotations import exponential

ROOT = Path(__file__).resolve().parents[2]
from sample_projects.simulate.camera import Camera  # noqa: E402
from sample_projects.simulate.geometry import Frame, rotation  # noqa: E402
from sample_projects.simulate.rolling_shutter import Flight, seen_by_row  # noqa: E402

CAMERA = Camera(c=8.8, width=5472, height=3648, pixel=0.0024, xh=0.02, yh=-0.01, radial=(-6e-4, 4e-6), r0=5.0)
READOUT = 0.03


def scene(count: int = 40) -> tuple[Flight, np.ndarray]:
    """An image, and points all over it."""
    random = np.random.default_rng(5)
    flight = Flight(
        Frame(np.array([10.0, -4.0, 61.0]), rotation(0.03, -0.05, 1.3)),
        np.array([0.7, 9.3, -0.4]),
        np.array([0.08, -0.05, 0.11]),
    )
    ground = random.uniform((-28.0, -18.0, -5.0), (28.0, 18.0, 5.0), (count, 3))
    return flight, flight.frame.position + (ground - [0.0, 0.0, 60.0]) @ flight.frame.D


def blocks_of(flight: Flight, points: np.ndarray, readout: float) -> list[np.ndarray]:
    n = len(points)

    def rows(values: np.ndarray) -> np.ndarray:
        return np.repeat(np.asarray(values, dtype=float)[None], n, axis=0)

    interior = [CAMERA.c, CAMERA.xh, CAMERA.yh, *CAMERA.radial, *(0.0,) * 5]
    return [
        rows(flight.frame.position),
        rows(flight.frame.D),
        np.zeros((n, 1)),
        np.zeros((n, 3)),
        rows(flight.velocity),
        rows(flight.rate),
        np.full((n, 1), readout),
        rows(interior),
        points,
    ]


def constants_of(observed: np.ndarray) -> np.ndarray:
    """Measured coordinates, r0, and the clock of a readout from the top row to the bottom."""
    clock = (CAMERA.r0, 0.0, -1.0 / (CAMERA.height * CAMERA.pixel), 0.0)
    return np.concatenate([observed, np.tile(clock, (len(observed), 1))], axis=1)


def test_points_are_where_an_independent_simulation_sees_them() -> None:
    flight, points = scene()
    seen = np.stack([seen_by_row(CAMERA, flight, point, READOUT) for point in points])
    noise = 0.001 * np.random.default_rng(6).standard_normal(seen.shape)
    for observed in (seen, seen + noise, seen + 0.3):  # what was measured only says where to begin
        found = MOVING_TYPES["mor"].equation(blocks_of(flight, points, READOUT), constants_of(observed))
        np.testing.assert_allclose(found.values, seen, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("model", ["mor", "brown", "opencv"])
def test_without_readout_time_it_is_the_frame_image_digit_by_digit(model: str) -> None:
    flight, points = scene()
    blocks = blocks_of(flight, points, 0.0)
    type_, frame = MOVING_TYPES[model], IMAGE_TYPES[model]
    random = np.random.default_rng(7)
    count = len(CAMERA_MODELS[model].components)
    blocks[-2] = np.concatenate([np.full((len(points), 2), 8.8), np.zeros((len(points), count - 2))], axis=1)
    observed = random.uniform(-4.0, 4.0, (len(points), 2))
    clock = constants_of(observed)[:, 3:]
    own = np.full((len(points), len(frame.constants) - 2), 5.0)
    moving = type_.equation(blocks, np.concatenate([observed, own, clock], axis=1))
    still = frame.equation(blocks[:4] + blocks[-2:], np.concatenate([observed, own], axis=1))
    assert np.array_equal(moving.values, still.values)
    kept = [k for k, slot in enumerate(type_.slots) if slot.part not in ("image velocity", "rotation rate", "readout")]
    for one, other in zip(kept, still.jacobians, strict=True):
        assert np.array_equal(moving.jacobians[one], other)
    assert not moving.jacobians[4].any()
    assert not moving.jacobians[5].any()


def test_right_jacobian_against_differences() -> None:
    for size in (0.0, 1e-9, 0.03, 0.0501, 1.0, 3.0):
        vector = size * np.array([[0.6, -0.64, 0.48]])
        found = right_jacobian(vector)[0]
        step = 1e-6
        for k in range(3):
            moved = [exponential(vector + sign * step * np.eye(3)[k])[0] for sign in (1.0, -1.0)]
            change = exponential(vector)[0].T @ (moved[0] - moved[1]) / (2.0 * step)
            numeric = np.array([change[2, 1], change[0, 2], change[1, 0]])
            np.testing.assert_allclose(found[:, k], numeric, atol=1e-9)


def test_rotation_and_inverse_of_the_jacobian_against_others() -> None:
    for size in (0.0, 1e-9, 0.03, 0.0499, 0.0501, 1.0, 3.0, np.pi):
        vector = size * np.array([[0.6, -0.64, 0.48], [-0.28, 0.96, 0.0]])
        turn = turn_by(vector)
        of_scipy = Rotation.from_rotvec(vector).as_matrix()
        np.testing.assert_allclose(turn.matrix, of_scipy, atol=5e-16)
        inverse = np.linalg.inv(turn.jacobian)
        np.testing.assert_allclose(inverse_right_jacobian(vector), inverse, atol=2e-15)


def test_nobody_waits_for_a_point_that_never_meets_the_shutter():
    asked = []

    def at(phase):
        """Points that drift steadily; a third one flees from the shutter, faster than it says."""
        n = len(phase)
        asked.append(n)
        y = np.where(np.arange(n) < 2, 1.0 + 0.01 * phase, 1.0 - 20.0 * phase)
        drift = np.where(np.arange(n) < 2, 0.01, 0.0)
        by_star = np.zeros((n, 2, 3))
        by_star[:, 1, 1] = 1.0
        by_time = np.zeros((n, 3))
        by_time[:, 1] = drift
        return None, Projection(np.stack([0.0 * y, y], axis=1), by_star, np.zeros((n, 2, 0))), by_time

    def met(n):
        clock = np.tile([0.0, 0.1, 0.0], (n, 1))
        return meet(at, np.tile([0.0, 0.9], (n, 1)), clock, np.ones((n, 1))).values

    alone = met(2)
    needed = len(asked)
    assert met(3)[:2] == pytest.approx(alone, rel=1e-15)
    assert len(asked) - needed <= needed + 4
