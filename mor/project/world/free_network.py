"""Networks on the earth that plumb lines leave neither free nor determined: these have no solution, and are told.

Levelled instruments tell nothing of a turn of their network about its vertical, nor of a movement along the earth that
turns it with its plumb lines: on a sphere nothing at all, on the ellipsoid what its curvature changes from place to
place. But verticals are constants of a step, and in such a step the plumb lines of the other places, by d/R beside the
one in the middle, hold the network against the turn, and with levelled heights its shifts, too. What seems determined
there is no information; the iteration follows it, and never comes to an end. An inner constraint in its place would
have to be a condition of its own, beside the defect.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.observations import ObservationGroup
from mor.project.network.reading import Reading

_LEVELLED = {
    "directions",
    "zenith_directions",
    "zenith_angle",
    "vertical_direction",
    "angle",
    "horizontal_distance",
}
_HEIGHTS = {"height_difference", "ellipsoidal_height_difference", "ellipsoidal_height", "orthometric_height"}
_TURNED = {
    "gnss_vector",
    "azimuth",
    "astronomic_azimuth",
    "projected_bearing",
    "projected_attitude",
    "navigation_attitude",
}
_PLACED = {"control", "gnss_position", "geodetic_position", "projected_position"}
_ORIENTED = "observed/rotation"
_FRAMES = ("station", "image", "system")
_KAPPA = 2
_LIES = (
    "datum: on the earth levelled instruments and heights leave neither free nor determined where the network lies, "
    "for verticals differ from place to place; fix or observe a point"
)
_TURNS = (
    "datum: on the earth levelled instruments leave the turn about the vertical neither free nor determined, for "
    "verticals differ from place to place; fix or observe two points, or one point and an azimuth"
)
_TURNS_ABOUT = (
    "datum: on the earth levelled instruments leave the turn about the only point that is held neither free nor "
    "determined, for verticals differ from place to place; fix or observe a second point, or an azimuth"
)


def check_held_on_earth(reading: Reading, groups: Sequence[ObservationGroup], free: bool) -> None:
    """Tell a datum that plumb lines leave open; ``groups`` are those of the project, control among them.

    ``free``: of a network that is not, and in which nothing is held, the defect is told later.
    """
    kinds = {group.type.key for group in groups}
    if reading.world is None or not kinds & _LEVELLED:
        return
    held = _places_held(reading, groups)
    if not _turn_is_held(reading, groups) and (held == 1 or (held == 0 and free)):
        reading.problems.append(reading.at("datum").problem(_TURNS_ABOUT if held else _TURNS))
    elif held == 0 and free and kinds & _HEIGHTS:
        reading.problems.append(reading.at("datum").problem(_LIES))


def _places_held(reading: Reading, groups: Sequence[ObservationGroup]) -> int:
    """Number of points and frame positions that are fixed or observed."""
    free = reading.shop.store("point").all_free()
    held = np.zeros(len(free), dtype=bool)
    for things in reading.shop.things.values():
        if "position" in things.parts:
            blocks = things.parts["position"]
            held[blocks[(~free[blocks]).any(axis=1)]] = True
    for group in groups:
        if group.type.key in _PLACED:
            held[group.blocks[0]] = True
    return int(np.count_nonzero(held))


def _turn_is_held(reading: Reading, groups: Sequence[ObservationGroup]) -> bool:
    """True if anything fixes or observes the orientation of the network."""
    if any(group.type.key in _TURNED for group in groups):
        return True
    if any(group.type.key == _ORIENTED and group.mask[:, _KAPPA].any() for group in groups):
        return True
    free = reading.shop.store("rotation").all_free()
    rotations = [
        reading.shop.things[space].parts["rotation"] for space in _FRAMES if space in reading.shop.things
    ]
    return any(bool((~free[blocks[blocks >= 0], _KAPPA]).any()) for blocks in rotations)
