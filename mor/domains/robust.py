"""Robust solutions over domains: the rounds of :mod:`mor.quality.gross_errors.robust_estimation`, domain by domain."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mor.adjustment.domains.domain import Domain
from mor.adjustment.domains.store import Store
from mor.domains.preparing import Head
from mor.domains.reweighting import Weighted, adjusted_from, begin
from mor.domains.settling import Solution, quality_of, with_cofactors
from mor.quality.assess import Quality
from mor.quality.gross_errors.exclusion import reweighted
from mor.quality.gross_errors.robust_estimation import (
    ROUNDS,
    SETTLED,
    Method,
    Robust,
    change_of,
    factors_of,
    spread_of,
    stages_of,
)


class Light(NamedTuple):
    """A robust solution of all domains."""

    method: Method
    settled: bool
    store: Store
    """Where domains have its values and the factors on their weights."""
    values: str
    """Stage of the values."""

    def of(self, quality: Quality, d: int) -> Robust:
        """As a domain has it, whose least-squares solution has this quality."""
        values = self.store.load(f"values/{self.values}/{d}")
        adjustment = quality.adjustment._replace(values=values)
        return Robust(self.method, adjustment, self.store.load(f"light/{d}"), self.settled)


def robust(first: Weighted, solution: Solution, method: Method, numbers: Iterator[int]) -> Light:
    """The robust solution that starts from one by least squares; ``numbers`` are those of layers."""
    engine = first.engine
    with_cofactors(engine, first.joined, lambda d: engine.submit(keep_spread, d, solution))
    last, settled = first, False
    _weigh(first, "l1", None)
    for stage in stages_of(method):
        settled = False
        for _ in range(ROUNDS):
            found = _adjusted(first, last, next(numbers))
            if not found.joined.outcome.is_solution:
                found.engine.store.clear()
                return Light(method, False, last.engine.store, last.joined.values)
            change = _weigh(found, stage, last)
            if last is not first:
                last.engine.store.clear()
            last = found
            if change < SETTLED:
                settled = True
                break
    return Light(method, settled, last.engine.store, last.joined.values)


def keep_spread(store: Store, d: int, solution: Solution) -> None:
    """Keep √r of all observations of a domain."""
    gc.collect()  # what is left of the domain before goes first
    store.save(f"spread/{d}", spread_of(quality_of(store, d, solution)))


def _weigh(weighted: Weighted, method: Method, last: Weighted | None) -> float:
    """Keep the factors that residuals ask for; the largest change of one since the last time."""
    engine, stage = weighted.engine, weighted.joined.values
    before = None if last is None else last.engine.store
    tasks = [engine.submit(weigh, d, stage, method, before) for d in weighted.joined.domains]
    changes: list[float] = [engine.result(task) for task in tasks]
    return max(changes)


def weigh(store: Store, d: int, stage: str, method: Method, last: Store | None) -> float:
    """Keep the factors on the weights of a domain at the values of a stage; how much they have changed."""
    domain: Domain = store.base.load(f"domain/{d}")
    spread = store.base.load(f"spread/{d}")
    found = factors_of(domain.problem, store.load(f"values/{stage}/{d}"), spread, method)
    store.save(f"light/{d}", found)
    return change_of(found, last.load(f"light/{d}")) if last is not None else 0.0


def _adjusted(first: Weighted, last: Weighted, number: int) -> Weighted:
    engine, stage = first.engine.layer(f"robust-{number}"), last.joined.values
    tasks = [engine.submit(lighten, d, last.engine.store, stage) for d in last.joined.domains]
    return adjusted_from(last, engine, [engine.result(task) for task in tasks])


def lighten(store: Store, d: int, last: Store, stage: str) -> Head:
    """Begin anew with the weights of a domain multiplied by the factors that the last layer has."""
    domain: Domain = store.base.load(f"domain/{d}")
    sigma = [1.0 / np.sqrt(factor) for factor in last.load(f"light/{d}")]
    return begin(store, d, reweighted(domain.problem, sigma), last, stage)
