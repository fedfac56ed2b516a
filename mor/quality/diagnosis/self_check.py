"""Is a converged solution one? The sum of the redundancy numbers, and unknowns with a σ beyond any use.

Σ r = n − u + d holds exactly, whatever the observations are; where it does not, round-off has eaten the cofactors.

A coordinate whose σ exceeds the size of the network is nowhere in particular: the point of two parallel lines of sight,
or of two places that have fallen together. An angle is known worse than not at all from σ = π/√3 on, that of an angle
spread evenly over the circle. Both come out of a system that is regular to the last digits, so that no pivot vanishes;
what is linear over one σ elsewhere is not so there, and σ itself means nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mor.adjustment.datum.undetermined import Undetermined
from mor.adjustment.datum.weak_directions import NOTHING_KNOWN
from mor.adjustment.equations import evaluated
from mor.adjustment.normals import image_of, objective
from mor.adjustment.state import Adjustment, Outcome
from mor.arrays import BoolArray, IntArray
from mor.geometry import tolerant
from mor.observations import can_be_at_infinity, target_slot
from mor.parameters.index import move
from mor.quality.assess import Quality

REDUNDANCY_LOST = "the sum of the redundancy numbers is not the redundancy: round-off has eaten the solution"
BEYOND_USE = "the standard deviations of unknowns are beyond any use"
"""Reasons of outcomes."""
_SUM = 1e-3
"""Σ r − (n − u + d) that is no longer round-off of exact cofactors, and 10⁻⁶ of it in large systems."""
_BEYOND_MEDIAN = 10.0
"""Size of a network in units of the median distance of its points from their median."""
_SEEN, _BENT = 9.0, 100.0
"""Increase of vᵀPv by 3 σ, and how many times as large as the linear equations have it where these do not hold."""
_NARROW = 0.05
"""σ (rad) of a direction that is known, the angle below which rays are nearly parallel."""
_TYPICAL, _SAMPLED = 1e-3, 500
"""Effect of one σ of a typical observation on a point, in parts of the size of the network, that is taken literally (a
tenth of what linear equations bear), and observations of a group that are asked for it."""
_LENGTHS = ("point", "base")
_TOLD = 1000


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
    """True where Σ r is the redundancy, but for round-off of exact cofactors."""
    return abs(redundancy_sum - redundancy) <= max(_SUM, 1e-6 * redundancy)


def beyond_use(quality: Quality) -> list[Undetermined]:
    """Blocks with unknowns whose σ is larger than the scale they live on; those first that are worst.

    σ are those of :func:`sigma_of_geometry`.
    """
    problem, found, factor = quality.adjustment.problem, [], sigma_of_geometry(quality)
    size = network_size(quality.adjustment)
    for kind, columns in problem.index.columns.items():
        limit = size if kind in _LENGTHS else NOTHING_KNOWN if kind == "rotation" else np.inf
        if not np.isfinite(limit) or limit <= 0.0:
            continue
        variance = np.diagonal(quality.cofactors[kind], axis1=1, axis2=2)
        sigma = factor * np.sqrt(np.maximum(variance, 0.0))
        beyond = (columns >= 0) & ~(sigma <= limit) & ~told_by_user(quality, kind)[:, None]
        for block in np.flatnonzero(beyond.any(axis=1)):
            components = np.flatnonzero(beyond[block])
            if kind == "point" and _has_direction(quality, int(block), limit, factor):
                continue
            if kind in _LENGTHS and _is_bound(quality, kind, int(block), limit):
                continue
            labels = tuple(problem.index.label(int(columns[block, k])) for k in components)
            amounts = sigma[block, components]
            found.append((float(np.nan_to_num(amounts / limit, nan=np.inf).max()), labels, amounts))
    found.sort(key=lambda one: -one[0])
    return [
        Undetermined(labels, tuple(float(x) for x in amounts / amounts.max()))
        for _, labels, amounts in found[:_TOLD]
    ]


def sigma_of_geometry(quality: Quality) -> float:
    """Return the factor on √Q with which determinability is judged, at most 1: the stated σ count.

    Residuals that are too large say nothing about the geometry. If the stated σ only mean ratios, they are far larger
    than the errors, and the factor is σ0. Residuals of error-free observations vanish, whatever the σ are. So the
    factor is at least the one by which a typical observation is good to ``_TYPICAL`` of the size of the network.
    """
    if quality.sigma0 >= 1.0:
        return 1.0
    adjustment = quality.adjustment
    size, relative = median_distance(adjustment), []
    for group in adjustment.problem.groups if size > 0.0 else ():
        slots = [k for k, slot in enumerate(group.type.slots) if slot.kind == "point"]
        if not slots or group.count == 0:
            continue
        rows: IntArray = np.unique(np.linspace(0, group.count - 1, _SAMPLED).astype(np.int64))
        jacobians = evaluated(group, adjustment.values, rows).jacobians
        change = size * np.sqrt(sum(np.sum(jacobians[k] ** 2, axis=2) for k in slots))
        told = (group.mask & ~group.left_out)[rows] & (change > 0.0)
        relative.append(group.sigma[rows][told] / change[told])
    typical = np.median(np.concatenate(relative)) if relative else 0.0
    return float(min(1.0, max(quality.sigma0, _TYPICAL / typical if typical > 0.0 else 1.0)))


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
    axes = tolerant.eigh(np.nan_to_num(quality.cofactors[kind][block])[np.ix_(free, free)])[1]
    direction[columns[free]] = size * axes[:, -1]
    linear = float(image_of(adjustment.plan, values, direction[:, None])[0, 0])
    before = objective(adjustment.plan, values)
    moved = [
        objective(adjustment.plan, move(problem.index, values, sign * direction)) for sign in (1.0, -1.0)
    ]
    return min(moved) - before > max(_SEEN, _BENT * linear)


def _has_direction(quality: Quality, block: int, size: float, factor: float) -> bool:
    """Return True if a point is far away, seen by rays alone: they determine its direction, hardly its distance.

    The adjustment has converged at a finite distance. The verdict names the point as not determined.
    """
    problem = quality.adjustment.problem
    for group in problem.groups:
        for k, numbers in enumerate(group.blocks):
            if group.type.slots[k].kind != "point" or not (numbers == block).any():
                continue
            if not can_be_at_infinity(group.type) or k != target_slot(group.type):
                return False
    variances = np.sort(tolerant.eigvalsh(quality.cofactors["point"][block]))
    sigma = factor * np.sqrt(np.maximum(variances, 0.0))
    points = quality.adjustment.values["point"]
    distance = float(np.linalg.norm(points[block] - np.median(points, axis=0)))
    return bool(np.isfinite(sigma).all() and sigma[-2] <= max(size, _NARROW * distance))


def network_size(adjustment: Adjustment) -> float:
    """Size of the network, length unit, which points that have run away do not change; 0 where there are no points."""
    return _BEYOND_MEDIAN * median_distance(adjustment)


def median_distance(adjustment: Adjustment) -> float:
    """Return the median distance of points from their median; 0 if it says nothing about the size of the network.

    Heights of points without plan coordinates are such a case: their differences may be smaller than their σ.
    """
    if "point" not in adjustment.values:
        return 0.0
    points = adjustment.values["point"]
    apart = points - np.median(points, axis=0)
    if np.count_nonzero(np.ptp(points, axis=0) > 0.0) < 2:
        return 0.0
    return float(np.median(np.linalg.norm(apart, axis=1)))


def told_by_user(quality: Quality, kind: str) -> BoolArray:
    """(n,) blocks whose values were observed themselves: how badly they are known is what the user said."""
    problem = quality.adjustment.problem
    told = np.zeros(len(problem.index.columns[kind]), dtype=bool)
    for group in problem.groups:
        if group.type.key in (f"observed/{kind}", "coordinates") and group.type.slots[0].kind == kind:
            told[group.blocks[0]] = True
    return told
