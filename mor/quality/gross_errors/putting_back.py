"""Suspects that fit the adjustment of the rest come back: then which they are does not hang on how they were found.

Graduated weights judge an observation by its residual at a place that is still on its way, and end a little elsewhere
from other start values. What is left out is tested against the rest instead, as data snooping does (its residual has
the variance σ² + aᵀQa), until nothing fits that is out. It fits unless so large a residual is none that chance brings
among all observations: of several that are merely unlikely, which one goes out would hang on the way again. Those come
back and are flagged, as in any adjustment.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mor.adjustment.problem import Problem
from mor.adjustment.solve import Settings, adjust
from mor.adjustment.state import Adjustment
from mor.arrays import BoolArray
from mor.quality.assess import Quality
from mor.quality.gross_errors.exclusion import exclude
from mor.quality.gross_errors.suspects import Suspects, with_suspects
from mor.quality.tests.levels import sidak
from mor.quality.tests.test_statistics import comparable, critical_value

_ROUNDS = 8
"""Adjustments in which suspects come back: of those that share a point only one at a time."""

Assessed = Callable[[Adjustment], Quality]


def put_back(
    quality: Quality, suspects: Suspects, assessed: Assessed, settings: Settings | None = None
) -> tuple[Quality, Suspects | None]:
    """Quality of the adjustment with those suspects in it again that fit, and the others; ``None`` where none is left.

    ``assessed``: how an adjustment is assessed. What was given up with a lost block stays out.
    """
    problem, masks = with_suspects(quality.adjustment.problem, suspects)
    kept_out = tuple(group.left_out for group in problem.groups)
    for _ in range(_ROUNDS):
        fitting = _fitting(quality, problem, masks)
        if not any(mask.any() for mask in fitting):
            break
        fewer = tuple(mask & ~fits for mask, fits in zip(masks, fitting, strict=True))
        out = tuple(a | b for a, b in zip(kept_out, fewer, strict=True))
        again = adjust(exclude(problem, out), quality.adjustment.values, settings)
        if not again.outcome.is_solution:
            break
        quality, masks = assessed(again), fewer
        suspects = replace(
            suspects,
            masks=tuple(mask & ~fits for mask, fits in zip(suspects.masks, fitting, strict=True)),
        )
    return quality, suspects if suspects.count else None


def _largest_by_chance(quality: Quality, observations: int) -> float:
    """|w| that the largest of so many observations exceeds by chance at the level of a single one."""
    if quality.levels.familywise is not None:
        return quality.critical
    return critical_value(sidak(quality.levels.snooping, observations))


def _fitting(quality: Quality, problem: Problem, masks: tuple[BoolArray, ...]) -> tuple[BoolArray, ...]:
    """Suspects that come back: rows of which every entry fits the rest, the best one of each point."""
    candidates, largest = [], _largest_by_chance(quality, problem.observations)
    for number, mask in enumerate(masks):
        test = np.where(mask, comparable(np.abs(quality.reliability[number].test)), 0.0)
        fits = mask.any(axis=1) & (test < largest).all(axis=1)
        rows = np.flatnonzero(fits)
        candidates += [(float(test[row].max()), number, row) for row in rows.tolist()]
    chosen = tuple(np.zeros_like(mask) for mask in masks)
    taken: set[int] = set()
    for _, number, row in sorted(candidates):
        group = problem.groups[number]
        points = {
            int(blocks[row])
            for slot, blocks in zip(group.type.slots, group.blocks, strict=True)
            if slot.kind == "point" and (problem.index.columns["point"][blocks[row]] >= 0).any()
        }
        if taken.isdisjoint(points):
            taken |= points
            chosen[number][row] = masks[number][row]
    return chosen
