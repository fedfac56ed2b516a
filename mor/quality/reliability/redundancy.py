"""Residuals, redundancy numbers and what the tests need of every observation, exact, correlated or not.

With Q_vv = P⁻¹ − A Q Aᵀ, r = diag(Q_vv P). The tests rest on P Q_vv P (W. Baarda, 1968), of which the diagonal is kept,
and for the components of one observation row the statistic of the joint test, (Pv)ᵀ (P Q_vv P)⁻¹ (Pv) over them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mor import compilation, long_arrays
from mor.adjustment.datum.s_transformation import STransformation
from mor.adjustment.linearise import linearise, misclosures, rotation_tangents
from mor.adjustment.normals import image_of_rays
from mor.adjustment.plan import RowSet, reduced_columns
from mor.adjustment.rays.chunks import RayChunk, ray_chunks, ray_residuals
from mor.adjustment.rays.lanes import in_lanes
from mor.adjustment.rays.plan import RayPlan
from mor.adjustment.rays.point_elimination import cofactors as ray_cofactors
from mor.adjustment.rays.point_elimination import split
from mor.adjustment.state import Adjustment
from mor.arrays import AnyIntArray, BoolArray, FloatArray, IntArray
from mor.observations import ObservationGroup
from mor.quality.effort import Done
from mor.quality.reliability import ray_kernels as compiled_rays
from mor.quality.reliability.correlated import cluster_quality, row_cluster_quality
from mor.quality.reliability.influence_on_position import (
    Directions,
    add_directions,
    counted_columns,
    directions,
    lengths_of_rays,
    lengths_of_rows,
)
from mor.quality.reliability.observation_quality import Correlated, ObservationQuality
from mor.quality.tests.joint_test import joint_statistic
from mor.quality.tests.test_statistics import CONTROLLED
from mor.sparse.block_matrix import BlockMatrix
from mor.sparse.rows import row_cofactors


def observation_quality(
    adjustment: Adjustment, cofactors: BlockMatrix, datum: STransformation, done: Done | None = None
) -> tuple[tuple[ObservationQuality, ...], FloatArray]:
    """Residuals, redundancy numbers and cofactors of all groups, from the selected inverse of the reduced system.

    Also the cofactors of the eliminated points (n, 3, 3), by point block, zero for all others; out of the same pass
    (without weak directions, in the minimal datum). What errors carry into points is in the datum of the adjustment.
    Residuals are those of the solution; Jacobians are taken where the system was factorised, a tiny last step before,
    so that Σ r comes out right to the last digits. ``done`` is told how many more rays are done.
    """
    plan, values = adjustment.plan, adjustment.inverse.values
    quality = _residuals(adjustment)
    tangent = rotation_tangents(adjustment.problem.index, values)
    extra = directions(adjustment, datum)
    for row_set in plan.row_sets:
        if len(row_set.rows):
            _fill_row_set(adjustment, cofactors, row_set, quality[row_set.group], tangent, extra)
    of_rows, wide = plan.sorted_clusters
    correlated = [
        *(
            row_cluster_quality(adjustment, cofactors, some, quality[some.group], tangent, extra)
            for some in of_rows
        ),
        *(cluster_quality(adjustment, cofactors, alike, quality, tangent, extra) for alike in wide),
    ]
    of_points = long_arrays.full((len(adjustment.problem.index.columns.get("point", ())), 3, 3), 0.0)
    weak = adjustment.inverse.weak
    selected = split(reduced_columns(plan.rays.frames.columns, plan.reduced), cofactors)

    def of_lane(rays: RayPlan) -> None:
        for chunk in ray_chunks(adjustment.problem, rays, plan.reduced, values):
            of_points[rays.points[chunk.points]], white, shares = ray_cofactors(chunk.rays, selected)
            if weak.shape[1]:
                image = image_of_rays(chunk.rays, weak[plan.kept], weak[rays.columns[chunk.points]])
                white = white + image @ np.swapaxes(image, 1, 2)
            add_directions(plan, rays, chunk, extra, shares)
            _fill_rays(quality, chunk, white, shares)
            if done is not None:
                done(len(chunk.row))

    in_lanes(plan.rays, 0, of_lane)
    return tuple(_with_correlated(number, one, correlated) for number, one in enumerate(quality)), of_points


def _fill_row_set(
    adjustment: Adjustment,
    cofactors: BlockMatrix,
    row_set: RowSet,
    quality: ObservationQuality,
    tangent: FloatArray | None,
    extra: Directions,
) -> None:
    plan, number = adjustment.plan, row_set.group
    group, index = adjustment.problem.groups[number], adjustment.problem.index
    rows = linearise(group, index, adjustment.inverse.values, tangent, row_set.rows)
    counted = counted_columns(adjustment, number, row_set.rows, rows.columns)
    own = np.where(counted[:, None, :], rows.jacobian, 0.0)
    both = np.concatenate([rows.jacobian, own], axis=1)
    q = row_cofactors(cofactors, plan.target.block_of, both, reduced_columns(rows.columns, plan.reduced))
    m = rows.jacobian.shape[1]
    q, shares = q[:, :m, :m], np.diagonal(q[:, m:, :m], axis1=1, axis2=2)
    shares = shares + extra.added(own, rows.jacobian, rows.columns)
    weak = adjustment.inverse.weak
    if weak.shape[1]:
        moved = np.where((rows.columns >= 0)[:, :, None], weak[rows.columns], 0.0)
        image = rows.jacobian @ moved
        q = q + image @ np.swapaxes(image, 1, 2)
    here = row_set.weight > 0.0
    white = q * row_set.weight[:, :, None] * row_set.weight[:, None, :]
    length = lengths_of_rows(adjustment, number, row_set.rows, rows.jacobian, rows.columns)
    _fill(quality, row_set.rows, here, white, shares * row_set.weight**2 * length, row_set.weight)


def _fill_rays(
    quality: tuple[ObservationQuality, ...], chunk: RayChunk, white: FloatArray, shares: FloatArray
) -> None:
    for number, place in _of_each_group(chunk.group):
        one = quality[number]
        rows = chunk.row[place]
        if compilation.wanted():
            arrays = one.v, one.absorbed, one.carried, one.joint_of_row, one.freedom_of_row
            by_point = chunk.rays.by_point
            compiled_rays.fill(rows, place, chunk.weight, white, shares, by_point, CONTROLLED, *arrays)
        else:
            weight, carries = chunk.weight[place], shares[place] * lengths_of_rays(chunk)[place]
            _fill(one, rows, weight > 0.0, white[place], carries, weight)


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
            weight = lane.measurements.of(chunk.rays).weight
            group_of_ray = lane.group_of_frame[chunk.frames][lane.frame[chunk.rays]]
            for number, here in _of_each_group(group_of_ray):
                rows, v = lane.row[chunk.rays][here], result[number].v
                if compilation.wanted():
                    compiled_rays.note_residuals(rows, here, weight, residual, v)
                else:
                    v[rows] = np.divide(
                        residual[here],
                        weight[here],
                        out=np.full((len(here), 2), np.nan),
                        where=weight[here] > 0.0,
                    )

    in_lanes(rays, 0, of_lane)
    return result


def _of_each_group(group: IntArray) -> Iterator[tuple[int, IntArray]]:
    """The groups of rays, and the rays of each; nothing is searched where all are of one, as in most blocks."""
    if len(group) and group.min() == group.max():
        yield int(group[0]), np.arange(len(group))
        return
    for number in np.unique(group):
        yield int(number), np.flatnonzero(group == number)


def _empty(group: ObservationGroup) -> ObservationQuality:
    v, absorbed, carried = (long_arrays.full(group.observed.shape, np.nan) for _ in range(3))
    joint, freedom = long_arrays.full(group.count, np.nan), long_arrays.full(group.count, 0, np.int8)
    return ObservationQuality(v, absorbed, carried, joint, freedom, group.sigma, group.left_out)


def _fill(
    quality: ObservationQuality,
    rows: AnyIntArray,
    here: BoolArray,
    white: FloatArray,
    carries: FloatArray,
    weight: FloatArray,
) -> None:
    """Rows of uncorrelated observations with W J Q Jᵀ W (n, m, m), W their weights (n, m) to the power ½."""
    joint, freedom = joint_statistic(quality.v[rows] * weight, np.eye(white.shape[1]) - white, here)
    quality.absorbed[rows] = np.where(here, np.diagonal(white, axis1=1, axis2=2), quality.absorbed[rows])
    quality.carried[rows] = np.where(here, carries, quality.carried[rows])
    quality.joint_of_row[rows] = joint
    quality.freedom_of_row[rows] = freedom


def _with_correlated(
    number: int, quality: ObservationQuality, found: list[dict[int, Correlated]]
) -> ObservationQuality:
    parts = [cluster[number] for cluster in found if number in cluster]
    if not parts:
        return quality
    return replace(quality, correlated=Correlated(*map(np.concatenate, zip(*parts, strict=True))))
