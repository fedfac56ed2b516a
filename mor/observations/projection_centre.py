"""Observations to the projection centre of an image, which may lie beside the point the camera is turned about.

An image named as a position is its rotation centre, X0 + h e_Z. The point that is imaged at X* = 0 is

    X_p = X0 + h e_Z + Dᵀ (b* − r0*)

with the eccentricity r0* from the projection centre to the rotation centre, and for a stereo follower, with the frame
of its leading image, its base b* (else 0). Every type that takes positions gets a twin that takes projection centres.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.frames import by_rotation
from mor.observations._between import POSITIONS
from mor.observations._contract import Computed, ObservationType, Slot

_ARM = (("rotation", "rotation"), ("eccentricity", "eccentricity"), ("base", "base"))


def to_projection_centres(type_: ObservationType) -> ObservationType:
    """The twin of a type whose positions may be projection centres.

    Its slots are those of the type, then for each end rotation, eccentricity and base (neutral where the end is no
    projection centre), and the height where the type itself knows none.
    """
    ends = [reference.name for reference in type_.references if reference.among == POSITIONS]
    at = {end: _slot_of(type_, end, "position") for end in ends}
    low = [end for end in ends if _slot_of(type_, end, "height") < 0]
    extra = [Slot(kind, end, part) for end in ends for kind, part in _ARM]
    extra += [Slot("height", end, "height") for end in low]

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        own, arms = list(blocks[: len(type_.slots)]), blocks[len(type_.slots) :]
        heights = dict(zip(low, arms[3 * len(ends) :], strict=True))
        frames = {end: arms[3 * k : 3 * k + 3] for k, end in enumerate(ends)}
        for end, (D, eccentricity, base) in frames.items():
            own[at[end]] = own[at[end]] + np.einsum("nji,nj->ni", D, base - eccentricity)
            if end in heights:
                own[at[end]][:, 2] += heights[end][:, 0]
        computed = type_.equation(own, constants)
        further: list[FloatArray] = []
        for end, (D, eccentricity, base) in frames.items():
            by_star = computed.jacobians[at[end]] @ np.swapaxes(D, 1, 2)
            further += [-by_rotation(by_star, base - eccentricity), -by_star, by_star]
        further += [computed.jacobians[at[end]][:, :, 2:] for end in low]
        return Computed(computed.values, (*computed.jacobians, *further))

    return type_._replace(
        key=f"{type_.key}/projection centre",
        written=type_.name,
        slots=(*type_.slots, *extra),
        equation=equation,
        flat=to_projection_centres(type_.flat) if type_.flat is not None else None,
    )


def _slot_of(type_: ObservationType, end: str, part: str) -> int:
    """Number of the slot of a part of a reference, −1 where the type has none."""
    return next((k for k, slot in enumerate(type_.slots) if (slot.of, slot.part) == (end, part)), -1)


def takes_positions(type_: ObservationType) -> bool:
    """True for types with a reference that may be any position."""
    return any(reference.among == POSITIONS for reference in type_.references)
