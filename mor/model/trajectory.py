"""Observations of trajectories and moving points: navigation, steadiness of knots."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from mor.model.contract import Computed, Equation, ObservationType, Reference, Slot
from mor.model.motion import Path, TrajectoryPoses, by_ends, path_of, right_jacobian, small_rotations
from mor.model.parameters import ATTITUDE_SHIFT, MOTIONS, POSITION_SHIFT, TIME_OFFSET, BlockKind
from mor.model.rotations import angles_by_tangent, angles_from_rotation, by_rotation, exponential
from mor.types import FloatArray
from mor.units import ANGLE, LENGTH, NUMBER, SPEED, TIME, TURN_RATE, Component, Quantity

# ---- Images on a trajectory: their pose is that of the trajectory at a time, a function of two or four knots.
#
# Every type of image coordinates has a twin that takes the knots instead of position and rotation; what it computes
# follows by the chain rule. The time is known. Nothing in the solver changes: such a ray has more slots.

LINEAR, CUBIC = 2, 4
"""Knots that a pose depends on."""
ON_TRAJECTORY = "on trajectory"
"""What the keys of these types begin with."""


def knot_slots(knots: int, of: str) -> tuple[Slot, ...]:
    """Positions of the knots, then their rotations."""
    positions = (Slot("point", of, f"position of knot {k}") for k in range(knots))
    rotations = (Slot("rotation", of, f"rotation of knot {k}") for k in range(knots))
    return (*positions, *rotations)


def clock_constants(knots: int) -> tuple[Component, ...]:
    """Constants of a row: its time since the first of its knots, and the weights as polynomials of that time."""
    weights = (Component(f"weight {k} {d}", NUMBER) for k in range(knots) for d in range(knots))
    return (Component("time since knot", TIME), *weights)


def is_along(type_: ObservationType) -> bool:
    """True for what is observed of a trajectory, or from one: the types that take knots."""
    return type_.slots[0].part == "position of knot 0"


def knot_count(type_: ObservationType) -> int:
    """Number of knots that such a type takes, 0 for others."""
    return sum(slot.kind == "rotation" and "knot" in slot.part for slot in type_.slots)


class Knots(NamedTuple):
    """Knots of n rows, and when something is observed between them."""

    path: Path
    time: FloatArray
    """(n,) since the first of them."""

    def pose(self, time: FloatArray) -> TrajectoryPoses:
        """The pose at ``time`` (n,) since the first knot."""
        return self.path.at(time)


def knots_of(blocks: Sequence[FloatArray], clock: FloatArray, knots: int) -> Knots:
    """Knots from the first 2k blocks of a row, and its constants (n, 1 + k²)."""
    weights = clock[:, 1:].reshape(-1, knots, knots)
    positions, rotations = np.stack(blocks[:knots], axis=1), np.stack(blocks[knots : 2 * knots], axis=1)
    return Knots(path_of(positions, rotations, weights), clock[:, 0])


def by_knots(pose: TrajectoryPoses, by_position: FloatArray, by_rotation: FloatArray) -> tuple[FloatArray, ...]:
    """Jacobians (n, m, 3) by the knots, positions first, from those by position and small rotation of the pose."""
    count = pose.weights.shape[1]
    positions = (pose.weights[:, k, None, None] * by_position for k in range(count))
    rotations = (by_rotation @ pose.by_rotations[:, k] for k in range(count))
    return (*positions, *rotations)


@cache
def on_trajectory(type_: ObservationType, knots: int) -> ObservationType:
    """The twin of a type of image coordinates whose image is on a trajectory.

    Slots: the knots, then those of ``type_`` after position and rotation. Constants: its own, then those of the clock.
    """
    clock = 1 + knots * knots

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        found = knots_of(blocks, constants[:, -clock:], knots)
        pose = found.pose(found.time)
        computed = type_.equation((pose.position, pose.rotation, *blocks[2 * knots :]), constants[:, :-clock])
        by_position, by_rotation, *others = computed.jacobians
        return Computed(computed.values, (*by_knots(pose, by_position, by_rotation), *others))

    return type_._replace(
        key=f"{ON_TRAJECTORY} {knots} {type_.key}",
        written=type_.name,
        slots=(*knot_slots(knots, "image"), *type_.slots[2:]),
        constants=(*type_.constants, *clock_constants(knots)),
        equation=equation,
    )


# ---- Satellites and inertial systems: positions and attitudes of a trajectory at any time, with what they have in
# common.
#
#     X_a = X0(t + τ) + Dᵀ(t + τ) a + s + d (t − t_m)              position of an antenna with the lever arm a
#     D_b = exp(−[ψ + ψ̇ (t − t_m)]×) B D(t + τ)                    attitude with the misalignment B (boresight)
#
# with the time offset τ, shift s and drift d of positions, ψ and ψ̇ of attitudes; t_m is the middle of the times of a
# strip. The attitude is observed as ω, φ, κ.

POSITION, ATTITUDE = "trajectory_position", "trajectory_attitude"
"""What a project calls these types."""


def _observed_pose(
    key: str, components: tuple[Component, ...], mounting: Slot, shift: BlockKind, equation: Equation, knots: int
) -> ObservationType:
    """A type with the slots of the knots and of the instrument: its mounting, shift and time offset."""
    return ObservationType(
        key=f"{key} {knots}",
        written=key,
        components=components,
        references=(Reference("trajectory", ("trajectory",)),),
        slots=(
            *knot_slots(knots, "trajectory"),
            mounting,
            *(Slot(kind.key, "instrument", kind.key) for kind in (shift, TIME_OFFSET)),
        ),
        equation=equation,
        constants=(Component("time since the middle of the strip", TIME), *clock_constants(knots)),
    )


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

    components = tuple(Component(name, LENGTH) for name in "xyz")
    lever_arm = Slot("eccentricity", "instrument", "lever arm")
    found = _observed_pose(POSITION, components, lever_arm, POSITION_SHIFT, equation, knots)
    return found._replace(in_object_axes=True)


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

    components = tuple(Component(name, ANGLE) for name in ("omega", "phi", "kappa"))
    mounting = Slot("rotation", "instrument", "boresight")
    return _observed_pose(ATTITUDE, components, mounting, ATTITUDE_SHIFT, equation, knots)


def _by_time(pose: TrajectoryPoses, by_position: FloatArray, by_turn: FloatArray) -> FloatArray:
    """(n, m, 1)."""
    return np.asarray(by_position @ pose.velocity[:, :, None] + by_turn @ pose.rate[:, :, None])


# ---- Observe the first and second differences of neighbouring knots of a trajectory as 0.
#
#     constancy     (X₂ − X₁)/Δ₁₂                                        velocity between two knots
#     smoothness    2 ((X₃ − X₂)/Δ₂₃ − (X₂ − X₁)/Δ₁₂)/(Δ₁₂ + Δ₂₃)        acceleration about the middle one of three
#
# and the same of attitudes with the small rotations θ between neighbouring knots, exp(−[θ]×) D₁ = D₂, instead of the
# differences: rates of rotation, and their changes, about the axes of the trajectory.


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


def _type(key: str, kind: str, names: tuple[str, ...], quantity: Quantity, equation: Equation) -> ObservationType:
    count = 2 if "constancy" in key else 3
    return ObservationType(
        key=key,
        components=tuple(Component(name, quantity) for name in names),
        references=(Reference("trajectory", ("trajectory",)),),
        slots=tuple(Slot(kind, "trajectory", f"{kind} {k}") for k in range(count)),
        equation=equation,
        constants=(Component("time before", TIME), Component("time after", TIME))[: count - 1],
    )


STEADINESS = {
    (type_.key.split()[0], type_.key.split()[-1]): type_
    for type_ in (
        _type("constancy of position", "point", ("vx", "vy", "vz"), SPEED, _constant_position),
        _type("constancy of attitude", "rotation", ("rate_x", "rate_y", "rate_z"), TURN_RATE, _constant_attitude),
        _type("smoothness of position", "point", ("ax", "ay", "az"), Quantity(length=1, time=-2), _smooth_position),
        _type(
            "smoothness of attitude",
            "rotation",
            ("turn_ax", "turn_ay", "turn_az"),
            Quantity(angle=1, time=-2),
            _smooth_attitude,
        ),
    )
}
"""Types by the keys of a trajectory that ask for them, as ("constancy", "position")."""


# ---- Observations of points that move: a position is a linear function of parameters at the time of the observation.
#
# At the time t a point is at
#
#     X(t) = X + (t − t0) v + sin(2πt) s + cos(2πt) c
#
# with the velocity v and the annual oscillation s, c of the point, t in years. So every type that observes
# points has a twin that takes these blocks besides, and its derivatives are those by the position times what
# each is multiplied with: ∂l/∂v = (t − t0) ∂l/∂X. The time is that of the row: a constant. Nothing else knows
# of it.

MOVING = "moving "
"""What the keys of these types begin with."""
BASIS = tuple(Component(name, NUMBER) for name in ("years since the reference", "sine", "cosine"))
"""Constants of a row: what the blocks of :data:`mor.model.parameters.MOTIONS` are multiplied with at its time."""


def basis(times: FloatArray, reference: float) -> FloatArray:
    """(n, 3) t − t0, sin 2πt, cos 2πt of times in years."""
    turn = 2.0 * np.pi * np.remainder(times, 1.0)
    return np.stack([times - reference, np.sin(turn), np.cos(turn)], axis=1)


@cache
def moving(type_: ObservationType) -> ObservationType:
    """The twin of a type whose points move.

    Slots: those of ``type_``, then for each of its positions velocity, sine and cosine. Constants: its own, then
    :data:`BASIS`.
    """
    positions = [k for k, slot in enumerate(type_.slots) if slot.kind == "point"]
    own = len(type_.slots)

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        places, given = list(blocks[:own]), constants[:, : -len(BASIS)]
        times = constants[:, -len(BASIS) :].T[:, :, None]
        for k, number in enumerate(positions):
            motions = blocks[own + k * len(MOTIONS) : own + (k + 1) * len(MOTIONS)]
            places[number] = places[number] + sum(t * motion for t, motion in zip(times, motions, strict=True))
        computed = type_.equation(places, given)
        further = [computed.jacobians[number] * t[:, :, None] for number in positions for t in times]
        return Computed(computed.values, (*computed.jacobians, *further))

    further = tuple(
        Slot(kind.key, type_.slots[number].of, f"{type_.slots[number].part} {kind.key}")
        for number in positions
        for kind in MOTIONS
    )
    return type_._replace(
        key=MOVING + type_.key,
        written=type_.name,
        slots=(*type_.slots, *further),
        constants=(*type_.constants, *BASIS),
        equation=equation,
        still=type_,
        flat=moving(type_.flat) if type_.flat is not None else None,
    )
