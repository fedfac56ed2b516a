"""Spatial (position) angles: between the sights to two targets, in the plane of the three, as a sextant reads them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.observations._between import POSITIONS, spatial_length
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.units import ANGLE, Component

UP = np.array([0.0, 0.0, 1.0])
_REFERENCES = ("at", "from", "to")


def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """γ = atan2(|u × v|, u · v), with u, v from the instrument to the two targets, heights included.

    0 ≤ γ ≤ π, whatever the level of the instrument. At 0 and π the angle has no derivatives: they are taken as zero.
    """
    station, station_height, first, first_height, second, second_height = blocks
    start = station + station_height * UP
    u, v = first + first_height * UP - start, second + second_height * UP - start
    normal = np.cross(u, v)
    size, _ = spatial_length(normal)
    by_first = _towards(u, normal, size)
    by_second = _towards(v, -normal, size)
    by_station = -by_first - by_second
    jacobians = (part for by in (by_station, by_first, by_second) for part in (by, by[:, :, 2:]))
    return Computed(np.arctan2(size, np.sum(u * v, axis=1))[:, None], tuple(jacobians))


def _towards(sight: FloatArray, normal: FloatArray, size: FloatArray) -> FloatArray:
    """Derivatives (n, 1, 3) by a sight: across it, away from the other one, divided by its length."""
    length, along = spatial_length(sight)
    across = np.cross(normal, along)
    tiny = np.finfo(float).tiny ** 0.5
    derivative: FloatArray = -across / (np.maximum(size, tiny) * np.maximum(length, tiny))[:, None]
    return derivative[:, None, :]


SPATIAL_ANGLE = ObservationType(
    key="spatial_angle",
    components=(Component("angle", ANGLE),),
    references=tuple(Reference(name, POSITIONS) for name in _REFERENCES),
    slots=tuple(
        Slot(kind, name, part)
        for name in _REFERENCES
        for kind, part in (("point", "position"), ("height", "height"))
    ),
    equation=equation,
    distances=("at", "to"),
)
