"""Bearings between two positions, clockwise from +Y (MOR eq. 14)."""

from __future__ import annotations

from collections.abc import Sequence

from mor.arrays import FloatArray
from mor.observations._between import BETWEEN_SLOTS, FROM_TO, bearing, between, by_between
from mor.observations._contract import Computed, ObservationType
from mor.units import ANGLE, Component


def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """t = atan2(ΔX, ΔY)."""
    value, by_vector = bearing(between(blocks))
    return Computed(value[:, None], by_between(by_vector[:, None, :]))


BEARING = ObservationType(
    key="bearing",
    components=(Component("bearing", ANGLE),),
    references=FROM_TO,
    slots=BETWEEN_SLOTS,
    equation=equation,
    distances=("from", "to"),
    turns=(0,),
    bearings=(0,),
)
