"""Satellites and inertial systems: positions and attitudes of a trajectory at any time, with what they have in common.

    X_a = X0(t + τ) + Dᵀ(t + τ) a + s + d (t − t_m)              position of an antenna with the lever arm a
    D_b = exp(−[ψ + ψ̇ (t − t_m)]×) B D(t + τ)                    attitude with the misalignment B (boresight)

with the time offset τ, shift s and drift d of positions, ψ and ψ̇ of attitudes; t_m is the middle of the times of a
strip. The attitude is observed as ω, φ, κ.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.frames import by_rotation
from mor.geometry.motion import right_jacobian
from mor.geometry.rotations import angles_by_tangent, angles_from_rotation, exponential
from mor.geometry.trajectory import Pose
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.observations.time.trajectory import by_knots, clock_constants, knot_slots, knots_of
from mor.parameters.kinds import ATTITUDE_SHIFT, POSITION_SHIFT, TIME_OFFSET
from mor.units import ANGLE, LENGTH, TIME, Component

POSITION, ATTITUDE = "trajectory_position", "trajectory_attitude"
"""What a project calls these types."""
SINCE_MIDDLE = Component("time since the middle of the strip", TIME)
_REFERENCES = (Reference("trajectory", ("trajectory",)),)
_OFFSET = Slot(TIME_OFFSET.key, "instrument", TIME_OFFSET.key)


@cache
def trajectory_position(knots: int) -> ObservationType:
    """x, y, z of an antenna. Slots: knots, lever arm, shift and drift, time offset."""
    clock = 1 + knots * knots

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        arm, shift, offset = blocks[2 * knots :]
        since = constants[:, :1]
        path = knots_of(blocks, constants[:, -clock:], knots)
        pose = path.pose(path.time + offset[:, 0])
        back = np.swapaxes(pose.rotation, 1, 2)
        by_turn = -by_rotation(back, arm)
        unit = np.broadcast_to(np.eye(3), back.shape)
        values = pose.position + np.einsum("nij,nj->ni", back, arm) + shift[:, :3] + shift[:, 3:] * since
        return Computed(
            values,
            (
                *by_knots(pose, unit, by_turn),
                back,
                np.concatenate([unit, unit * since[:, :, None]], axis=2),
                _by_time(pose, unit, by_turn),
            ),
        )

    return ObservationType(
        key=f"{POSITION} {knots}",
        written=POSITION,
        components=tuple(Component(name, LENGTH) for name in "xyz"),
        references=_REFERENCES,
        slots=(
            *knot_slots(knots, "trajectory"),
            Slot("eccentricity", "instrument", "lever arm"),
            Slot(POSITION_SHIFT.key, "instrument", POSITION_SHIFT.key),
            _OFFSET,
        ),
        equation=equation,
        constants=(SINCE_MIDDLE, *clock_constants(knots)),
        in_object_axes=True,
    )


@cache
def trajectory_attitude(knots: int) -> ObservationType:
    """ω, φ, κ of an inertial system. Slots: knots, boresight, shift and drift, time offset."""
    clock = 1 + knots * knots

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        boresight, shift, offset = blocks[2 * knots :]
        since = constants[:, :1]
        path = knots_of(blocks, constants[:, -clock:], knots)
        pose = path.pose(path.time + offset[:, 0])
        turn = shift[:, :3] + shift[:, 3:] * since
        turned = exponential(-turn)
        angles = angles_from_rotation(turned @ boresight @ pose.rotation)
        by_whole = angles_by_tangent(angles)
        by_boresight = by_whole @ turned
        by_turn, by_shift = by_boresight @ boresight, by_whole @ right_jacobian(turn)
        nothing = np.zeros_like(by_turn)
        return Computed(
            angles,
            (
                *by_knots(pose, nothing, by_turn),
                by_boresight,
                np.concatenate([by_shift, by_shift * since[:, :, None]], axis=2),
                _by_time(pose, nothing, by_turn),
            ),
        )

    return ObservationType(
        key=f"{ATTITUDE} {knots}",
        written=ATTITUDE,
        components=tuple(Component(name, ANGLE) for name in ("omega", "phi", "kappa")),
        references=_REFERENCES,
        slots=(
            *knot_slots(knots, "trajectory"),
            Slot("rotation", "instrument", "boresight"),
            Slot(ATTITUDE_SHIFT.key, "instrument", ATTITUDE_SHIFT.key),
            _OFFSET,
        ),
        equation=equation,
        constants=(SINCE_MIDDLE, *clock_constants(knots)),
    )


def _by_time(pose: Pose, by_position: FloatArray, by_turn: FloatArray) -> FloatArray:
    """(n, m, 1)."""
    found: FloatArray = by_position @ pose.velocity[:, :, None] + by_turn @ pose.rate[:, :, None]
    return found
