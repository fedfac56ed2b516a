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
Masks = tuple[BoolArray, ...]
"""(n, m) of each group."""


def put_back(
    quality: Quality, suspects: Suspects, assessed: Assessed, settings: Settings | None = None
) -> tuple[Quality, Suspects | None]:
    """Quality of the adjustment with those suspects in it again that fit, and the others; ``None`` where none is left.

    ``assessed``: how an adjustment is assessed. What was given up with a lost block stays out.
    """
    problem, masks = with_suspects(quality.adjustment.problem, suspects)
    kept_out = tuple(group.left_out for group in problem.groups)
    refused = tuple(np.zeros_like(mask) for mask in masks)
    largest = _largest_by_chance(quality, problem.observations)

    def returned(rows: Masks) -> Quality | None:
        out = tuple(a | (b & ~c) for a, b, c in zip(kept_out, masks, rows, strict=True))
        again = adjust(exclude(problem, out), quality.adjustment.values, settings)
        return assessed(again) if again.outcome.is_solution else None

    for _ in range(_ROUNDS):
        fitting = _fitting(quality, problem, _but(masks, refused), largest)
        found = returned(fitting) if any(mask.any() for mask in fitting) else None
        if found is None:
            break
        misfits = _misfits(found, fitting, largest)
        if any(mask.any() for mask in misfits):
            refused = tuple(a | b for a, b in zip(refused, misfits, strict=True))
            fitting = _but(fitting, misfits)
            found = returned(fitting) if any(mask.any() for mask in fitting) else quality
        if found is None:
            break
        quality, masks = found, _but(masks, fitting)
        suspects = replace(suspects, masks=_but(suspects.masks, fitting))
    return quality, suspects if suspects.count else None


def _but(masks: Masks, others: Masks) -> Masks:
    return tuple(mask & ~other for mask, other in zip(masks, others, strict=True))


def _misfits(quality: Quality, rows: Masks, largest: float) -> Masks:
    """Rows that are back and do not fit all the same: of a pair of coordinates that was out together each fits less."""
    found = []
    for one, mask in zip(quality.reliability, rows, strict=True):
        test = np.where(mask, np.abs(np.nan_to_num(one.test)), 0.0)
        found.append(mask & (test >= largest).any(axis=1, keepdims=True))
    return tuple(found)


def _largest_by_chance(quality: Quality, observations: int) -> float:
    """|w| that the largest of so many observations exceeds by chance at the level of a single one."""
    if quality.levels.familywise is not None:
        return quality.critical
    return critical_value(sidak(quality.levels.snooping, observations))


def _fitting(quality: Quality, problem: Problem, masks: Masks, largest: float) -> Masks:
    """Suspects that may fit: rows of which every entry is near enough to the rest, the best one of each point."""
    candidates = []
    for number, mask in enumerate(masks):
        test = np.where(mask, comparable(np.abs(quality.reliability[number].test)), 0.0)
        several = np.count_nonzero(mask, axis=1, keepdims=True) > 1
        fits = mask.any(axis=1) & (test < np.where(several, np.sqrt(2.0), 1.0) * largest).all(axis=1)
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
