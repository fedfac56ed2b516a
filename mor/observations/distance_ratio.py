"""Ratios of two distances from one place: what a distance meter says whose scale nobody knows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.observations._between import POSITIONS, spatial_length
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.units import NUMBER, Component

UP = np.array([0.0, 0.0, 1.0])
_REFERENCES = ("at", "from", "to")


def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """q = s(at → to) / s(at → from), heights included. It has no value where the place and ``from`` coincide."""
    station, station_height, first, first_height, second, second_height = blocks
    start = station + station_height * UP
    length, along = spatial_length(first + first_height * UP - start)
    other, by_second = spatial_length(second + second_height * UP - start)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = other / length
        by_first = -(ratio / length)[:, None] * along
        by_second = by_second / length[:, None]
    by_station = -by_first - by_second
    jacobians = (part for by in (by_station, by_first, by_second) for part in (by[:, None], by[:, None, 2:]))
    return Computed(ratio[:, None], tuple(jacobians))


DISTANCE_RATIO = ObservationType(
    key="distance_ratio",
    components=(Component("ratio", NUMBER),),
    references=tuple(Reference(name, POSITIONS) for name in _REFERENCES),
    slots=tuple(
        Slot(kind, name, part)
        for name in _REFERENCES
        for kind, part in (("point", "position"), ("height", "height"))
    ),
    equation=equation,
)
