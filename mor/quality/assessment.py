"""Assess an adjustment: residuals, redundancy, tests; and check the numerical solution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mor.model import rotations
from mor.model.contract import lengths_of_sights
from mor.model.coordinates import can_be_at_infinity, target_slot
from mor.model.images import is_image_point
from mor.model.parameters import KINDS, move
from mor.project.rows import rows_of_points
from mor.quality.precision import (
    FollowerCofactors,
    MovingCofactors,
    datum_transformation,
    follower_cofactors,
    moving_cofactors,
    parameter_cofactors,
)
from mor.quality.redundancy import Done, Reliability, observation_quality, of_operations
from mor.quality.test_statistics import (
    ChiSquareTest,
    ObservationQuality,
    critical_value,
    global_test,
    in_pieces,
    noncentrality,
    normalised_residuals,
    redundancy_of,
    sidak,
)
from mor.solve.datum import NOTHING_KNOWN, STransformation, Undetermined
from mor.solve.iterate import Adjustment, Outcome
from mor.solve.normals import image_of, objective
from mor.solve.problem import evaluated
from mor.types import BoolArray, FloatArray, IntArray, pieces
from mor.units import LENGTH

# ---- From an adjustment to its quality: everything a report says about trust.


class Levels(NamedTuple):
    """Levels of the tests: α0 and β0 of the test of single observations, level of the global test."""

    snooping: float = 0.001
    power: float = 0.8
    overall: float = 0.05
    familywise: float | None = None
    """Level of all tests of single observations together (Šidák); it takes the place of ``snooping``."""
    least_redundancy: float = 0.01
    """Redundancy number below which an observation is called uncontrolled."""


@dataclass(frozen=True)
class Quality:
    """Quality of an adjustment. Standard deviations are those of the report: a posteriori where there is redundancy."""

    adjustment: Adjustment
    redundancy: int
    redundancy_sum: float
    """Σ r, which must equal the redundancy: a self-check."""
    sigma0: float
    """A-posteriori standard deviation of unit weight; the a-priori one is 1."""
    sigma_factor: float
    """What cofactors are multiplied with to become standard deviations: σ0 a posteriori, 1 without redundancy."""
    levels: Levels
    global_test: ChiSquareTest
    critical: float
    """Critical value of |w|."""
    noncentrality: float
    """δ0² of α0 and β0."""
    groups: tuple[ObservationQuality, ...]
    reliability: tuple[Reliability, ...]
    """Test values, detectable errors and external reliability of each group."""
    cofactors: Mapping[str, FloatArray]
    """Cofactor matrices (n, k, k) of the blocks of each kind, in the datum of the adjustment; rotations as vectors."""
    datum: STransformation
    moving: MovingCofactors
    """Joint cofactors of the coordinates of points and of what moves them."""
    followers: FollowerCofactors
    """Of the poses of stereo followers, which are no blocks of their own."""

    @cached_property
    def flagged(self) -> tuple[BoolArray, ...]:
        """Observations whose test value |w| exceeds the critical value, by group; excluded ones are not among them."""
        groups = self.adjustment.problem.groups
        return tuple(
            _beyond(one, self.critical) & ~group.left_out for one, group in zip(self.reliability, groups, strict=True)
        )

    @property
    def w(self) -> tuple[FloatArray, ...]:
        """Normalised residuals v/σ_v of each group (n, m)."""
        return tuple(normalised_residuals(one) for one in self.groups)

    @property
    def omega(self) -> float:
        """vᵀPv."""
        return self.adjustment.normals.objective

    @cached_property
    def size(self) -> float:
        """Median distance of points from their median (see :func:`median_distance`)."""
        return median_distance(self.adjustment)

    @cached_property
    def longest_axes(self) -> FloatArray:
        """(n,) roots of the largest eigenvalues of the cofactors of the point blocks."""
        values = rotations.eigvalsh(np.nan_to_num(self.cofactors["point"]))[:, -1]
        return np.sqrt(np.maximum(values, 0.0))


def assess(
    adjustment: Adjustment, levels: Levels | None = None, aposteriori: bool = True, done: Done | None = None
) -> Quality:
    """Quality of a converged adjustment; standard deviations with σ0 a posteriori, or a priori (1).

    ``done`` is told how much more of :func:`mor.quality.redundancy.effort` is done.
    """
    levels = levels or Levels()
    problem = adjustment.problem
    cofactors = adjustment.inverse.selected(of_operations(done) if done is not None else None)
    datum = datum_transformation(adjustment)
    if levels.familywise is not None:
        levels = levels._replace(snooping=sidak(levels.familywise, problem.observations))
    redundancy = adjustment.redundancy
    omega = adjustment.normals.objective
    sigma0 = sigma_of_unit_weight(omega, redundancy)
    groups, of_eliminated = observation_quality(adjustment, cofactors, datum, done)
    ncp = noncentrality(levels.snooping, levels.power)
    blocks = {
        kind: parameter_cofactors(adjustment, cofactors, of_eliminated, datum, kind) for kind in problem.index.columns
    }
    return Quality(
        adjustment=adjustment,
        redundancy=redundancy,
        redundancy_sum=float(sum(redundancy_of(group) for group in groups)),
        sigma0=sigma0,
        sigma_factor=sigma0 if aposteriori else 1.0,
        levels=levels,
        global_test=global_test(omega, redundancy, levels.overall),
        critical=critical_value(levels.snooping),
        noncentrality=ncp,
        groups=groups,
        reliability=tuple(Reliability(one, ncp) for one in groups),
        cofactors=blocks,
        datum=datum,
        moving=moving_cofactors(adjustment, cofactors, datum),
        followers=follower_cofactors(adjustment, cofactors, datum),
    )


def sigma_of_unit_weight(omega: float, redundancy: int) -> float:
    """σ0 a posteriori, √(vᵀPv / r); 1 without redundancy."""
    return float(np.sqrt(omega / redundancy)) if redundancy > 0 else 1.0


def _beyond(one: Reliability, critical: float) -> BoolArray:
    return in_pieces(one.quality.v.shape, lambda rows: np.abs(np.nan_to_num(one.at(rows).test)) > critical)


def standard_deviations(quality: Quality, kind: str) -> FloatArray:
    """Standard deviations (n, size) of the blocks of a kind (rotations: of their small rotation); 0 where fixed."""
    variances = np.diagonal(quality.cofactors[kind], axis1=1, axis2=2)
    with np.errstate(invalid="ignore"):
        sigma: FloatArray = quality.sigma_factor * np.sqrt(np.maximum(variances, 0.0))
    return sigma


# ---- Is a converged solution one? The sum of the redundancy numbers, and unknowns with a σ beyond any use.
#
# Σ r = n − u + d holds exactly, whatever the observations are; where it does not, round-off has eaten the cofactors.
#
# A coordinate whose σ exceeds the size of the network, and a third of the distance of its point from the rest, is
# nowhere in particular: the point of two parallel lines of sight, or of two places that have fallen together. An angle
# is known worse than not at all from σ = π/√3 on, that of an angle spread evenly over the circle. Both come out of a
# system that is regular to the last digits, so that no pivot vanishes; what is linear over one σ elsewhere is not so
# there, and σ itself means nothing.

REDUNDANCY_LOST = (
    "the sum of the redundancy numbers is not the redundancy: round-off errors have destroyed the solution"
)
BEYOND_USE = "the standard deviations of unknowns are too large to be useful"
"""Reasons of outcomes."""
_BEYOND_MEDIAN = 10.0
"""Size of a network in units of the median distance of its points from their median."""


def checked(quality: Quality) -> Adjustment:
    """The adjustment of an assessed solution, with the outcome it deserves."""
    adjustment = quality.adjustment
    useless = beyond_use(quality)
    if useless:
        defect = replace(adjustment.defect, beyond_use=tuple(useless))
        return adjustment._replace(outcome=Outcome.SINGULAR, reason=BEYOND_USE, defect=defect)
    if not is_complete(quality.redundancy_sum, quality.redundancy):
        return adjustment._replace(outcome=Outcome.NOT_CONVERGED, reason=REDUNDANCY_LOST)
    return adjustment


def is_complete(redundancy_sum: float, redundancy: int) -> bool:
    """True where Σ r is the redundancy, but for round-off of exact cofactors: 10⁻³, or 10⁻⁶ of it in large systems."""
    return abs(redundancy_sum - redundancy) <= max(1e-3, 1e-6 * redundancy)


def beyond_use(quality: Quality) -> list[Undetermined]:
    """Blocks with unknowns whose σ is larger than the scale they live on; at most 1000, those first that are worst.

    Cameras come before what their constants move. σ are those of :func:`sigma_of_geometry`.
    """
    problem, found, factor = quality.adjustment.problem, [], sigma_of_geometry(quality)
    size = _BEYOND_MEDIAN * quality.size
    lengths = ("point", "base")  # kinds of blocks whose components are lengths
    for kind, columns in problem.index.columns.items():
        limit = size if kind in lengths else NOTHING_KNOWN if kind == "rotation" else np.inf
        limits = np.full(columns.shape, limit)
        if kind.startswith("interior/"):  # a camera constant counts as determined if it is 3 σ away from 0
            of_constants = np.isin(KINDS[kind].names, ("c", "f", "fx", "fy"))
            limits = np.where(of_constants, np.abs(quality.adjustment.values[kind]) / 3.0, np.inf)
        elif not np.isfinite(limit) or limit <= 0.0:
            continue
        elif kind == "point":  # a far one counts as determined if it is 3 σ away from the rest
            limits = np.maximum(limits, _distances(quality.adjustment)[:, None] / 3.0)
        variance = np.diagonal(quality.cofactors[kind], axis1=1, axis2=2)
        sigma = factor * np.sqrt(np.maximum(variance, 0.0))
        beyond = (columns >= 0) & ~(sigma <= limits)
        beyond &= ~told_by_user(quality, kind)[:, None]
        for block in np.flatnonzero(beyond.any(axis=1)):
            components = np.flatnonzero(beyond[block])
            if kind == "point" and _has_direction(quality, int(block), limit, factor):
                continue
            if kind in lengths and _is_bound(quality, kind, int(block), limit):
                continue
            labels = tuple(problem.index.label(int(columns[block, k])) for k in components)
            amounts = sigma[block, components]
            ratio = float(np.nan_to_num(amounts / limits[block, components], nan=np.inf).max())
            found.append(((kind in lengths or kind == "rotation", -ratio), labels, amounts))
    found.sort(key=lambda one: one[0])
    return [
        Undetermined(labels, tuple(float(x) for x in amounts / amounts.max())) for _, labels, amounts in found[:1000]
    ]


def sigma_of_geometry(quality: Quality) -> float:
    """Return the factor on √Q with which determinability is judged, at most 1: the stated σ count.

    Residuals that are too large say nothing about the geometry. If the stated σ only mean ratios, they are far larger
    than the errors, and the factor is σ0. Residuals of error-free observations vanish, whatever the σ are. So the
    factor is at least the one by which a typical observation is good to 10⁻³ of the size of the network, a tenth
    of what linear equations bear.
    """
    if quality.sigma0 >= 1.0:
        return 1.0
    adjustment = quality.adjustment
    size, relative = quality.size, []
    for group in adjustment.problem.groups if size > 0.0 else ():
        slots = [k for k, slot in enumerate(group.type.slots) if slot.kind == "point"]
        if not slots or group.count == 0:
            continue
        rows: IntArray = np.unique(np.linspace(0, group.count - 1, 500).astype(np.int64))  # a sample
        jacobians = evaluated(group, adjustment.values, rows).jacobians
        change = size * np.sqrt(sum(np.sum(jacobians[k] ** 2, axis=2) for k in slots))
        told = group.used_among(rows) & (change > 0.0)
        relative.append(group.sigma[rows][told] / change[told])
    typical = np.median(np.concatenate(relative)) if relative else 0.0
    return float(min(1.0, max(quality.sigma0, 1e-3 / typical if typical > 0.0 else 1.0)))


def _is_bound(quality: Quality, kind: str, block: int, size: float) -> bool:
    """Return True if the equations bind a point whose σ exceeds the size of the network only because they are bent.

    A distance to a line that is as long as the perpendicular, or shorter, does not change to first order as the point
    moves along the line. The linear equations then let it move by the size of the network; the distance does not.
    """
    adjustment = quality.adjustment
    problem, values = adjustment.problem, adjustment.values
    columns = problem.index.columns[kind][block]
    free = columns >= 0
    direction = np.zeros(problem.index.count)
    axes = rotations.eigh(np.nan_to_num(quality.cofactors[kind][block])[np.ix_(free, free)])[1]
    direction[columns[free]] = size * axes[:, -1]
    linear = float(image_of(adjustment.plan, values, direction[:, None])[0, 0])
    before = objective(adjustment.plan, values)
    moved = [objective(adjustment.plan, move(problem.index, values, sign * direction)) for sign in (1.0, -1.0)]
    # An increase of vᵀPv by 3 σ, and a hundred times what the linear equations say where these do not hold.
    return min(moved) - before > max(9.0, 100.0 * linear)


def _has_direction(quality: Quality, block: int, size: float, factor: float) -> bool:
    """Return True if a point is far away, seen by rays alone: they determine its direction, hardly its distance.

    The adjustment has converged at a finite distance. The verdict names the point as not determined.
    """
    for group in quality.adjustment.problem.groups:
        for k, numbers in enumerate(group.blocks):
            if group.type.slots[k].kind != "point" or not (numbers == block).any():
                continue
            if not can_be_at_infinity(group.type) or k != target_slot(group.type):
                return False
    variances = np.sort(rotations.eigvalsh(quality.cofactors["point"][block]))
    sigma = factor * np.sqrt(np.maximum(variances, 0.0))
    distance = _distances(quality.adjustment)[block]
    # A direction is known up to a σ of 0.05 rad, the angle below which rays are nearly parallel.
    return bool(np.isfinite(sigma).all() and sigma[-2] <= max(size, 0.05 * distance))


def median_distance(adjustment: Adjustment) -> float:
    """Return the median distance of points from their median; 0 if it says nothing about the size of the network.

    Heights of points without plan coordinates are such a case: their differences may be smaller than their σ. If most
    points coincide to the σ of lengths, as those of several sights to one target, it is that of the others. It is at
    least half the median length of sights: names for one far target make no small network.
    """
    if "point" not in adjustment.values:
        return 0.0
    observed = _observed(adjustment)
    if np.count_nonzero(np.ptp(adjustment.values["point"][observed], axis=0) > 0.0) < 2:
        return 0.0
    distances = _distances(adjustment)[observed]
    apart = distances[distances > _least_sigma_of_lengths(adjustment)]
    usual = float(np.median(apart if 0 < 2 * len(apart) < len(distances) else distances))
    sights = [
        lengths_of_sights(group, adjustment.values) for group in adjustment.problem.groups if group.type.distances
    ]
    lengths = np.concatenate([np.zeros(0), *sights])
    lengths = lengths[np.isfinite(lengths)]  # points that are left out may have no coordinates
    return max(usual, 0.5 * float(np.median(lengths))) if len(lengths) else usual


def _least_sigma_of_lengths(adjustment: Adjustment) -> float:
    lengths = [
        group.sigma[:, k][group.mask[:, k] & ~group.left_out[:, k]]
        for group in adjustment.problem.groups
        for k, component in enumerate(group.type.components)
        if component.quantity == LENGTH and not is_image_point(group.type)
    ]
    return min((float(sigma.min()) for sigma in lengths if len(sigma)), default=0.0)


def points_far_off(adjustment: Adjustment) -> IntArray:
    """Return numbers (k,) of the points that are farther from the others than the size of the network."""
    far = _distances(adjustment) > _BEYOND_MEDIAN * median_distance(adjustment)
    return np.asarray(np.flatnonzero(far & _observed(adjustment)))


def _distances(adjustment: Adjustment) -> FloatArray:
    """(n,) distances of points from the median of those that are observed."""
    points = adjustment.values["point"]
    return np.asarray(np.linalg.norm(points - np.median(points[_observed(adjustment)], axis=0), axis=1))


def _observed(adjustment: Adjustment) -> BoolArray:
    """(n,) points with observations, all if none has: those that are left out may have no coordinates."""
    rows = rows_of_points(adjustment.problem.groups, len(adjustment.values["point"]))
    return rows > 0 if rows.any() else np.ones(len(rows), dtype=bool)


def told_by_user(quality: Quality, kind: str) -> BoolArray:
    """(n,) blocks whose values were observed themselves: how badly they are known is what the user said."""
    problem = quality.adjustment.problem
    told = np.zeros(len(problem.index.columns[kind]), dtype=bool)
    for group in problem.groups:
        if group.type.key in (f"observed/{kind}", "coordinates") and group.type.slots[0].kind == kind:
            told[group.blocks[0]] = True
    return told


# ---- Covariances of any unknowns together, in the datum of the adjustment: what the stored blocks do not hold.
#
# Columns of the inverse come from one solution each; the S-transformation carries them into the datum, which
# also makes them independent of the minimal datum the factorisation happened to take.


class RelativeEllipsoid(NamedTuple):
    """Precision of the difference of two points (second minus first)."""

    difference: FloatArray
    """(3,) internal axes."""
    covariance: FloatArray
    """(3, 3)."""
    axes: FloatArray
    """(3,) standard semi-axes, the largest first."""


def joint_cofactors(quality: Quality, columns: IntArray) -> FloatArray:
    """(k, k) cofactors (σ0 = 1) of the unknowns ``columns`` (k,); zero rows for −1, which is fixed."""
    used = np.unique(columns[columns >= 0])
    inverse = quality.adjustment.inverse
    result = np.zeros((len(used), len(used)))
    for piece in pieces(len(used), 200):
        part = used[piece]
        right = np.zeros((quality.adjustment.problem.index.count, len(part)))
        right[part, np.arange(len(part))] = 1.0
        result[:, piece] = inverse.solve(right)[used]
    result = 0.5 * (result + result.T) + quality.datum.correction(used, used)
    where = np.searchsorted(used, np.maximum(columns, used.min(initial=0)))
    free = columns >= 0
    picked = result[np.ix_(where, where)] if len(used) else np.zeros((len(columns), len(columns)))
    return np.where(free[:, None] & free[None, :], picked, 0.0)


def cofactors_of_difference(quality: Quality, first: int, second: int) -> FloatArray:
    """(3, 3) cofactors of the difference of two point blocks."""
    q = joint_cofactors(quality, quality.adjustment.problem.index.columns["point"][[first, second]].ravel())
    return q[:3, :3] + q[3:, 3:] - q[:3, 3:] - q[3:, :3]


def relative_ellipsoid(quality: Quality, first: int, second: int) -> RelativeEllipsoid:
    """Relative error ellipsoid between two point blocks."""
    covariance = cofactors_of_difference(quality, first, second) * quality.sigma_factor**2
    eigenvalues, _ = rotations.eigh(0.5 * (covariance + covariance.T))
    points = quality.adjustment.values["point"]
    return RelativeEllipsoid(points[second] - points[first], covariance, np.sqrt(np.maximum(eigenvalues[::-1], 0.0)))
