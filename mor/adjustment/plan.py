"""What is worked out once: which rows go where, which blocks meet, in which order they are eliminated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mor.adjustment.correlated_rows import (
    AlikeClusters,
    ClusterRows,
    alike_clusters,
    columns_of_clusters,
    group_columns,
)
from mor.adjustment.problem import Cluster, Problem
from mor.adjustment.rays.plan import RayPlan, plan_rays
from mor.arrays import FloatArray, IntArray, ranges
from mor.observations import ObservationGroup
from mor.sparse.block_matrix import BlockStructure, structure_from_cliques
from mor.sparse.rows import Target, target
from mor.sparse.symbolic_factorisation import Elimination, analyse


class RowSet(NamedTuple):
    """Rows of one group with the square roots of their weights; correlated entries have weight 0 here."""

    group: int
    rows: IntArray
    weight: FloatArray
    """(n, m) 1/σ."""


class RowClusters(NamedTuple):
    """Clusters that are one row of a group each, all of a group together: vectors with a covariance of their own."""

    group: int
    rows: IntArray
    whitening: FloatArray
    """(n, m, m) W of each row, zero rows and columns where a component is not observed."""


@dataclass(frozen=True)
class Plan:
    """Structure of an adjustment, independent of the values."""

    problem: Problem
    kept: IntArray
    """(n,) unknowns of the reduced system, in its order."""
    reduced: IntArray
    """(u,) their numbers in it, −1 for the coordinates of eliminated points."""
    rays: RayPlan
    target: Target
    elimination: Elimination
    row_sets: tuple[RowSet, ...]
    clusters: tuple[ClusterRows, ...]

    @cached_property
    def sorted_clusters(self) -> tuple[tuple[RowClusters, ...], tuple[AlikeClusters, ...]]:
        """Clusters that are single rows, by group, and the others, those that are alike together."""
        of_rows, wide = _sorted_clusters(self.problem, self.clusters)
        return of_rows, alike_clusters(self.problem, wide)

    @cached_property
    def places_in_clusters(self) -> dict[tuple[int, int, int], tuple[ClusterRows, int]]:
        """Group, row and component of every correlated entry → its cluster, and its place in it."""
        return {
            key: (cluster, place)
            for cluster in self.clusters
            for place, key in enumerate(
                zip(cluster.groups.tolist(), cluster.rows.tolist(), cluster.components.tolist(), strict=True)
            )
        }


def make_plan(problem: Problem, rays: RayPlan | None = None) -> Plan:
    """Work out rows, pattern and elimination order of a problem.

    ``rays`` are those of the points to eliminate on the fly (see :mod:`mor.adjustment.rays.eliminable`).
    """
    if rays is None:
        rays = plan_rays(problem, np.zeros(0, dtype=np.int64))
    offsets, widths = problem.offsets, np.array([group.observed.shape[1] for group in problem.groups])
    clusters = tuple(_cluster_rows(offsets, widths, cluster) for cluster in problem.clusters)
    row_sets = tuple(_row_set(number, group, clusters, rays) for number, group in enumerate(problem.groups))
    remains = np.ones(problem.index.count, dtype=bool)
    remains[rays.columns] = False
    kept, block_of, sizes = reduced_blocks(problem, np.flatnonzero(remains), rays)
    reduced = np.full(problem.index.count, -1, dtype=np.int64)
    reduced[kept] = np.arange(len(kept))
    of_rows, wide = _sorted_clusters(problem, clusters)
    structure = _structure(problem, (*row_sets, *of_rows), wide, rays, block_of, sizes, reduced)
    return Plan(problem, kept, reduced, rays, target(structure), analyse(structure), row_sets, clusters)


def _sorted_clusters(
    problem: Problem, clusters: tuple[ClusterRows, ...]
) -> tuple[tuple[RowClusters, ...], tuple[ClusterRows, ...]]:
    single: dict[int, list[ClusterRows]] = {}
    wide = []
    for cluster in clusters:
        if (cluster.groups == cluster.groups[0]).all() and (cluster.rows == cluster.rows[0]).all():
            single.setdefault(int(cluster.groups[0]), []).append(cluster)
        else:
            wide.append(cluster)
    return tuple(_row_clusters(problem, number, some) for number, some in sorted(single.items())), tuple(wide)


def _row_clusters(problem: Problem, number: int, clusters: list[ClusterRows]) -> RowClusters:
    width = problem.groups[number].observed.shape[1]
    whitening = np.zeros((len(clusters), width, width))
    for k, cluster in enumerate(clusters):
        whitening[k][np.ix_(cluster.components, cluster.components)] = cluster.whitening
    return RowClusters(number, np.array([cluster.rows[0] for cluster in clusters], dtype=np.int64), whitening)


def _row_set(
    number: int, group: ObservationGroup, clusters: tuple[ClusterRows, ...], rays: RayPlan
) -> RowSet:
    uncorrelated = np.ones(group.observed.shape, dtype=bool)
    uncorrelated[rays.rows_of_group(number)] = False
    for cluster in clusters:
        here = cluster.groups == number
        uncorrelated[cluster.rows[here], cluster.components[here]] = False
    rows = np.flatnonzero(uncorrelated.any(axis=1))
    seen = uncorrelated[rows] & np.isfinite(group.observed[rows])
    weight = np.where(seen, 1.0 / np.where(seen, group.sigma[rows], 1.0), 0.0)
    used = seen.any(axis=1)
    return RowSet(number, rows[used], weight[used])


def _cluster_rows(offsets: IntArray, width_of_group: IntArray, cluster: Cluster) -> ClusterRows:
    groups = np.searchsorted(offsets, cluster.entries, side="right") - 1
    within = cluster.entries - offsets[groups]
    widths = width_of_group[groups]
    lower = np.linalg.cholesky(cluster.covariance)
    whitening = np.linalg.solve(lower, np.eye(len(lower)))
    return ClusterRows(groups.astype(np.int64), within // widths, within % widths, whitening)


def _structure(
    problem: Problem,
    row_sets: tuple[RowSet | RowClusters, ...],
    clusters: tuple[ClusterRows, ...],
    rays: RayPlan,
    block_of: IntArray,
    sizes: IntArray,
    reduced: IntArray,
) -> BlockStructure:
    index = problem.index
    lengths, members = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for row_set in row_sets:
        columns = group_columns(problem.groups[row_set.group], index, row_set.rows)
        counts, blocks = _cliques(reduced_columns(columns, reduced), block_of)
        lengths.append(counts)
        members.append(blocks)
    for columns in columns_of_clusters(problem, clusters):
        blocks = np.unique(block_of[reduced[columns]])
        lengths.append(np.array([len(blocks)]))
        members.append(blocks)
    if len(rays.columns):
        counts, blocks = _cliques_of_points(rays, reduced, block_of)
        lengths.append(counts)
        members.append(blocks)
    pointers = np.concatenate([[0], np.cumsum(np.concatenate(lengths))])
    return structure_from_cliques(sizes, pointers, np.concatenate(members))


def reduced_columns(columns: IntArray, reduced: IntArray) -> IntArray:
    """Columns renumbered for the reduced system; −1 stays."""
    return np.where(columns >= 0, reduced[columns], -1) if len(reduced) else columns


def _cliques_of_points(rays: RayPlan, reduced: IntArray, block_of: IntArray) -> tuple[IntArray, IntArray]:
    """Blocks that the rays of each eliminated point meet together (repetitions allowed); equal points once."""
    counts, blocks = _cliques(reduced_columns(rays.frames.columns, reduced), block_of)
    starts = np.cumsum(counts) - counts
    frame = rays.frame_of_ray
    distinct = _distinct_cliques(rays.pointers, frame)
    degree = np.diff(rays.pointers)[distinct]
    chosen = frame[ranges(rays.pointers[distinct], degree)]
    members = blocks[ranges(starts[chosen], counts[chosen])]
    ends = np.concatenate([[0], np.cumsum(counts[chosen])])[np.concatenate([[0], np.cumsum(degree)])]
    return np.diff(ends).astype(np.int64), members


def _distinct_cliques(pointers: IntArray, frame: IntArray) -> IntArray:
    """Points (k,) such that every combination of frames that sees a point occurs, seldom more than once."""
    mixed = ((frame + 1).astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)) ^ (
        frame.astype(np.uint64) << np.uint64(31)
    )
    keys = np.add.reduceat(mixed * (mixed | np.uint64(1)), pointers[:-1])
    # Two combinations with the same sum of 64-bit keys and the same number of rays, first and last frame: never seen.
    table = np.stack([keys.view(np.int64), np.diff(pointers), frame[pointers[:-1]], frame[pointers[1:] - 1]])
    order = np.lexsort(table)
    first = np.ones(len(order), dtype=bool)
    first[1:] = (np.diff(table[:, order], axis=1) != 0).any(axis=0)
    return np.sort(order[first])


def reduced_blocks(problem: Problem, kept: IntArray, rays: RayPlan) -> tuple[IntArray, IntArray, IntArray]:
    """Unknowns (n,) in the order of the reduced system, block number of each, and size of every block.

    A block for each parameter block; but position and rotation of an image are one where each belongs to the other
    alone, for then they occur together only, and one block of six is quicker than four of three by three. So it is with
    the motion of a rolling shutter.
    """
    kind, block = problem.index.kind_of[kept], problem.index.block_of[kept]
    if len(kept) == 0:
        return kept, kept, kept
    numbers = np.cumsum(np.concatenate([[0], (np.diff(kind) != 0) | (np.diff(block) != 0)]))
    joined = _joined(problem, kept, numbers, rays)
    order = np.argsort(joined, kind="stable")
    kept, joined = kept[order], joined[order]
    block_of = np.cumsum(np.concatenate([[0], np.diff(joined) != 0])).astype(np.int64)
    return kept, block_of, np.bincount(block_of).astype(np.int64)


def _joined(problem: Problem, kept: IntArray, numbers: IntArray, rays: RayPlan) -> IntArray:
    """Block numbers (n,) of the unknowns, the same for what goes together with the rotation of an image."""
    index, count = problem.index, int(numbers[-1]) + 1
    number_of = np.full(index.count, -1, dtype=np.int64)
    number_of[kept] = numbers
    pairs: dict[str, list[IntArray]] = {}
    for kind, together in rays.together(problem.groups):
        pairs.setdefault(kind, []).append(together)
    into = np.arange(count)
    for kind, found in pairs.items():
        other, rotation = np.unique(np.concatenate(found, axis=1), axis=1)
        columns = index.columns[kind][other], index.columns["rotation"][rotation]
        both = np.stack([column.max(axis=1, initial=-1) for column in columns])
        both = number_of[both[:, (both >= 0).all(axis=0)]]
        one, turn = both[:, (both >= 0).all(axis=0)]
        alone = (np.bincount(one, minlength=count)[one] == 1) & (
            np.bincount(turn, minlength=count)[turn] == 1
        )
        into[one[alone]] = turn[alone]
    return into[numbers]


def _cliques(columns: IntArray, block_of: IntArray) -> tuple[IntArray, IntArray]:
    """Blocks that meet in each row (lengths and members), runs of equal blocks taken once."""
    if columns.shape[1] == 0:
        return np.zeros(len(columns), dtype=np.int64), np.zeros(0, dtype=np.int64)
    blocks = np.where(columns >= 0, block_of[columns], -1)
    first = np.ones(blocks.shape, dtype=bool)
    first[:, 1:] = blocks[:, 1:] != blocks[:, :-1]
    first &= blocks >= 0
    return first.sum(axis=1).astype(np.int64), blocks[first]
