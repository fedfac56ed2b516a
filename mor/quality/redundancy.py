"""Residuals and redundancy numbers of every observation: r = diag(Q_vv P), exact, correlated or not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.block_matrix import BlockMatrix
from mor.adjustment.linearise import linearise, misclosures, rotation_tangents
from mor.adjustment.normals import cluster_rows, image_of_rays
from mor.adjustment.plan import ClusterRows, reduced_columns
from mor.adjustment.point_elimination import cofactors as ray_cofactors
from mor.adjustment.ray_plan import RayChunk, ray_chunks
from mor.adjustment.rows import gather, row_cofactors
from mor.adjustment.solve import Adjustment
from mor.geometry.arrays import BoolArray, FloatArray, IntArray


class ObservationQuality(NamedTuple):
    """Quality of one observation group, (n, m) each; NaN where not observed. Cofactors hold for σ0 = 1."""

    v: FloatArray
    """Residuals, adjusted − observed."""
    r: FloatArray
    """Redundancy numbers."""
    q_adjusted: FloatArray
    """Cofactors (variances for σ0 = 1) of the adjusted observations."""
    q_residual: FloatArray
    """Cofactors of the residuals; 0 where an observation is not controlled at all."""
    weighted: FloatArray
    """P v, so that Σ v · P v is the part of vᵀPv a group contributes, correlated or not."""


def observation_quality(
    adjustment: Adjustment, cofactors: BlockMatrix
) -> tuple[tuple[ObservationQuality, ...], FloatArray]:
    """Residuals, redundancy numbers and cofactors of all groups, from the selected inverse of the reduced system.

    Also the cofactors (p, 3, 3) of the eliminated points, which come out of the same pass (without weak directions).
    """
    plan, values = adjustment.plan, adjustment.values
    groups = adjustment.problem.groups
    quality = tuple(_empty(misclosures(group, values)) for group in groups)
    tangent = rotation_tangents(adjustment.problem.index, values)
    weak = adjustment.inverse.weak
    for row_set in plan.row_sets:
        rows = linearise(groups[row_set.group], adjustment.problem.index, values, tangent, row_set.rows)
        q = row_cofactors(
            cofactors, plan.target.block_of, rows.jacobian, reduced_columns(rows.columns, plan.reduced)
        )
        if weak.shape[1]:
            moved = np.where((rows.columns >= 0)[:, :, None], weak[rows.columns], 0.0)
            image = rows.jacobian @ moved
            q = q + image @ np.swapaxes(image, 1, 2)
        adjusted = np.diagonal(q, axis1=1, axis2=2)
        here = row_set.weight > 0.0
        _fill(quality[row_set.group], row_set.rows, here, adjusted, row_set.weight)
    for cluster in plan.clusters:
        _cluster_quality(adjustment, cofactors, cluster, quality, tangent)
    of_points = np.zeros((len(plan.rays.columns), 3, 3))
    for chunk in ray_chunks(adjustment.problem, plan.rays, plan.reduced, values):
        of_points[chunk.points], whitened = ray_cofactors(chunk.rays, cofactors)
        if weak.shape[1]:
            image = image_of_rays(chunk.rays, weak[plan.kept], weak[plan.rays.columns[chunk.points]])
            whitened = whitened + np.sum(image**2, axis=2)
        _fill_rays(adjustment, quality, chunk, whitened)
    return quality, of_points


def _fill_rays(
    adjustment: Adjustment, quality: tuple[ObservationQuality, ...], chunk: RayChunk, whitened: FloatArray
) -> None:
    for number in np.unique(chunk.group):
        group = adjustment.problem.groups[number]
        here = chunk.group == number
        rows = chunk.row[here]
        weight = np.where(group.mask[rows], 1.0 / group.sigma[rows], 0.0)
        variance = np.where(group.mask[rows], group.sigma[rows] ** 2, 0.0)
        _fill(quality[number], rows, group.mask[rows], whitened[here] * variance, weight)


def _empty(misclosure: FloatArray) -> ObservationQuality:
    return ObservationQuality(-misclosure, *(np.full(misclosure.shape, np.nan) for _ in range(4)))


def _fill(
    quality: ObservationQuality, rows: IntArray, here: BoolArray, adjusted: FloatArray, weight: FloatArray
) -> None:
    variance = 1.0 / np.where(here, weight, 1.0) ** 2
    r = np.clip(1.0 - adjusted / variance, 0.0, 1.0)
    for array, new in (
        (quality.r, r),
        (quality.q_adjusted, adjusted),
        (quality.q_residual, r * variance),
        (quality.weighted, quality.v[rows] / variance),
    ):
        array[rows] = np.where(here, new, array[rows])


def _cluster_quality(
    adjustment: Adjustment,
    cofactors: BlockMatrix,
    cluster: ClusterRows,
    quality: tuple[ObservationQuality, ...],
    tangent: FloatArray | None,
) -> None:
    plan = adjustment.plan
    _, jacobian, columns = cluster_rows(plan, cluster, adjustment.values, tangent)
    q = gather(cofactors, plan.target.block_of, plan.reduced[columns])
    weak = adjustment.inverse.weak[columns]
    adjusted = jacobian @ (q + weak @ weak.T) @ jacobian.T
    precision = cluster.whitening.T @ cluster.whitening
    covariance = np.linalg.inv(precision)
    r = 1.0 - np.diagonal(adjusted @ precision)
    residual = np.diagonal(covariance - adjusted)
    misclosure = [
        quality[group].v[row, component]
        for group, row, component in zip(cluster.groups, cluster.rows, cluster.components, strict=True)
    ]
    weighted = precision @ np.array(misclosure)
    for k, (group, row, component) in enumerate(
        zip(cluster.groups, cluster.rows, cluster.components, strict=True)
    ):
        quality[group].r[row, component] = r[k]
        quality[group].q_adjusted[row, component] = adjusted[k, k]
        quality[group].q_residual[row, component] = max(residual[k], 0.0)
        quality[group].weighted[row, component] = weighted[k]
