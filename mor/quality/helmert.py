"""Helmert's system of variance components in full: what each group's part of vᵀPv is expected to be.

With the covariance matrix of the observations V = Σ f_g V_g, f_g = 1 where the σ are right, and R = I − A Q Aᵀ of the
whitened observations, the parts Ω_g of vᵀPv have the expectations (F. R. Helmert, 1907; E. W. Grafarend, 1980)

    E Ω_g = Σ_h S_gh f_h,    S_gh = tr(R V_g R V_h) = tr(V_g V_h) − 2 tr(Q Aᵀ V_g V_h A) + tr(Q N_g Q N_h),

with V_g whitened and N_g = Aᵀ V_g A. f = S⁻¹ Ω is unbiased, in one step, and of all unbiased quadratic estimates the
best for normally distributed observations whose σ are those assumed; its covariance matrix is 2 S⁻¹ then. Rows of S add
up to Σ r_g: where groups do not mix, this is the simplified estimate Ω_g/Σr_g.

Correlations between groups scale with the σ of both, so that V_g is the derivative of V = F^½ V F^½.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse

from mor.model import rotations
from mor.quality.assessment import Quality, joint_cofactors
from mor.solve.elimination import ray_chunks
from mor.solve.problem import ClusterRows, cluster_rows, linearise, rotation_tangents
from mor.types import BoolArray, FloatArray, IntArray

MOST_UNKNOWNS = 3000


def affordable(quality: Quality) -> bool:
    """True where the dense matrices of Helmert's system have room."""
    problem = quality.adjustment.problem
    unknowns = problem.index.count
    # Room (480 MB) for a matrix of all unknowns for each group.
    return unknowns <= MOST_UNKNOWNS and len(problem.groups) * unknowns**2 <= 60_000_000


def helmert_system(quality: Quality) -> FloatArray:
    """S (g, g) of the groups of an assessed adjustment; excluded observations have no part in it."""
    A, parts = _design(quality)
    Q = joint_cofactors(quality, np.arange(quality.adjustment.problem.index.count))
    passed_on = [np.asarray((A.T @ (V @ A)).T @ Q).T for V in parts]  # Q N_g
    system = np.zeros((len(parts), len(parts)))
    for g, one in enumerate(parts):
        for h in range(g + 1):
            product = one @ parts[h]
            middle = (A.T @ (product @ A)).tocoo() if product.nnz else None
            hidden = 0.0 if middle is None else float(np.sum(Q[middle.row, middle.col] * middle.data))
            both = float(np.sum(passed_on[g] * passed_on[h].T))
            system[g, h] = system[h, g] = product.trace() - 2.0 * hidden + both
    return system


class _Rows(NamedTuple):
    """Whitened rows of one group, or of a cluster."""

    design: scipy.sparse.coo_array
    """(n, u)."""
    parts: list[scipy.sparse.coo_array]
    """(n, n) whitened V_g of each group."""


def _design(quality: Quality) -> tuple[scipy.sparse.csr_array, list[scipy.sparse.csr_array]]:
    """Whitened A (n, u), and the whitened V_g (n, n)."""
    adjustment = quality.adjustment
    plan, values, problem = adjustment.plan, adjustment.inverse.values, adjustment.problem
    tangent = rotation_tangents(problem.index, values)
    found = []
    for row_set in plan.row_sets:
        rows = linearise(problem.groups[row_set.group], problem.index, values, tangent, row_set.rows)
        jacobian = rows.jacobian * row_set.weight[:, :, None]
        inside = (row_set.weight > 0.0) & ~problem.groups[row_set.group].left_out[row_set.rows]
        found.append(_uncorrelated(quality, row_set.group, jacobian, rows.columns, inside))
    for chunk in ray_chunks(problem, plan.rays, np.arange(problem.index.count), values):
        of_points = np.repeat(plan.rays.columns[chunk.points], np.diff(chunk.rays.point_pointers), axis=0)
        columns = np.concatenate([chunk.rays.columns_of_rays, of_points], axis=1)
        jacobian = np.concatenate([chunk.rays.by_others, chunk.rays.by_point], axis=2)
        for number in np.unique(chunk.group):
            here = chunk.group == number
            inside = (chunk.weight[here] > 0.0) & ~problem.groups[number].left_out[chunk.row[here]]
            found.append(_uncorrelated(quality, number, jacobian[here], columns[here], inside))
    for cluster in plan.clusters:
        _, jacobian, unknowns = cluster_rows(plan.problem, cluster, values, tangent)
        found.append(_correlated(quality, cluster, cluster.whitening @ jacobian, unknowns))
    A = scipy.sparse.vstack([rows.design for rows in found], format="csr")
    return A, [
        scipy.sparse.block_diag([rows.parts[g] for rows in found], format="csr") for g in range(len(problem.groups))
    ]


def _uncorrelated(quality: Quality, number: int, jacobian: FloatArray, columns: IntArray, inside: BoolArray) -> _Rows:
    n, m, width = jacobian.shape
    row = np.repeat(np.arange(n * m), width)
    column = np.repeat(columns[:, None, :], m, axis=1).ravel()
    free = column >= 0
    shape = n * m, quality.adjustment.problem.index.count
    design = scipy.sparse.coo_array((jacobian.ravel()[free], (row[free], column[free])), shape=shape)
    parts = [
        scipy.sparse.diags_array(inside.ravel() * float(g == number), format="coo") for g in range(len(quality.groups))
    ]
    return _Rows(design, parts)


def _correlated(quality: Quality, cluster: ClusterRows, jacobian: FloatArray, unknowns: IntArray) -> _Rows:
    k, W = len(cluster.rows), cluster.whitening
    row, column = np.repeat(np.arange(k), len(unknowns)), np.tile(unknowns, k)
    shape = k, quality.adjustment.problem.index.count
    design = scipy.sparse.coo_array((jacobian.ravel(), (row, column)), shape=shape)
    groups = quality.adjustment.problem.groups
    left_out = np.array(
        [groups[g].left_out[i, c] for g, i, c in zip(cluster.groups, cluster.rows, cluster.components, strict=True)]
    )
    back = rotations.inv(W)
    parts = []
    for g in range(len(groups)):
        half = W @ (((cluster.groups == g) & ~left_out)[:, None] * back)
        parts.append(scipy.sparse.coo_array(0.5 * (half + half.T)))
    return _Rows(design, parts)
