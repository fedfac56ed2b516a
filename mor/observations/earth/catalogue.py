"""The types there are on the earth, made for the object system of a network."""

from __future__ import annotations

from mor.geometry.earth import Horizon
from mor.observations._contract import ObservationType
from mor.observations.earth.arcs import (
    ellipsoid_arc,
    ellipsoid_chord,
    height_reduced_distance,
    mean_sea_level_distance,
)
from mor.observations.earth.attitude import navigation_attitude
from mor.observations.earth.geodetic_coordinates import (
    ellipsoidal_height,
    geodetic_position,
    orthometric_height,
)
from mor.observations.earth.gnss import gnss_position, gnss_vector
from mor.observations.earth.height_difference import ellipsoidal_height_difference, height_difference
from mor.observations.earth.plumb_line import about_normal, about_plumb_line
from mor.observations.earth.projected_bearing import KEY, open_projection
from mor.observations.level import LEVEL
from mor.observations.local import LOCAL
from mor.observations.terrestrial.angle import ANGLE_TYPE
from mor.observations.terrestrial.bearing import BEARING
from mor.observations.terrestrial.directions import DIRECTIONS, ZENITH_DIRECTIONS
from mor.observations.terrestrial.distance import DISTANCE, DISTANCE_RATIO, HORIZONTAL_DISTANCE
from mor.observations.terrestrial.spatial_angle import SPATIAL_ANGLE
from mor.observations.terrestrial.vertical import VERTICAL_DIRECTION, ZENITH_ANGLE

_ABOUT_PLUMB_LINE = (
    DISTANCE,
    HORIZONTAL_DISTANCE,
    DISTANCE_RATIO,
    DIRECTIONS,
    ZENITH_DIRECTIONS,
    VERTICAL_DIRECTION,
    ZENITH_ANGLE,
    ANGLE_TYPE,
    SPATIAL_ANGLE,
)
_AS_EVERYWHERE = (LOCAL, LEVEL)
_OF_THE_EARTH = (
    gnss_vector,
    gnss_position,
    geodetic_position,
    ellipsoidal_height,
    orthometric_height,
    height_difference,
    ellipsoidal_height_difference,
    ellipsoid_arc,
    ellipsoid_chord,
    mean_sea_level_distance,
    height_reduced_distance,
    navigation_attitude,
)
EARTH_TYPES = (
    "azimuth",
    "astronomic_azimuth",
    *(make.__name__ for make in _OF_THE_EARTH if make is not height_difference),
    "projected_position",
    "projected_attitude",
    KEY,
)
"""Types that only a project with ``world`` has."""
NOT_ON_EARTH = {
    "bearing": "azimuth (about the ellipsoidal normal) or astronomic_azimuth (about the plumb line)",
    "vector": "gnss_vector (in geocentric axes)",
    "coordinates": "gnss_position (in geocentric axes) or geodetic_position",
}
"""Plain types that leave open on the earth what they refer to, and those that say it."""


def earth_types(horizon: Horizon) -> dict[str, ObservationType]:
    """All types of a project with ``world``, by their keys."""
    types = [
        *(about_plumb_line(type_, horizon) for type_ in _ABOUT_PLUMB_LINE),
        *_AS_EVERYWHERE,
        _as("azimuth", about_normal(BEARING, horizon)),
        _as("astronomic_azimuth", about_plumb_line(BEARING, horizon)),
        *(make(horizon) for make in _OF_THE_EARTH),
        open_projection(),
    ]
    return {type_.key: type_ for type_ in types}


def _as(key: str, bearing: ObservationType) -> ObservationType:
    component = bearing.components[0]._replace(name="azimuth")
    return bearing._replace(key=key, components=(component,))
