"""Residuals, redundancy numbers and what the tests need of every observation, exact, correlated or not.

With Q_vv = P⁻¹ − A Q Aᵀ, r = diag(Q_vv P). The tests rest on P Q_vv P (W. Baarda, 1968), of which the diagonal is kept,
and for the components of one observation row the statistic of the joint test, (Pv)ᵀ (P Q_vv P)⁻¹ (Pv) over them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mor.adjustment import compiled
from mor.adjustment.block_matrix import BlockMatrix
from mor.adjustment.lanes import in_lanes
from mor.adjustment.linearise import linearise, misclosures, rotation_tangents
from mor.adjustment.normals import cluster_rows, image_of_rays
from mor.adjustment.plan import ClusterRows, reduced_columns
from mor.adjustment.point_elimination import cofactors as ray_cofactors
from mor.adjustment.ray_chunks import RayChunk, ray_chunks, ray_residuals
from mor.adjustment.ray_plan import RayPlan
from mor.adjustment.rows import gather, row_cofactors
from mor.adjustment.solve import Adjustment
from mor.geometry.arrays import BoolArray, FloatArray, IntArray
from mor.observations import ObservationGroup
from mor.quality import compiled_rays
from mor.quality.joint import joint_statistic
from mor.quality.observation_quality import Correlated, ObservationQuality
from mor.quality.tests import CONTROLLED


def observation_quality(
    adjustment: Adjustment, cofactors: BlockMatrix
) -> tuple[tuple[ObservationQuality, ...], FloatArray]:
    """Residuals, redundancy numbers and cofactors of all groups, from the selected inverse of the reduced system.

    Also the cofactors (p, 3, 3) of the eliminated points, which come out of the same pass (without weak directions).
    Residuals are those of the solution; Jacobians are taken where the system was factorised, a tiny last step before,
    so that Σ r comes out right to the last digits.
    """
    plan, values = adjustment.plan, adjustment.inverse.values
    groups = adjustment.problem.groups
    quality = _residuals(adjustment)
    tangent = rotation_tangents(adjustment.problem.index, values)
    weak = adjustment.inverse.weak
    for row_set in plan.row_sets:
        if len(row_set.rows) == 0:
            continue
        rows = linearise(groups[row_set.group], adjustment.problem.index, values, tangent, row_set.rows)
        q = row_cofactors(
            cofactors, plan.target.block_of, rows.jacobian, reduced_columns(rows.columns, plan.reduced)
        )
        if weak.shape[1]:
            moved = np.where((rows.columns >= 0)[:, :, None], weak[rows.columns], 0.0)
            image = rows.jacobian @ moved
            q = q + image @ np.swapaxes(image, 1, 2)
        here = row_set.weight > 0.0
        white = q * row_set.weight[:, :, None] * row_set.weight[:, None, :]
        _fill(quality[row_set.group], row_set.rows, here, white, row_set.weight)
    correlated = [
        _cluster_quality(adjustment, cofactors, cluster, quality, tangent) for cluster in plan.clusters
    ]
    of_points = np.zeros((len(plan.rays.columns), 3, 3))

    def of_lane(rays: RayPlan) -> None:
        for chunk in ray_chunks(adjustment.problem, rays, plan.reduced, values):
            of_points[chunk.points], white = ray_cofactors(chunk.rays, cofactors)
            if weak.shape[1]:
                image = image_of_rays(chunk.rays, weak[plan.kept], weak[rays.columns[chunk.points]])
                white = white + image @ np.swapaxes(image, 1, 2)
            _fill_rays(quality, chunk, white)

    in_lanes(plan.rays, 0, of_lane)
    return tuple(_with_correlated(number, one, correlated) for number, one in enumerate(quality)), of_points


def _fill_rays(quality: tuple[ObservationQuality, ...], chunk: RayChunk, white: FloatArray) -> None:
    for number in np.unique(chunk.group):
        place = np.flatnonzero(chunk.group == number)
        one = quality[number]
        rows = chunk.row[place]
        if compiled.available:
            arrays = one.v, one.out, one.absorbed, one.joint, one.freedom
            compiled_rays.fill(rows, place, chunk.weight, white, CONTROLLED, *arrays)
        else:
            _fill(one, rows, chunk.weight[place] > 0.0, white[place], chunk.weight[place])


def _residuals(adjustment: Adjustment) -> tuple[ObservationQuality, ...]:
    """Residuals of all groups, and nothing else yet."""
    rays, values = adjustment.plan.rays, adjustment.values
    groups = adjustment.problem.groups
    result = tuple(_empty(group) for group in groups)
    for number, (group, one) in enumerate(zip(groups, result, strict=True)):
        others = np.ones(group.count, dtype=bool)
        others[rays.rows_of_group(number)] = False
        rows = np.flatnonzero(others)
        if len(rows):
            one.v[rows] = -misclosures(group, values, rows)

    def of_lane(lane: RayPlan) -> None:
        for chunk, residual in ray_residuals(adjustment.problem, lane, values):
            weight = lane.measured.weight[chunk.rays]
            v = np.where(weight > 0.0, residual / np.where(weight > 0.0, weight, 1.0), np.nan)
            group_of_ray = lane.group_of_frame[chunk.frames][lane.frame[chunk.rays]]
            for number in np.unique(group_of_ray):
                here = group_of_ray == number
                result[number].v[lane.row[chunk.rays][here]] = v[here]

    in_lanes(rays, 0, of_lane)
    return result


def _empty(group: ObservationGroup) -> ObservationQuality:
    v, absorbed, joint, freedom = (np.full(group.observed.shape, np.nan) for _ in range(4))
    return ObservationQuality(v, absorbed, joint, freedom, group.sigma, group.left_out)


def _fill(
    quality: ObservationQuality, rows: IntArray, here: BoolArray, white: FloatArray, weight: FloatArray
) -> None:
    """Rows of uncorrelated observations with W J Q Jᵀ W (n, m, m), W their weights (n, m) to the power ½."""
    joint, freedom = joint_statistic(quality.v[rows] * weight, np.eye(white.shape[1]) - white, here)
    tested = here & ~quality.out[rows]
    quality.absorbed[rows] = np.where(here, np.diagonal(white, axis1=1, axis2=2), quality.absorbed[rows])
    quality.joint[rows] = np.where(tested, joint[:, None], quality.joint[rows])
    quality.freedom[rows] = np.where(tested, freedom[:, None], quality.freedom[rows])


def _with_correlated(
    number: int, quality: ObservationQuality, found: list[dict[int, Correlated]]
) -> ObservationQuality:
    parts = [cluster[number] for cluster in found if number in cluster]
    if not parts:
        return quality
    return replace(quality, correlated=Correlated(*map(np.concatenate, zip(*parts, strict=True))))


def _cluster_quality(
    adjustment: Adjustment,
    cofactors: BlockMatrix,
    cluster: ClusterRows,
    quality: tuple[ObservationQuality, ...],
    tangent: FloatArray | None,
) -> dict[int, Correlated]:
    """Quality of the entries of a cluster, by group; the joint tests are set in ``quality``."""
    plan = adjustment.plan
    _, jacobian, columns = cluster_rows(plan, cluster, adjustment.inverse.values, tangent)
    q = gather(cofactors, plan.target.block_of, plan.reduced[columns])
    weak = adjustment.inverse.weak[columns]
    adjusted = jacobian @ (q + weak @ weak.T) @ jacobian.T
    precision = cluster.whitening.T @ cluster.whitening
    covariance = np.linalg.inv(precision)
    misclosure = quality_at(cluster, [group.v for group in quality])
    weighted_cofactors = precision - precision @ adjusted @ precision
    joint, freedom = _joint_of_cluster(cluster, precision @ misclosure, weighted_cofactors)
    found = {}
    for number in np.unique(cluster.groups):
        here = cluster.groups == number
        rows, components = place = cluster.rows[here], cluster.components[here]
        inside = ~quality[number].out[place]
        quality[number].joint[place] = np.where(inside, joint[here], np.nan)
        quality[number].freedom[place] = np.where(inside, freedom[here], np.nan)
        found[int(number)] = Correlated(
            rows,
            components,
            r=1.0 - np.diagonal(adjusted @ precision)[here],
            q_adjusted=np.diagonal(adjusted)[here],
            q_residual=np.maximum(np.diagonal(covariance - adjusted), 0.0)[here],
            weighted=(precision @ misclosure)[here],
            precision=np.diagonal(precision)[here],
            q_weighted=np.clip(np.diagonal(weighted_cofactors), 0.0, np.diagonal(precision))[here],
        )
    return found


def quality_at(cluster: ClusterRows, arrays: list[FloatArray]) -> FloatArray:
    """(k,) entries of a cluster out of one array (n, m) for each group."""
    result = np.zeros(len(cluster.rows))
    for number in np.unique(cluster.groups):
        here = cluster.groups == number
        result[here] = arrays[number][cluster.rows[here], cluster.components[here]]
    return result


def _joint_of_cluster(
    cluster: ClusterRows, weighted: FloatArray, cofactors: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Statistic and freedom (k,) of the joint tests of the rows that a cluster touches."""
    statistic, freedom = np.zeros(len(weighted)), np.zeros(len(weighted))
    _, row_of = np.unique(np.stack([cluster.groups, cluster.rows]), axis=1, return_inverse=True)
    scale = np.sqrt(np.diagonal(cluster.whitening.T @ cluster.whitening))
    for row in range(int(row_of.max(initial=-1)) + 1):
        here = np.flatnonzero(row_of.ravel() == row)
        part = cofactors[np.ix_(here, here)] / np.outer(scale[here], scale[here])
        found = joint_statistic(
            (weighted[here] / scale[here])[None], part[None], np.ones((1, len(here)), bool)
        )
        statistic[here], freedom[here] = found[0][0], found[1][0]
    return statistic, freedom
