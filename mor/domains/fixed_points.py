"""Tests of fixed points that several domains observe: sums over domains, with the system of all solved for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mor.adjustment.datum.defect import network_components
from mor.adjustment.domains.adjust import Joined
from mor.adjustment.domains.domain import Domain, Stage, reduce_side, solve_side
from mor.adjustment.domains.store import Store
from mor.adjustment.domains.tree import Engine, solve
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.domains.settling import Solution
from mor.project.domains.part_network import PartNetwork
from mor.quality.tests.fixed_coordinates import ENTRIES, MOST, FixedPointTest, movement_test, released

Key = tuple[str, int]
"""Name of a point and number of a coordinate."""


class Fixed(NamedTuple):
    """A fixed point and its test."""

    name: str
    test: FixedPointTest


class Summed(NamedTuple):
    """What a domain adds to the normal equations of fixed coordinates; BᵀPA Q AᵀPB comes later."""

    own: FloatArray
    right: FloatArray
    left: FloatArray
    """(s, f) of the outer unknowns."""


def tests_of_shared(engine: Engine, joined: Joined, solution: Solution) -> tuple[Fixed, ...]:
    """Tests of the fixed points that several domains observe, at most as many as one machine tests."""
    tasks = [engine.submit(fixed_of, d, solution) for d in joined.domains]
    found: list[tuple[tuple[Key, ...], int]] = [engine.result(task) for task in tasks]
    names = list(dict.fromkeys(name for keys, _ in found for name, _ in keys))[:MOST]
    at_a_time = max(1, ENTRIES // (3 * max(max(size for _, size in found), 1)))
    every = {key for keys, _ in found for key in keys}
    return tuple(
        test
        for first in range(0, len(names), at_a_time)
        for test in _tests(engine, joined, solution, names[first : first + at_a_time], every)
    )


def _tests(
    engine: Engine, joined: Joined, solution: Solution, names: Sequence[str], every: set[Key]
) -> list[Fixed]:
    keys = [(name, axis) for name in names for axis in range(3) if (name, axis) in every]
    tasks = [engine.submit(sums_of_fixed, d, solution, keys) for d in joined.domains]
    sums: list[Summed] = [engine.result(task) for task in tasks]
    factor = joined.root.factor(joined.null_space.anchors)
    left = [one.left for one in sums]
    outer = solve(engine, joined.boundaries, joined.stage, joined.root, factor, left)
    known = [engine.submit(known_of_fixed, d, solution, outer[d]) for d in joined.domains]
    own, right = sum(one.own for one in sums), sum(one.right for one in sums)
    S = own - sum(engine.result(task) for task in known)
    number = {key: k for k, key in enumerate(keys)}
    whole = solution.whole
    return [
        Fixed(
            name,
            movement_test(
                -1,
                np.array([number.get((name, axis), -1) for axis in range(3)]),
                np.asarray(S),
                np.asarray(own),
                np.asarray(right),
                whole.redundancy,
                whole.omega,
            ),
        )
        for name in names
    ]


def fixed_of(store: Store, d: int, solution: Solution) -> tuple[tuple[Key, ...], int]:
    """The fixed coordinates that a domain observes as others do, and its number of unknowns."""
    domain: Domain = store.load(f"domain/{d}")
    fixed = _fixed(store, d, solution)
    ids = domain.problem.index.blocks["point"].ids
    keys = tuple((ids[point], int(axis)) for point, axis in np.argwhere(fixed))
    return keys, domain.problem.index.count


def _fixed(store: Store, d: int, solution: Solution) -> BoolArray:
    """(n, 3) fixed coordinates of points that other domains have, too."""
    domain: Domain = store.load(f"domain/{d}")
    part: PartNetwork = store.load(f"network/{d}")
    _, fixed = network_components(domain.problem, store.load(f"values/{solution.values}/{d}"))
    ids = domain.problem.index.blocks["point"].ids
    common = np.array([part.is_common("point", name) for name in ids], dtype=bool)
    return np.asarray(fixed & common[:, None])


def sums_of_fixed(store: Store, d: int, solution: Solution, keys: Sequence[Key]) -> Summed:
    """Sums over the observations of a domain, for some fixed coordinates (f,); begin to solve for them."""
    domain: Domain = store.load(f"domain/{d}")
    at: Stage = store.load(f"stage/{solution.stage}/{d}")
    number = {key: k for k, key in enumerate(keys)}
    ids = domain.problem.index.blocks["point"].ids
    chosen = _fixed(store, d, solution)
    places = [number.get((ids[point], int(axis)), -1) for point, axis in np.argwhere(chosen)]
    chosen[chosen] = np.array(places, dtype=np.int64) >= 0
    to: IntArray = np.array([place for place in places if place >= 0], dtype=np.int64)
    mine = released(domain.plan, store.load(f"values/{solution.values}/{d}"), chosen)
    own, right = np.zeros((len(keys),) * 2), np.zeros(len(keys))
    coupling = np.zeros((domain.problem.index.count, len(keys)))
    own[np.ix_(to, to)], right[to], coupling[:, to] = mine.own, mine.right, mine.coupling
    half, left = reduce_side(domain, at, coupling)
    store.save(f"released/{d}", (half, coupling))
    return Summed(own, right, left)


def known_of_fixed(store: Store, d: int, solution: Solution, outer: FloatArray) -> FloatArray:
    """(f, f) part of BᵀPA Q AᵀPB, the solution at the outer unknowns (s, f) given."""
    half, coupling = store.load(f"released/{d}")
    domain: Domain = store.load(f"domain/{d}")
    at: Stage = store.load(f"stage/{solution.stage}/{d}")
    return np.asarray(coupling.T @ solve_side(domain, at, half, outer))
