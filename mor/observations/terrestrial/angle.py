"""Horizontal angles at a station from a backsight to a foresight, clockwise (MOR eq. 17)."""

from __future__ import annotations

from collections.abc import Sequence

from mor.arrays import FloatArray
from mor.observations._between import POSITIONS, bearing
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.units import ANGLE, Component


def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """β = t(at → to) − t(at → from)."""
    station, backsight, foresight = blocks
    back, by_back = bearing(backsight - station)
    fore, by_fore = bearing(foresight - station)
    by_back, by_fore = by_back[:, None, :], by_fore[:, None, :]
    return Computed((fore - back)[:, None], (by_back - by_fore, -by_back, by_fore))


ANGLE_TYPE = ObservationType(
    key="angle",
    components=(Component("angle", ANGLE),),
    references=(Reference("at", POSITIONS), Reference("from", POSITIONS), Reference("to", POSITIONS)),
    slots=(
        Slot("point", "at", "position"),
        Slot("point", "from", "position"),
        Slot("point", "to", "position"),
    ),
    equation=equation,
    distances=("at", "to"),
    turns=(0,),
)
