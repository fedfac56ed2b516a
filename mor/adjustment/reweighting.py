"""Residuals in units of σ and weights multiplied by factors, within the plan of an adjustment: nothing is sorted anew.

Factors are one array (n, m) for each observation group. Correlated observations keep their correlations: a factor f on
the weight divides σ by √f, so that whitening W becomes W diag(√f).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mor.adjustment.correlated_rows import ClusterRows
from mor.adjustment.linearise import misclosures, misclosures_of
from mor.adjustment.plan import Plan
from mor.adjustment.rays.chunks import ray_residuals
from mor.adjustment.rays.lanes import in_lanes
from mor.adjustment.rays.plan import Measurements, RayPlan
from mor.arrays import FloatArray
from mor.parameters.index import Values

Factors = Sequence[FloatArray]


def normalised_misclosures(plan: Plan, values: Values) -> tuple[FloatArray, ...]:
    """(observed − computed)/σ of every group (n, m), 0 where not observed; correlated ones each by its own σ."""
    problem = plan.problem
    found = tuple(np.zeros(group.observed.shape) for group in problem.groups)

    def of_lane(rays: RayPlan) -> None:
        for chunk, residual in ray_residuals(problem, rays, values):
            rows = rays.row[chunk.rays]
            group_of_ray = rays.group_of_frame[chunk.frames[rays.frame[chunk.rays]]]
            for group in rays.frames.groups:
                here = group_of_ray == group.group
                found[group.group][rows[here]] = -residual[here]

    in_lanes(plan.rays, 0, of_lane)
    for row_set in plan.row_sets:
        misclosure = misclosures_of(problem, row_set.group, values, row_set.rows)
        seen = row_set.weight > 0.0
        found[row_set.group][row_set.rows] = np.where(seen, row_set.weight * misclosure, 0.0)
    for cluster in plan.clusters:
        sigma = _sigmas(cluster)
        for number in np.unique(cluster.groups):
            here = cluster.groups == number
            rows, components = cluster.rows[here], cluster.components[here]
            misclosure = misclosures(problem.groups[number], values, rows)
            own = misclosure[np.arange(len(rows)), components]
            found[number][rows, components] = own / sigma[here]
    return found


def _sigmas(cluster: ClusterRows) -> FloatArray:
    """(k,) standard deviations of the entries: Σ = W⁻¹W⁻ᵀ."""
    root = np.linalg.inv(cluster.whitening)
    sigma: FloatArray = np.linalg.norm(root, axis=1)
    return sigma


def reweighted_plan(plan: Plan, factors: Factors) -> Plan:
    """The plan with weights multiplied by factors (n, m) of each group."""
    roots = [np.sqrt(factor) for factor in factors]
    row_sets = tuple(
        row_set._replace(weight=row_set.weight * roots[row_set.group][row_set.rows])
        for row_set in plan.row_sets
    )
    return replace(
        plan,
        rays=_reweighted_rays(plan, roots),
        row_sets=row_sets,
        clusters=tuple(_reweighted_cluster(cluster, roots) for cluster in plan.clusters),
    )


def _reweighted_rays(plan: Plan, roots: Factors) -> RayPlan:
    rays = plan.rays
    if len(rays.row) == 0:
        return rays
    kept = rays.measurements
    observed = kept.observed if kept.row is None else kept.observed[kept.row]
    weight = np.empty((len(rays.row), 2))
    group_of_ray = rays.group_of_frame[rays.frame_of_ray]
    for own in rays.frames.groups:
        here = group_of_ray == own.group
        group, rows = plan.problem.groups[own.group], rays.row[here]
        seen = np.isfinite(group.observed[rows])
        weight[here] = np.where(seen, roots[own.group][rows] / group.sigma[rows], 0.0)
    measured = observed if kept.measured is kept.observed else kept.measured
    return rays._replace(measurements=Measurements(observed, weight, measured, kept.clock))


def _reweighted_cluster(cluster: ClusterRows, roots: Factors) -> ClusterRows:
    own = np.array(
        [
            roots[group][row, component]
            for group, row, component in zip(cluster.groups, cluster.rows, cluster.components, strict=True)
        ]
    )
    return cluster._replace(whitening=cluster.whitening * own)
