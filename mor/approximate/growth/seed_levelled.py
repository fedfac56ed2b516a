"""Begin a levelled part where nothing is known: one station at the origin, its circle zero along +Y."""

from __future__ import annotations

import numpy as np

from mor.approximate.growth.grow_levelled import Distances
from mor.approximate.growth.part import Part, empty_part
from mor.approximate.terrestrial.sights import Terrestrial


def seed_levelled(measured: Terrestrial, unknown: set[int], points: int, tried: set[int]) -> Part | None:
    """A levelled part around the unoriented set that sees most; ``tried`` remembers where a part was begun already.

    With distances the part has its scale. Without, the distance to the farthest-seen other station is taken as one.
    """
    best = None
    for number, sight in enumerate(measured.sights):
        if sight.oriented or number in tried or sight.position not in unknown:
            continue
        count = int(np.isfinite(sight.directions).sum())
        if count >= 2 and (best is None or count > best[0]):
            best = (count, number)
    if best is None:
        return None
    tried.add(best[1])
    sight = measured.sights[best[1]]
    part = empty_part(points)
    part.levelled = True
    part.points[sight.position] = 0.0
    part.kappas[best[1]] = 0.0
    part.how[f"point {sight.position}"] = f"origin of a local system at {sight.name}"
    distances = Distances(part, measured)
    part.scaled = bool(distances.horizontal or distances.slope)
    if not part.scaled:
        _unit_base(part, measured, best[1])
    return part


def _unit_base(part: Part, measured: Terrestrial, number: int) -> None:
    """Directions alone: the first sighted point that is itself a station comes at the distance one."""
    sight = measured.sights[number]
    stations = {other.position for other in measured.sights}
    for point, direction in zip(sight.points, sight.directions, strict=True):
        if int(point) in stations and np.isfinite(direction):
            part.points[point, :2] = [np.sin(direction), np.cos(direction)]
            part.how[f"point {int(point)}"] = "base of length one"
            return
