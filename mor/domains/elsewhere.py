"""Over domains: points that all their observations put elsewhere than what data snooping has left of them.

As :mod:`mor.quality.gross_errors.other_places`, with medians and sums over domains. A point whose observations are in
several domains is looked at in none.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

import numpy as np

from mor.adjustment.domains.domain import Domain
from mor.adjustment.domains.store import Store
from mor.adjustment.domains.tree import Engine
from mor.adjustment.problem import Problem
from mor.arrays import FloatArray, IntArray
from mor.domains.medians import Between, Sampled, between, bounds, median, sampled
from mor.project.domains.part_network import PartNetwork
from mor.quality.gross_errors.data_snooping import Out, entries_of, masks_of
from mor.quality.gross_errors.description_length import (
    Costs,
    cost_of_sums,
    observed,
    robust_sigma,
    sizes_of,
    sums_of_costs,
)
from mor.quality.gross_errors.other_places import BEYOND_CHANCE, out_elsewhere
from mor.quality.gross_errors.reintersection import POINTS, Among, doubtful_points, intersected_anew
from mor.quality.gross_errors.worst_first import Entry

STAGE = "elsewhere"
"""Stage of the values with points at other places."""


class Looked(NamedTuple):
    """What a domain tells of its observations and points."""

    series: tuple[Sampled, ...]
    """Of |v|/σ, x, y and z."""
    doubtful: tuple[tuple[int, int], ...]
    """Points in doubt: by how much more fits than is suspect, and number."""


def look(store: Store, d: int, stage: str) -> Looked:
    """Sizes of the residuals of all observations at the values of a stage, and the points they leave in doubt."""
    problem = _all(store, d)
    part: PartNetwork = store.load(f"network/{d}")
    values = store.load(f"values/{stage}/{d}")
    sizes = sizes_of(problem.groups, values)
    names = problem.index.blocks["point"].ids
    own = np.array([part.owns("point", name) for name in names], dtype=bool)
    coordinates = values["point"][own]
    unsorted = [observed(sizes), *(column[np.isfinite(column)] for column in coordinates.T)]
    series = tuple(np.sort(one) for one in unsorted)
    store.save(f"sizes/{d}", series)
    points, excess = doubtful_points(problem, sizes)
    alone = np.array([not part.is_common("point", names[k]) for k in points.tolist()], dtype=bool)
    told = zip(excess[alone][:POINTS].tolist(), points[alone][:POINTS].tolist(), strict=True)
    return Looked(tuple(sampled(one) for one in series), tuple(told))


def tell_between(store: Store, d: int, limits: Sequence[tuple[float, float]]) -> tuple[Between, ...]:
    """What lies between two bounds of each series."""
    series: tuple[FloatArray, ...] = store.load(f"sizes/{d}")
    return tuple(between(one, *limit) for one, limit in zip(series, limits, strict=True))


def costs(store: Store, d: int, factor: float, count: int) -> Costs:
    """What the observations of a domain cost."""
    return sums_of_costs(store.load(f"sizes/{d}")[0], factor, count)


def move_points(
    store: Store, d: int, stage: str, points: Collection[int], among: Among, out: Collection[Entry]
) -> Out | None:
    """What is out where some points are intersected anew; nothing where they stay. Their places are kept."""
    problem, values = _all(store, d), store.load(f"values/{stage}/{d}")
    moved = intersected_anew(problem, values, points, among, gain=BEYOND_CHANCE)
    store.save(f"values/{STAGE}/{d}", moved)
    kept_out = tuple(group.left_out for group in problem.groups)
    there = out_elsewhere(problem, values, moved, masks_of(kept_out, out))
    if there is None:
        return None
    return entries_of(tuple(mask & ~kept for mask, kept in zip(there.out, kept_out, strict=True)), d)


def _all(store: Store, d: int) -> Problem:
    """The problem of a domain with nothing out that may come back."""
    domain: Domain = store.base.load(f"domain/{d}")
    return domain.problem


class Seen(NamedTuple):
    """All observations at the values of an adjustment."""

    among: Among
    cost: float
    doubtful: tuple[IntArray, ...]
    """Points of each domain that are to be looked at."""


def seen(engine: Engine, domains: range, stage: str, count: int) -> Seen:
    """All ``count`` observations at the values of a stage."""

    def each(task: Callable[..., Any], *arguments: Any) -> list[Any]:
        return [engine.result(one) for one in [engine.submit(task, d, *arguments) for d in domains]]

    looked: list[Looked] = each(look, stage)
    of_series = list(zip(*(one.series for one in looked), strict=True))
    told = each(tell_between, [bounds(parts) for parts in of_series])
    size, *middle = (
        median(parts, sum(one.size for one in series))
        for parts, series in zip(zip(*told, strict=True), of_series, strict=True)
    )
    factor = robust_sigma(np.array([size]))
    sums = Costs(*map(sum, zip(*each(costs, factor, count), strict=True)))
    ordered = sorted((excess, d, k) for d, part in enumerate(looked) for excess, k in part.doubtful)
    doubtful = tuple(
        np.array([k for _, of, k in ordered[:POINTS] if of == d], dtype=np.int64) for d in domains
    )
    return Seen(Among(count, np.array(middle), factor), cost_of_sums(sums, factor), doubtful)


def out_where_moved(engine: Engine, found: Seen, stage: str, out: Sequence[Collection[Entry]]) -> Out | None:
    """What is out where points are intersected anew, ``out`` being so in each domain now; nothing where they stay."""
    tasks = [
        engine.submit(move_points, d, stage, points.tolist(), found.among, out[d])
        for d, points in enumerate(found.doubtful)
    ]
    there: list[Out | None] = [engine.result(task) for task in tasks]
    if all(one is None for one in there):
        return None
    return Out(
        entry for one, before in zip(there, out, strict=True) for entry in (before if one is None else one)
    )
