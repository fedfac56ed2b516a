"""Observations that stand in a project twice with the same value: measured twice, or exported twice?

Two measurements of the same quantity, rounded to multiples of u, are equal with the probability

    p = u / (2 √π σ),

because their difference has the density 1/(2 √π σ) at 0. Of n repeated rows, k are equal by chance with at most the
binomial probability of k or more with the mean of these p (W. Hoeffding, Ann. Math. Statist. 27, 1956). u is taken from
the values: the smallest difference between two of them. If values are rounded to several σ, p is 1 and nothing is said.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import numpy as np
from scipy.special import bdtrc

from mor.arrays import FloatArray, IntArray
from mor.errors import Problem
from mor.observations import ObservationGroup
from mor.project.network.build import Network
from mor.quality.plausibility.places import line_of, sigmas
from mor.quality.reliability.influence_on_position import OF_IMAGES

_CHANCE = 1e-3
"""Probability of so many equal rows by chance from which down they are noted."""
_CHANCE_OF_TABLE = 0.05
"""The same for a whole table whose rows all stand in another one in the same order, which chance does not arrange."""


def repeated_rows(network: Network) -> Iterator[Problem]:
    """Yield one note for each table that repeats rows of another one, or of itself, to the last digit."""
    by_type: dict[str, list[int]] = defaultdict(list)
    for number, group in enumerate(network.groups):
        if group.count and group.file and len(group.lines):
            by_type[group.type.key].append(number)
    deviations = sigmas(network)
    for numbers in by_type.values():
        yield from _of_one_type(network, numbers, deviations)


def _of_one_type(network: Network, numbers: list[int], deviations: list[FloatArray]) -> Iterator[Problem]:
    groups = [network.groups[number] for number in numbers]
    if len(groups) == 1 and groups[0].type.key in OF_IMAGES:
        return  # points that an image has twice in one table are noted one by one
    owner = np.repeat(np.arange(len(groups)), [group.count for group in groups])
    row = np.concatenate([np.arange(group.count) for group in groups])
    order, again = _pairs(groups)
    if not again.any():
        return
    first, second = order[:-1][again], order[1:][again]
    sigma = np.concatenate([deviations[number] for number in numbers])
    observed = np.concatenate([group.observed for group in groups])
    equal = _same(observed, first, second) & _same(sigma, first, second)
    zero = ~(np.nan_to_num(observed[first]) != 0.0).any(axis=1)
    start = np.concatenate([[0], np.cumsum(~again)])
    times = np.bincount(start)[
        start[:-1][again]
    ]  # m values have m(m − 1)/2 pairs, of which m − 1 are looked at
    chance = np.minimum(1.0, 0.5 * times * _chances(observed, sigma, first))
    for one in range(len(groups)):
        for other in range(len(groups)):
            here = (owner[first] == one) & (owner[second] == other) & ~zero
            found = np.flatnonzero(here & equal)
            if len(found) == 0 or (one == other and groups[one].type.key in OF_IMAGES):
                continue
            whole = (
                one != other
                and len(found) == groups[other].count
                and bool((np.diff(row[first[found]][np.argsort(row[second[found]])]) > 0).all())
            )
            probability = float(
                bdtrc(len(found) - 1, np.count_nonzero(here), min(1.0, float(chance[here].mean())))
            )
            if probability > (_CHANCE_OF_TABLE if whole else _CHANCE):
                continue
            yield _note(groups[one], groups[other], row[first[found]], row[second[found]])


def _pairs(groups: list[ObservationGroup]) -> tuple[IntArray, np.ndarray]:
    """Rows in an order in which those of the same quantity are neighbours, and (n − 1,) true where two are."""
    slots = [k for k, slot in enumerate(groups[0].type.slots) if slot.kind != "rotation"]
    columns = [np.concatenate([group.blocks[k] for group in groups]) for k in slots]
    constants = np.concatenate([group.constants for group in groups])
    columns += list(constants.T) if groups[0].type.key not in OF_IMAGES else []
    observed = np.concatenate([group.observed for group in groups])
    order = np.lexsort([*observed.T, *columns[::-1]])  # of one quantity, equal values are neighbours
    again = np.ones(max(len(order) - 1, 0), dtype=bool)
    for column in columns:
        sorted_ = column[order]
        again &= (sorted_[1:] == sorted_[:-1]) | (
            (sorted_[1:] != sorted_[1:]) & (sorted_[:-1] != sorted_[:-1])
        )
    return order, again


def _same(values: FloatArray, first: IntArray, second: IntArray) -> np.ndarray:
    one, other = values[first], values[second]
    return np.asarray(((one == other) | (np.isnan(one) & np.isnan(other))).all(axis=1))


def _chances(observed: FloatArray, sigma: FloatArray, rows: IntArray) -> FloatArray:
    """(n,) probability p that a second measurement of each row has the same value."""
    result = np.ones(len(rows))
    for component in range(observed.shape[1]):
        values = np.unique(observed[np.isfinite(observed[:, component]), component])
        gaps = np.diff(values)
        gaps = gaps[gaps > 1e-12 * np.abs(values).max(initial=0.0)]  # less is the round-off of a conversion
        if len(gaps) == 0:
            continue
        own = sigma[rows, component]
        with np.errstate(divide="ignore", invalid="ignore"):
            p = gaps.min() / (2.0 * np.sqrt(np.pi) * own)
        result *= np.where(np.isfinite(p) & np.isfinite(observed[rows, component]), np.minimum(p, 1.0), 1.0)
    return result


def _note(one: ObservationGroup, other: ObservationGroup, first: IntArray, second: IntArray) -> Problem:
    where = line_of(one, int(first[0])), line_of(other, int(second[0]))
    observations = int(np.count_nonzero(other.mask[second]))
    return Problem(
        f"{len(second)} of {other.count} rows repeat rows of {one.file} with the same value and sigma (line "
        f"{where[1]} repeats line {where[0]}). Perhaps they were exported twice: then leave them out, for they add "
        f"{observations} to the redundancy and make standard deviations too small",
        other.file,
        where[1],
    )
