"""Verticals at the ends of an observation on the earth, and marks lifted to instrument and target."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from mor.observations._contract import ObservationType
from mor.units import ANGLE, LENGTH, Component

DEFLECTIONS = ("deflection_north", "deflection_east")
"""ξ and η of the plumb line, north and east positive: the astronomic zenith lies there from the geodetic one."""
GEOID = "geoid"
"""Height N of the geoid above the ellipsoid."""
_QUANTITIES = {**dict.fromkeys(DEFLECTIONS, ANGLE), GEOID: LENGTH}


def end_constants(ends: Sequence[str], names: Sequence[str]) -> tuple[Component, ...]:
    """Constants of a type that belong to the points at its ends: ``geoid of from``."""
    return tuple(Component(f"{name} of {end}", _QUANTITIES[name]) for end in ends for name in names)


class End(NamedTuple):
    """Slots of one end of an observation."""

    name: str
    position: int
    height: int
    """−1 where the type knows no height of instrument or target there."""


def ends_of(type_: ObservationType) -> tuple[End, ...]:
    """The ends of a type in the order of their positions: the first is where the instrument stands."""
    slots = {(slot.of, slot.part): k for k, slot in enumerate(type_.slots)}
    names = [slot.of for slot in type_.slots if slot.part == "position"]
    return tuple(
        End(name, slots[name, "position"], slots.get((name, "height"), -1)) for name in dict.fromkeys(names)
    )
