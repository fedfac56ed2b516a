"""Free networks on the earth: what plumb lines cannot leave free.

Verticals turn with the places they are at, by 1/R for every metre, and the Jacobian has them as they stand. Shifts of
a network whose instruments are levelled are invariances of it all the same. Its turn about the vertical is none, for
the verticals of the other places stay behind; nor are shifts where heights are levelled, too, which are along other
verticals at the other end. Such a network would be iterated for a movement that the observations do not tell.
"""

from __future__ import annotations

from collections.abc import Iterable

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
_LIES = (
    "datum: verticals on the earth differ from place to place, and with them instruments and heights say where the "
    "network lies; fix or observe a point"
)
_TURNS = (
    "datum: verticals on the earth differ from place to place, and a free network of levelled instruments cannot turn "
    "about all of them; fix or observe two points, or one point and an azimuth"
)


def check_free_on_earth(reading: Reading, groups: Iterable[ObservationGroup]) -> None:
    """Tell a free datum that plumb lines do not allow; ``groups`` are those of the project, control among them."""
    kinds = {group.type.key for group in groups}
    if reading.world is None or not kinds & _LEVELLED or kinds & _PLACED or _holds_a_place(reading):
        return
    if kinds & _HEIGHTS:
        reading.problems.append(reading.at("datum").problem(_LIES))
    elif not kinds & _TURNED:
        reading.problems.append(reading.at("datum").problem(_TURNS))


def _holds_a_place(reading: Reading) -> bool:
    """Whether a point, or the place of a frame, is fixed."""
    free = reading.shop.store("point").all_free()
    places = [
        things.parts["position"] for things in reading.shop.things.values() if "position" in things.parts
    ]
    return any(bool((~free[blocks]).any()) for blocks in places)
