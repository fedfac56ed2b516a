"""Which points are eliminated on the fly: those that meet nothing but frames, and that their rays determine."""

from __future__ import annotations

import numpy as np

from mor.adjustment.problem import Problem
from mor.adjustment.rays.chunks import ray_chunks
from mor.adjustment.rays.frames import is_ray
from mor.adjustment.rays.lanes import in_lanes
from mor.adjustment.rays.plan import RayPlan, plan_rays
from mor.adjustment.rays.point_solutions import point_normals
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.parameters.index import Values

WELL_DETERMINED = 1e-8
"""Smallest eigenvalue of the normal matrix of a point, scaled to unit diagonal, from which it may be eliminated."""


def eliminable_rays(problem: Problem, values: Values) -> RayPlan:
    """Rays of the points that may be eliminated, points in the order of the first frame that sees them.

    A point qualifies if all its coordinates are free and its own, if it occurs only as the target of uncorrelated
    rays, and if these rays alone, from known frames, determine it.
    """
    candidates = _candidates(problem)
    if problem.index.count == 3 * len(candidates):
        return plan_rays(problem, candidates[:0])  # nothing would be left of the reduced system
    rays = plan_rays(problem, candidates)
    good = _well_determined(_point_normals(problem, rays, values))
    return rays if good.all() else plan_rays(problem, rays.points[good])


def _candidates(problem: Problem) -> IntArray:
    """Points that nothing but uncorrelated rays meets, in the order of the first frame that sees them."""
    blocks = problem.index.blocks.get("point")
    if blocks is None:
        return np.zeros(0, dtype=np.int64)
    count = len(blocks.ids)
    foreign = blocks.owner != np.arange(count)[:, None]
    may = blocks.free.all(axis=1) & ~foreign.any(axis=1) & ~_used_otherwise(problem, count)
    may[blocks.owner[foreign]] = False
    first = np.full(count, np.iinfo(np.int64).max)
    for group in filter(is_ray, problem.groups):
        np.minimum.at(first, group.blocks[-1], group.blocks[1])
    may &= first < np.iinfo(np.int64).max
    chosen = np.flatnonzero(may)
    return chosen[np.argsort(first[chosen], kind="stable")].astype(np.int64)


def _used_otherwise(problem: Problem, count: int) -> BoolArray:
    """(points,) true where a point occurs in anything but an uncorrelated ray."""
    used = np.zeros(count, dtype=bool)
    offsets = problem.offsets
    for number, group in enumerate(problem.groups):
        ray = is_ray(group)
        for slot, blocks in list(zip(group.type.slots, group.blocks, strict=True))[: -1 if ray else None]:
            if slot.kind == "point":
                used[blocks] = True
        if not ray:
            continue
        for cluster in problem.clusters:
            here = (cluster.entries >= offsets[number]) & (cluster.entries < offsets[number + 1])
            rows = (cluster.entries[here] - offsets[number]) // group.observed.shape[1]
            used[group.blocks[-1][rows]] = True
    return used


def _point_normals(problem: Problem, rays: RayPlan, values: Values) -> FloatArray:
    """Normal matrices (p, 3, 3) of the points, all else known."""
    normal = np.zeros((len(rays.points), 3, 3))
    reduced = np.arange(problem.index.count)

    def of_lane(lane: RayPlan) -> None:
        for chunk in ray_chunks(problem, lane, reduced, values):
            normal[chunk.points] = point_normals(chunk.rays)

    in_lanes(rays, 0, of_lane)
    return normal


def _well_determined(normal: FloatArray) -> BoolArray:
    """True where the smallest eigenvalue of a matrix (p, 3, 3), scaled to unit diagonal, is not too small.

    The three eigenvalues of such a matrix add up to 3, so the smallest is at least its determinant / (3/2)². Only where
    that does not decide, it is worked out.
    """
    diagonal = np.diagonal(normal, axis1=1, axis2=2)
    good: BoolArray = np.asarray((diagonal > 0.0).all(axis=1) & np.isfinite(normal).all(axis=(1, 2)))
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    a, b, c = (
        np.where(good, normal[:, i, j] * scale[:, i] * scale[:, j], 0.0) for i, j in ((1, 0), (2, 0), (2, 1))
    )
    determinant = 1.0 + 2.0 * a * b * c - a * a - b * b - c * c
    doubtful = np.flatnonzero(good & (determinant < 1e-4))
    if len(doubtful):
        s = scale[doubtful]
        scaled = normal[doubtful] * s[:, :, None] * s[:, None, :]
        good[doubtful] = np.linalg.eigvalsh(scaled)[:, 0] > WELL_DETERMINED
    return good
