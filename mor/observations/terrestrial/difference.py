"""Coordinate differences, vectors and height differences between two positions (MOR eqs. 10-12)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.observations._between import BETWEEN_SLOTS, FROM_TO, between, by_between
from mor.observations._contract import Computed, ObservationType
from mor.units import LENGTH, Component


def vector_equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """(ΔX, ΔY, ΔZ)."""
    vector = between(blocks)
    return Computed(vector, by_between(np.broadcast_to(np.eye(3), (len(vector), 3, 3))))


def height_equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """ΔZ."""
    vector = between(blocks)
    vertical = np.array([[0.0, 0.0, 1.0]])
    return Computed(vector[:, 2:], by_between(np.broadcast_to(vertical, (len(vector), 1, 3))))


VECTOR = ObservationType(
    key="vector",
    components=(Component("dx", LENGTH), Component("dy", LENGTH), Component("dz", LENGTH)),
    references=FROM_TO,
    slots=BETWEEN_SLOTS,
    equation=vector_equation,
    distances=("from", "to"),
    between_marks=True,
    in_object_axes=True,
)
HEIGHT_DIFFERENCE = ObservationType(
    key="height_difference",
    components=(Component("dz", LENGTH),),
    references=FROM_TO,
    slots=BETWEEN_SLOTS,
    equation=height_equation,
    distances=("from", "to"),
    between_marks=True,
)
