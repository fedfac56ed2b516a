"""Observe the first and second differences of neighbouring knots of a trajectory as 0.

    constancy     (X₂ − X₁)/Δ₁₂                                        velocity between two knots
    smoothness    2 ((X₃ − X₂)/Δ₂₃ − (X₂ − X₁)/Δ₁₂)/(Δ₁₂ + Δ₂₃)        acceleration about the middle one of three

and the same of attitudes with the small rotations θ between neighbouring knots, exp(−[θ]×) D₁ = D₂, in place of the
differences: rates of rotation, and their changes, about the axes of the trajectory.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.trajectory import by_ends, small_rotations
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.units import SPEED, TIME, TURN_RATE, Component, Quantity

ACCELERATION = Quantity(length=1, time=-2)
TURN_ACCELERATION = Quantity(angle=1, time=-2)
_BEFORE, _AFTER = Component("time before", TIME), Component("time after", TIME)


def _constant_position(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    first, second = blocks
    per_second = np.eye(3) / constants[:, :1, None]
    return Computed((second - first) / constants[:, :1], (-per_second, per_second))


def _constant_attitude(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    turn = small_rotations(*blocks)
    by_first, by_second = by_ends(turn)
    interval = constants[:, :1]
    return Computed(turn / interval, (by_first / interval[:, :, None], by_second / interval[:, :, None]))


def _smooth_position(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    first, second, third = blocks
    before, after = _factors(constants)
    unit = np.eye(3)
    return Computed(
        (third - second) * after[:, 0] - (second - first) * before[:, 0],
        (unit * before, -unit * (before + after), unit * after),
    )


def _smooth_attitude(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    first, second, third = blocks
    before, after = _factors(constants)
    one, other = small_rotations(first, second), small_rotations(second, third)
    by_first, by_middle = by_ends(one)
    by_second, by_third = by_ends(other)
    return Computed(
        other * after[:, 0] - one * before[:, 0],
        (-by_first * before, by_second * after - by_middle * before, by_third * after),
    )


def _factors(constants: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, 1, 1) what both differences are multiplied with."""
    before, after = constants[:, 0], constants[:, 1]
    return tuple((2.0 / (interval * (before + after)))[:, None, None] for interval in (before, after))  # type: ignore[return-value]


def _type(
    key: str, kind: str, names: tuple[str, ...], quantity: Quantity, equation: object
) -> ObservationType:
    count = 2 if "constancy" in key else 3
    return ObservationType(
        key=key,
        components=tuple(Component(name, quantity) for name in names),
        references=(Reference("trajectory", ("trajectory",)),),
        slots=tuple(Slot(kind, "trajectory", f"{kind} {k}") for k in range(count)),
        equation=equation,  # type: ignore[arg-type]
        constants=(_BEFORE, _AFTER)[: count - 1],
    )


_V, _RATE = ("vx", "vy", "vz"), ("rate_x", "rate_y", "rate_z")
_A, _TURN = ("ax", "ay", "az"), ("turn_ax", "turn_ay", "turn_az")
CONSTANT_POSITION = _type("constancy of position", "point", _V, SPEED, _constant_position)
CONSTANT_ATTITUDE = _type("constancy of attitude", "rotation", _RATE, TURN_RATE, _constant_attitude)
SMOOTH_POSITION = _type("smoothness of position", "point", _A, ACCELERATION, _smooth_position)
SMOOTH_ATTITUDE = _type("smoothness of attitude", "rotation", _TURN, TURN_ACCELERATION, _smooth_attitude)
STEADINESS = (CONSTANT_POSITION, CONSTANT_ATTITUDE, SMOOTH_POSITION, SMOOTH_ATTITUDE)
