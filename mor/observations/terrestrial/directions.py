"""Horizontal and vertical directions of a theodolite, a frame like an image (MOR eqs. 6-9)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.frames import by_point, by_rotation, into_frame
from mor.observations._between import POSITIONS, bearing
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.observations.terrestrial.vertical import (
    FACE,
    RADIUS,
    REFRACTION_SLOT,
    bent_elevation,
    face_of_zenith,
)
from mor.units import ANGLE, Component

SLOTS = (
    Slot("point", "station", "position"),
    Slot("rotation", "station", "rotation"),
    Slot("height", "station", "height"),
    Slot("point", "to", "position"),
    Slot("height", "to", "height"),
    REFRACTION_SLOT,
)


def first_face(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """r_h = atan2(X*, Y*), r_v = atan(Z*/√(X*² + Y*²)) + k s_h/(2R)."""
    position, rotation, height, point, target_height, refraction = blocks
    frame = into_frame(position, rotation, height, point, target_height)
    horizontal, by_horizontal = bearing(frame.star)
    vertical, by_vertical, by_k = bent_elevation(frame.star, refraction, constants[:, 0])
    by_star = np.stack([by_horizontal, by_vertical], axis=1)
    to_point = by_point(by_star, frame)
    to_refraction = np.stack([np.zeros_like(by_k), by_k], axis=1)
    return Computed(
        np.stack([horizontal, vertical], axis=1),
        (
            -to_point,
            by_rotation(by_star, frame.lever),
            -to_point[:, :, 2:],
            to_point,
            to_point[:, :, 2:],
            to_refraction,
        ),
    )


def _on_the_circle(zenith: bool) -> Callable[[Sequence[FloatArray], FloatArray], Computed]:
    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        computed = first_face(blocks, constants)
        second = constants[:, 1] == 2.0
        upwards = np.where(second, -1.0, 1.0)
        if zenith:
            vertical = np.where(
                second, 1.5 * np.pi + computed.values[:, 1], 0.5 * np.pi - computed.values[:, 1]
            )
            upwards = -upwards
        else:
            vertical = np.where(second, np.pi - computed.values[:, 1], computed.values[:, 1])
        horizontal = computed.values[:, 0] + np.where(second, np.pi, 0.0)
        sign = np.stack([np.ones_like(upwards), upwards], axis=1)[:, :, None]
        return Computed(
            np.stack([horizontal, vertical], axis=1),
            tuple(sign * jacobian for jacobian in computed.jacobians),
        )

    return equation


def face_of_vertical(vertical: FloatArray) -> FloatArray:
    """Face two where the telescope points backwards: between a quarter and three quarters of the circle."""
    return np.where(np.cos(np.nan_to_num(vertical)) < 0.0, 2.0, 1.0)


def _direction_type(key: str, vertical: str, zenith: bool) -> ObservationType:
    return ObservationType(
        key=key,
        components=(Component("horizontal", ANGLE), Component(vertical, ANGLE)),
        references=(Reference("station", ("station",)), Reference("to", POSITIONS)),
        slots=SLOTS,
        equation=_on_the_circle(zenith),
        constants=(RADIUS, FACE),
        tell_face=face_of_zenith if zenith else face_of_vertical,
        distances=("station", "to"),
        turns=(0,),
    )


DIRECTIONS = _direction_type("directions", "vertical", zenith=False)
"""Horizontal circle and vertical direction; in face two r_h + π and π − r_v."""
ZENITH_DIRECTIONS = _direction_type("zenith_directions", "zenith", zenith=True)
"""Horizontal circle and zenith angle; in face two r_h + π and 2π − z."""
