"""Which points are eliminated on the fly: those that meet nothing but frames, and that their rays determine."""

from __future__ import annotations

import numpy as np

from mor.adjustment.linearise import linearise, rotation_tangents
from mor.adjustment.problem import Problem
from mor.geometry.arrays import BoolArray, FloatArray, IntArray
from mor.observations import ObservationGroup
from mor.parameters.index import Values

WELL_DETERMINED = 1e-8
"""Smallest eigenvalue of the normal matrix of a point, scaled to unit diagonal, from which it may be eliminated."""
_ROWS_AT_A_TIME = 100_000


def is_ray(group: ObservationGroup) -> bool:
    """True for image coordinates: two components, and the point as the last slot."""
    slot = group.type.slots[-1]
    return slot.kind == "point" and slot.of == "point" and len(group.type.components) == 2


def eliminable_points(problem: Problem, values: Values) -> IntArray:
    """Numbers of the point blocks that may be eliminated, in the order of the first frame that sees them.

    A point qualifies if all its coordinates are free and its own, if it occurs only as the target of uncorrelated
    rays, and if these rays alone, from known frames, determine it.
    """
    blocks = problem.index.blocks.get("point")
    if blocks is None:
        return np.zeros(0, dtype=np.int64)
    count = len(blocks.ids)
    own = (blocks.owner == np.arange(count)[:, None]).all(axis=1)
    may = blocks.free.all(axis=1) & own & ~_used_otherwise(problem, count)
    may &= _shared_by_nobody(problem, count)
    normal, first = _point_normals(problem, values, may)
    may &= _well_determined(normal)
    chosen = np.flatnonzero(may)
    if problem.index.count == 3 * len(chosen):
        return np.zeros(0, dtype=np.int64)  # nothing would be left of the reduced system
    order = np.argsort(first[chosen], kind="stable")
    return chosen[order].astype(np.int64)


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


def _shared_by_nobody(problem: Problem, count: int) -> BoolArray:
    owner = problem.index.blocks["point"].owner
    foreign = owner[(owner != np.arange(count)[:, None])]
    alone = np.ones(count, dtype=bool)
    alone[foreign] = False
    return alone


def _point_normals(problem: Problem, values: Values, may: BoolArray) -> tuple[FloatArray, IntArray]:
    """Normal matrices (points, 3, 3) of the points, all else known, and the first frame that sees each."""
    normal = np.zeros((len(may), 3, 3))
    first = np.full(len(may), np.iinfo(np.int64).max)
    tangent = rotation_tangents(problem.index, values)
    for group in filter(is_ray, problem.groups):
        rows_of_candidates = np.flatnonzero(may[group.blocks[-1]])
        np.minimum.at(first, group.blocks[-1][rows_of_candidates], group.blocks[1][rows_of_candidates])
        for start in range(0, len(rows_of_candidates), _ROWS_AT_A_TIME):
            rows = rows_of_candidates[start : start + _ROWS_AT_A_TIME]
            by_point = linearise(group, problem.index, values, tangent, rows).jacobian[:, :, -3:]
            weighted = by_point / np.where(group.mask[rows], group.sigma[rows], np.inf)[:, :, None]
            products = np.einsum("nmi,nmj->nij", weighted, weighted)
            for i in range(3):
                for j in range(3):
                    normal[:, i, j] += np.bincount(
                        group.blocks[-1][rows], weights=products[:, i, j], minlength=len(may)
                    )
    return normal, first


def _well_determined(normal: FloatArray) -> BoolArray:
    diagonal = np.diagonal(normal, axis1=1, axis2=2)
    good = (diagonal > 0.0).all(axis=1) & np.isfinite(normal).all(axis=(1, 2))
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = np.where(good[:, None, None], normal * scale[:, :, None] * scale[:, None, :], np.eye(3))
    return np.asarray(good & (np.linalg.eigvalsh(scaled)[:, 0] > WELL_DETERMINED))
