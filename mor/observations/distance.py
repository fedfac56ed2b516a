"""Spatial and horizontal distances, with scale and zero offset of the instrument (MOR eq. 13)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.observations._between import BETWEEN_SLOTS, FROM_TO, between, by_between, spatial_length
from mor.observations._contract import Computed, ObservationType, Slot
from mor.units import LENGTH, Component

Length = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


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


DISTANCE = distance_type("distance", spatial_length, through_air=True)
HORIZONTAL_DISTANCE = distance_type("horizontal_distance", horizontal_distance)
