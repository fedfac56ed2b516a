"""Vertical directions and zenith angles between two positions, either face, with refraction (MOR eq. 15)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.earth import EARTH_RADIUS
from mor.observations._between import (
    BETWEEN_SLOTS,
    FROM_TO,
    between,
    by_between,
    elevation,
    horizontal_length,
)
from mor.observations._contract import Computed, ObservationType, Slot
from mor.units import ANGLE, LENGTH, NUMBER, Component

FACE = Component("face", NUMBER, default=1.0)
RADIUS = Component("earth radius", LENGTH, default=EARTH_RADIUS)
REFRACTION_SLOT = Slot("refraction", "instrument", "refraction")


def bent_elevation(
    vector: FloatArray, refraction: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Observed elevation r_v + k s_h/(2R) (n,), derivatives by the vector (n, 3) and by k (n, 1).

    Refraction lifts the target: z_obs = z − k s_h/(2R), hence the plus for vertical directions.
    """
    value, by_vector = elevation(vector)
    horizontal = horizontal_length(vector)
    bending = horizontal / (2.0 * radius)
    by_vector[:, :2] += (refraction[:, 0] / (2.0 * radius * horizontal))[:, None] * vector[:, :2]
    return value + refraction[:, 0] * bending, by_vector, bending[:, None]


def vertical_direction(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """r_v = atan(ΔZ / s0)."""
    *positions, refraction = blocks
    value, by_vector, by_k = bent_elevation(between(positions), refraction, constants[:, 0])
    return Computed(value[:, None], (*by_between(by_vector[:, None, :]), by_k[:, None, :]))


def zenith_angle(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """z = π/2 − r_v in face one, 2π − z in face two."""
    computed = vertical_direction(blocks, constants)
    second = constants[:, 1] == 2.0
    sign = np.where(second, 1.0, -1.0)
    circle = np.where(second, 1.5 * np.pi, 0.5 * np.pi)
    return Computed(
        circle[:, None] + sign[:, None] * computed.values,
        tuple(sign[:, None, None] * jacobian for jacobian in computed.jacobians),
    )


def face_of_zenith(zenith: FloatArray) -> FloatArray:
    """Face two where the zenith angle is beyond the half circle."""
    return np.where(np.remainder(np.nan_to_num(zenith), 2.0 * np.pi) > np.pi, 2.0, 1.0)


VERTICAL_DIRECTION = ObservationType(
    key="vertical_direction",
    components=(Component("vertical_direction", ANGLE),),
    references=FROM_TO,
    slots=(*BETWEEN_SLOTS, REFRACTION_SLOT),
    equation=vertical_direction,
    constants=(RADIUS,),
    distances=("from", "to"),
)
ZENITH_ANGLE = ObservationType(
    key="zenith_angle",
    components=(Component("zenith_angle", ANGLE),),
    references=FROM_TO,
    slots=(*BETWEEN_SLOTS, REFRACTION_SLOT),
    equation=zenith_angle,
    constants=(RADIUS, FACE),
    tell_face=face_of_zenith,
    distances=("from", "to"),
)
