"""Points at which snooping may have believed the wrong observations, intersected anew once nothing else is to be done.

Observations go out one after the other, the worst at that moment: of a point with two wrong rays good ones may go
first, and what is left agrees because it can hardly do otherwise. No test of what is out against the rest can tell
then. All observations of such points can: where most of them have it, others are out, and less is left to explain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.problem import Problem
from mor.arrays import BoolArray
from mor.observations import ObservationGroup
from mor.parameters.index import Values
from mor.quality.gross_errors.description_length import cost_of_residuals, sizes_of
from mor.quality.gross_errors.reintersection import SUSPECT, reintersected, slots_of_ends

BEYOND_CHANCE = 2.0 * float(np.log(1000.0))
"""What another place must cost less, that chance does not put it first at the level 0.001."""

Masks = tuple[BoolArray, ...]
"""(n, m) of each group."""


class Elsewhere(NamedTuple):
    """Values with some points at other places, and what is out there."""

    values: Values
    out: Masks


def other_places(problem: Problem, values: Values, out: Masks) -> Elsewhere | None:
    """Where points are whose observations all together put them elsewhere than the rest without ``out`` does.

    ``problem``: with nothing out that may come back. Nothing where nothing is out, or no point is elsewhere.
    """
    kept_out = tuple(group.left_out for group in problem.groups)
    if "point" not in problem.index.blocks or not any(
        (mask & ~kept).any() for mask, kept in zip(out, kept_out, strict=True)
    ):
        return None
    moved = reintersected(problem, values, sizes_of(problem.groups, values), gain=BEYOND_CHANCE)
    return out_elsewhere(problem, values, moved, out)


def out_elsewhere(problem: Problem, values: Values, moved: Values, out: Masks) -> Elsewhere | None:
    """What is out where points have moved: of these all that is suspect there, of the others what was out."""
    points: BoolArray = np.asarray((moved["point"] != values["point"]).any(axis=1))
    if not points.any():
        return None
    sizes = sizes_of(problem.groups, moved)
    masks = tuple(mask.copy() for mask in out)
    for group, size, mask in zip(problem.groups, sizes, masks, strict=True):
        rows = _of(group, points)
        suspect = (size > SUSPECT).any(axis=1, keepdims=True)
        mask[rows] = (group.left_out | (group.mask & suspect))[rows]
    return Elsewhere(moved, masks)


def cost_at(problem: Problem, values: Values) -> float:
    """What all observations cost at some values, those that are out at what it takes to say so."""
    return cost_of_residuals(sizes_of(problem.groups, values), problem.observations)


def _of(group: ObservationGroup, points: BoolArray) -> BoolArray:
    """(n,) rows that see one of some points (k,)."""
    seen = np.zeros(group.count, dtype=bool)
    for slot in slots_of_ends(group):
        seen |= points[group.blocks[slot]]
    return seen
