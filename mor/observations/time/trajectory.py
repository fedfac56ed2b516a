"""Images on a trajectory: their pose is that of the trajectory at a time, a function of two or four knots.

Every type of image coordinates has a twin that takes the knots in place of position and rotation; what it computes
follows by the chain rule. The time is known. Nothing in the solver changes: such a ray has more slots.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.trajectory import Path, Pose, path_of
from mor.observations._contract import Computed, ObservationType, Slot
from mor.units import NUMBER, TIME, Component

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

    def pose(self, time: FloatArray) -> Pose:
        """The pose at ``time`` (n,) since the first knot."""
        return self.path.at(time)


def knots_of(blocks: Sequence[FloatArray], clock: FloatArray, knots: int) -> Knots:
    """Knots from the first 2k blocks of a row, and its constants (n, 1 + k²)."""
    weights = clock[:, 1:].reshape(-1, knots, knots)
    positions, rotations = np.stack(blocks[:knots], axis=1), np.stack(blocks[knots : 2 * knots], axis=1)
    return Knots(path_of(positions, rotations, weights), clock[:, 0])


def by_knots(pose: Pose, by_position: FloatArray, by_rotation: FloatArray) -> tuple[FloatArray, ...]:
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
