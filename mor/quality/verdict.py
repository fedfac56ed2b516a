"""What to think of an adjustment: do the observations agree, which groups contradict, is the result determined."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.datum.defect import network_components
from mor.arrays import BoolArray
from mor.geometry import tolerant
from mor.project.network.build import Network
from mor.project.network.entities import thing_of
from mor.quality.assess import Quality
from mor.quality.diagnosis.self_check import median_distance, sigma_of_geometry, told_by_user
from mor.quality.diagnosis.weak_directions import weak_directions
from mor.quality.tests.common_effects import CommonEffect, common_effects
from mor.quality.tests.fixed_coordinates import fixed_point_tests
from mor.quality.tests.group_tests import GroupTest, GroupTests, group_tests, rows_of_test
from mor.quality.tests.one_factor import fits_one_factor
from mor.quality.tests.p_values import log_p_normal, log_p_student
from mor.quality.tests.quadratic_form import Moments, log_tail

EXPLAINED, ALWAYS_EXPLAINED = 20, 5
"""Groups for which an explanation is looked for, at most where they reject beside all others, and in any case: what is
worst beside the rest need not be what is wrong."""
_LEAST_LEFT = 1.0
"""Redundancy that an effect must leave: a group that is used up by it says nothing for it."""
_MOST_MOVEMENTS = 7
"""Movements of a whole network: shifts, turns, scale."""


class Explained(NamedTuple):
    """What would bring a rejected group into line with its σ."""

    test: GroupTest
    flagged: int
    """Number of its observations that the test of single observations flags."""
    share_of_flagged: float
    """Their part of its part of vᵀPv."""
    largest: float
    """The largest |w| of these, 0 where none is flagged."""
    effect: CommonEffect | None
    """The most significant offset or scale, where it is significant beside what it leaves."""
    suffices: bool
    """True where with the effect the test accepts."""

    @property
    def gain(self) -> float:
        """By how much vᵀPv of all falls with the effect, or without the worst observation: one more unknown each."""
        return max(self.effect.test**2 if self.effect is not None else 0.0, self.largest**2)


LARGEST_SIGMA = 0.01
"""σ of a point, in parts of the size of the network, from which on the point is ill-determined.

Observations are linearised. A point that moves by δ at a distance D turns a sight by δ/D, and the second-order term,
which is neglected, is δ/(2D) of the first. For δ = 2σ (95 %) and σ = D/100 it is 1 %: up to there σ, tests and
ellipsoids hold to two digits."""


class Determined(NamedTuple):
    """How well the result is determined, whatever the residuals are. σ are those of ``sigma_of_geometry``."""

    size: float
    """Size of the network, length unit: twice the median distance of its points from their median."""
    points: int
    """Points and places of frames with unknown coordinates that were not observed themselves."""
    largest: float
    """Largest semi-axis of their ellipsoids (σ), length unit."""
    median: float
    beyond: tuple[tuple[str, str, float], ...]
    """(kind, name, σ) of those with σ beyond ``LARGEST_SIGMA`` of the size, the worst first."""
    directions: int
    """Number of directions that are hardly determined."""

    @property
    def as_a_whole(self) -> bool:
        """True if at least half of the points are determined."""
        return self.size == 0.0 or self.median <= LARGEST_SIGMA * self.size

    @property
    def everywhere(self) -> bool:
        """True if every point is determined and no direction is weak."""
        return self.as_a_whole and not self.beyond and not self.directions


class Verdict(NamedTuple):
    """The tests of the whole and of the groups together, and whether the result is determined."""

    tests: GroupTests
    explained: tuple[Explained, ...]
    """The worst of the rejected groups; those first of which an effect or an observation explains most of vᵀPv."""
    all_alike: bool
    """True if groups are rejected, none of them beside the others, and the w of all are normal with one factor."""
    chosen_only: bool
    """True where the fixed coordinates are the datum and no more: no observation controls them."""
    determined: Determined

    @property
    def contradicted(self) -> bool:
        """True where the test of a group rejects."""
        return bool(self.tests.rejected)


def verdict(quality: Quality, network: Network, tests: GroupTests | None = None) -> Verdict:
    """The tests of all groups of an adjustment, known ones or new ones, and what would explain those that reject."""
    tests = tests or group_tests(quality, network)
    rejected = tests.rejected
    limit = float(np.log(tests.level_of_each))
    alike = tests.all_alike and fits_one_factor(quality)
    beside = sum(test.log_p_beside_rest <= limit for test in rejected)
    looked_at = rejected[: min(max(beside, ALWAYS_EXPLAINED), EXPLAINED)]
    explained = [] if alike else [_explained(quality, tests, test) for test in looked_at]
    # Two that contradict each other gain alike: round-off must not say which comes first.
    explained.sort(key=lambda one: -float(f"{one.gain:.6g}"))
    return Verdict(tests, tuple(explained), alike, _chosen_only(quality), determined(quality))


def determined(quality: Quality) -> Determined:
    """Return how well the points of an adjustment are determined."""
    adjustment = quality.adjustment
    size, directions = 2.0 * median_distance(adjustment), len(weak_directions(quality))
    if "point" not in quality.cofactors or size == 0.0:
        return Determined(size, 0, 0.0, 0.0, (), directions)
    index = adjustment.problem.index
    judged = np.flatnonzero((index.columns["point"] >= 0).any(axis=1) & ~told_by_user(quality, "point"))
    if len(judged) == 0:
        return Determined(size, 0, 0.0, 0.0, (), directions)
    variance = tolerant.eigvalsh(quality.cofactors["point"][judged])[:, -1]
    sigma = sigma_of_geometry(quality) * np.sqrt(np.maximum(variance, 0.0))
    order = np.argsort(-sigma, kind="stable")
    order = order[sigma[order] > LARGEST_SIGMA * size]
    ids = index.blocks["point"].ids
    beyond = tuple((*thing_of("point", ids[judged[k]]), float(sigma[k])) for k in order.tolist())
    return Determined(size, len(judged), float(sigma.max()), float(np.median(sigma)), beyond, directions)


def _chosen_only(quality: Quality) -> bool:
    """True where coordinates are held fixed, but so few that nothing controls them."""
    _, fixed = network_components(quality.adjustment.problem, quality.adjustment.values)
    if not fixed.any() or np.count_nonzero(fixed) > _MOST_MOVEMENTS:
        return False
    return only_chosen_of(
        int(np.count_nonzero(fixed)), sum(test.freedom for test in fixed_point_tests(quality))
    )


def only_chosen_of(fixed: int, freedom: int) -> bool:
    """True where so many fixed coordinates are the datum and no more: their tests have no degree of freedom."""
    return bool(0 < fixed <= _MOST_MOVEMENTS and freedom == 0)


def _explained(quality: Quality, tests: GroupTests, test: GroupTest) -> Explained:
    chosen = tests.rows(test, quality.adjustment.problem)
    single = _single_observations(quality, chosen, test.omega)
    if test.omega < test.redundancy:  # residuals that are too small: no effect makes them so
        return Explained(test, *single, None, False)
    rows = rows_of_test(quality, test, tests.partitions[test.partition])
    effects = [
        effect
        for effect in common_effects(quality, rows, chosen, test.redundancy)
        if abs(effect.test) > quality.critical
    ]
    limit = float(np.log(tests.level_of_each))
    enough = [effect for effect in effects if _accepted(test, effect, limit)]
    found = enough or [effect for effect in effects if _beside_what_is_left(effect, quality.critical)]
    return Explained(test, *single, found[0] if found else None, bool(enough))


def _beside_what_is_left(effect: CommonEffect, critical: float) -> bool:
    """True where an effect is significant beside the residuals it leaves: those of a gross error have any offset."""
    if effect.redundancy < _LEAST_LEFT:
        return False
    square = np.array([(effect.test / effect.factor) ** 2])
    return bool(log_p_student(square, effect.redundancy)[0] < log_p_normal(np.array([critical]))[0])


def _accepted(test: GroupTest, effect: CommonEffect, limit: float) -> bool:
    """True where there is something left to test with an effect, and the test does not reject it."""
    if effect.redundancy < _LEAST_LEFT:
        return False
    share = effect.redundancy / test.redundancy
    left = Moments(*(share * part for part in test.moments))
    return bool(log_tail(np.array([effect.omega]), left)[0] >= limit or effect.omega < effect.redundancy)


def _single_observations(quality: Quality, chosen: list[BoolArray], omega: float) -> tuple[int, float, float]:
    """Number of flagged ones among the chosen, their share of ``omega``, and the largest |w|."""
    count, part, largest = 0, 0.0, 0.0
    for one, reliability, flags, mask in zip(
        quality.groups, quality.reliability, quality.flagged, chosen, strict=True
    ):
        rows = np.flatnonzero((flags & mask).any(axis=1))
        if len(rows):
            here, some = (flags & mask)[rows], one.at(rows)
            count += int(np.count_nonzero(here))
            part += float((some.v * some.weighted)[here].sum())
            largest = max(largest, float(np.abs(reliability.at(rows).test[here]).max()))
    return count, part / omega if omega > 0.0 else 0.0, largest
