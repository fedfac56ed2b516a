"""Points of which some sights do not fit, intersected anew from each two of their sights: where most of them have it.

An iteration that began with a wrong sight may have left the point where that one and another agree. Of all places that
two sights meet at, the one at which all sights of the point cost least (``description_length.py``) is taken.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from mor.adjustment.problem import Problem
from mor.arrays import FloatArray, IntArray
from mor.observations import ObservationGroup, wrap
from mor.parameters.index import Values
from mor.quality.gross_errors.description_length import cost_of_residuals

SUSPECT = 4.5
"""|v|/σ beyond which an observation is looked at: nothing is decided by it."""
_POINTS = 20
"""Points that are looked at, the worst first."""
_SIGHTS = 8
"""Sights of a point that are put together in pairs."""
_LEAST = 3
"""Sights that are needed: two always meet."""
_ITERATIONS = 8
_RANK = 4.0 * float(np.finfo(np.float64).eps)
"""Part of the largest singular value of two sights below which they tell nothing of a direction."""


class _Sights(NamedTuple):
    """Sights of one group to a point."""

    group: ObservationGroup
    rows: IntArray
    slot: int
    """Of the point."""


def reintersected(problem: Problem, values: Values, sizes: tuple[FloatArray, ...]) -> dict[str, FloatArray]:
    """Values with points moved of whose sights, |v|/σ (n, m) of each group in ``sizes``, some are suspect."""
    points = values["point"].copy()
    columns = problem.index.columns["point"]
    middle = np.nanmedian(points, axis=0)
    for point in _suspected(problem, sizes):
        sights = _sights_to(problem, point)
        if (columns[point] >= 0).any() and sum(len(one.rows) for one in sights) >= _LEAST:
            found = _best(
                sights, values, [points[point], middle], problem.observations, places=[points[point]]
            )
            points[point] = np.where(columns[point] >= 0, found, points[point])
    return {**values, "point": points}


def by_sights_alone(problem: Problem, values: Values, points: IntArray) -> FloatArray:
    """(k, 3) places of points by their sights alone, whatever their coordinates say; NaN without two sights."""
    places = np.full((len(points), 3), np.nan)
    middle = np.nanmedian(values["point"], axis=0)
    for k, point in enumerate(points.tolist()):
        sights = _sights_to(problem, point)
        if sum(len(one.rows) for one in sights) >= 2:
            pair = [values["point"][point], middle]
            places[k] = _best(sights, values, pair, problem.observations, places=[])
    return places


def costs_at_places(problem: Problem, values: Values, point: int, places: FloatArray) -> FloatArray:
    """(k,) what the sights of a point cost if it were at other places (k, 3); 0 where nothing sights it."""
    sights = _sights_to(problem, point)
    if not sights:
        return np.zeros(len(places))
    count = problem.observations
    return _costs(sights, values, places, count)


def _slot_of_target(group: ObservationGroup) -> int | None:
    """The slot of the point that is sighted, of observations with two components."""
    if len(group.type.components) != 2:
        return None
    slots = [k for k, slot in enumerate(group.type.slots) if slot.kind == "point"]
    targets = [k for k in slots if group.type.slots[k].of in ("point", "to")]
    return targets[0] if targets else None


def _suspected(problem: Problem, sizes: tuple[FloatArray, ...]) -> list[int]:
    worst = np.zeros(len(problem.index.columns["point"]))
    for group, size in zip(problem.groups, sizes, strict=True):
        slot = _slot_of_target(group)
        if slot is not None:
            np.maximum.at(worst, group.blocks[slot], size.max(axis=1, initial=0.0))
    order = np.argsort(-worst, kind="stable")[:_POINTS]
    return [int(k) for k in order if worst[k] > SUSPECT]


def _sights_to(problem: Problem, point: int) -> list[_Sights]:
    found, left = [], _SIGHTS
    for group in problem.groups:
        slot = _slot_of_target(group)
        if slot is not None:
            rows = np.flatnonzero((group.blocks[slot] == point) & group.mask.all(axis=1))[:left]
            found += [_Sights(group, rows, slot)] if len(rows) else []
            left -= len(rows)
    return found


def _best(
    sights: list[_Sights], values: Values, begins: list[FloatArray], count: int, places: list[FloatArray]
) -> FloatArray:
    """The place (3,) among all intersections, and some further places, that costs least."""

    pairs = np.array(list(combinations(range(sum(len(one.rows) for one in sights)), 2)))
    begin = np.tile(np.array(begins), (len(pairs), 1))
    met = _intersected(sights, values, begin, np.repeat(pairs, len(begins), axis=0))
    every = np.concatenate([np.array(places).reshape(-1, 3), met])
    best: FloatArray = every[np.argmin(_costs(sights, values, every, count))]
    return best


def _costs(sights: list[_Sights], values: Values, places: FloatArray, count: int) -> FloatArray:
    """(k,) what the sights of a point cost if it were at some places (k, 3)."""
    sizes = np.abs(_residuals(sights, values, places)[0])
    return np.nan_to_num([cost_of_residuals([one], count) for one in sizes], nan=np.inf)


def _intersected(sights: list[_Sights], values: Values, begin: FloatArray, pairs: IntArray) -> FloatArray:
    """Least squares (Gauss–Newton) of two sights each (k, 2), from (k, 3); the beginning where it leads nowhere."""
    place, two = begin, np.arange(len(pairs))[:, None]
    lost = np.zeros(len(pairs), dtype=bool)
    for _ in range(_ITERATIONS):
        residuals, jacobian = _residuals(sights, values, place)
        own, design = residuals[two, pairs].reshape(-1, 4), jacobian[two, pairs].reshape(-1, 4, 3)
        lost |= ~(np.isfinite(own).all(axis=1) & np.isfinite(design).all(axis=(1, 2)))
        own, design = np.where(lost[:, None], 0.0, own), np.where(lost[:, None, None], 0.0, design)
        step = np.einsum("kij,kj->ki", np.linalg.pinv(design, rcond=_RANK), own)
        place = np.where(lost[:, None], begin, place + step)
    return place


def _residuals(sights: list[_Sights], values: Values, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(observed − computed)/σ (k, s, 2) of s sights to the point at each place (k, 3), and derivatives (k, s, 2, 3)."""
    misclosures, jacobians = [], []
    for group, rows, slot in sights:
        every = np.tile(rows, len(places))
        blocks = [values[s.kind][b[every]] for s, b in zip(group.type.slots, group.blocks, strict=True)]
        blocks[slot] = np.repeat(places, len(rows), axis=0)
        with np.errstate(all="ignore"):
            equation = group.type.equation(blocks, group.constants[every])
        difference = group.observed[every] - equation.values
        difference[:, group.type.wraps] = wrap(difference[:, group.type.wraps])
        sigma = group.given_sigma[every]
        misclosures.append((difference / sigma).reshape(len(places), -1, 2))
        jacobians.append((equation.jacobians[slot] / sigma[:, :, None]).reshape(len(places), -1, 2, 3))
    return np.concatenate(misclosures, axis=1), np.concatenate(jacobians, axis=1)
