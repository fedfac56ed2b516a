"""Rays to points at infinity: a direction in place of a point. Shifts and scale do not change them at all.

A point whose rays are parallel to their precision has a direction and no distance. Its coordinates would grow without
limit and take the datum along. The direction u = Dᵀ e_Z, D a rotation of two free turns, is the limit itself: seen from
a frame it is X* = D_frame · u, wherever the frame stands (MOR eq. 1 with X → ∞).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from mor.arrays import FloatArray
from mor.observations._contract import Computed, ObservationType, Slot
from mor.parameters.kinds import KINDS
from mor.units import LENGTH

FREE_TURNS = (True, True, False)
"""Turns about the axes of D that move u: not the one about u itself."""
AT_INFINITY = " at infinity"
"""What the keys of these types end with."""
TURNED_AXIS: FloatArray = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
"""∂u/∂δ in the axes of D: −[e_Z]×."""


@cache
def at_infinity(type_: ObservationType) -> ObservationType:
    """Return the observation type for a point at infinity, which is a direction; lengths of the set-up vanish.

    Slots: those of ``type_`` that are no lengths, and a rotation in place of the point.
    """
    target = target_slot(type_)
    kept = tuple(
        k for k, slot in enumerate(type_.slots) if slot.kind not in _LENGTHS and slot.kind != "point"
    )

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        D = blocks[-1]
        near = {k: _without_lengths(type_.slots[k], b) for k, b in zip(kept, blocks[:-1], strict=True)}
        near[target] = D[:, 2, :]
        nothing = [np.zeros((len(D), _LENGTHS.get(slot.kind, 3))) for slot in type_.slots]
        filled = [near.get(k, zero) for k, zero in enumerate(nothing)]
        computed = type_.equation(filled, constants)
        by_point = computed.jacobians[target]
        by_turn = by_point @ np.swapaxes(D, 1, 2) @ TURNED_AXIS
        by_kept = (_without_lengths(type_.slots[k], computed.jacobians[k]) for k in kept)
        return Computed(computed.values, (*by_kept, by_turn))

    return type_._replace(
        key=type_.key + AT_INFINITY,
        written=type_.name,
        slots=(*(type_.slots[k] for k in kept), Slot("rotation", type_.slots[target].of, "direction")),
        equation=equation,
        distances=None,
    )


_LENGTHS = {"height": 1, "eccentricity": 3, "base": 3, "image velocity": 3}
"""Kinds of blocks that are nothing beside an infinite distance, also per second, and their sizes."""


def _without_lengths(slot: Slot, array: FloatArray) -> FloatArray:
    """A block (n, size), or the derivatives (n, m, size) by it, with the components that are lengths at 0."""
    if not slot.kind.startswith("interior/"):
        return array
    lengths = [component.quantity == LENGTH for component in KINDS[slot.kind].components]
    return np.where(lengths, 0.0, array) if any(lengths) else array


def target_slot(type_: ObservationType) -> int:
    """Number of the slot of the point that is sighted."""
    return max(k for k, slot in enumerate(type_.slots) if slot.kind == "point")


def can_be_at_infinity(type_: ObservationType) -> bool:
    """True for rays: two angles or image coordinates from a frame with an attitude to a point.

    Not where the place of the frame turns the axes: without it there is no vertical.
    """
    positions = sum(slot.kind == "point" for slot in type_.slots)
    frames = positions == 2 and any(slot.part == "rotation" for slot in type_.slots)
    lengths = any(component.quantity == LENGTH for component in type_.components)
    sighted = any(slot.kind == "point" for slot in type_.slots)
    two = len(type_.components) == 2 and not type_.about_local_vertical
    return frames and sighted and two and not lengths
