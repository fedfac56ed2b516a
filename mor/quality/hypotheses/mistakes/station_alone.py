"""A station or an image whose sights spoil its own place: each exchange of two of its names, adjusted by itself.

Two wrong sights of a few leave a pose at which none fits, so that no row tells the right name. But everything else is
known from elsewhere: with all other unknowns held, and only its own rows, each exchange is an adjustment of a few
unknowns, and the right one is what its rows cost least with (``description_length.py``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from mor.adjustment.linearise import linearise, rotation_tangents
from mor.adjustment.problem import Problem
from mor.allowance import spend
from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant
from mor.observations import ObservationGroup, some_rows
from mor.parameters.index import Values, index_unknowns, move
from mor.quality.gross_errors.description_length import cost_of_residuals, sizes_of
from mor.quality.hypotheses.effort import SMALL
from mor.quality.hypotheses.situation import Situation

_LEAST, _MOST = 4, 12
"""Sights of a station: of fewer any exchange fits, of more the others keep its pose right."""
_BAD = 2
"""Sights that do not fit: an exchange makes two."""
_STATIONS = 2
_ITERATIONS, _HALVED, _SETTLED = 12, 6, 1e-3
_PAIR = 400
"""Units of work of a pair (:mod:`mor.allowance`)."""


class Exchange(NamedTuple):
    """Two rows of a group that fit with each other's targets."""

    group: int
    rows: tuple[int, int]
    candidates: int


class _Alone(NamedTuple):
    """The problem of nothing but the rows of a station, with the blocks that are its own as the only unknowns."""

    problem: Problem
    numbers: tuple[int, ...]
    """Groups of the network that its groups are of."""
    rows: tuple[IntArray, ...]
    """(n,) rows of these that its rows are."""


def exchanges_at_stations(situation: Situation) -> list[Exchange]:
    """The best exchange at each station of which many sights do not fit."""
    if situation.count > SMALL:
        return []
    problem = situation.make(situation.network, situation.start, situation.values)
    found = [_best(situation, _alone(problem, situation, name)) for name in _spoiled(situation)]
    return [one for one in found if one is not None]


def _sighting(groups: Sequence[ObservationGroup]) -> list[int]:
    """Numbers of the groups of sights from something to something, with two components."""
    return [k for k, g in enumerate(groups) if len(g.type.components) == 2 and len(g.references) == 2]


def _spoiled(situation: Situation) -> list[str]:
    """Names of the stations, the worst first."""
    whole: Counter[str] = Counter()
    wrong: Counter[str] = Counter()
    for number in _sighting(situation.network.groups):
        names = list(situation.network.groups[number].references[0])
        whole.update(names)
        wrong.update(names[row] for row in np.flatnonzero(situation.misfitting[number].any(axis=1)))
    shares = {n: wrong[n] / whole[n] for n in whole if _LEAST <= whole[n] <= _MOST}
    spoiled = [n for n in shares if wrong[n] >= _BAD]
    return sorted(spoiled, key=lambda n: -shares[n])[:_STATIONS]


def _alone(problem: Problem, situation: Situation, name: str) -> _Alone:
    groups, numbers, rows = [], [], []
    free = {kind: np.zeros(len(blocks.ids), dtype=bool) for kind, blocks in problem.index.blocks.items()}
    for number in _sighting(situation.network.groups):
        group = problem.groups[number]
        own = np.flatnonzero(np.array([station == name for station in group.references[0]]))
        if not len(own):
            continue
        groups.append(some_rows(group, own))
        numbers.append(number)
        rows.append(own)
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
            if slot.of == group.type.references[0].name and slot.part in ("position", "rotation"):
                free[slot.kind][blocks[own]] = True
    held = {
        kind: blocks._replace(free=blocks.free & free[kind][:, None])
        for kind, blocks in problem.index.blocks.items()
    }
    alone = replace(problem, groups=tuple(groups), clusters=(), index=index_unknowns(held))
    return _Alone(alone, tuple(numbers), tuple(rows))


def _best(situation: Situation, alone: _Alone) -> Exchange | None:
    pairs = [(k, pair) for k, rows in enumerate(alone.rows) for pair in combinations(range(len(rows)), 2)]
    spend(len(pairs) * _PAIR)
    costs = [_cost(situation, _exchanged(alone.problem, k, pair)) for k, pair in pairs]
    best = int(np.argmin(costs))
    if not costs[best] < _cost(situation, alone.problem):
        return None
    k, (one, other) = pairs[best]
    return Exchange(alone.numbers[k], (int(alone.rows[k][one]), int(alone.rows[k][other])), len(pairs))


def _exchanged(problem: Problem, number: int, pair: tuple[int, int]) -> Problem:
    """The problem with the targets of two rows of a group exchanged."""
    group = problem.groups[number]
    target = group.type.references[1].name
    order = np.arange(group.count)
    order[list(pair)] = order[list(reversed(pair))]
    slots = zip(group.type.slots, group.blocks, strict=True)
    blocks = tuple(own[order] if slot.of == target else own for slot, own in slots)
    groups = list(problem.groups)
    groups[number] = replace(group, blocks=blocks)
    return replace(problem, groups=tuple(groups))


def _cost(situation: Situation, problem: Problem) -> float:
    """What the rows of the station cost after its own adjustment."""
    with np.errstate(all="ignore"):
        values = _adjusted(problem, situation.values)
        sizes = sizes_of(problem.groups, values)
    used = [np.where(group.left_out, 0.0, size) for group, size in zip(problem.groups, sizes, strict=True)]
    cost = cost_of_residuals(used, situation.count)
    return cost if np.isfinite(cost) else np.inf


def _adjusted(problem: Problem, values: Values) -> Values:
    """Least squares of a few unknowns (Gauss–Newton, steps halved where they go too far)."""
    now, derivatives = _system(problem, values)
    for _ in range(_ITERATIONS):
        if not (np.isfinite(now).all() and np.isfinite(derivatives).all()):
            break
        step = np.asarray(tolerant.lstsq(derivatives, now, rcond=None), dtype=np.float64)
        for _ in range(_HALVED):
            there = move(problem.index, values, step)
            residuals, further = _system(problem, there)
            if residuals @ residuals < now @ now:
                break
            step = 0.5 * step
        else:
            break
        settled = residuals @ residuals > (1.0 - _SETTLED) * (now @ now)
        values, now, derivatives = there, residuals, further
        if settled:
            break
    return values


def _system(problem: Problem, values: Values) -> tuple[FloatArray, FloatArray]:
    """(observed − computed)/σ (k,) of all rows, and the derivatives (k, u) of what is computed."""
    tangent = rotation_tangents(problem.index, values)
    misclosures, derivatives = [], []
    for group in problem.groups:
        part = linearise(group, problem.index, values, tangent, slice(None))
        weight = np.where(group.mask & ~group.left_out, 1.0 / group.sigma, 0.0)
        dense = np.zeros(
            (*part.misclosure.shape, problem.index.count + 1)
        )  # fixed ones go to the last column
        rows = np.arange(group.count)[:, None]
        for component in range(part.misclosure.shape[1]):
            np.add.at(dense[:, component], (rows, part.columns), part.jacobian[:, component])
        derivatives.append(
            (dense[..., :-1] * weight[:, :, None]).reshape(part.misclosure.size, problem.index.count)
        )
        misclosures.append((part.misclosure * weight).ravel())
    return np.concatenate(misclosures), np.concatenate(derivatives)
