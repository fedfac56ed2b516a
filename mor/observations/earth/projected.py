"""Observed coordinates in the projection of the project: antennas of cameras, control that is measured again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.earth import Horizon
from mor.observations._between import POSITIONS
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.units import LENGTH, NUMBER, Component

PLACE = tuple(Component(f"given {name}", LENGTH) for name in "xyz")
"""Object coordinates of what was observed."""
GRID = tuple(Component(f"grid {name}", NUMBER) for name in ("ee", "en", "ne", "nn"))
"""∂(east, north)/∂(e, n) there: scale and convergence of the projection."""
OBSERVED = tuple(Component(f"observed {name}", LENGTH) for name in ("east", "north", "height"))


def projected_position(horizon: Horizon) -> ObservationType:
    """(east, north, height) of a position, the projection linearised where the position was observed.

    Between there and the place of the adjustment lies a residual v: what is left out is of the order v²/R.
    """

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        place, grid, observed = constants[:, :3], constants[:, 3:7].reshape(-1, 2, 2), constants[:, 7:]
        by_position = horizon.local_axes(place)
        by_position[:, :2] = grid @ by_position[:, :2]
        moved = np.einsum("nij,nj->ni", by_position, blocks[0] - place)
        return Computed(observed + moved, (by_position,))

    return ObservationType(
        key="projected_position",
        components=tuple(Component(name, LENGTH) for name in ("east", "north", "height")),
        references=(Reference("point", POSITIONS),),
        slots=(Slot("point", "point", "position"),),
        equation=equation,
        constants=(*PLACE, *GRID, *OBSERVED),
    )
