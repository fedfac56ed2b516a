"""Control points on the earth: the shift of a position from where it was given, in east, north, up of the place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.earth import Horizon
from mor.observations._between import POSITIONS
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.units import LENGTH, Component


def control(horizon: Horizon) -> ObservationType:
    """(east, north, up) from the given place, whose object coordinates are the constants; observed as zero."""

    def equation(blocks: Sequence[FloatArray], given: FloatArray) -> Computed:
        axes = horizon.local_axes(given)
        return Computed(np.einsum("nij,nj->ni", axes, blocks[0] - given), (axes,))

    return ObservationType(
        key="control",
        components=(Component("east", LENGTH), Component("north", LENGTH), Component("up", LENGTH)),
        references=(Reference("point", POSITIONS),),
        slots=(Slot("point", "point", "position"),),
        equation=equation,
        constants=tuple(Component(f"given {name}", LENGTH) for name in "xyz"),
    )
