"""The list of observation types."""

from __future__ import annotations

from mor.model.coordinates import (
    COORDINATES,
    LEVEL,
    LOCAL,
    OBSERVED_DIFFERENCES,
    OBSERVED_PARAMETERS,
    takes_positions,
    to_projection_centres,
)
from mor.model.images import FOLLOWER_TYPES, IMAGE_TYPES, MOVING_TYPES
from mor.model.shapes import PERPENDICULAR_TYPES, RELATION_TYPES, SHAPE_TYPES
from mor.model.terrestrial import (
    ANGLE_TYPE,
    BEARING,
    DIRECTIONS,
    DISTANCE,
    DISTANCE_RATIO,
    HEIGHT_DIFFERENCE,
    HORIZONTAL_DISTANCE,
    SPATIAL_ANGLE,
    VECTOR,
    VERTICAL_DIRECTION,
    ZENITH_ANGLE,
    ZENITH_DIRECTIONS,
)

# ---- Observation types: one file each, every one a value of :class:`ObservationType`.

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
        *RELATION_TYPES.values(),
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
        *SHAPE_TYPES.values(),
        *PERPENDICULAR_TYPES.values(),
        *OBSERVED_PARAMETERS.values(),
        *OBSERVED_DIFFERENCES.values(),
    )
}
