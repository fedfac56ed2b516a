"""Observation types on the earth: those about the plumb line of their place, and those that need the ellipsoid.

Each is made for the :class:`mor.geometry.earth.Horizon` that is the object system of the network.
"""

from mor.observations.earth.attitude import projected_attitude
from mor.observations.earth.catalogue import EARTH_TYPES, NOT_ON_EARTH, earth_types
from mor.observations.earth.control import control
from mor.observations.earth.ends import DEFLECTIONS, GEOID
from mor.observations.earth.projected import projected_position

__all__ = [
    "DEFLECTIONS",
    "EARTH_TYPES",
    "GEOID",
    "NOT_ON_EARTH",
    "control",
    "earth_types",
    "projected_attitude",
    "projected_position",
]
