"""Normal equations N = AᵀPA, b = AᵀPl of a plan at given values, and what else one pass over the rows yields."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mor.adjustment.block_matrix import BlockMatrix
from mor.adjustment.linearise import Linearised, linearise, misclosures, rotation_tangents
from mor.adjustment.plan import ClusterRows, Plan, cluster_columns
from mor.adjustment.rows import accumulate_rows
from mor.geometry.arrays import FloatArray, IntArray
from mor.parameters.index import Values


class Normals(NamedTuple):
    """Normal equations."""

    matrix: BlockMatrix
    rhs: FloatArray
    """(u,) AᵀPl with l = observed − computed."""
    objective: float
    """lᵀPl."""


class WhiteRows(NamedTuple):
    """Whitened rows of a row set or a cluster: unit weight, uncorrelated."""

    misclosure: FloatArray
    jacobian: FloatArray
    columns: IntArray


def build_normals(plan: Plan, values: Values) -> Normals:
    """One pass over all rows."""
    structure = plan.target.structure
    block_values = np.zeros(int(structure.position[-1]))
    rhs = np.zeros(structure.unknowns)
    objective = 0.0
    for rows in white_rows(plan, values):
        objective += float(np.sum(rows.misclosure**2))
        accumulate_rows(plan.target, block_values, rhs, rows.jacobian, rows.misclosure, rows.columns)
    return Normals(BlockMatrix(structure, block_values), rhs, objective)


def white_rows(plan: Plan, values: Values) -> Iterator[WhiteRows]:
    """All rows, whitened: row set by row set, then cluster by cluster."""
    problem = plan.problem
    tangent = rotation_tangents(problem.index, values)
    for row_set in plan.row_sets:
        rows = linearise(problem.groups[row_set.group], problem.index, values, tangent, row_set.rows)
        yield WhiteRows(
            row_set.weight * rows.misclosure, row_set.weight[:, :, None] * rows.jacobian, rows.columns
        )
    for cluster in plan.clusters:
        misclosure, jacobian, columns = cluster_rows(plan, cluster, values, tangent)
        yield WhiteRows(
            (cluster.whitening @ misclosure)[None, :],
            (cluster.whitening @ jacobian)[None, :, :],
            columns[None, :],
        )


def cluster_rows(
    plan: Plan, cluster: ClusterRows, values: Values, tangent: FloatArray | None
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Misclosures (k,), dense Jacobian (k, c) and unknowns (c,) of a cluster, not whitened."""
    problem = plan.problem
    columns = cluster_columns(problem, cluster)
    misclosure = np.zeros(len(cluster.rows))
    jacobian = np.zeros((len(cluster.rows), len(columns)))
    for number in np.unique(cluster.groups):
        here = np.flatnonzero(cluster.groups == number)
        rows, inverse = np.unique(cluster.rows[here], return_inverse=True)
        part = linearise(problem.groups[number], problem.index, values, tangent, rows)
        misclosure[here] = part.misclosure[inverse, cluster.components[here]]
        _spread(jacobian, columns, here, inverse, cluster.components[here], part)
    return misclosure, jacobian, columns


def _spread(
    jacobian: FloatArray,
    columns: IntArray,
    here: IntArray,
    rows: IntArray,
    components: IntArray,
    part: Linearised,
) -> None:
    free = part.columns[rows] >= 0
    entry = np.broadcast_to(here[:, None], free.shape)[free]
    place = np.searchsorted(columns, part.columns[rows][free])
    np.add.at(jacobian, (entry, place), part.jacobian[rows, components][free])


def objective(plan: Plan, values: Values) -> float:
    """lᵀPl at the given values, without derivatives; infinite where an equation cannot be evaluated."""
    residuals = [misclosures(group, values) for group in plan.problem.groups]
    total = 0.0
    for row_set in plan.row_sets:
        scaled = np.where(row_set.weight > 0.0, row_set.weight * residuals[row_set.group][row_set.rows], 0.0)
        total += float(np.sum(scaled**2))
    for cluster in plan.clusters:
        together = np.array(
            [
                residuals[group][row, component]
                for group, row, component in zip(
                    cluster.groups, cluster.rows, cluster.components, strict=True
                )
            ]
        )
        total += float(np.sum((cluster.whitening @ together) ** 2))
    return total if np.isfinite(total) else np.inf


def image_of(plan: Plan, values: Values, directions: FloatArray) -> FloatArray:
    """GᵀNG (k, k) of directions G (u, k), formed from A G itself, so that a null vector shows as zero and not as noise."""
    gram = np.zeros((directions.shape[1], directions.shape[1]))
    for rows in white_rows(plan, values):
        moved = np.where((rows.columns >= 0)[:, :, None], directions[rows.columns], 0.0)
        image = np.einsum("nmk,nkd->nmd", rows.jacobian, moved)
        gram += np.einsum("nmd,nme->de", image, image)
    return gram
