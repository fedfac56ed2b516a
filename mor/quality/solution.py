"""The adjusted network with its quality and its verdict."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from mor.model import rotations
from mor.model.parameters import tangents
from mor.project.entities import thing_of
from mor.project.network import Network
from mor.project.planned_network import ImagePoses, image_poses, with_image_poses
from mor.quality.assessment import (
    REDUNDANCY_LOST,
    Levels,
    Quality,
    joint_cofactors,
    sigma_of_geometry,
    told_by_user,
)
from mor.quality.determinability import UnsettledUnknowns, last_movements
from mor.quality.external_reliability import PointEffect, effects
from mor.quality.global_tests import GroupEffect, common_effects, fits_one_factor, fixed_point_tests
from mor.quality.group_tests import (
    CommonToFlagged,
    GroupStatistic,
    GroupTests,
    Moments,
    common_to_flagged,
    group_tests,
    log_tail,
    rows_of_test,
)
from mor.quality.outliers import SuspectedOutliers, with_suspects
from mor.quality.reliability_map import Controlled, reliability_map
from mor.quality.robust_estimation import Method, RobustSolution, reweighted, robust_estimate
from mor.quality.snooping import SnoopingResult, snoop
from mor.quality.test_statistics import ObservationQuality, log_p_normal, log_p_student
from mor.quality.variance_components import Components, components, iterated_components
from mor.quality.variance_components import Method as ComponentMethod
from mor.solve.datum import network_components
from mor.solve.iterate import Adjustment, Outcome
from mor.types import BoolArray, FloatArray, IntArray

# ---- Directions that are determined, but hardly: which unknowns move together, and how far.


class WeakDirection(NamedTuple):
    """A direction that the observations hardly determine."""

    unknowns: tuple[tuple[str, str, str], ...]
    """(kind, block, component); points follow what they hang on, and those come first of whose variance it is most."""
    sigmas: tuple[float, ...]
    """Standard deviation of each along this direction, internal units, with its sign: they move together."""


def weak_directions(adjustment: Adjustment, quality: Quality | None) -> list[WeakDirection]:
    """Weak directions that the datum leaves, the weakest first; without a solution those at the last values.

    Up to six unknowns are told of each: those that have more than half of their variance from it.
    """
    weak, normals = adjustment.inverse.weak, adjustment.normals
    if weak.shape[1] == 0 or (quality is None and not len(normals.diagonal)):
        return []
    null, bound = adjustment.defect.datum, adjustment.constraint.normals
    if null.shape[1]:
        weak = weak - null @ rotations.solve(bound.T @ null, bound.T @ weak)
    index = adjustment.problem.index
    variance = np.sum(weak**2, axis=1)
    if quality is None:
        variance[adjustment.plan.kept] += 1.0 / normals.diagonal
    else:
        for kind, columns in index.columns.items():
            diagonal = np.diagonal(quality.cofactors[kind], axis1=1, axis2=2)
            variance[columns[columns >= 0]] = diagonal[columns >= 0]
    factor = 1.0 if quality is None else quality.sigma_factor
    share = weak**2 / np.maximum(variance, 1e-300)[:, None]
    of_points = np.zeros(index.count, dtype=bool)
    of_points[index.columns["point"][index.columns["point"] >= 0]] = True
    directions = []
    for k in range(weak.shape[1]):
        moving = np.flatnonzero(share[:, k] > 0.5)
        told = moving[np.lexsort([-share[moving, k], of_points[moving]])][:6]
        if len(told):
            directions.append(
                WeakDirection(
                    tuple(index.label(int(column)) for column in told),
                    tuple(float(factor * weak[column, k]) for column in told),
                )
            )
    return directions


# ---- What to think of an adjustment: do the observations agree, which groups contradict, is the result determined.

_LEAST_LEFT = 1.0
"""Redundancy that an effect must leave: a group that is used up by it says nothing for it."""


class Explained(NamedTuple):
    """Change that would bring a rejected group into line with its σ."""

    test: GroupStatistic
    flagged: int
    """Number of its observations that the test of single observations flags."""
    share_of_flagged: float
    """Their part of its part of vᵀPv."""
    largest: float
    """The largest |w| of these, 0 where none is flagged."""
    effect: GroupEffect | None
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


class Determination(NamedTuple):
    """Determination of the result, independent of residuals. σ are those of ``sigma_of_geometry``."""

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


class OverallAssessment(NamedTuple):
    """The tests of the whole and of the groups together, and whether the result is determined."""

    tests: GroupTests
    explained: tuple[Explained, ...]
    """The worst of the rejected groups; those first of which an effect or an observation explains most of vᵀPv."""
    all_alike: bool
    """True if groups are rejected, none of them beside the others, and the w of all are normal with one factor."""
    chosen_only: bool
    """True where the fixed coordinates are the datum and no more: no observation controls them."""
    determined: Determination

    @property
    def contradicted(self) -> bool:
        """True where the test of a group rejects."""
        return bool(self.tests.rejected)


def verdict(quality: Quality, network: Network, tests: GroupTests | None = None) -> OverallAssessment:
    """The tests of all groups of an adjustment, known ones or new ones, and what would explain those that reject."""
    tests = tests or group_tests(quality, network)
    rejected = tests.rejected
    limit = float(np.log(tests.level_of_each))
    alike = tests.all_alike and fits_one_factor(quality)
    beside = sum(test.log_p_beside_rest <= limit for test in rejected)
    # At least five, for what is worst beside the rest need not be what is wrong; at most twenty.
    looked_at = rejected[: min(max(beside, 5), 20)]
    explained = [] if alike else [_explained(quality, tests, test) for test in looked_at]
    # Two that contradict each other gain alike: round-off must not say which comes first.
    explained.sort(key=lambda one: -float(f"{one.gain:.6g}"))
    return OverallAssessment(tests, tuple(explained), alike, _chosen_only(quality), determined(quality))


def determined(quality: Quality) -> Determination:
    """Return how well the points of an adjustment are determined."""
    adjustment = quality.adjustment
    size, directions = 2.0 * quality.size, len(weak_directions(adjustment, quality))
    if "point" not in quality.cofactors or size == 0.0:
        return Determination(size, 0, 0.0, 0.0, (), directions)
    index = adjustment.problem.index
    judged = np.flatnonzero((index.columns["point"] >= 0).any(axis=1) & ~told_by_user(quality, "point"))
    if len(judged) == 0:
        return Determination(size, 0, 0.0, 0.0, (), directions)
    sigma = sigma_of_geometry(quality) * quality.longest_axes[judged]
    order = np.argsort(-sigma, kind="stable")
    order = order[sigma[order] > LARGEST_SIGMA * size]
    ids = index.blocks["point"].ids
    beyond = tuple((*thing_of("point", ids[judged[k]]), float(sigma[k])) for k in order.tolist())
    return Determination(size, len(judged), float(sigma.max()), float(np.median(sigma)), beyond, directions)


def _chosen_only(quality: Quality) -> bool:
    """True where coordinates are held fixed, but so few that nothing controls them."""
    _, fixed = network_components(quality.adjustment.problem, quality.adjustment.values)
    # A whole network has seven movements: shifts, turns, scale.
    return 0 < int(np.count_nonzero(fixed)) <= 7 and not any(test.freedom for test in fixed_point_tests(quality))


def _explained(quality: Quality, tests: GroupTests, test: GroupStatistic) -> Explained:
    chosen = tests.rows(test, quality.adjustment.problem)
    single = _single_observations(quality, chosen, test.omega)
    if test.omega < test.redundancy:  # residuals that are too small: no effect makes them so
        return Explained(test, *single, None, False)
    rows = partial(rows_of_test, quality, tests.partitions[test.partition], test.number)
    effects = [
        effect
        for effect in common_effects(quality, rows, chosen, test.redundancy)
        if abs(effect.test) > quality.critical
    ]
    limit = float(np.log(tests.level_of_each))
    enough = [effect for effect in effects if _accepted(test, effect, limit)]
    found = enough or [effect for effect in effects if _beside_what_is_left(effect, quality.critical)]
    return Explained(test, *single, found[0] if found else None, bool(enough))


def _beside_what_is_left(effect: GroupEffect, critical: float) -> bool:
    """True where an effect is significant beside the residuals it leaves: those of a gross error have any offset."""
    if effect.redundancy < _LEAST_LEFT:
        return False
    return bool(log_p_student((effect.test / effect.factor) ** 2, effect.redundancy) < log_p_normal(critical))


def _accepted(test: GroupStatistic, effect: GroupEffect, limit: float) -> bool:
    if effect.redundancy < _LEAST_LEFT:
        return False
    share = effect.redundancy / test.redundancy
    left = Moments(*(share * part for part in test.moments))
    return bool(log_tail(np.array([effect.omega]), left)[0] >= limit or effect.omega < effect.redundancy)


def _single_observations(quality: Quality, chosen: list[BoolArray], omega: float) -> tuple[int, float, float]:
    """Number of flagged ones among the chosen, their share of ``omega``, and the largest |w|."""
    count, part, largest = 0, 0.0, 0.0
    for one, reliability, flags, mask in zip(quality.groups, quality.reliability, quality.flagged, chosen, strict=True):
        rows = np.flatnonzero((flags & mask).any(axis=1))
        if len(rows):
            here, some = (flags & mask)[rows], one.at(rows)
            count += int(np.count_nonzero(here))
            part += float((some.v * some.weighted)[here].sum())
            largest = max(largest, float(np.abs(reliability.at(rows).test[here]).max()))
    return count, part / omega if omega > 0.0 else 0.0, largest


# ---- What is done about gross errors and weights after the first adjustment, as the project asks for it.


class TreatmentOptions(NamedTuple):
    """Treatment that the project asks for."""

    snooping: bool = False
    robust: Method | None = None
    iterate_components: bool = False
    component_method: ComponentMethod = "simplified"


class Treatment(NamedTuple):
    """Treatment that was applied."""

    components: Components
    snooping: SnoopingResult | None = None
    robust: RobustSolution | None = None


def treat(
    quality: Quality,
    levels: Levels,
    aposteriori: bool,
    wanted: TreatmentOptions,
    suspects: SuspectedOutliers | None = None,
) -> tuple[Quality, Treatment]:
    """Robust comparison, data snooping (starting from what the robust solution rejects), variance components.

    Data snooping begins with the suspects taken out, if there are any, and may put them back. With components iterated,
    it goes over it again with the new weights.
    """
    problem, rejected = quality.adjustment.problem, None
    if suspects is not None and wanted.snooping:
        problem, rejected = with_suspects(problem, suspects)
    robust = robust_estimate(quality, wanted.robust) if wanted.robust is not None else None
    snooping = None
    if wanted.snooping:
        if rejected is None and robust is not None and robust.settled:
            rejected = robust.rejected
        snooping = snoop(problem, quality, levels, aposteriori, rejected)
        quality = snooping.quality
    if not wanted.iterate_components:
        return quality, Treatment(components(quality, wanted.component_method), snooping, robust)
    found, quality = iterated_components(quality, levels, aposteriori, wanted.component_method)
    if snooping is not None and found.settled:
        weighted = reweighted(problem, [found.of(group, k) for k, group in enumerate(problem.groups)])
        out = quality.adjustment.problem.left_out
        again = snoop(weighted, quality, levels, aposteriori, out)
        snooping = again.after(snooping)
        quality = again.quality
    return quality, Treatment(found, snooping, robust)


# ---- A network together with what became of it.


class AddedParameter(NamedTuple):
    """Value of the parameter that a mistake adds."""

    name: str
    """offset, scale, height, c, …"""
    value: float
    """Internal units."""


class ScoredHypothesis(NamedTuple):
    """A mistake that would explain what is rejected, by a score test: not verified by an adjustment."""

    cause: str
    """Key of the cause: ``names exchanged``, ``distance offset``, …"""
    things: tuple[str, ...]
    """Names of the points, stations, images or tables it is about."""
    line: str
    """What to change in the project to try it."""
    gain: float
    """Decrease of vᵀPv to first order."""
    parameters: int
    log10_p: float
    """Decimal logarithm of the probability that chance decreases vᵀPv as much."""
    amount: AddedParameter | None
    rows: tuple[tuple[int, int], ...] = ()
    """(group, row) of the observations that it changes, if they are few."""
    components: tuple[int, ...] = ()
    """Components of these that it changes in any row."""


@dataclass(frozen=True, eq=False)
class Solved:
    """A network with its adjustment, and its quality where the adjustment converged."""

    network: Network
    adjustment: Adjustment
    quality: Quality | None
    treatment: Treatment | None = None
    """What was done about gross errors and weights; ``None`` where there was no solution."""
    suspects: SuspectedOutliers | None = None
    """What was left out because all observations together have no solution."""
    possible_causes: tuple[ScoredHypothesis, ...] = ()
    """Mistakes that would explain what is rejected, by score tests; the best first."""
    tested: tuple[tuple[ObservationQuality, ...], GroupTests] | None = None
    """Tests of groups that were needed before, and the quality of the observations that they are of."""

    @cached_property
    def movements(self) -> UnsettledUnknowns | None:
        """Unknowns that do not come to rest if there is no solution; computed once for all reports."""
        if self.adjustment.reason == REDUNDANCY_LOST:
            return None  # it did come to rest
        if self.adjustment.outcome in (Outcome.NOT_CONVERGED, Outcome.DIVERGED):
            return last_movements(self.adjustment)
        return None

    @cached_property
    def effects(self) -> tuple[PointEffect, ...]:
        """Effects of the suspicious observations; computed once for all reports."""
        return tuple(effects(self.quality)) if self.quality is not None else ()

    @cached_property
    def common(self) -> tuple[CommonToFlagged, ...]:
        """Things that flagged observations have in common; computed once for all reports."""
        return common_to_flagged(self.quality, self.network) if self.quality is not None else ()

    @cached_property
    def verdict(self) -> OverallAssessment | None:
        """The tests of the groups and what would explain those that reject, worked out once for all reports."""
        if self.quality is None:
            return None
        groups, tests = self.tested or ((), None)
        return verdict(self.quality, self.network, tests if groups is self.quality.groups else None)

    @cached_property
    def reliability_map(self) -> tuple[Controlled, ...]:
        """Control of points, images, stations and sets; computed once for all reports."""
        return tuple(reliability_map(self.quality, self.network)) if self.quality is not None else ()

    @property
    def accepted(self) -> bool:
        """True if the global test and the tests of all groups accept, or without redundancy.

        False if the result as a whole is not determined.
        """
        quality, judged = self.quality, self.verdict
        if quality is None or judged is None or not quality.global_test.accepted or judged.contradicted:
            return False
        return judged.determined.as_a_whole


# ---- Images on a trajectory in the result: their poses and cofactors, from those of the knots.


def with_poses(solved: Solved) -> Solved:
    """The result in which images on trajectories have the poses of their times, and how precise these are."""
    network = solved.network
    if not network.image_times:
        return solved
    adjustment = solved.adjustment._replace(values=with_image_poses(network, solved.adjustment.values))
    if solved.quality is None:
        return replace(solved, adjustment=adjustment)
    parts = network.things["image"].parts
    cofactors = dict(solved.quality.cofactors)
    for kind in ("point", "rotation"):
        cofactors[kind] = cofactors[kind].copy()
    for found in image_poses(network, adjustment.values):
        for piece, position, rotation in _of_poses(solved.quality, found):
            images = found.images[piece]
            cofactors["point"][parts["position"][images]] = position
            cofactors["rotation"][parts["rotation"][images]] = rotation
    quality = replace(solved.quality, adjustment=adjustment, cofactors=cofactors)
    return replace(solved, adjustment=adjustment, quality=quality)


def _of_poses(quality: Quality, found: ImagePoses) -> Iterator[tuple[IntArray, FloatArray, FloatArray]]:
    """Some images after the other, (m,) of ``found``: cofactors (m, 3, 3) of positions and of small rotations."""
    index, values = quality.adjustment.problem.index, quality.adjustment.values
    tangent = tangents(index.blocks["rotation"], values["rotation"])
    for piece in _pieces(found.positions):
        positions, rotations = found.positions[piece], found.rotations[piece]
        columns = np.concatenate(
            [index.columns["point"][positions], index.columns["rotation"][rotations]], axis=1
        ).reshape(len(piece), -1)
        known, where = np.unique(columns, return_inverse=True)
        whole = joint_cofactors(quality, known)
        where = where.reshape(columns.shape)
        q = whole[where[:, :, None], where[:, None, :]]
        count = positions.shape[1]
        by_rotations = found.pose.by_rotations[piece]
        if tangent is not None:
            by_rotations = by_rotations @ tangent[rotations]
        design = np.zeros((len(piece), 6, 6 * count))
        for k in range(count):
            design[:, :3, 3 * k : 3 * k + 3] = found.pose.weights[piece, k, None, None] * np.eye(3)
            design[:, 3:, 3 * (count + k) : 3 * (count + k + 1)] = by_rotations[:, k]
        own = design @ q @ np.swapaxes(design, 1, 2)
        yield piece, own[:, :3, :3], own[:, 3:, 3:]


def _pieces(knots: IntArray) -> Iterator[IntArray]:
    """Rows (m,) of knots (n, k) in the order of their first knots, so many that they have few different knots."""
    order = np.argsort(knots[:, 0], kind="stable")
    # Knots whose columns of the inverse are worked out together.
    number = np.cumsum(np.diff(knots[order, 0], prepend=-1) > 0) // 32
    for k in np.unique(number):
        yield order[number == k]
