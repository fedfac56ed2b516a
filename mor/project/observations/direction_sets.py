"""Sets of directions: what a set with an orientation of its own needs to say anything."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.errors import Problem
from mor.observations import ObservationGroup
from mor.project.network.reading import Reading

_DIRECTIONS = ("directions", "zenith_directions")
_KNOWLEDGE = ("observed/rotation", "difference/rotation")


def check_direction_sets(reading: Reading, groups: Sequence[ObservationGroup]) -> None:
    """Report sets whose orientation is unknown and that have no horizontal target; note those that have a single one.

    Sets are counted by their rotation, over all observation groups. A single direction only determines its own
    orientation: its redundancy number is 0, and nothing else depends on it.
    """
    free = reading.shop.store("rotation").all_free()[:, 2].copy()
    for group in groups:
        if group.type.key in _KNOWLEDGE:
            for blocks in group.blocks:
                free[blocks] = False
    of_directions = [group for group in groups if group.type.key in _DIRECTIONS]
    if not of_directions or not free.any():
        return
    rotation = np.concatenate([group.blocks[1] for group in of_directions])
    target = np.concatenate([group.blocks[3] for group in of_directions])
    horizontal = np.concatenate([np.isfinite(group.observed[:, 0]) for group in of_directions])
    different = np.unique(np.stack([rotation[horizontal], target[horizontal]]), axis=1)
    count = np.bincount(different[0], minlength=len(free))
    numbers, first = np.unique(rotation, return_index=True)
    poor = free[numbers] & (count[numbers] < 2)
    starts = np.cumsum([0, *(group.count for group in of_directions)])
    for place, number in sorted(zip(first[poor].tolist(), numbers[poor].tolist(), strict=True)):
        g = int(np.searchsorted(starts, place, side="right")) - 1
        group, row = of_directions[g], place - int(starts[g])
        name, place = group.references[0][row], (group.file, int(group.lines[row]))
        if count[number]:
            reading.notes.append(Problem(_ONE_TARGET.format(repr(name)), *place))
        else:
            reading.problems.append(Problem(_NO_TARGET.format(repr(name)), *place))


_NO_TARGET = (
    "station {} has no horizontal direction that would orient its circle; zenith angles alone are of type "
    "zenith_angle, vertical directions alone of type vertical_direction"
)
_ONE_TARGET = (
    "the set of directions at {} has a single horizontal target: it only finds its own orientation and says nothing "
    "about the points"
)
