"""Tests of what was observed together: of each table, image, camera, station, set, instrument, local system.

A few observations that are all wrong, as distances without their prism constant, hardly change vᵀPv of thousands. So
the part that each group has in vᵀPv is put to a two-sided test of its own (``quadratic_form.py``). All these tests
together reject an adjustment without errors with one level: each takes the share of it that Šidák's inequality leaves
it. Groups of the same observations are one test, the only set of a station is part of that station's, and the whole has
the global test.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mor.adjustment.problem import Problem
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.project.network.build import Network
from mor.quality.assess import Quality
from mor.quality.in_chunks import ROWS_AT_A_TIME
from mor.quality.reliability.whitened_rows import WhitenedRows, whitened_rows
from mor.quality.tests.levels import sidak
from mor.quality.tests.p_values import log_p_f
from mor.quality.tests.partitions import Partition, partitions, rows_of, sets_beside_others
from mor.quality.tests.quadratic_form import Moments, bounds, log_tail, moments
from mor.quality.tests.test_statistics import CONTROLLED

_SUMS = 4
"""Σ v·Pv, Σ r, number of observations, and a random number for each of them: the same for the same observations."""


@dataclass(frozen=True)
class GroupTest:
    """Test of the observations of one thing; σ0 = 1."""

    partition: int
    number: int
    """Class in the partition."""
    of: str
    name: str
    also: tuple[tuple[str, str], ...]
    """Further things (what, name) with the same observations."""
    count: int
    redundancy: float
    omega: float
    """Its part of vᵀPv."""
    moments: Moments
    """Of its distribution; where they were not needed, those of least variance if it accepts, of largest if not."""
    log_p: float
    """ln of the two-sided probability; where moments were not needed at least so much if it accepts, at most if not."""
    rejected: bool
    log_p_beside_rest: float = 0.0
    """The same where σ0² is that of all other observations; of rejected ones."""

    @property
    def factor(self) -> float:
        """√(Ω/Σr): what its σ would have to be multiplied with."""
        return float(np.sqrt(max(self.omega, 0.0) / self.redundancy))

    @property
    def freedom(self) -> float:
        """Degrees of freedom ν of the χ² distribution it is compared with."""
        return float(self.moments.freedom[0])


class GroupTests(NamedTuple):
    """All tests of groups, those of tables first."""

    level: float
    """Of all of them together."""
    level_of_each: float
    tests: tuple[GroupTest, ...]
    partitions: tuple[Partition, ...]

    @property
    def rejected(self) -> list[GroupTest]:
        """Those that reject, the worst beside all others first."""
        return sorted((test for test in self.tests if test.rejected), key=lambda test: test.log_p_beside_rest)

    @property
    def all_alike(self) -> bool:
        """True where some reject, but none of them beside the others: all σ seem wrong by one factor."""
        limit, rejected = float(np.log(self.level_of_each)), self.rejected
        return bool(rejected) and all(test.log_p_beside_rest > limit for test in rejected)

    def rows(self, test: GroupTest, problem: Problem) -> list[BoolArray]:
        """(n, m) of each group of observations: those of a test."""
        return rows_of(self.partitions[test.partition], test.number, problem.groups)


def group_tests(quality: Quality, network: Network) -> GroupTests:
    """Tests of all groups that are not the whole."""
    problem = quality.adjustment.problem
    found = partitions(problem, network)

    def exactly(one: Summed) -> Moments:
        return moments(_rows(quality, found[one.partition], one.number), float(one.sums[1]))

    whole = TestedWhole(problem.observations, quality.redundancy, quality.omega, quality.levels.overall)
    return tests_of_sums(summed_groups(quality, network), whole, exactly, found)


class TestedWhole(NamedTuple):
    """The network that groups are parts of."""

    observations: int
    redundancy: int
    omega: float
    """vᵀPv."""
    level: float
    """Of all tests of groups together."""


class Summed(NamedTuple):
    """Sums over the observations of one thing."""

    partition: int
    number: int
    of: str
    name: str
    sums: FloatArray
    """(4,) Σ v·Pv, Σ r, number of observations, and the number that tells which ones."""


def tests_of_sums(
    summed: list[Summed],
    whole: TestedWhole,
    exactly: Callable[[Summed], Moments | None],
    found: Sequence[Partition],
) -> GroupTests:
    """Tests of sums over groups; ``exactly`` works the moments out of those that their sums do not decide.

    Where it gives none, those of largest variance are taken: such a test rejects less often than its level.
    """
    controlled = [one for one in summed if one.sums[1] > CONTROLLED]
    tests = _without_twins(controlled, whole.observations)
    if not tests:
        return GroupTests(whole.level, whole.level, (), tuple(found))
    each = sidak(whole.level, len(tests))
    return GroupTests(whole.level, each, tuple(_decided(tests, whole, each, exactly)), tuple(found))


def summed_groups(quality: Quality, network: Network, seed: int = 0) -> list[Summed]:
    """Sums over everything that is tested; those of parts of a network add up, each part having its own ``seed``."""
    found, several = partitions(quality.adjustment.problem, network), sets_beside_others(network)
    return [one for one in _summed(quality, found, seed) if one.of != "set" or one.name in several]


def _summed(quality: Quality, found: list[Partition], seed: int) -> list[Summed]:
    """Sums over the classes of all partitions."""
    sums = [np.zeros((_SUMS, len(partition.names))) for partition in found]
    random = np.random.default_rng(1977 + seed)
    for number, one in enumerate(quality.groups):
        for first in range(0, len(one.v), ROWS_AT_A_TIME):
            rows = slice(first, first + ROWS_AT_A_TIME)
            values = _of_rows(quality, number, rows, random)
            for partition, total in zip(found, sums, strict=True):
                classes = partition.of_rows(number, rows)
                if classes is not None:
                    _add(total, classes, values)
    for k, partition in enumerate(found):
        _take_out_shared(quality, partition, sums[k])
    return [
        Summed(k, c, partition.of, partition.names[c], sums[k][:, c])
        for k, partition in enumerate(found)
        for c in np.flatnonzero(sums[k][2] > 0.0).tolist()
    ]


def _of_rows(quality: Quality, number: int, rows: slice, random: np.random.Generator) -> FloatArray:
    """(4, k) what is summed, of some rows of a group."""
    one = quality.groups[number].at(rows)
    r = one.r
    inside = np.isfinite(r)
    omega = np.where(inside, one.v * one.weighted, 0.0)
    count = inside.sum(axis=1)
    return np.stack(
        [omega.sum(axis=1), np.where(inside, r, 0.0).sum(axis=1), count, count * random.random(len(r))]
    )


def _add(total: FloatArray, classes: IntArray, values: FloatArray) -> None:
    inside = classes >= 0
    if not inside.all():
        classes, values = classes[inside], values[:, inside]
    for k in range(_SUMS):
        total[k] += np.bincount(classes, values[k], total.shape[1])


def _take_out_shared(quality: Quality, partition: Partition, total: FloatArray) -> None:
    """Observations that are correlated with those of another class take no part: neither class has them alone."""
    for groups, rows, components in shared_between(quality, partition):
        for number, row, component in zip(groups, rows, components, strict=True):
            classes = partition.of_rows(number, np.array([row]))
            one = quality.groups[number].at(np.array([row]))
            if classes is not None and classes[0] >= 0 and np.isfinite(one.r[0, component]):
                part = one.v[0, component] * one.weighted[0, component], one.r[0, component], 1.0
                total[:3, classes[0]] -= part


def shared_between(quality: Quality, partition: Partition) -> list[tuple[IntArray, IntArray, IntArray]]:
    """Groups, rows and components of the clusters of correlated observations that reach over several classes."""
    found = []
    classes = [partition.of_rows(number, slice(None)) for number in range(len(quality.groups))]
    for cluster in quality.adjustment.plan.clusters:
        own = {
            -1 if classes[number] is None else int(classes[number][row])
            for number, row in zip(cluster.groups.tolist(), cluster.rows.tolist(), strict=True)
        }
        if len(own) > 1:
            found.append((cluster.groups, cluster.rows, cluster.components))
    return found


def _without_twins(
    summed: list[Summed], observations: int
) -> list[tuple[Summed, tuple[tuple[str, str], ...]]]:
    """Each set of observations once, with all its names; that of all observations not at all."""
    twins: dict[tuple[int, float], list[Summed]] = {}
    for one in summed:
        twins.setdefault((int(one.sums[2]), round(float(one.sums[3]), 7)), []).append(one)
    return [
        (first, tuple((twin.of, twin.name) for twin in rest))
        for first, *rest in twins.values()
        if first.sums[2] < observations
    ]


def _decided(
    tests: list[tuple[Summed, tuple[tuple[str, str], ...]]],
    whole: TestedWhole,
    level: float,
    exactly: Callable[[Summed], Moments | None],
) -> list[GroupTest]:
    omega, redundancy, count, _ = np.stack([one.sums for one, _ in tests], axis=1)
    limit, both = float(np.log(level)), bounds(redundancy, count, float(whole.redundancy))
    rejects = [log_tail(omega, some) < limit for some in both]
    decided = []
    for k, (one, also) in enumerate(tests):
        numbers = int(count[k]), float(redundancy[k]), float(omega[k])
        known = exactly(one) if rejects[0][k] != rejects[1][k] else None
        least = rejects[0][k] == rejects[1][k] and not rejects[0][k]
        some = known or Moments(*(part[k : k + 1] for part in both[0 if least else 1]))
        log_p = float(log_tail(omega[k : k + 1], some)[0])
        test = GroupTest(
            one.partition, one.number, one.of, one.name, also, *numbers, some, log_p, log_p < limit
        )
        decided.append(replace(test, log_p_beside_rest=_beside_rest(whole, test)) if test.rejected else test)
    return decided


def _beside_rest(whole: TestedWhole, test: GroupTest) -> float:
    """ln of the two-sided probability of F(freedom, rest)."""
    rest, rest_omega = whole.redundancy - test.redundancy, whole.omega - test.omega
    if rest <= CONTROLLED or rest_omega <= 0.0:
        return 0.0
    ratio, freedom = test.omega / test.redundancy / (rest_omega / rest), test.freedom
    above = log_p_f(np.array([ratio]), freedom, rest)[0]
    below = log_p_f(np.array([1.0 / ratio]), rest, freedom)[0] if ratio > 0.0 else -np.inf
    return float(min(np.log(2.0) + min(above, below), 0.0))


def rows_of_test(quality: Quality, test: GroupTest, partition: Partition) -> WhitenedRows:
    """The observations of a test, without those that are correlated with others'."""
    return _rows(quality, partition, test.number)


def _rows(quality: Quality, partition: Partition, number: int) -> WhitenedRows:
    chosen = rows_of(partition, number, quality.adjustment.problem.groups)
    for groups, rows, components in shared_between(quality, partition):
        for group, row, component in zip(groups, rows, components, strict=True):
            chosen[group][row, component] = False
    return whitened_rows(quality, chosen)
