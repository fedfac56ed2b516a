"""The ranking of a plan: what its observations and candidates are worth towards what is required."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mor.arrays import IntArray
from mor.compilation import chosen_by_size
from mor.errors import InputError, Problem
from mor.project.network.build import Network
from mor.quality.design.interest import MOST_ROWS, interest_of
from mor.quality.design.ranking import (
    Ranked,
    Step,
    by_worth,
    greedy,
    of_units,
    points_looked_at,
    ranked,
)
from mor.quality.design.requirements import RequiredPrecision, Requirement
from mor.quality.design.shortfall import Outcome, least_redundancies, present, wanted_of
from mor.quality.design.wide import weak_observations, wide_interest, wide_outcomes
from mor.quality.solved import Solved


class Ranking(NamedTuple):
    """Changes that lose least, changes that gain most, and a greedy plan."""

    network: Network
    now: Outcome
    planned: tuple[Ranked, ...]
    candidates: tuple[Ranked, ...]
    steps: tuple[Step, ...]
    unestimable: tuple[tuple[int, int], ...]
    """Candidates (group, row) that would change the datum."""


def ranking(solved: Solved, required: Sequence[Requirement], most: int) -> Ranking:
    """The ranking of a plan that has a solution, and a greedy plan of up to ``most`` candidates.

    Of plans with more than ``MOST_ROWS`` rows candidates alone are ranked. Raises :class:`InputError` for greedy plans
    of these, and where too much is required of them.
    """
    quality, network = solved.quality, solved.network
    assert quality is not None
    limited = [one.blocks for one in required if isinstance(one, RequiredPrecision)]
    with chosen_by_size(network.observations), np.errstate(all="ignore"):
        every = network.things["point"].parts["position"]
        blocks = points_looked_at(limited, every)
        names = [group.name for group in (*solved.adjustment.problem.groups, *network.candidates)]
        count = network.observations + sum(int(group.mask.sum()) for group in network.candidates)
        if count + 3 * len(blocks) > MOST_ROWS:
            if most:
                words = f"greedy plans are made of up to {MOST_ROWS} observations, found {count}"
                raise InputError([Problem(words, "--greedy")])
            return _of_large_block(solved, required, blocks if limited else every[:0], names)
        interest = interest_of(quality, network.candidates, blocks)
        wanted = wanted_of(required, interest, quality, names)
        return Ranking(
            network,
            present(interest, wanted),
            tuple(ranked(interest, wanted, candidates=False)),
            tuple(ranked(interest, wanted, candidates=True)),
            tuple(greedy(interest, wanted, most)),
            interest.unestimable,
        )


def _of_large_block(
    solved: Solved, required: Sequence[Requirement], blocks: IntArray, names: Sequence[str]
) -> Ranking:
    """Candidates ranked by what they do to required σ and to weak observations."""
    quality, network = solved.quality, solved.network
    assert quality is not None
    groups = solved.adjustment.problem.groups
    least = least_redundancies(required, quality, names)
    weak = weak_observations(quality, least[: len(groups)])
    wide = wide_interest(quality, blocks, weak, network.candidates)
    wanted = wanted_of(required, wide.interest, quality, names)
    now = present(wide.interest, wanted)
    found: list[Ranked] = []
    unestimable: list[tuple[int, int]] = []
    for units, outcome, estimable in wide_outcomes(
        quality, wide, wanted, network.candidates, least[len(groups) :]
    ):
        unestimable += [(u.group, u.row) for u, good in zip(units, estimable, strict=True) if not good]
        found += [one for one, good in zip(of_units(units, outcome), estimable, strict=True) if good]
    found.sort(key=lambda one: (one.unit.group, one.unit.row))
    return Ranking(network, now, (), tuple(by_worth(found, now, True)), (), tuple(unestimable))
