"""Sets of directions: what a set with an orientation of its own needs to say anything."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.errors import Problem
from mor.observations import ObservationGroup
from mor.project.reading import Reading

_DIRECTIONS = ("directions", "zenith_directions")
_KNOWLEDGE = ("observed/rotation", "difference/rotation")


def check_direction_sets(reading: Reading, groups: Sequence[ObservationGroup]) -> None:
    """Report sets whose orientation is unknown and that have fewer than two horizontal targets.

    Sets are counted by their rotation, over all observation groups. A single direction only determines its own
    orientation: it looks like an observation and is none.
    """
    free = reading.shop.store("rotation").all_free()
    known = {int(n) for g in groups if g.type.key in _KNOWLEDGE for blocks in g.blocks for n in blocks}
    targets: dict[int, set[int]] = {}
    places: dict[int, Problem] = {}
    for group in groups:
        if group.type.key not in _DIRECTIONS:
            continue
        for i, (rotation, target) in enumerate(zip(group.blocks[1], group.blocks[3], strict=True)):
            number = int(rotation)
            places.setdefault(number, Problem(group.references[0][i], group.file, int(group.lines[i])))
            seen = targets.setdefault(number, set())
            if np.isfinite(group.observed[i, 0]):
                seen.add(int(target))
    for number, seen in targets.items():
        if free[number, 2] and number not in known and len(seen) < 2:
            at = places[number]
            reading.problems.append(Problem(_words(at.message, len(seen)), at.file, at.line))


def _words(name: str, count: int) -> str:
    if count == 0:
        return (
            f"station {name!r} has no horizontal direction that would orient its circle; zenith angles alone are "
            "of type zenith_angle, vertical directions alone of type vertical_direction"
        )
    return (
        f"the set of directions at {name!r} has a single horizontal target, expected two or more: one direction "
        "only finds its own orientation (fix or observe the orientation, or give a bearing)"
    )
