"""Tests of groups of observations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.special import betainc, gammainc

from mor.model.contract import ObservationGroup
from mor.project.entities import Entities, thing_of
from mor.project.network import Network
from mor.quality.assessment import Quality
from mor.quality.external_reliability import WhitenedRows, whitened_rows
from mor.quality.test_statistics import CONTROLLED, LEVEL, ROWS_AT_A_TIME, log_p_chi2, log_p_f, log_p_normal, sidak
from mor.solve.problem import Problem
from mor.types import AnyIntArray, BoolArray, FloatArray, IntArray, pieces

# ---- Which observations belong together: by table, image, camera, station, set, instrument, local system.
#
# Each of these is a partition of the observations, or of some of them. What is wrong with a thing is wrong
# with all that was observed with it, so that their residuals are tested together.

NOBODY = -1


class Partition(NamedTuple):
    """Observations by the thing they were made with."""

    of: str
    """``group``, ``image``, ``camera``, ``station``, ``set``, ``instrument`` or ``system``."""
    names: Sequence[str]
    """Names of its classes."""
    numbers: tuple[AnyIntArray | None, ...]
    """For each group of observations what tells of each row (n,) whose it is; ``None`` where none is anybody's."""
    classes: tuple[IntArray, ...]
    """For each group the class that each of these numbers stands for, −1 for none."""

    def of_rows(self, group: int, rows: IntArray | slice) -> IntArray | None:
        """(k,) classes of some rows of a group, −1 where a row is in none; ``None`` where no row is in any."""
        numbers = self.numbers[group]
        return None if numbers is None else self.classes[group][numbers[rows]]

    def members(self, group: int, one: int) -> IntArray:
        """Rows of a group that are in a class."""
        found = self.of_rows(group, slice(None))
        return np.flatnonzero(found == one) if found is not None else np.zeros(0, dtype=np.int64)


def partitions(problem: Problem, network: Network) -> list[Partition]:
    """All partitions that say anything; tables first."""
    things, groups = network.things, problem.groups
    stations = _standpoints(network)
    images = things["image"]
    of_image = _named("image", images.numbers)

    def tell(group: ObservationGroup) -> _Told | None:
        told = of_image(group)
        if told is None:
            return None
        return told[0], np.where(told[1] >= 0, images.parts["camera"][np.maximum(told[1], 0)], NOBODY)

    found = [
        _by_group(groups),
        _partition("image", things["image"].ids, groups, _named("image", things["image"].numbers)),
        _partition("camera", things["camera"].ids, groups, tell),
        _partition("station", tuple(dict.fromkeys(stations)), groups, _from_station(stations)),
        _partition("set", things["station"].ids, groups, _named("station", things["station"].numbers)),
        _partition("instrument", things["instrument"].ids, groups, _by_instrument(things["instrument"])),
        _partition("system", things["system"].ids, groups, _named("system", things["system"].numbers)),
    ]
    return [one for one in found if one.names and any(numbers is not None for numbers in one.numbers)]


_Told = tuple[AnyIntArray, IntArray]
"""What tells of each row whose it is, and the class each of these numbers stands for."""
_Teller = Callable[[ObservationGroup], _Told | None]


def _partition(of: str, names: Sequence[str], groups: tuple[ObservationGroup, ...], tell: _Teller) -> Partition:
    told = [tell(group) for group in groups]
    nothing = np.zeros(0, dtype=np.int64)
    numbers = tuple(one[0] if one is not None else None for one in told)
    return Partition(of, names, numbers, tuple(one[1] if one is not None else nothing for one in told))


def _by_group(groups: tuple[ObservationGroup, ...]) -> Partition:
    numbers = tuple(np.broadcast_to(np.int32(0), (group.count,)) for group in groups)
    return Partition(
        "group", [group.name for group in groups], numbers, tuple(np.array([k]) for k in range(len(groups)))
    )


def _named(reference: str, classes: Mapping[str, int]) -> _Teller:
    def tell(group: ObservationGroup) -> _Told | None:
        for own, names in zip(group.type.references, group.references, strict=True):
            if own.name == reference:
                known = np.full(len(names.known), NOBODY)
                used = np.unique(names.numbers)
                known[used] = [classes.get(names.known[k], NOBODY) for k in used]
                return names.numbers, known
        return None

    return tell


def _standpoints(network: Network) -> dict[str, str]:
    sets = network.sets
    return {name: sets[name][0] if name in sets else name for name in network.things["station"].ids}


def sets_beside_others(network: Network) -> set[str]:
    """Names of the sets of directions at stations that have more than one."""
    stations = _standpoints(network)
    count = Counter(stations.values())
    return {name for name, station in stations.items() if count[station] > 1}


def _from_station(stations: dict[str, str]) -> _Teller:
    """Rows by the station whose instrument they were read at; levelled lines and vectors have none."""
    places = {station: k for k, station in enumerate(dict.fromkeys(stations.values()))}
    classes = {name: places[station] for name, station in stations.items()}
    tellers = [_named(name, classes) for name in ("station", "at", "from")]

    def tell(group: ObservationGroup) -> _Told | None:
        if group.type.between_marks:
            return None
        told = next((told for teller in tellers if (told := teller(group)) is not None), None)
        return told if told is not None and (told[1] >= 0).any() else None

    return tell


def _by_instrument(instruments: Entities) -> _Teller:
    def tell(group: ObservationGroup) -> _Told | None:
        for slot, blocks in group.blocks_by_slot:
            if slot.of == "instrument" and slot.part in instruments.parts:
                own = instruments.parts[slot.part]
                classes = np.full(max(int(blocks.max(initial=0)), int(own.max(initial=0))) + 1, NOBODY)
                classes[own] = np.arange(len(own))
                classes[0] = NOBODY  # the block of those that refer to no instrument
                return (blocks, classes) if (classes[blocks] >= 0).any() else None
        return None

    return tell


def rows_of(partition: Partition, one: int, groups: tuple[ObservationGroup, ...]) -> list[BoolArray]:
    """(n, m) of each group: the observations of a class that take part in the adjustment."""
    found = []
    for number, group in enumerate(groups):
        inside = np.zeros(group.observed.shape, dtype=bool)
        rows = partition.members(number, one)
        inside[rows] = group.used_among(rows)
        found.append(inside)
    return found


# ---- The part that some observations have in vᵀPv: how it is distributed.
#
# Ω_g = v_gᵀ P_g v_g of whitened residuals with the cofactors R_g, a diagonal block of the projection R, is a
# sum of squares of independent normal variables, weighted with the eigenvalues λ of R_g, 0 ≤ λ ≤ 1. It is χ²
# only where all of them are 0 or 1, as for all observations together. It has
#
#     E Ω_g = Σλ = tr R_g = Σr,    Var Ω_g = 2 Σλ² = 2 tr R_g²,    third cumulant 8 Σλ³ = 8 tr R_g³,
#
# and (Ω_g − Σλ)/√(2 Σλ²) is compared with (χ²_ν − ν)/√(2ν), ν = (Σλ²)³/(Σλ³)², which has the same three (E.
# S. Pearson, 1959; J. P. Imhof, 1961). That one begins above 0 where λ differ much; below the mean it is
# (Σλ²/Σλ) χ²_ν with the first two, ν = (Σλ)²/Σλ² (F. E. Satterthwaite, 1946), instead.
#
# Σr is known of all observations. Σλ² is not, as it needs cofactors between each two of them; it lies between
# (Σr)²/n, all λ alike, and Σr, all λ 0 or 1. What both say alike needs no more. Where they differ it is
# worked out: exactly for few observations, for many by M. F. Hutchinson's (1989) estimate from a few random
# vectors of signs.

MOST_PROBES = 64
"""Observations up to which moments are exact, and vectors of signs for more."""


class Moments(NamedTuple):
    """Σλ, Σλ² and Σλ³ of k quadratic forms, (k,) each."""

    first: FloatArray
    second: FloatArray
    third: FloatArray

    @property
    def freedom(self) -> FloatArray:
        """(k,) ν."""
        return np.asarray(self.second**3 / self.third**2)


def bounds(redundancy: FloatArray, count: FloatArray, whole: float) -> tuple[Moments, Moments]:
    """Moments (k,) of least and largest variance that Σr (k,) of so many observations (k,) allows.

    R is a projection of the rank ``whole``, so that Σr − Σλ² = ‖R_gh‖² ≤ whole − Σr, h all other observations.
    """
    each = redundancy / np.maximum(count, 1.0)
    each = np.maximum(each, (2.0 * redundancy - whole) / redundancy)
    largest = np.minimum(redundancy, 1.0)  # all in eigenvalues of 1, or in one below 1
    return tuple(  # type: ignore[return-value]
        Moments(redundancy, redundancy * one, redundancy * one**2) for one in (each, np.maximum(largest, each))
    )


def moments(rows: WhitenedRows, redundancy: float) -> Moments:
    """Moments (1,) of the part of vᵀPv of the chosen observations; ``redundancy`` is their Σr."""
    count = rows.design.shape[0]
    probes = np.eye(count if count <= MOST_PROBES else 0)
    if count > MOST_PROBES:
        # Vectors of signs times redundancy: as Σλ² is off by about 2/√(k ν) of itself with k of them, by 2 %.
        several = int(np.clip(np.ceil(10_000.0 / redundancy), 2, MOST_PROBES))
        signs = np.random.default_rng(1989).integers(0, 2, (count, several))
        probes = (2.0 * signs - 1.0) / np.sqrt(several)
    once = rows.residuals_of(probes)
    second, third = float(np.sum(once**2)), float(np.sum(once * rows.residuals_of(once)))
    least, largest = bounds(np.array([redundancy]), np.array([float(count)]), np.inf)
    second = float(np.clip(second, least.second[0], largest.second[0]))
    third = float(np.clip(third, second**2 / redundancy, second * largest.third[0] / largest.second[0]))
    return Moments(np.array([redundancy]), np.array([second]), np.array([third]))


def log_tail(omega: FloatArray, of: Moments) -> FloatArray:
    """ln of twice the smaller of P(Ω_g ≥ ω) and P(Ω_g ≤ ω), (k,): the two-sided probability; at most 0."""
    freedom = np.broadcast_to(of.freedom, omega.shape)
    square = np.maximum(freedom + (omega - of.first) * np.sqrt(freedom / of.second), 0.0)
    half = np.broadcast_to(0.5 * of.first**2 / of.second, omega.shape)
    with np.errstate(divide="ignore"):
        below = np.log(gammainc(half, np.maximum(omega, 0.0) * half / of.first))
    one_sided = np.where(omega > of.first, log_p_chi2(square, freedom), below)
    return np.asarray(np.minimum(np.log(2.0) + one_sided, 0.0))


# ---- Tests of what was observed together: of each table, image, camera, station, set, instrument, local system.
#
# A few observations that are all wrong, as distances without their prism constant, hardly change vᵀPv of
# thousands. So the part that each group has in vᵀPv is put to a two-sided test of its own, by the distribution of
# a quadratic form (below). All these tests together reject an adjustment without errors with one level: each
# takes the share of it that Šidák's inequality leaves it. Groups of the same observations are one test, the
# only set of a station is part of that station's, and the whole has the global test.

_SUMS = 4
"""Σ v·Pv, Σ r, number of observations, and a random number for each of them: the same for the same observations."""


@dataclass(frozen=True)
class GroupStatistic:
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
    tests: tuple[GroupStatistic, ...]
    partitions: tuple[Partition, ...]

    @property
    def rejected(self) -> list[GroupStatistic]:
        """Tests that reject, the worst beside all others first."""
        return sorted((test for test in self.tests if test.rejected), key=lambda test: test.log_p_beside_rest)

    @property
    def all_alike(self) -> bool:
        """True where some reject, but none of them beside the others: all σ seem wrong by one factor."""
        limit, rejected = float(np.log(self.level_of_each)), self.rejected
        return bool(rejected) and all(test.log_p_beside_rest > limit for test in rejected)

    def rows(self, test: GroupStatistic, problem: Problem) -> list[BoolArray]:
        """(n, m) of each group of observations: those of a test."""
        return rows_of(self.partitions[test.partition], test.number, problem.groups)


def group_tests(quality: Quality, network: Network) -> GroupTests:
    """Tests of all groups that are not the whole."""
    problem = quality.adjustment.problem
    found = partitions(problem, network)

    several = sets_beside_others(network)
    summed = [one for one in _summed(quality, found) if one.of != "set" or one.name in several]
    controlled = [one for one in summed if one.sums[1] > CONTROLLED]
    tests = _without_twins(controlled, problem.observations)
    level = quality.levels.overall
    if not tests:
        return GroupTests(level, level, (), tuple(found))
    each = sidak(level, len(tests))
    return GroupTests(level, each, tuple(_decided(tests, quality, each, found)), tuple(found))


class Summed(NamedTuple):
    """Sums over the observations of one thing."""

    partition: int
    number: int
    of: str
    name: str
    sums: FloatArray
    """(4,) Σ v·Pv, Σ r, number of observations, and the number that tells which ones."""


def _summed(quality: Quality, found: list[Partition]) -> list[Summed]:
    sums = [np.zeros((_SUMS, len(partition.names))) for partition in found]
    random = np.random.default_rng(1977)
    for number, one in enumerate(quality.groups):
        for rows in pieces(len(one.v), ROWS_AT_A_TIME):
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
    return np.stack([omega.sum(axis=1), np.where(inside, r, 0.0).sum(axis=1), count, count * random.random(len(r))])


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


def _without_twins(summed: list[Summed], observations: int) -> list[tuple[Summed, tuple[tuple[str, str], ...]]]:
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
    quality: Quality,
    level: float,
    of_partitions: Sequence[Partition],
) -> list[GroupStatistic]:
    """Tests at a level; moments are worked out where those of smallest and largest variance decide differently."""
    omega, redundancy, count, _ = np.stack([one.sums for one, _ in tests], axis=1)
    limit, both = float(np.log(level)), bounds(redundancy, count, float(quality.redundancy))
    rejects = [log_tail(omega, some) < limit for some in both]
    decided = []
    for k, (one, also) in enumerate(tests):
        numbers = int(count[k]), float(redundancy[k]), float(omega[k])
        if rejects[0][k] != rejects[1][k]:
            some = moments(rows_of_test(quality, of_partitions[one.partition], one.number), float(redundancy[k]))
        else:
            some = Moments(*(part[k : k + 1] for part in both[1 if rejects[0][k] else 0]))
        log_p = float(log_tail(omega[k : k + 1], some)[0])
        test = GroupStatistic(one.partition, one.number, one.of, one.name, also, *numbers, some, log_p, log_p < limit)
        decided.append(replace(test, log_p_beside_rest=_beside_rest(quality, test)) if test.rejected else test)
    return decided


def _beside_rest(quality: Quality, test: GroupStatistic) -> float:
    """ln of the two-sided probability of F(freedom, rest)."""
    rest, rest_omega = quality.redundancy - test.redundancy, quality.omega - test.omega
    if rest <= CONTROLLED or rest_omega <= 0.0:
        return 0.0
    ratio, freedom = test.omega / test.redundancy / (rest_omega / rest), test.freedom
    above = float(log_p_f(ratio, freedom, rest))
    below = float(log_p_f(1.0 / ratio, rest, freedom)) if ratio > 0.0 else -np.inf
    return float(min(np.log(2.0) + min(above, below), 0.0))


def rows_of_test(quality: Quality, partition: Partition, number: int) -> WhitenedRows:
    """The observations of a test, without those that are correlated with others'."""
    chosen = rows_of(partition, number, quality.adjustment.problem.groups)
    for groups, rows, components in shared_between(quality, partition):
        for group, row, component in zip(groups, rows, components, strict=True):
            chosen[group][row, component] = False
    return whitened_rows(quality, chosen)


# ---- Whether anything is rejected: only then causes are looked for.


class Rejection(Enum):
    """Tests that reject at ``LEVEL``: of all observations, of single ones, or of groups."""

    NOTHING = auto()
    SMALLER = auto()
    """Residuals smaller than their σ says, and nothing else."""
    LARGER = auto()
    """Residuals larger than their σ says."""


def rejection(quality: Quality, network: Network, tests: GroupTests | None = None) -> Rejection:
    """Return which tests reject, and to which side; ``tests`` are those of the groups, if they are known."""
    freedom = float(quality.redundancy)
    overall = freedom > 0.0 and _two_sided(quality.omega, freedom) < np.log(LEVEL)
    if (overall and quality.omega > freedom) or _largest(quality) < np.log(LEVEL):
        return Rejection.LARGER
    tests = tests or group_tests(quality, network)
    limit = np.log(sidak(LEVEL, len(tests.tests)))
    rejected = [test for test in tests.rejected if test.log_p < limit]
    if any(test.factor > 1.0 for test in rejected):
        return Rejection.LARGER
    return Rejection.SMALLER if rejected or overall else Rejection.NOTHING


def _two_sided(omega: float, freedom: float) -> float:
    """ln of the two-sided probability of χ²."""
    one = np.array([freedom])
    return float(log_tail(np.array([omega]), Moments(one, one, one))[0])


def _largest(quality: Quality) -> float:
    """ln of the probability of the largest test value among so many; 0 where none is flagged."""
    largest = 0.0
    for reliability, flags in zip(quality.reliability, quality.flagged, strict=True):
        rows = np.flatnonzero(flags.any(axis=1))
        if len(rows):
            largest = max(largest, float(np.abs(reliability.at(rows).test[flags[rows]]).max()))
    return float(log_p_normal(largest) + np.log(max(quality.adjustment.problem.observations, 1)))


# ---- What flagged observations have in common: a point, image, camera, station, set, instrument or table.
#
# A row of observations counts as flagged if the test of single observations flags it, or if mor left it out.
# Checks do not count: the project keeps them out. If flagged rows fell on all rows alike, their number among
# the n rows of a point would be at most binomial with the share of flagged rows. The thing with the smallest
# probability is named. Without its rows the next one is looked for, as long as the family-wise level is kept.

_AT_LEAST = 2


class CommonToFlagged(NamedTuple):
    """A thing that many of the flagged rows refer to."""

    of: str
    """``group``, ``image``, ``camera``, ``station``, ``set``, ``instrument``, ``system`` or ``point``."""
    name: str
    flagged: int
    """Number of its flagged rows."""
    rows: int
    all_flagged: int
    """Number of all flagged rows."""


class _Membership(NamedTuple):
    """Rows that refer to the things of one kind."""

    of: str
    names: Sequence[str]
    parts: Callable[[], Iterator[tuple[IntArray, AnyIntArray]]]
    """Some rows (k,) at a time, counted through all groups, and the numbers (k,) of what they refer to."""


def common_to_flagged(quality: Quality, network: Network) -> tuple[CommonToFlagged, ...]:
    """Return up to three things that more flagged rows refer to than chance explains, the clearest first."""
    groups = quality.adjustment.problem.groups
    used = [group.mask & (k < len(network.groups)) for k, group in enumerate(groups)]  # the last are checks
    parts = zip(quality.flagged, groups, used, strict=True)
    flagged = np.concatenate([np.zeros(0, bool), *(((f | g.left_out) & u).any(axis=1) for f, g, u in parts)])
    if np.count_nonzero(flagged) < _AT_LEAST:
        return ()
    counted: BoolArray = np.concatenate([np.zeros(0, bool), *(u.any(axis=1) for u in used)])
    memberships = list(_memberships(quality, network))
    found: list[CommonToFlagged] = []
    for _ in range(3):
        best = _clearest(memberships, flagged & counted, counted)
        if best is None:
            break
        one, number, rows = best
        mine = np.concatenate([some[things == number] for some, things in one.parts()])
        hit = int(np.count_nonzero(flagged[mine] & counted[mine]))
        of, name = one.of, one.names[number]
        if of == "point":  # or a projection centre
            of, name = thing_of(of, name)
        found.append(CommonToFlagged(of, name, hit, rows, int(np.count_nonzero(flagged))))
        counted = counted.copy()
        counted[mine] = False
    return tuple(found)


def _memberships(quality: Quality, network: Network) -> Iterator[_Membership]:
    problem = quality.adjustment.problem
    several = sets_beside_others(network)
    for partition in partitions(problem, network):
        # the only set of a station is that station
        counted = np.array([partition.of != "set" or name in several for name in partition.names], dtype=bool)
        yield _Membership(partition.of, partition.names, partial(_of_partition, problem.groups, partition, counted))
    if "point" in problem.index.blocks:
        yield _Membership("point", problem.index.blocks["point"].ids, partial(_of_points, problem.groups))


def _pieces_of_groups(groups: Sequence[ObservationGroup]) -> Iterator[tuple[int, slice, int]]:
    """Number of a group, some of its rows, and the number of the first of them."""
    first = 0
    for k, group in enumerate(groups):
        for some in pieces(group.count, 1_000_000):
            yield k, some, first + some.start
        first += group.count


def _of_partition(
    groups: Sequence[ObservationGroup], partition: Partition, counted: BoolArray
) -> Iterator[tuple[IntArray, AnyIntArray]]:
    for k, some, first in _pieces_of_groups(groups):
        own = partition.of_rows(k, some)
        if own is not None:
            here = np.flatnonzero((own >= 0) & counted[own])
            yield first + here, own[here]


def _of_points(groups: Sequence[ObservationGroup]) -> Iterator[tuple[IntArray, AnyIntArray]]:
    for k, some, first in _pieces_of_groups(groups):
        points = [blocks[some] for blocks in groups[k].blocks_of("point")]
        for i, blocks in enumerate(points):
            new = np.ones(len(blocks), dtype=bool)  # a row counts once for each point
            for before in points[:i]:
                new &= before != blocks
            yield first + np.flatnonzero(new), blocks[new]


def _clearest(
    memberships: Sequence[_Membership], flagged: BoolArray, counted: BoolArray
) -> tuple[_Membership, int, int] | None:
    """The thing whose flagged rows are least likely, with its number and its number of rows."""
    whole, hits = int(np.count_nonzero(counted)), int(np.count_nonzero(flagged))
    best: tuple[float, int, _Membership, int] | None = None
    tests = 0
    for one in memberships:
        n, k = np.zeros((2, len(one.names)), dtype=np.int64)
        for rows, things in one.parts():
            n += np.bincount(things[counted[rows]], minlength=len(n))
            k += np.bincount(things[flagged[rows]], minlength=len(k))
        tests += int(np.count_nonzero(n))
        some = np.flatnonzero((k >= _AT_LEAST) & (n < whole))
        if not len(some):
            continue
        p = _tail(np.asarray(k[some], float), np.asarray(n[some], float), hits / whole)
        place = int(np.lexsort((n[some], p))[0])
        ranked = float(p[place]), int(n[some][place])
        if best is None or ranked < best[:2]:
            best = (*ranked, one, int(some[place]))
    if best is None or best[0] * tests >= LEVEL:
        return None
    return best[2], best[3], best[1]


def _tail(k: FloatArray, n: FloatArray, share: float) -> FloatArray:
    return np.asarray(betainc(k, n - k + 1.0, share), dtype=np.float64)
