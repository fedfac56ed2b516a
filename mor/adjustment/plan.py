"""What is worked out once: which rows go where, which blocks meet, in which order they are eliminated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mor.adjustment.block_matrix import BlockStructure, structure_from_cliques
from mor.adjustment.elimination import Elimination, analyse
from mor.adjustment.problem import Cluster, Problem
from mor.adjustment.ray_plan import RayPlan, plan_rays
from mor.adjustment.rows import Target, target
from mor.geometry.arrays import FloatArray, IntArray
from mor.observations import ObservationGroup
from mor.parameters.index import Index


@dataclass(frozen=True)
class RowSet:
    """Rows of one group with the square roots of their weights; correlated entries have weight 0 here."""

    group: int
    rows: IntArray
    weight: FloatArray
    """(n, m) 1/σ."""


@dataclass(frozen=True)
class ClusterRows:
    """A correlated cluster: where its entries stand, and the matrix that makes them uncorrelated."""

    groups: IntArray
    rows: IntArray
    components: IntArray
    whitening: FloatArray
    """(k, k) W with W Σ Wᵀ = I."""


@dataclass(frozen=True)
class Plan:
    """Structure of an adjustment, independent of the values."""

    problem: Problem
    kept: IntArray
    """(n,) unknowns of the reduced system."""
    reduced: IntArray
    """(u,) their numbers in it, −1 for the coordinates of eliminated points."""
    rays: RayPlan
    target: Target
    elimination: Elimination
    row_sets: tuple[RowSet, ...]
    clusters: tuple[ClusterRows, ...]


def make_plan(problem: Problem, eliminated: IntArray | None = None) -> Plan:
    """Work out rows, pattern and elimination order of a problem.

    ``eliminated`` are numbers of point blocks to eliminate on the fly (see :mod:`mor.adjustment.eliminable`).
    """
    points = np.zeros(0, dtype=np.int64) if eliminated is None else eliminated
    rays = plan_rays(problem, points)
    clusters = tuple(_cluster_rows(problem, cluster) for cluster in problem.clusters)
    row_sets = tuple(_row_set(number, group, clusters, rays) for number, group in enumerate(problem.groups))
    remains = np.ones(problem.index.count, dtype=bool)
    remains[rays.columns] = False
    kept = np.flatnonzero(remains)
    reduced = np.where(remains, np.cumsum(remains) - 1, -1)
    structure = _structure(problem, row_sets, clusters, rays, kept, reduced)
    return Plan(problem, kept, reduced, rays, target(structure), analyse(structure), row_sets, clusters)


def group_columns(group: ObservationGroup, index: Index, rows: IntArray) -> IntArray:
    """(n, K) unknowns of the chosen rows, over all slots that are not fixed throughout."""
    parts = [
        index.columns[slot.kind][number[rows]]
        for slot, number in zip(group.type.slots, group.blocks, strict=True)
    ]
    used = [part for part in parts if (part >= 0).any()]
    return np.concatenate(used, axis=1) if used else np.zeros((len(rows), 0), dtype=np.int64)


def _row_set(
    number: int, group: ObservationGroup, clusters: tuple[ClusterRows, ...], rays: RayPlan
) -> RowSet:
    weight = np.where(group.mask, 1.0 / np.where(group.mask, group.sigma, 1.0), 0.0)
    weight[rays.row[rays.group == number]] = 0.0
    for cluster in clusters:
        here = cluster.groups == number
        weight[cluster.rows[here], cluster.components[here]] = 0.0
    rows = np.flatnonzero((weight > 0.0).any(axis=1))
    return RowSet(number, rows, weight[rows])


def _cluster_rows(problem: Problem, cluster: Cluster) -> ClusterRows:
    offsets = problem.offsets
    groups = np.searchsorted(offsets, cluster.entries, side="right") - 1
    within = cluster.entries - offsets[groups]
    widths = np.array([group.observed.shape[1] for group in problem.groups])[groups]
    lower = np.linalg.cholesky(cluster.covariance)
    whitening = np.linalg.solve(lower, np.eye(len(lower)))
    return ClusterRows(groups.astype(np.int64), within // widths, within % widths, whitening)


def _structure(
    problem: Problem,
    row_sets: tuple[RowSet, ...],
    clusters: tuple[ClusterRows, ...],
    rays: RayPlan,
    kept: IntArray,
    reduced: IntArray,
) -> BlockStructure:
    index = problem.index
    block_of, sizes = unknown_blocks(index, kept)
    lengths, members = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for row_set in row_sets:
        columns = group_columns(problem.groups[row_set.group], index, row_set.rows)
        counts, blocks = _cliques(reduced_columns(columns, reduced), block_of)
        lengths.append(counts)
        members.append(blocks)
    for cluster in clusters:
        blocks = np.unique(block_of[reduced[cluster_columns(problem, cluster)]])
        lengths.append(np.array([len(blocks)]))
        members.append(blocks)
    if len(rays.columns):
        counts, blocks = _cliques_of_points(problem, rays, reduced, block_of)
        lengths.append(counts)
        members.append(blocks)
    pointers = np.concatenate([[0], np.cumsum(np.concatenate(lengths))])
    return structure_from_cliques(sizes, pointers, np.concatenate(members))


def cluster_columns(problem: Problem, cluster: ClusterRows) -> IntArray:
    """Unknowns (sorted, each once) that the entries of a cluster depend on."""
    found = [np.zeros(0, dtype=np.int64)]
    for number in np.unique(cluster.groups):
        rows = np.unique(cluster.rows[cluster.groups == number])
        found.append(group_columns(problem.groups[number], problem.index, rows).ravel())
    columns = np.unique(np.concatenate(found))
    return columns[columns >= 0]


def reduced_columns(columns: IntArray, reduced: IntArray) -> IntArray:
    """Columns renumbered for the reduced system; −1 stays."""
    return np.where(columns >= 0, reduced[columns], -1) if len(reduced) else columns


def _cliques_of_points(
    problem: Problem, rays: RayPlan, reduced: IntArray, block_of: IntArray
) -> tuple[IntArray, IntArray]:
    """Blocks that the rays of each eliminated point meet together (repetitions allowed)."""
    per_ray = np.zeros(len(rays.row), dtype=np.int64)
    found: list[tuple[IntArray, IntArray]] = []
    for number in np.unique(rays.group):
        here = np.flatnonzero(rays.group == number)
        columns = group_columns(problem.groups[number], problem.index, rays.row[here])[:, :-3]
        counts, blocks = _cliques(reduced_columns(columns, reduced), block_of)
        per_ray[here] = counts
        found.append((np.repeat(here, counts), blocks))
    ray = np.concatenate([part[0] for part in found])
    blocks = np.concatenate([part[1] for part in found])[np.argsort(ray, kind="stable")]
    starts = np.concatenate([[0], np.cumsum(per_ray)])
    return np.diff(starts[rays.pointers]).astype(np.int64), blocks


def unknown_blocks(index: Index, kept: IntArray | None = None) -> tuple[IntArray, IntArray]:
    """Block number of every (kept) unknown and size of every block: one for each parameter block with unknowns."""
    kind, block = (
        (index.kind_of, index.block_of) if kept is None else (index.kind_of[kept], index.block_of[kept])
    )
    if len(kind) == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    changes = (np.diff(kind) != 0) | (np.diff(block) != 0)
    block_of = np.concatenate([[0], np.cumsum(changes)]).astype(np.int64)
    return block_of, np.bincount(block_of).astype(np.int64)


def _cliques(columns: IntArray, block_of: IntArray) -> tuple[IntArray, IntArray]:
    """Blocks that meet in each row (lengths and members), runs of equal blocks taken once."""
    if columns.shape[1] == 0:
        return np.zeros(len(columns), dtype=np.int64), np.zeros(0, dtype=np.int64)
    blocks = np.where(columns >= 0, block_of[columns], -1)
    first = np.ones(blocks.shape, dtype=bool)
    first[:, 1:] = blocks[:, 1:] != blocks[:, :-1]
    first &= blocks >= 0
    return first.sum(axis=1).astype(np.int64), blocks[first]
