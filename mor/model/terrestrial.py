"""Directions, angles, bearings, distances, zenith angles and height differences."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mor.model.contract import (
    BETWEEN_SLOTS,
    FROM_TO,
    POSITIONS,
    Computed,
    ObservationType,
    Reference,
    Slot,
    bearing,
    between,
    by_between,
    elevation,
    horizontal_length,
    spatial_length,
)
from mor.model.earth import EARTH_RADIUS
from mor.model.rotations import by_point, by_rotation, into_frame
from mor.types import FloatArray
from mor.units import ANGLE, LENGTH, NUMBER, Component

# ---- Horizontal angles at a station from a backsight to a foresight, clockwise (MOR eq. 17).


def angle_equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """β = t(at → to) − t(at → from)."""
    station, backsight, foresight = blocks
    back, by_back = bearing(backsight - station)
    fore, by_fore = bearing(foresight - station)
    by_back, by_fore = by_back[:, None, :], by_fore[:, None, :]
    return Computed((fore - back)[:, None], (by_back - by_fore, -by_back, by_fore))


ANGLE_TYPE = ObservationType(
    key="angle",
    drawn="direction",
    components=(Component("angle", ANGLE),),
    references=(Reference("at", POSITIONS), Reference("from", POSITIONS), Reference("to", POSITIONS)),
    slots=(Slot("point", "at", "position"), Slot("point", "from", "position"), Slot("point", "to", "position")),
    equation=angle_equation,
    distances=("at", "to"),
    turns=(0,),
)


# ---- Spatial (position) angles: between the sights to two targets, in the plane of the three, as a sextant reads them.

UP = np.array([0.0, 0.0, 1.0])


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
    drawn="direction",
    components=(Component("angle", ANGLE),),
    references=ANGLE_TYPE.references,
    slots=tuple(
        Slot(kind, end.name, part)
        for end in ANGLE_TYPE.references
        for kind, part in (("point", "position"), ("height", "height"))
    ),
    equation=equation,
    distances=("at", "to"),
)


# ---- Bearings between two positions, clockwise from +Y (MOR eq. 14).


def bearing_equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """t = atan2(ΔX, ΔY)."""
    value, by_vector = bearing(between(blocks))
    return Computed(value[:, None], by_between(by_vector[:, None, :]))


BEARING = ObservationType(
    key="bearing",
    drawn="direction",
    components=(Component("bearing", ANGLE),),
    references=FROM_TO,
    slots=BETWEEN_SLOTS,
    equation=bearing_equation,
    distances=("from", "to"),
    turns=(0,),
    bearings=(0,),
)


# ---- Spatial and horizontal distances, with scale and zero offset of the instrument (MOR eq. 13); ratios of two of
# them.
#
# A ratio is what a distance meter says whose scale nobody knows: of two distances from one place it cancels.

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
        return Computed(computed[:, None], (*by_between(by_vector[:, None, :] / scale[:, None, None]), by_meter))

    return ObservationType(
        key=key,
        drawn="distance",
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
    drawn="distance",
    components=(Component("ratio", NUMBER),),
    references=SPATIAL_ANGLE.references,
    slots=SPATIAL_ANGLE.slots,
    equation=_ratio,
)


# ---- Vertical directions and zenith angles between two positions, either face, with refraction (MOR eq. 15).


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
    drawn="direction",
    components=(Component("vertical_direction", ANGLE),),
    references=FROM_TO,
    slots=(*BETWEEN_SLOTS, Slot("refraction", "instrument", "refraction")),
    equation=vertical_direction,
    constants=(Component("earth radius", LENGTH, default=EARTH_RADIUS),),
    distances=("from", "to"),
)
ZENITH_ANGLE = VERTICAL_DIRECTION._replace(
    key="zenith_angle",
    components=(Component("zenith_angle", ANGLE),),
    equation=zenith_angle,
    constants=(*VERTICAL_DIRECTION.constants, Component("face", NUMBER, default=1.0)),
    tell_face=face_of_zenith,
)


# ---- Horizontal and vertical directions of a theodolite, a frame like an image (MOR eqs. 6-9).


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
            vertical = np.where(second, 1.5 * np.pi + computed.values[:, 1], 0.5 * np.pi - computed.values[:, 1])
            upwards = -upwards
        else:
            vertical = np.where(second, np.pi - computed.values[:, 1], computed.values[:, 1])
        horizontal = computed.values[:, 0] + np.where(second, np.pi, 0.0)
        sign = np.stack([np.ones_like(upwards), upwards], axis=1)[:, :, None]
        return Computed(
            np.stack([horizontal, vertical], axis=1), tuple(sign * jacobian for jacobian in computed.jacobians)
        )

    return equation


def face_of_vertical(vertical: FloatArray) -> FloatArray:
    """Face two where the telescope points backwards: between a quarter and three quarters of the circle."""
    return np.where(np.cos(np.nan_to_num(vertical)) < 0.0, 2.0, 1.0)


def _direction_type(key: str, vertical: str, zenith: bool) -> ObservationType:
    return ObservationType(
        key=key,
        drawn="direction",
        components=(Component("horizontal", ANGLE), Component(vertical, ANGLE)),
        references=(Reference("station", ("station",)), Reference("to", POSITIONS)),
        slots=(
            Slot("point", "station", "position"),
            Slot("rotation", "station", "rotation"),
            Slot("height", "station", "height"),
            Slot("point", "to", "position"),
            Slot("height", "to", "height"),
            Slot("refraction", "instrument", "refraction"),
        ),
        equation=_on_the_circle(zenith),
        constants=ZENITH_ANGLE.constants,
        tell_face=face_of_zenith if zenith else face_of_vertical,
        distances=("station", "to"),
        turns=(0,),
    )


DIRECTIONS = _direction_type("directions", "vertical", zenith=False)
"""Horizontal circle and vertical direction; in face two r_h + π and π − r_v."""
ZENITH_DIRECTIONS = _direction_type("zenith_directions", "zenith", zenith=True)
"""Horizontal circle and zenith angle; in face two r_h + π and 2π − z."""


# ---- Coordinate differences, vectors and height differences between two positions (MOR eqs. 10-12).


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
    drawn="vector",
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
    drawn="levelling",
    components=(Component("dz", LENGTH),),
    references=FROM_TO,
    slots=BETWEEN_SLOTS,
    equation=height_equation,
    distances=("from", "to"),
    between_marks=True,
)
