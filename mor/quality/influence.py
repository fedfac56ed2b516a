"""What a gross error does to the coordinates: of chosen observations exactly, of all terrestrial ones as one number.

A gross error ∇ in observation i moves all unknowns by Q Aᵀ P e_i ∇, in the datum of the adjustment.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.linearise import linearise, rotation_tangents
from mor.adjustment.normals import cluster_rows
from mor.adjustment.plan import ClusterRows, reduced_columns
from mor.adjustment.rows import row_cofactors
from mor.adjustment.solve import Adjustment
from mor.geometry.arrays import BoolArray, FloatArray, IntArray
from mor.quality.assess import Quality
from mor.quality.ray_influence import OF_IMAGES, fill_influence_of_rays


class Entry(NamedTuple):
    """One observation: group, row, component."""

    group: int
    row: int
    component: int


def movements(quality: Quality, entries: list[Entry], errors: FloatArray) -> FloatArray:
    """Movement (u, k) of all unknowns by the gross errors (k,) of k observations, in the datum of the adjustment."""
    adjustment = quality.adjustment
    right = np.zeros((adjustment.problem.index.count, len(entries)))
    for k, (entry, error) in enumerate(zip(entries, errors, strict=True)):
        columns, values = gradient(adjustment, entry)
        np.add.at(right[:, k], columns, values * error)
    moved = adjustment.inverse.solve(right)
    datum = quality.datum
    if datum.null.shape[1] == 0:
        return moved
    into: FloatArray = moved - datum.null @ (datum.binding @ (adjustment.constraint.normals.T @ moved))
    return into


def gradient(adjustment: Adjustment, entry: Entry) -> tuple[IntArray, FloatArray]:
    """Aᵀ P e of an observation: unknowns (k,) and values (k,)."""
    problem = adjustment.problem
    tangent = rotation_tangents(problem.index, adjustment.values)
    for cluster in adjustment.plan.clusters:
        place = _place_in(cluster, entry)
        if place is not None:
            _, jacobian, columns = cluster_rows(adjustment.plan, cluster, adjustment.values, tangent)
            return columns, jacobian.T @ (cluster.whitening.T @ cluster.whitening[:, place])
    group = problem.groups[entry.group]
    rows = linearise(group, problem.index, adjustment.values, tangent, np.array([entry.row]))
    used = rows.columns[0] >= 0
    weight = 1.0 / group.sigma[entry.row, entry.component] ** 2
    return rows.columns[0][used], rows.jacobian[0, entry.component][used] * weight


def _place_in(cluster: ClusterRows, entry: Entry) -> int | None:
    here = (
        (cluster.groups == entry.group)
        & (cluster.rows == entry.row)
        & (cluster.components == entry.component)
    )
    return int(np.flatnonzero(here)[0]) if here.any() else None


def influence_on_points(quality: Quality) -> tuple[FloatArray, ...]:
    """EP of each group (n, m): the estimated gross error times the part of 1 − r that goes into coordinates of points.

    EP_i = ∇̂_i Σ_k a_ik (Q AᵀP)_ki over the unknown coordinates k (angles and instruments left out), for angles times
    the length of the sight. For image coordinates it is summed over the point they are of, not over the projection
    centre, and divided by |∂x/∂X|: the movement of the point across the ray. It depends on the datum. NaN for
    correlated observations, and for directions to points that nothing else meets; :func:`movements` gives them too.
    """
    adjustment = quality.adjustment
    problem, plan = adjustment.problem, adjustment.plan
    told = {row_set.group for row_set in plan.row_sets} | {
        frames.group
        for frames in plan.rays.frames.groups
        if problem.groups[frames.group].type.key in OF_IMAGES
    }
    result = tuple(
        np.full(group.observed.shape, np.nan)
        if number in told
        else np.broadcast_to(np.nan, group.observed.shape)
        for number, group in enumerate(problem.groups)
    )
    tangent = rotation_tangents(problem.index, adjustment.values)
    cofactors = adjustment.inverse.selected()
    is_point = np.array(problem.index.unknown_kind)[problem.index.kind_of] == "point"
    for row_set in plan.row_sets:
        group = problem.groups[row_set.group]
        rows = linearise(group, problem.index, adjustment.values, tangent, row_set.rows)
        free = rows.columns >= 0
        is_image = group.type.key in OF_IMAGES
        ours = is_point[np.where(free, rows.columns, 0)] & (_last_three(rows.columns) if is_image else True)
        own = np.where((free & ours)[:, None, :], rows.jacobian, 0.0)
        reduced = reduced_columns(rows.columns, plan.reduced)
        forms = [
            np.diagonal(row_cofactors(cofactors, plan.target.block_of, form, reduced), axis1=1, axis2=2)
            for form in (rows.jacobian + own, rows.jacobian - own)
        ]
        weak = np.where(free[:, :, None], adjustment.inverse.weak[rows.columns], 0.0)
        share = 0.25 * (forms[0] - forms[1]) + np.sum((own @ weak) * (rows.jacobian @ weak), axis=2)
        correction = quality.datum.correction(rows.columns, rows.columns)
        share = share + np.einsum("nmk,nkl,nml->nm", own, correction, rows.jacobian)
        error = quality.reliability[row_set.group].at(row_set.rows).error
        if is_image:
            length = 1.0 / np.linalg.norm(rows.jacobian[:, :, -3:], axis=2)
        else:
            length = _sight(adjustment, row_set.group)[row_set.rows]
        values = share * row_set.weight**2 * error * length
        result[row_set.group][row_set.rows] = np.where(row_set.weight > 0.0, values, np.nan)
    fill_influence_of_rays(quality, cofactors, result)
    return result


def _last_three(columns: IntArray) -> BoolArray:
    """(n, k) true for the coordinates of the point that an image coordinate is of."""
    return np.broadcast_to(np.arange(columns.shape[1]) >= columns.shape[1] - 3, columns.shape)


def _sight(adjustment: Adjustment, number: int) -> FloatArray:
    """(n, m) length of the sight for angular components, 1 for all others."""
    group = adjustment.problem.groups[number]
    positions = [
        adjustment.values["point"][blocks]
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True)
        if slot.kind == "point" and slot.part == "position"
    ]
    angular = group.type.wraps
    if len(positions) < 2 or not angular.any():
        return np.ones(group.observed.shape)
    along = positions[-1] - positions[0]
    horizontal, slope = np.hypot(along[:, 0], along[:, 1]), np.linalg.norm(along, axis=1)
    columns = [
        (horizontal if component in group.type.turns else slope) if turns else np.ones(len(slope))
        for component, turns in enumerate(angular)
    ]
    return np.stack(columns, axis=1)
