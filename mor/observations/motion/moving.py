"""Observations of points that move: a position is a linear function of parameters at the time of the observation.

At the time t a point is at

    X(t) = X + (t − t0) v + sin(2πt) s + cos(2πt) c

with the velocity v and the annual oscillation s, c of the point, t in years. So every type that observes points has a
twin that takes these blocks besides, and its derivatives are those by the position times what each is multiplied with:
∂l/∂v = (t − t0) ∂l/∂X. The time is that of the row: a constant. Nothing else knows of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from mor.arrays import FloatArray
from mor.observations._contract import Computed, ObservationType, Slot
from mor.parameters.kinds import MOTIONS
from mor.units import NUMBER, Component

MOVING = "moving "
"""What the keys of these types begin with."""
BASIS = tuple(Component(name, NUMBER) for name in ("years since the reference", "sine", "cosine"))
"""Constants of a row: what the blocks of :data:`mor.parameters.kinds.MOTIONS` are multiplied with at its time."""


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
            places[number] = places[number] + sum(
                t * motion for t, motion in zip(times, motions, strict=True)
            )
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
