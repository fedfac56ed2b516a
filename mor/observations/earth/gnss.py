"""What satellites give in geocentric axes: vectors between marks, positions of marks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.earth import Horizon
from mor.observations._between import BETWEEN_SLOTS, FROM_TO, POSITIONS
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.units import LENGTH, Component

_MIDDLE = np.array([0.0, 0.0, 1.0])
"""Normal at the middle of the network: near enough for the derivative by heights that are all 0."""


def gnss_vector(horizon: Horizon) -> ObservationType:
    """Geocentric (ΔX, ΔY, ΔZ) between marks, or between antennas at heights along the normals above them."""
    turn = horizon.axes.T

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        start, start_height, end, end_height = blocks
        vector = end - start
        by_end = np.broadcast_to(turn, (len(vector), 3, 3))
        up_start = up_end = np.broadcast_to(_MIDDLE, vector.shape)
        if start_height.any() or end_height.any():  # from mark to mark nothing needs the normals
            up_start, up_end = np.split(horizon.foot(np.concatenate([start, end])).up, 2)
            vector = vector + end_height * up_end - start_height * up_start
        by_heights = [(up @ turn.T)[:, :, None] for up in (up_start, up_end)]
        return Computed(vector @ turn.T, (-by_end, -by_heights[0], by_end, by_heights[1]))

    return ObservationType(
        key="gnss_vector",
        components=(Component("dx", LENGTH), Component("dy", LENGTH), Component("dz", LENGTH)),
        references=FROM_TO,
        slots=BETWEEN_SLOTS,
        equation=equation,
        distances=("from", "to"),
        between_marks=True,
    )


def gnss_position(horizon: Horizon) -> ObservationType:
    """Geocentric (X, Y, Z) of a position."""
    turn = horizon.axes.T

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        (position,) = blocks
        return Computed(horizon.to_geocentric(position), (np.broadcast_to(turn, (len(position), 3, 3)),))

    return ObservationType(
        key="gnss_position",
        components=(Component("x", LENGTH), Component("y", LENGTH), Component("z", LENGTH)),
        references=(Reference("point", POSITIONS),),
        slots=(Slot("point", "point", "position"),),
        equation=equation,
    )
