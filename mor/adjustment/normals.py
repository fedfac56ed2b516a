"""Normal equations N = AᵀPA, b = AᵀPl of a plan at given values, and what else one pass over the rows yields."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mor.adjustment.linearise import linearise_of, misclosures_of, rotation_tangents
from mor.adjustment.plan import Plan, reduced_columns
from mor.adjustment.rays.chunks import eliminate_chunks, ray_chunks, ray_objective
from mor.adjustment.rays.lanes import in_lanes
from mor.adjustment.rays.linearised import Rays
from mor.adjustment.rays.plan import RayPlan
from mor.adjustment.rays.point_solutions import add_to_others
from mor.adjustment.rays.reduced_system import ReducedSystem, empty_reduced_system
from mor.arrays import FloatArray, IntArray
from mor.parameters.index import Values
from mor.sparse.block_matrix import BlockMatrix
from mor.sparse.rows import accumulate_rows


class Normals(NamedTuple):
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

    def spent(self) -> Normals:
        """The objective alone: of a solution nobody asks for the system, and it takes room."""
        none = np.zeros(0)
        return Normals(BlockMatrix(self.matrix.structure, none), none, none, none, self.objective)


class WhiteRows(NamedTuple):
    """Whitened rows of a row set or a cluster: unit weight, uncorrelated."""

    misclosure: FloatArray
    jacobian: FloatArray
    columns: IntArray


def build_normals(plan: Plan, values: Values, damping: float = 0.0) -> Normals:
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

    def of_lane(rays: RayPlan) -> tuple[ReducedSystem, float]:
        own, squares = empty_reduced_system(structure), 0.0
        for chunk in eliminate_chunks(plan.problem, rays, plan.reduced, values, own, damping):
            rhs[rays.columns[chunk.points]] = chunk.gradient
            squares += chunk.squares
        return own, squares

    for own, squares in in_lanes(plan.rays, block_values.size, of_lane):
        for whole, part in zip(_arrays(system), _arrays(own), strict=True):
            whole += part
        total += squares
    rhs[plan.kept] = system.gradient
    if damping:
        add_to_diagonal(matrix, damping * system.diagonal)
    return Normals(matrix, reduced_rhs, system.diagonal, rhs, total)


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
    total = sum(in_lanes(plan.rays, 0, lambda rays: ray_objective(plan.problem, rays, values)))
    for row_set in plan.row_sets:
        misclosure = misclosures_of(plan.problem, row_set.group, values, row_set.rows)
        total += float(np.sum(np.where(row_set.weight > 0.0, row_set.weight * misclosure, 0.0) ** 2))
    of_rows, wide = plan.sorted_clusters
    for some in of_rows:
        misclosure = misclosures_of(plan.problem, some.group, values, some.rows)
        observed = some.whitening.any(axis=1)
        total += float(
            np.sum(np.einsum("nij,nj->ni", some.whitening, np.where(observed, misclosure, 0.0)) ** 2)
        )
    for alike in wide:
        misclosure = alike.misclosures(plan.problem, values)
        total += float(np.sum(np.einsum("nij,nj->ni", alike.whitening, misclosure) ** 2))
    return total if np.isfinite(total) else np.inf


def image_of(plan: Plan, values: Values, directions: FloatArray) -> FloatArray:
    """GᵀNG (k, k) of directions G (u, k), formed from A G itself: a null vector shows as zero, not as noise."""
    gram = np.zeros((directions.shape[1], directions.shape[1]))
    reduced = directions[plan.kept]
    for rows in white_rows(plan, values):
        moved = np.where((rows.columns >= 0)[:, :, None], reduced[rows.columns], 0.0)
        image = np.einsum("nmk,nkd->nmd", rows.jacobian, moved)
        gram += np.einsum("nmd,nme->de", image, image)

    def of_lane(rays: RayPlan) -> FloatArray:
        own = np.zeros_like(gram)
        for chunk in ray_chunks(plan.problem, rays, plan.reduced, values):
            image = image_of_rays(chunk.rays, reduced, directions[rays.columns[chunk.points]])
            flat = image.reshape(-1, image.shape[2])
            own += flat.T @ flat
        return own

    return sum(in_lanes(plan.rays, gram.size, of_lane), gram)


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
        rhs[plan.rays.columns[here.points]] = np.add.reduceat(
            of_points[:, :, 0], here.rays.point_pointers[:-1], axis=0
        )
        add_to_others(here.rays, image, reduced)
    rhs[plan.kept] += reduced[:, 0]
    return rhs
