"""Begin a levelled part where nothing is known: one station at the origin, its circle zero along +Y.

Bearings bring north with them; alone they have no set that sees much, and begin with the two points of one of them.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from mor.approximate.parts.part import Part, empty_part
from mor.approximate.parts.rule import rule
from mor.approximate.terrestrial.sights import Sight, Terrestrial


def seed_levelled(
    measured: Terrestrial, unknown: set[int], points: int, tried: set[int], with_distances: bool
) -> Part | None:
    """A levelled part around the set that sees most; ``tried`` remembers where a part was begun already.

    A station ``with_distances`` of its own has its scale. Of one without, the distance to another station that it
    sights is taken as one. Sets that have to find their orientation come before bearings.
    """
    reach, meeting = _measured_from(measured), _bearings_at(measured)
    best = None
    for number, sight in enumerate(measured.sights):
        if number in tried or sight.position not in unknown:
            continue
        if sight.oriented:
            count = _promise_of_bearing(sight, reach, meeting, with_distances)
        else:
            count = _promise(measured, sight, reach, with_distances)
        rank = (not sight.oriented, count)
        if count and (best is None or rank > best[0]):
            best = (rank, number)
    if best is None:
        return None
    tried.add(best[1])
    sight = measured.sights[best[1]]
    part = empty_part(points)
    part.levelled, part.oriented = True, sight.oriented
    part.points[sight.position] = 0.0
    part.kappas[best[1]] = 0.0
    part.began = rule("origin of a local system at {one}", one=sight.name)
    part.how[f"point {sight.position}"] = part.began
    part.scaled = with_distances
    if not with_distances:
        _unit_base(part, *_base(measured, sight))
    return part


def _bearings_at(measured: Terrestrial) -> Counter[int]:
    """Point → the bearings from and to it."""
    meeting: Counter[int] = Counter()
    for sight in measured.sights:
        if sight.oriented:
            meeting.update([sight.position, *sight.points.tolist()])
    return meeting


def _promise_of_bearing(
    sight: Sight, reach: dict[int, set[int]], meeting: Counter[int], with_distances: bool
) -> int:
    """Bearings that meet at the end with fewer of them; one that nothing else meets does not make a network."""
    ends = [sight.position, int(sight.points[0])]
    if with_distances and ends[1] not in reach.get(ends[0], set()):
        return 0
    count = min(meeting[end] for end in ends)
    return count if with_distances or count > 1 else 0


def _measured_from(measured: Terrestrial) -> dict[int, set[int]]:
    """Position → the points with a distance from or to it."""
    reach: dict[int, set[int]] = {}
    for lengths in (measured.slopes, measured.horizontals):
        for a, b in zip(lengths.start.tolist(), lengths.end.tolist(), strict=True):
            reach.setdefault(a, set()).add(b)
            reach.setdefault(b, set()).add(a)
    return reach


def _promise(measured: Terrestrial, sight: Sight, reach: dict[int, set[int]], with_distances: bool) -> int:
    """Sighted points, where the set can begin a part: with distances two of them, without another station."""
    sighted = sight.points[np.isfinite(sight.directions)]
    if len(sighted) < 2:
        return 0
    if with_distances:
        both = len(reach.get(sight.position, set()).intersection(sighted.tolist()))
        return both if both > 0 else 0
    return len(sighted) if _other_station(measured, sight) is not None else 0


def _other_station(measured: Terrestrial, sight: Sight) -> tuple[int, float] | None:
    """The first sighted point that is itself a station, and its direction."""
    stations = {other.position for other in measured.sights}
    for point, direction in zip(sight.points.tolist(), sight.directions, strict=True):
        if point in stations and np.isfinite(direction) and point != sight.position:
            return point, float(direction)
    return None


def _base(measured: Terrestrial, sight: Sight) -> tuple[int, float]:
    """The point at the other end of the base, and the direction to it."""
    if sight.oriented:
        return int(sight.points[0]), float(sight.directions[0])
    other = _other_station(measured, sight)
    assert other is not None
    return other


def _unit_base(part: Part, point: int, direction: float) -> None:
    """Directions alone: another station comes at the distance one."""
    part.points[point, :2] = [np.sin(direction), np.cos(direction)]
    part.how[f"point {point}"] = rule("base of length one")
