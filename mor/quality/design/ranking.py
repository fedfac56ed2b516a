"""Which planned observations can be spared, which candidates bring most, and a plan made of the best, one by one.

Every figure is that of the plan with this one change, adjusted anew, to round-off (``interest.py``).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from mor.arrays import IntArray
from mor.geometry import tolerant
from mor.quality.design.interest import Interest, Unit
from mor.quality.design.shortfall import REACHED, Outcome, Wanted, outcomes, present

_CELLS = 20_000_000
"""Numbers that are worked on together."""
_GONE_OVER = 30
"""Choices up to which a greedy plan is gone over once more."""
_GAINS = 1e-12
"""Part of the mean variance that a candidate has to take away to be worth a measurement."""


class Ranked(NamedTuple):
    """A unit and what the plan would be with it, or without it."""

    unit: Unit
    shortfall: float
    precision: float
    largest_ratio: float
    smallest_r: float
    possible: bool


class Step(NamedTuple):
    """One choice of a greedy plan, and what the plan is after it."""

    ranked: Ranked
    measurements: int
    """All that were added so far."""


def ranked(interest: Interest, wanted: Wanted, candidates: bool) -> list[Ranked]:
    """All candidates, the most useful first; or all planned units, the most easily spared first."""
    units = [unit for unit in interest.units if unit.is_candidate == candidates]
    found = list(_scored(interest, wanted, units, 1.0 if candidates else -1.0))
    return by_worth(found, present(interest, wanted), candidates)


def by_worth(found: Sequence[Ranked], present: Outcome, candidates: bool) -> list[Ranked]:
    """Changes of a plan, the most useful candidates first, or what is most easily spared."""
    now = _one(present, 0)

    def worth(one: Ranked) -> tuple[float, ...]:
        cost = one.unit.cost
        gain = now.shortfall - one.shortfall, now.precision - one.precision
        if candidates:
            return (0.0 if one.possible else 1.0, -_rounded(gain[0] / cost), -_rounded(gain[1] / cost))
        return (0.0 if one.possible else 1.0, _rounded(-gain[0] / cost), _rounded(-gain[1] / cost))

    return sorted(found, key=worth)


def of_units(units: Sequence[Unit], found: Outcome) -> list[Ranked]:
    """Units with what the plan would be with each."""
    columns = (found.shortfall, found.precision, found.largest_ratio, found.smallest_r, found.possible)
    return list(map(Ranked, units, *(column.tolist() for column in columns)))


def _rounded(value: float) -> float:
    """A value with the digits in which machines agree, to sort by."""
    return float(f"{value:.9g}")


def greedy(interest: Interest, wanted: Wanted, most: int) -> list[Step]:
    """Candidates one after the other, each the one that takes away most of the shortfall for a measurement.

    It ends where nothing falls short, where no candidate is left that helps, or after ``most`` of them. A plan that
    reaches what is required is gone over once more: what later choices have made superfluous is taken out again, and
    any two for which one will do.
    """
    left = [unit for unit in interest.units if unit.is_candidate]
    steps = list(_one_by_one(interest, wanted, left, most))
    if wanted.is_empty or not steps or steps[-1].ranked.shortfall > REACHED or len(steps) > _GONE_OVER:
        return steps
    chosen = _fewer(interest, wanted, [step.ranked.unit for step in steps], left)
    return list(_one_by_one(interest, wanted, chosen, most)) if len(chosen) < len(steps) else steps


def _one_by_one(interest: Interest, wanted: Wanted, units: Sequence[Unit], most: int) -> Iterator[Step]:
    left = list(units)
    now = _one(present(interest, wanted), 0)
    total = 0
    for _ in range(most):
        if not left or (now.shortfall <= REACHED and not wanted.is_empty):
            return
        best = _best(now, [one for one in _scored(interest, wanted, left, 1.0) if one.possible])
        if best is None:
            return
        interest = added(interest, best.unit)
        left = [unit for unit in left if unit is not best.unit]
        total += best.unit.cost
        now = best
        yield Step(best, total)


def _fewer(
    interest: Interest, wanted: Wanted, chosen: Sequence[Unit], candidates: Sequence[Unit]
) -> list[Unit]:
    """A choice that reaches what is required as well, with fewer measurements where one is found near by."""
    whole = interest
    for unit in chosen:
        whole = added(whole, unit)
    kept, again = list(chosen), True
    while again:
        again = False
        for out in (*((unit,) for unit in kept), *combinations(kept, 2)):
            without = whole
            for unit in out:
                without = spared(without, unit)
            rest = [unit for unit in kept if all(unit is not one for one in out)]
            if len(out) == 1:
                again = present(without, wanted).shortfall[0] <= REACHED
                new: list[Unit] = []
            else:
                new = _one_that_will_do(without, wanted, rest, out, candidates)
                again = bool(new)
            if again:
                kept = [*rest, *new]
                whole = without
                for unit in new:
                    whole = added(whole, unit)
                break
    return kept


def _one_that_will_do(
    interest: Interest,
    wanted: Wanted,
    rest: Sequence[Unit],
    out: Sequence[Unit],
    candidates: Sequence[Unit],
) -> list[Unit]:
    """The candidate that takes the place of others with fewer measurements; nothing where there is none."""
    cost = sum(unit.cost for unit in out)
    taken = {id(unit) for unit in (*rest, *out)}
    others = [unit for unit in candidates if id(unit) not in taken and unit.cost < cost]
    found = [
        one for one in _scored(interest, wanted, others, 1.0) if one.possible and one.shortfall <= REACHED
    ]
    return [min(found, key=lambda one: (one.unit.cost, _rounded(one.precision))).unit] if found else []


def _best(now: Ranked, found: Sequence[Ranked]) -> Ranked | None:
    """What takes away most of the shortfall for a measurement; where none does, most of the variance."""
    if not found:
        return None
    gain = [(now.shortfall - one.shortfall) / one.unit.cost for one in found]
    if max(gain) > REACHED:
        return found[int(np.argmax([_rounded(value) for value in gain]))]
    gain = [(now.precision - one.precision) / one.unit.cost for one in found]
    best = found[int(np.argmax([_rounded(value) for value in gain]))]
    return best if max(gain) > _GAINS * now.precision else None


def added(interest: Interest, unit: Unit) -> Interest:
    """The cofactors with a candidate taking part."""
    K = interest.cofactors
    column = K[:, unit.rows]
    R = np.eye(unit.cost) + K[np.ix_(unit.rows, unit.rows)]
    half = tolerant.solve(tolerant.cholesky(R), column.T)
    active = interest.active.copy()
    active[unit.rows] = True
    return interest._replace(cofactors=K - half.T @ half, active=active)


def spared(interest: Interest, unit: Unit) -> Interest:
    """The cofactors without observations that take part."""
    K = interest.cofactors
    R = np.eye(unit.cost) - K[np.ix_(unit.rows, unit.rows)]
    half = tolerant.solve(tolerant.cholesky(R), K[:, unit.rows].T)
    active = interest.active.copy()
    active[unit.rows] = False
    return interest._replace(cofactors=K + half.T @ half, active=active)


def _scored(interest: Interest, wanted: Wanted, units: Sequence[Unit], sign: float) -> Iterator[Ranked]:
    """Each unit with what the plan would be, in the order of the units."""
    scores: dict[int, Ranked] = {}
    sizes = np.array([unit.cost for unit in units])
    for size in np.unique(sizes).tolist():
        here = np.flatnonzero(sizes == size)
        at_a_time = max(1, _CELLS // (len(interest.cofactors) * size))
        for first in range(0, len(here), at_a_time):
            some = here[first : first + at_a_time].tolist()
            chosen = [units[k] for k in some]
            scores |= zip(some, of_units(chosen, outcomes(interest, wanted, chosen, sign)), strict=True)
    return (scores[k] for k in range(len(units)))


def _one(found: Outcome, number: int) -> Ranked:
    unit = Unit(-1, -1, np.zeros(0, dtype=np.int64), True)
    return Ranked(
        unit,
        float(found.shortfall[number]),
        float(found.precision[number]),
        float(found.largest_ratio[number]),
        float(found.smallest_r[number]),
        bool(found.possible[number]),
    )


def points_looked_at(blocks: Sequence[IntArray], every: IntArray) -> IntArray:
    """The point blocks with a required σ, or ``every`` one where there are none."""
    found = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *blocks]))
    return found if len(found) else every
