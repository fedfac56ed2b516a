"""Normal equations: their sparsity, their sums, and the solution for eliminated points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mor.linalg.block_matrix import BlockMatrix, BlockStructure, Target, accumulate_rows, structure_from_cliques, target
from mor.linalg.symbolic import Elimination, analyse
from mor.model.contract import ObservationGroup
from mor.model.parameters import Values
from mor.solve.elimination import (
    Rays,
    ReducedSystem,
    eliminate_chunks,
    empty_reduced_system,
    follow_directions,
    inverse_roots,
    point_steps,
    ray_chunks,
    ray_objective,
)
from mor.solve.engine import Put, RaysOfProblem, in_lanes, shared_among
from mor.solve.problem import (
    AlikeClusters,
    ClusterRows,
    CorrelatedObservations,
    Problem,
    alike_clusters,
    columns_of_clusters,
    group_columns,
    linearise_of,
    misclosures_of,
    rotation_tangents,
)
from mor.solve.rays import RayPlan, is_ray, plan_rays
from mor.types import BoolArray, FloatArray, IntArray, ranges

# ---- What is worked out once: which rows go where, which blocks meet, in which order they are eliminated.


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
    def seen_points(self) -> tuple[IntArray, IntArray]:
        """Points that only rays meet, and of each the position of a camera that sees it: numbers of point blocks."""
        points = _candidates(self.problem)
        camera = np.zeros(int(points.max(initial=-1)) + 1, dtype=np.int64)
        for group in filter(is_ray, self.problem.groups):
            seen = group.blocks[-1] < len(camera)
            camera[group.blocks[-1][seen]] = group.blocks[0][seen]
        return points, camera[points]

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

    ``rays`` are those of the points to eliminate on the fly (see :mod:`mor.solve.normals`).
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


def _row_set(number: int, group: ObservationGroup, clusters: tuple[ClusterRows, ...], rays: RayPlan) -> RowSet:
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


def _cluster_rows(offsets: IntArray, width_of_group: IntArray, cluster: CorrelatedObservations) -> ClusterRows:
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
    lengths, members = [], []
    for chunk in rays.chunks:
        frame = chunk.frames[rays.frame[chunk.rays]]
        pointers = rays.pointers[chunk.points.start : chunk.points.stop + 1] - chunk.rays.start
        distinct = _different_combinations(frame, pointers)
        degree = np.diff(pointers)[distinct]
        chosen = frame[ranges(pointers[distinct], degree)]
        members.append(blocks[ranges(starts[chosen], counts[chosen])])
        ends = np.concatenate([[0], np.cumsum(counts[chosen])])[np.concatenate([[0], np.cumsum(degree)])]
        lengths.append(np.diff(ends))
    return np.concatenate(lengths).astype(np.int64), np.concatenate(members)


def _different_combinations(frame: IntArray, pointers: IntArray) -> IntArray:
    """Points (k,) such that every combination of frames that sees a point occurs, seldom more than once."""
    mixed = ((frame + 1).astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)) ^ (frame.astype(np.uint64) << np.uint64(31))
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
        alone = (np.bincount(one, minlength=count)[one] == 1) & (np.bincount(turn, minlength=count)[turn] == 1)
        into[one[alone]] = turn[alone]
    return into[numbers]


def _cliques(columns: IntArray, block_of: IntArray) -> tuple[IntArray, IntArray]:
    if columns.shape[1] == 0:
        return np.zeros(len(columns), dtype=np.int64), np.zeros(0, dtype=np.int64)
    blocks = np.where(columns >= 0, block_of[columns], -1)
    first = np.ones(blocks.shape, dtype=bool)
    first[:, 1:] = blocks[:, 1:] != blocks[:, :-1]
    first &= blocks >= 0
    return first.sum(axis=1).astype(np.int64), blocks[first]


# ---- From the reduced system to the eliminated points and back, one pass over the rays each.
#
# With the rows of the rays split into A_p (their points) and A_r (all else), N_pp = A_pᵀA_p is block diagonal:
#
#     reduced right-hand side   b_r − A_rᵀ A_p N_pp⁻¹ b_p
#     points                    x_p = N_pp⁻¹ (b_p − A_pᵀ A_r x_r)


def full_directions(plan: Plan, values: Values, reduced: FloatArray, damping: float = 0.0) -> FloatArray:
    """Directions (u, k) whose reduced part is given (n, k), the points following so that AᵀA g vanishes for them."""
    full = np.zeros((plan.problem.index.count, reduced.shape[1]))
    full[plan.kept] = reduced
    if reduced.shape[1] == 0:
        return full

    def put(points: slice, directions: FloatArray) -> None:
        full[plan.rays.columns[points]] = directions

    in_lanes(plan, 0, _directions_of_points, values, reduced, damping, put=put)
    return full


def _directions_of_points(
    plan: Plan, rays: RayPlan, put: Put, values: Values, reduced: FloatArray, damping: float
) -> None:
    for chunk in ray_chunks(plan.problem, rays, plan.reduced, values):
        put(chunk.points, follow_directions(chunk.rays, reduced, damping))


def full_step(plan: Plan, values: Values, reduced: FloatArray, damping: float = 0.0) -> FloatArray:
    """Step (u,) of all unknowns from that of the reduced ones (n,)."""
    full = np.zeros(plan.problem.index.count)
    full[plan.kept] = reduced
    steps = np.empty((len(plan.rays.columns), 3))

    in_lanes(plan, 0, _steps_of_points, values, full, damping, put=steps.__setitem__)
    full[plan.rays.columns] = steps
    return full


def _steps_of_points(plan: Plan, rays: RayPlan, put: Put, values: Values, step: FloatArray, damping: float) -> None:
    for points, found in point_steps(plan.problem, rays, values, step, damping):
        put(points, found)


def reduce_right_hand_side(
    plan: Plan, values: Values, rhs: FloatArray, damping: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Reduced right-hand sides (n, k) of rhs (u, k), and N_pp⁻¹ b_p of the points (p, 3, k).

    Where points have nothing on their right-hand side, their rays are not looked at.
    """
    reduced = rhs[plan.kept].copy()
    of_points = rhs[plan.rays.columns]
    answer = np.zeros(of_points.shape)
    touched = np.asarray(of_points.any(axis=(1, 2)))
    wanted = tuple(chunk for chunk in plan.rays.chunks if touched[chunk.points].any())
    for chunk in ray_chunks(plan.problem, plan.rays._replace(chunks=wanted), plan.reduced, values):
        if not touched[chunk.points].any():
            continue
        rays = chunk.rays
        roots = inverse_roots(point_normals(rays), damping)[0]
        alone = roots.transpose(0, 2, 1) @ (roots @ of_points[chunk.points])
        answer[chunk.points] = alone
        moved = np.einsum("nmi,nik->nmk", rays.by_point, alone[point_of_ray(rays)])
        add_to_others(rays, -moved, reduced)
    return reduced, answer


def add_to_others(rays: Rays, image: FloatArray, into: FloatArray) -> None:
    """Add A_rᵀ of an image (n, 2, k) of the rays to the reduced unknowns (r, k), in place, frame by frame."""
    order = np.argsort(rays.frame, kind="stable")
    ends = np.cumsum(np.bincount(rays.frame, minlength=len(rays.columns)))
    by_others, width = rays.by_others[order], rays.by_others.shape[2]
    sorted_image = image[order]
    first = 0
    for columns, end in zip(rays.columns, ends, strict=True):
        free = columns >= 0
        if end > first and free.any():
            J, v = (by_others[first:end].reshape(-1, width), sorted_image[first:end].reshape(-1, image.shape[2]))
            into[columns[free]] += (J.T @ v)[free]
        first = end


def point_normals(rays: Rays) -> FloatArray:
    """N_pp (p, 3, 3) of the points of a chunk."""
    products = np.einsum("nmi,nmj->nij", rays.by_point, rays.by_point)
    normals: FloatArray = np.add.reduceat(products, rays.point_pointers[:-1], axis=0)
    return normals


def point_of_ray(rays: Rays) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """(n,) point of each ray within its chunk."""
    return np.repeat(np.arange(rays.points), np.diff(rays.point_pointers))


# ---- Normal equations N = AᵀPA, b = AᵀPl of a plan at given values, and what else one pass over the rows yields.


class NormalEquations(NamedTuple):
    """Normal equations."""

    matrix: BlockMatrix
    """The reduced system: N without the eliminated points."""
    reduced_rhs: FloatArray
    """(n,) its right-hand side."""
    diagonal: FloatArray
    """(n,) diagonal of N itself, before points are eliminated: the measure of what vanishes."""
    rhs: FloatArray
    """(u,) AᵀPl with l = observed − computed, of all unknowns."""
    objective: float
    """lᵀPl."""

    def spent(self) -> NormalEquations:
        """The objective alone: of a solution nobody asks for the system, and it takes room."""
        none = np.zeros(0)
        return NormalEquations(BlockMatrix(self.matrix.structure, none), none, none, none, self.objective)


class WhiteRows(NamedTuple):
    """Whitened rows of a row set or a cluster: unit weight, uncorrelated."""

    misclosure: FloatArray
    jacobian: FloatArray
    columns: IntArray


def build_normals(plan: Plan, values: Values, damping: float = 0.0) -> NormalEquations:
    """One pass over all rows; ``damping`` μ adds μ diag N (Levenberg-Marquardt)."""
    structure = plan.target.structure
    block_values = np.zeros(int(structure.position[-1]))
    reduced_rhs = np.zeros(structure.unknowns)
    rhs = np.zeros(plan.problem.index.count)
    total = 0.0
    for rows in white_rows(plan, values):
        total += float(np.sum(rows.misclosure**2))
        accumulate_rows(plan.target, block_values, reduced_rhs, rows.jacobian, rows.misclosure, rows.columns)
    matrix = BlockMatrix(structure, block_values)
    system = ReducedSystem(matrix, reduced_rhs, matrix.diagonal(), reduced_rhs.copy())

    def put(points: slice, gradient: FloatArray) -> None:
        rhs[plan.rays.columns[points]] = gradient

    for own, squares in in_lanes(plan, block_values.size, _reduced_system, values, damping, put=put):
        for whole, part in zip(_arrays(system), own, strict=True):
            whole += part
        total += squares
    rhs[plan.kept] = system.gradient
    if damping:
        add_to_diagonal(matrix, damping * system.diagonal)
    return NormalEquations(matrix, reduced_rhs, system.diagonal, rhs, total)


def _reduced_system(
    plan: Plan, rays: RayPlan, put: Put, values: Values, damping: float
) -> tuple[tuple[FloatArray, ...], float]:
    own, squares = empty_reduced_system(plan.target.structure), 0.0
    for chunk in eliminate_chunks(plan.problem, rays, plan.reduced, values, own, damping):
        put(chunk.points, chunk.gradient)
        squares += chunk.squares
    return _arrays(own), squares


def _arrays(system: ReducedSystem) -> tuple[FloatArray, ...]:
    return system.matrix.values, system.right_hand_side, system.diagonal, system.gradient


def add_to_diagonal(matrix: BlockMatrix, amounts: FloatArray) -> None:
    """Add (n,) amounts to the diagonal, in place."""
    structure = matrix.structure
    sizes = structure.sizes
    within = np.arange(structure.unknowns) - np.repeat(structure.offsets[:-1], sizes)
    starts = np.repeat(structure.position[structure.indptr[:-1]], sizes)
    matrix.values[starts + within * (np.repeat(sizes, sizes) + 1)] += amounts


def white_rows(plan: Plan, values: Values) -> Iterator[WhiteRows]:
    """All rows but those of eliminated points, whitened: by row sets, by clusters of single rows, then by clusters.

    Their columns are those of the reduced system.
    """
    problem = plan.problem
    tangent = rotation_tangents(problem.index, values)
    for row_set in plan.row_sets:
        rows = linearise_of(problem, row_set.group, values, tangent, row_set.rows)
        yield WhiteRows(
            row_set.weight * rows.misclosure,
            row_set.weight[:, :, None] * rows.jacobian,
            reduced_columns(rows.columns, plan.reduced),
        )
    of_rows, wide = plan.sorted_clusters
    for some in of_rows:
        rows = linearise_of(problem, some.group, values, tangent, some.rows)
        yield WhiteRows(
            np.einsum("nij,nj->ni", some.whitening, rows.misclosure),
            some.whitening @ rows.jacobian,
            reduced_columns(rows.columns, plan.reduced),
        )
    for alike in wide:
        misclosure, jacobian = alike.rows(problem, values, tangent)
        yield WhiteRows(
            np.einsum("nij,nj->ni", alike.whitening, misclosure),
            alike.whitening @ jacobian,
            plan.reduced[alike.columns],
        )


def objective(plan: Plan, values: Values) -> float:
    """lᵀPl at the given values, without derivatives; infinite where an equation cannot be evaluated."""
    total = sum(in_lanes(plan, 0, _objective_of_rays, values))
    for row_set in plan.row_sets:
        misclosure = misclosures_of(plan.problem, row_set.group, values, row_set.rows)
        total += float(np.sum(np.where(row_set.weight > 0.0, row_set.weight * misclosure, 0.0) ** 2))
    of_rows, wide = plan.sorted_clusters
    for some in of_rows:
        misclosure = misclosures_of(plan.problem, some.group, values, some.rows)
        observed = some.whitening.any(axis=1)
        total += float(np.sum(np.einsum("nij,nj->ni", some.whitening, np.where(observed, misclosure, 0.0)) ** 2))
    for alike in wide:
        misclosure = alike.misclosures(plan.problem, values)
        total += float(np.sum(np.einsum("nij,nj->ni", alike.whitening, misclosure) ** 2))
    return total if np.isfinite(total) else np.inf


def _objective_of_rays(plan: Plan, rays: RayPlan, put: Put | None, values: Values) -> float:
    return ray_objective(plan.problem, rays, values)


def image_of(plan: Plan, values: Values, directions: FloatArray) -> FloatArray:
    """GᵀNG (k, k) of directions G (u, k), formed from A G itself: a null vector shows as zero, not as noise."""
    gram = np.zeros((directions.shape[1], directions.shape[1]))
    reduced = directions[plan.kept]
    for rows in white_rows(plan, values):
        moved = np.where((rows.columns >= 0)[:, :, None], reduced[rows.columns], 0.0)
        image = np.einsum("nmk,nkd->nmd", rows.jacobian, moved)
        gram += np.einsum("nmd,nme->de", image, image)

    return sum(in_lanes(plan, gram.size, _gram_of_rays, values, directions), gram)


def _gram_of_rays(plan: Plan, rays: RayPlan, put: Put | None, values: Values, directions: FloatArray) -> FloatArray:
    own, reduced = np.zeros((directions.shape[1], directions.shape[1])), directions[plan.kept]
    for chunk in ray_chunks(plan.problem, rays, plan.reduced, values):
        image = image_of_rays(chunk.rays, reduced, directions[rays.columns[chunk.points]])
        flat = image.reshape(-1, image.shape[2])
        own += flat.T @ flat
    return own


def normal_product(plan: Plan, values: Values, directions: FloatArray) -> FloatArray:
    """AᵀPA G (u, k) of directions G (u, k), formed from A G itself."""
    product = np.zeros_like(directions)
    reduced = directions[plan.kept]
    below = np.zeros_like(reduced)
    for rows in white_rows(plan, values):
        free = rows.columns >= 0
        moved = np.where(free[:, :, None], reduced[rows.columns], 0.0)
        back = np.swapaxes(rows.jacobian, 1, 2) @ (rows.jacobian @ moved)
        np.add.at(below, rows.columns[free], back[free])
    for chunk in ray_chunks(plan.problem, plan.rays, plan.reduced, values):
        rays, columns = chunk.rays, plan.rays.columns[chunk.points]
        image = image_of_rays(rays, reduced, directions[columns])
        of_points = np.swapaxes(rays.by_point, 1, 2) @ image
        product[columns] = np.add.reduceat(of_points, rays.point_pointers[:-1], axis=0)
        add_to_others(rays, image, below)
    product[plan.kept] = below
    return product


def image_of_rays(rays: Rays, reduced: FloatArray, of_points: FloatArray) -> FloatArray:
    """A G (n, 2, k) of rays for directions given on the reduced unknowns (n, k) and on their points (p, 3, k)."""
    moved = np.where((rays.columns >= 0)[:, :, None], reduced[rays.columns], 0.0)[rays.frame]
    point = np.repeat(np.arange(rays.points), np.diff(rays.point_pointers))
    image: FloatArray = np.matmul(rays.by_others, moved) + np.matmul(rays.by_point, of_points[point])
    return image


def gradient_elsewhere(plan: Plan, values: Values, there: Values) -> FloatArray:
    """Return AᵀPl (u,) with the derivatives A at ``values`` and the misclosures l at the values ``there``."""
    rhs = np.zeros(plan.problem.index.count)
    reduced = np.zeros((len(plan.kept), 1))
    for rows, other in zip(white_rows(plan, values), white_rows(plan, there), strict=True):
        free = rows.columns >= 0
        back = np.einsum("nmk,nm->nk", rows.jacobian, other.misclosure)
        np.add.at(reduced[:, 0], rows.columns[free], back[free])
    chunks = zip(
        ray_chunks(plan.problem, plan.rays, plan.reduced, values),
        ray_chunks(plan.problem, plan.rays, plan.reduced, there),
        strict=True,
    )
    for here, moved in chunks:
        image = -moved.rays.residual[:, :, None]
        of_points = np.swapaxes(here.rays.by_point, 1, 2) @ image
        rhs[plan.rays.columns[here.points]] = np.add.reduceat(of_points[:, :, 0], here.rays.point_pointers[:-1], axis=0)
        add_to_others(here.rays, image, reduced)
    rhs[plan.kept] += reduced[:, 0]
    return rhs


# ---- Which points are eliminated on the fly: those that meet nothing but frames, and that their rays determine.


def eliminable_rays(problem: Problem, values: Values) -> RayPlan:
    """Rays of the points that may be eliminated, points in the order of the first frame that sees them.

    A point qualifies if all its coordinates are free and its own, if it occurs only as the target of uncorrelated
    rays, and if these rays alone, from known frames, determine it.
    """
    candidates = _candidates(problem)
    if problem.index.count == 3 * len(candidates):
        return plan_rays(problem, candidates[:0])  # nothing would be left of the reduced system
    rays = plan_rays(problem, candidates)
    # Normal matrices (p, 3, 3) of the points, all else known.
    normal = np.zeros((len(rays.points), 3, 3))
    with shared_among(lambda: None):  # one pass only: to send the problem for it takes longer
        in_lanes(RaysOfProblem(problem, rays), 0, _normals_of_points, values, put=normal.__setitem__)
    good = _well_determined(normal)
    return rays if good.all() else plan_rays(problem, rays.points[good])


def _normals_of_points(shared: RaysOfProblem, rays: RayPlan, put: Put, values: Values) -> None:
    for chunk in ray_chunks(shared.problem, rays, np.arange(shared.problem.index.count), values):
        put(chunk.points, point_normals(chunk.rays))


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


def _well_determined(normal: FloatArray) -> BoolArray:
    """True where the smallest eigenvalue of a matrix (p, 3, 3), scaled to unit diagonal, is not too small.

    The three eigenvalues of such a matrix add up to 3, so the smallest is at least its determinant / (3/2)². Only where
    that does not decide, it is worked out.
    """
    diagonal = np.diagonal(normal, axis1=1, axis2=2)
    good: BoolArray = np.asarray((diagonal > 0.0).all(axis=1) & np.isfinite(normal).all(axis=(1, 2)))
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    a, b, c = (np.where(good, normal[:, i, j] * scale[:, i] * scale[:, j], 0.0) for i, j in ((1, 0), (2, 0), (2, 1)))
    determinant = 1.0 + 2.0 * a * b * c - a * a - b * b - c * c
    doubtful = np.flatnonzero(good & (determinant < 1e-4))
    if len(doubtful):
        s = scale[doubtful]
        scaled = normal[doubtful] * s[:, :, None] * s[:, None, :]
        # A point may be eliminated if no eigenvalue of its normal matrix, scaled to unit diagonal, is smaller.
        good[doubtful] = np.linalg.eigvalsh(scaled)[:, 0] > 1e-8
    return good
