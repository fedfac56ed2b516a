"""Observed coordinates of a position, one, two or all three, with covariances where they are correlated (MOR 2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.observations._between import POSITIONS
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.units import LENGTH, Component


def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """(X, Y, Z)."""
    position = blocks[0]
    return Computed(position.copy(), (np.broadcast_to(np.eye(3), (len(position), 3, 3)),))


COORDINATES = ObservationType(
    key="coordinates",
    components=(Component("x", LENGTH), Component("y", LENGTH), Component("z", LENGTH)),
    references=(Reference("point", POSITIONS),),
    slots=(Slot("point", "point", "position"),),
    equation=equation,
    in_object_axes=True,
)
