"""Spatial and horizontal distances, with scale and zero offset of the instrument (MOR eq. 13); ratios of two of them.

A ratio is what a distance meter says whose scale nobody knows: of two distances from one place it cancels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.observations._between import BETWEEN_SLOTS, FROM_TO, POSITIONS, between, by_between, spatial_length
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.units import LENGTH, NUMBER, Component

Length = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
UP = np.array([0.0, 0.0, 1.0])
_REFERENCES = ("at", "from", "to")


def horizontal_distance(vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """√(ΔX² + ΔY²) (n,) and its derivatives (n, 3)."""
    flat = vector * np.array([1.0, 1.0, 0.0])
    return spatial_length(flat)


def distance_type(key: str, length: Length, through_air: bool = False) -> ObservationType:
    """A distance type s_obs = (s − a)/m with scale m and zero offset a of its distance meter."""

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        *positions, meter = blocks
        s, by_vector = length(between(positions))
        scale, offset = meter[:, 0], meter[:, 1]
        computed = (s - offset) / scale
        by_meter = np.stack([-computed / scale, -1.0 / scale], axis=1)[:, None, :]
        return Computed(
            computed[:, None], (*by_between(by_vector[:, None, :] / scale[:, None, None]), by_meter)
        )

    return ObservationType(
        key=key,
        components=(Component("distance", LENGTH),),
        references=FROM_TO,
        slots=(*BETWEEN_SLOTS, Slot("distance meter", "instrument", "distance meter")),
        equation=equation,
        distances=("from", "to"),
        through_air=through_air,
    )


def _ratio(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
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


DISTANCE = distance_type("distance", spatial_length, through_air=True)
HORIZONTAL_DISTANCE = distance_type("horizontal_distance", horizontal_distance)
DISTANCE_RATIO = ObservationType(
    key="distance_ratio",
    components=(Component("ratio", NUMBER),),
    references=tuple(Reference(name, POSITIONS) for name in _REFERENCES),
    slots=tuple(
        Slot(kind, name, part)
        for name in _REFERENCES
        for kind, part in (("point", "position"), ("height", "height"))
    ),
    equation=_ratio,
)
