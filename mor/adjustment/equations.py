"""The equations of a problem, evaluated.

An iteration asks for the same derivatives two or three times: for the normal equations, for the steps of the points,
for the size of round-off. In a small project, in plain numpy, a call costs about as much as a hundred rows, so there
all rows of a type are evaluated together, whichever group they are of, and what was found at the last places is kept.
In a large one it would take too much room, and chunks have many rows each.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from mor import compilation
from mor.arrays import AnyIntArray, FloatArray, IntArray
from mor.observations import Computed, ObservationGroup, ObservationType
from mor.parameters.index import Values

_KEPT = 2
"""Places whose equations are kept: where the iteration is, and where it tries to go."""


class _Together(NamedTuple):
    """All n rows of one type that observe anything."""

    type: ObservationType
    blocks: tuple[AnyIntArray, ...]
    constants: FloatArray
    place: dict[int, IntArray]
    """By number of the group: place of each of its rows among them, −1 of those that observe nothing."""
    known: deque[tuple[tuple[FloatArray, ...], Computed]]
    """What was found at the last places, and the values of all blocks there."""

    def at(self, values: Values) -> Computed:
        """The rows at some values, which nobody changes in place."""
        arrays = tuple(values[slot.kind] for slot in self.type.slots)
        for before, found in self.known:
            if all(one is other for one, other in zip(before, arrays, strict=True)):
                return found
        blocks = [array[number] for array, number in zip(arrays, self.blocks, strict=True)]
        found = self.type.equation(blocks, self.constants)
        self.known.append((arrays, found))
        return found


class Equations:
    """The equations of some groups."""

    def __init__(self, groups: tuple[ObservationGroup, ...]) -> None:
        self._groups = groups
        self._together: dict[int, _Together] = {}
        """By number of the group, those of the types that were asked for."""

    def computed(self, number: int, values: Values, rows: AnyIntArray) -> Computed:
        """Rows of a group at some values."""
        found, place = self._found(number, values, rows)
        return Computed(found.values[place], tuple(jacobian[place] for jacobian in found.jacobians))

    def computed_values(self, number: int, values: Values, rows: AnyIntArray) -> FloatArray:
        """What they compute (n, m), without derivatives."""
        found, place = self._found(number, values, rows)
        return found.values[place]

    def _found(self, number: int, values: Values, rows: AnyIntArray) -> tuple[Computed, AnyIntArray | slice]:
        """What was found, and where the rows are in it."""
        if not compilation.is_small():
            return evaluated(self._groups[number], values, rows), slice(None)
        if number not in self._together:
            self._put_together(self._groups[number].type)
        together = self._together[number]
        place = together.place[number][rows]
        if (place < 0).any():  # some observe nothing
            return evaluated(self._groups[number], values, rows), slice(None)
        return together.at(values), place

    def _put_together(self, type_: ObservationType) -> None:
        alike = {number: group for number, group in enumerate(self._groups) if group.type is type_}
        rows = {number: np.flatnonzero(group.mask.any(axis=1)) for number, group in alike.items()}
        place, first = {}, 0
        for number, own in rows.items():
            place[number] = np.full(alike[number].count, -1, dtype=np.int64)
            place[number][own] = first + np.arange(len(own))
            first += len(own)
        blocks = tuple(
            np.concatenate([group.blocks[slot][rows[number]] for number, group in alike.items()])
            for slot in range(len(type_.slots))
        )
        constants = np.concatenate([group.constants[rows[number]] for number, group in alike.items()])
        together = _Together(type_, blocks, constants, place, deque(maxlen=_KEPT))
        self._together |= dict.fromkeys(alike, together)


def evaluated(group: ObservationGroup, values: Values, rows: AnyIntArray | slice) -> Computed:
    """The equation of a group for the chosen rows."""
    blocks = [
        values[slot.kind][number[rows]] for slot, number in zip(group.type.slots, group.blocks, strict=True)
    ]
    return group.type.equation(blocks, group.constants[rows])
