"""A station or an image whose sights spoil its own place: each exchange of two of its names, adjusted by itself.

Two wrong sights of a few leave a pose at which none fits, so that no row tells the right name. But everything else is
known from elsewhere: with all other unknowns held, and only its own rows, each exchange is an adjustment of a few
unknowns, and the right one is what its rows cost least with (``description_length.py``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from mor.adjustment.problem import Problem
from mor.adjustment.solve import Settings, adjust
from mor.arrays import BoolArray, IntArray
from mor.errors import InputError
from mor.observations import ObservationGroup
from mor.parameters.index import index_unknowns
from mor.project.network.build import Network
from mor.quality.gross_errors.exclusion import exclude
from mor.quality.hypotheses.changes import with_blocks
from mor.quality.hypotheses.description_length import cost_of_residuals
from mor.quality.hypotheses.situation import SMALL, Situation, sizes_of
from mor.sparse.cholesky import NotFiniteError

_LEAST, _MOST = 4, 12
"""Sights of a station: of fewer any exchange fits, of more the others keep its pose right."""
_BAD = 2
"""Sights that do not fit: an exchange makes two."""
_STATIONS = 2
_ITERATIONS = 12


class Exchange(NamedTuple):
    """Two rows of a group that fit with each other's targets."""

    group: int
    rows: tuple[int, int]
    candidates: int


def exchanges_at_stations(situation: Situation) -> list[Exchange]:
    """The best exchange at each station of which many sights do not fit."""
    if situation.count > SMALL:
        return []
    problem = situation.make(situation.network, situation.start, situation.values)
    found = [_best(situation, problem, name) for name in _spoiled(situation)]
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


def _best(situation: Situation, problem: Problem, name: str) -> Exchange | None:
    groups = situation.network.groups
    rows = {
        number: np.flatnonzero(np.array([own == name for own in groups[number].references[0]]))
        for number in _sighting(groups)
    }
    alone = _alone(problem, name, rows)
    pairs = [(number, pair) for number in rows for pair in combinations(rows[number].tolist(), 2)]
    if len(pairs) * situation.count > SMALL:  # each of them computes all observations of the network
        return None
    costs = [_cost(situation, alone, _exchanged(situation.network, *pair)) for pair in pairs]
    best = int(np.argmin(costs))
    if not costs[best] < _cost(situation, alone, situation.network):
        return None
    return Exchange(pairs[best][0], pairs[best][1], len(pairs))


def _alone(problem: Problem, name: str, rows: Mapping[int, IntArray]) -> Problem:
    """The problem of the rows of a station, with the blocks that are its own as the only unknowns."""
    free = {kind: np.zeros(len(blocks.ids), dtype=bool) for kind, blocks in problem.index.blocks.items()}
    for number, own in rows.items():
        group = problem.groups[number]
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
            if slot.of == group.type.references[0].name and slot.part in ("position", "rotation"):
                free[slot.kind][blocks[own]] = True
    held = {
        kind: replace(blocks, free=blocks.free & free[kind][:, None])
        for kind, blocks in problem.index.blocks.items()
    }
    return replace(
        exclude(problem, [_of_others(other, name) | other.left_out for other in problem.groups]),
        index=index_unknowns(held),
    )


def _of_others(group: ObservationGroup, name: str) -> BoolArray:
    mine = np.zeros(group.count, dtype=bool)
    if len(group.references) == 2:
        mine = np.array([own == name for own in group.references[0]], dtype=bool)
    return np.broadcast_to(~mine[:, None], group.observed.shape)


def _exchanged(network: Network, number: int, pair: tuple[int, int]) -> Network:
    """The network with the targets of two rows exchanged."""
    group = network.groups[number]
    target = group.type.references[1].name
    slots = [k for k, slot in enumerate(group.type.slots) if slot.of == target]
    return with_blocks(
        network, number, pair, {k: group.blocks[k][list(reversed(pair))].tolist() for k in slots}
    )


def _cost(situation: Situation, alone: Problem, network: Network) -> float:
    """What the rows of the station cost after its own adjustment; ∞ where there is none."""
    groups = (
        tuple(
            replace(own, blocks=changed.blocks)
            for own, changed in zip(alone.groups, network.groups, strict=False)
        )
        + alone.groups[len(network.groups) :]
    )
    problem = replace(alone, groups=groups)
    try:
        with np.errstate(all="ignore"):
            found = adjust(problem, situation.values, Settings(_ITERATIONS))
    except (InputError, NotFiniteError):
        return np.inf
    sizes = sizes_of(problem.groups, found.values)
    used = [np.where(group.left_out, 0.0, size) for size, group in zip(sizes, problem.groups, strict=True)]
    cost = cost_of_residuals(used, situation.count)
    return cost if np.isfinite(cost) else np.inf
