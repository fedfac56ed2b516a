"""Observation types: one file each, every one a value of :class:`ObservationType`."""

from mor.observations._at_infinity import (
    AT_INFINITY,
    FREE_TURNS,
    TURNED_AXIS,
    at_infinity,
    can_be_at_infinity,
    target_slot,
)
from mor.observations._contract import (
    PERFECT_SET_UP,
    Computed,
    External,
    ObservationGroup,
    ObservationType,
    Reference,
    SetUp,
    Slot,
    some_rows,
    without,
    wrap,
)
from mor.observations.coordinates import COORDINATES
from mor.observations.image import FOLLOWER_TYPES, IMAGE_TYPES, is_image_point
from mor.observations.level import LEVEL
from mor.observations.local import LOCAL
from mor.observations.parameter import OBSERVED_DIFFERENCES, OBSERVED_PARAMETERS
from mor.observations.projection_centre import takes_positions, to_projection_centres
from mor.observations.terrestrial.angle import ANGLE_TYPE
from mor.observations.terrestrial.bearing import BEARING
from mor.observations.terrestrial.difference import HEIGHT_DIFFERENCE, VECTOR
from mor.observations.terrestrial.directions import DIRECTIONS, ZENITH_DIRECTIONS
from mor.observations.terrestrial.distance import DISTANCE, DISTANCE_RATIO, HORIZONTAL_DISTANCE
from mor.observations.terrestrial.spatial_angle import SPATIAL_ANGLE
from mor.observations.terrestrial.vertical import VERTICAL_DIRECTION, ZENITH_ANGLE
from mor.observations.time.rolling_shutter import MOVING_TYPES, read_out_at_once

PLAIN_TYPES = {
    kind.key: kind
    for kind in (
        DISTANCE,
        HORIZONTAL_DISTANCE,
        DISTANCE_RATIO,
        DIRECTIONS,
        ZENITH_DIRECTIONS,
        BEARING,
        VERTICAL_DIRECTION,
        ZENITH_ANGLE,
        ANGLE_TYPE,
        SPATIAL_ANGLE,
        VECTOR,
        HEIGHT_DIFFERENCE,
        COORDINATES,
        LOCAL,
        LEVEL,
    )
}
"""Types a project names directly; image coordinates are chosen by the model of the camera."""

PROJECTION_CENTRE_TYPES = {
    kind.key: to_projection_centres(kind) for kind in PLAIN_TYPES.values() if takes_positions(kind)
}
"""Twins, by the key of the type, that take projection centres for positions."""

ALL_TYPES = {
    kind.key: kind
    for kind in (
        *IMAGE_TYPES.values(),
        *FOLLOWER_TYPES.values(),
        *MOVING_TYPES.values(),
        *PLAIN_TYPES.values(),
        *PROJECTION_CENTRE_TYPES.values(),
        *OBSERVED_PARAMETERS.values(),
        *OBSERVED_DIFFERENCES.values(),
    )
}

__all__ = [
    "ALL_TYPES",
    "AT_INFINITY",
    "FOLLOWER_TYPES",
    "FREE_TURNS",
    "IMAGE_TYPES",
    "MOVING_TYPES",
    "OBSERVED_DIFFERENCES",
    "OBSERVED_PARAMETERS",
    "PERFECT_SET_UP",
    "PLAIN_TYPES",
    "PROJECTION_CENTRE_TYPES",
    "TURNED_AXIS",
    "Computed",
    "External",
    "ObservationGroup",
    "ObservationType",
    "Reference",
    "SetUp",
    "Slot",
    "at_infinity",
    "can_be_at_infinity",
    "is_image_point",
    "read_out_at_once",
    "some_rows",
    "target_slot",
    "to_projection_centres",
    "without",
    "wrap",
]
