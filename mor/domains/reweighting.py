"""Domains adjusted with other weights: each time in a layer of the store of its own, begun where the last one is.

Variance components are iterated into the weights as on one machine, from sums over the observations of all domains.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping
from typing import NamedTuple, TypeAlias

import numpy as np

from mor.adjustment.domains.adjust import Joined, adjust
from mor.adjustment.domains.domain import Domain, Key, plan_domain
from mor.adjustment.domains.store import Store
from mor.adjustment.domains.tree import Engine
from mor.adjustment.problem import Problem
from mor.arrays import FloatArray
from mor.domains.prepared import Prepared, numbered
from mor.domains.preparing import Head, head_of
from mor.domains.settling import Solution, quality_of, solution_of, with_cofactors
from mor.observations import ObservationGroup
from mor.project.domains.part_network import PartNetwork
from mor.quality.diagnosis.self_check import beyond_use
from mor.quality.gross_errors.exclusion import reweighted
from mor.quality.variance_components.simplified import (
    LEAST,
    ROUNDS,
    Components,
    group_sums,
    has_settled,
    next_step,
    spread_of_sums,
)

GroupKey: TypeAlias = tuple[str, str, bool]
"""Name of a group, type of its observations, and whether all of it is kept out, as checks are."""


class Weighted(NamedTuple):
    """An adjustment of domains with some weights, and who has it."""

    engine: Engine
    ready: Prepared
    joined: Joined


def key_of(group: ObservationGroup) -> GroupKey:
    """What a group is called in every domain."""
    return group.name, group.type.key, bool(group.left_out.all())


def begin(store: Store, d: int, problem: Problem, last: Store, stage: str) -> Head:
    """Plan a domain with the weights of a problem, at the values of a stage of another layer ``last``."""
    values = last.load(f"values/{stage}/{d}")
    part: PartNetwork = store.load(f"network/{d}")
    domain = plan_domain(problem, values, part.common(problem.index))
    store.save(f"values/0/{d}", values)
    store.save(f"domain/{d}", domain)
    return head_of(domain, part, d)


def adjusted_from(last: Weighted, engine: Engine, heads: list[Head]) -> Weighted:
    """Domains that are planned anew in a layer, adjusted."""
    ready = numbered(engine, engine.store.load("divided"), heads)
    joined = adjust(engine, ready.boundaries, ready.sizes, last.joined.free)
    return Weighted(engine, ready, joined)


class Sums(NamedTuple):
    """What a domain adds to the variance components."""

    redundancy: float
    useless: tuple[Key, ...]
    """Unknowns whose σ is larger than the domain they live in."""
    of_groups: tuple[tuple[GroupKey, float, float], ...]
    """vᵀPv and Σ r."""


def sums_of_domain(store: Store, d: int, solution: Solution) -> Sums:
    """Sums over the observations of a domain."""
    gc.collect()  # what is left of the domain before goes first
    quality = quality_of(store, d, solution)
    keys = [key_of(group) for group in quality.adjustment.problem.groups]
    return Sums(
        quality.redundancy_sum,
        tuple((kind, name, 0) for one in beyond_use(quality) for kind, name, _ in one.unknowns),
        tuple(zip(keys, *(sums.tolist() for sums in group_sums(quality)), strict=True)),
    )


def reweigh(store: Store, d: int, last: Store, stage: str, factors: Mapping[GroupKey, float]) -> Head:
    """Begin anew with the σ of groups multiplied by their factors."""
    domain: Domain = store.base.load(f"domain/{d}")
    groups = domain.problem.groups
    own = [np.full(group.observed.shape, factors[key_of(group)]) for group in groups]
    return begin(store, d, reweighted(domain.problem, own), last, stage)


class InWeights(NamedTuple):
    """Variance components that the weights have in them."""

    factors: Mapping[GroupKey, tuple[float, float]]
    """Factor on σ, and its standard deviation."""
    settled: bool
    rounds: int

    def of(self, problem: Problem) -> Components:
        """As the groups of a domain have them."""
        pairs = np.array([self.factors[key_of(group)] for group in problem.groups]).reshape(-1, 2)
        return Components(pairs[:, 0], pairs[:, 1], self.settled, self.rounds, iterated=True)


class Iterated(NamedTuple):
    """The adjustment that variance components have led to."""

    last: Weighted
    solution: Solution
    components: InWeights


class Tested(NamedTuple):
    """An adjustment with what its domains add to the variance components."""

    weighted: Weighted
    solution: Solution
    sums: tuple[Sums, ...]

    @property
    def useless(self) -> tuple[Key, ...]:
        """Unknowns whose σ is larger than the domain they live in."""
        return tuple(key for one in self.sums for key in one.useless)

    @property
    def redundancy_sum(self) -> float:
        """Σ r over all domains."""
        return sum(one.redundancy for one in self.sums)

    def of_groups(self) -> dict[GroupKey, tuple[float, float]]:
        """vᵀPv and Σ r of each group."""
        found: dict[GroupKey, tuple[float, float]] = {}
        for key, omega, r in (row for one in self.sums for row in one.of_groups):
            before = found.get(key, (0.0, 0.0))
            found[key] = before[0] + omega, before[1] + r
        return found


def with_sums(weighted: Weighted, solution: Solution) -> Tested:
    """An adjustment that is a solution with the sums of its domains."""
    engine = weighted.engine
    sums = with_cofactors(engine, weighted.joined, lambda d: engine.submit(sums_of_domain, d, solution))
    return Tested(weighted, solution, tuple(sums))


def iterated(first: Tested, numbers: Iterator[int]) -> Iterated:
    """Variance components iterated into the weights, as :func:`mor.quality.variance_components.simplified`.

    ``numbers`` are those of layers: none is used twice.
    """
    last, base = first, first.weighted.engine
    keys = tuple(first.of_groups())
    total, estimated = np.ones(len(keys)), np.ones(len(keys), dtype=bool)
    for rounds in range(1, ROUNDS + 1):
        omega, r = _arrays(last, keys)
        estimated &= r >= LEAST
        step = next_step(omega, r, estimated, total)
        total = total * step
        found = _adjusted(base, last.weighted, next(numbers), dict(zip(keys, total.tolist(), strict=True)))
        if not found.joined.outcome.is_solution:
            found.engine.store.clear()
            return _told(last, keys, total, np.full(len(keys), np.nan), False, rounds)
        settings = found.ready.project.settings
        tested = with_sums(found, solution_of(found.engine, found.joined, settings))
        if last is not first:
            last.weighted.engine.store.clear()
        last = tested
        if has_settled(step):
            break
    omega, r = _arrays(last, keys)
    spread = total * spread_of_sums(omega, r, estimated)
    sigma = np.where(estimated, spread, np.nan)
    return _told(last, keys, total, sigma, has_settled(step), rounds)


def _arrays(tested: Tested, keys: tuple[GroupKey, ...]) -> tuple[FloatArray, FloatArray]:
    sums = tested.of_groups()
    both = np.array([sums[key] for key in keys]).reshape(-1, 2)
    return both[:, 0], both[:, 1]


def _adjusted(base: Engine, last: Weighted, number: int, factors: Mapping[GroupKey, float]) -> Weighted:
    engine, stage = base.layer(f"weights-{number}"), last.joined.values
    tasks = [engine.submit(reweigh, d, last.engine.store, stage, factors) for d in last.joined.domains]
    return adjusted_from(last, engine, [engine.result(task) for task in tasks])


def _told(
    last: Tested, keys: tuple[GroupKey, ...], total: FloatArray, sigma: FloatArray, settled: bool, rounds: int
) -> Iterated:
    factors = dict(zip(keys, zip(total.tolist(), sigma.tolist(), strict=True), strict=True))
    return Iterated(last.weighted, last.solution, InWeights(factors, settled, rounds))
