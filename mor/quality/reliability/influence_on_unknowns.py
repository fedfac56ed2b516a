"""What gross errors of chosen observations do to all unknowns.

A gross error ∇ in observation i moves all unknowns by Q Aᵀ P e_i ∇, in the datum of the adjustment.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.correlated_rows import cluster_rows
from mor.adjustment.linearise import linearise, rotation_tangents
from mor.adjustment.state import Adjustment
from mor.arrays import FloatArray, IntArray
from mor.quality.assess import Quality


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
    found = adjustment.plan.places_in_clusters.get((entry.group, entry.row, entry.component))
    if found is not None:
        cluster, place = found
        _, jacobian, columns = cluster_rows(adjustment.problem, cluster, adjustment.values, tangent)
        return columns, jacobian.T @ (cluster.whitening.T @ cluster.whitening[:, place])
    group = problem.groups[entry.group]
    rows = linearise(group, problem.index, adjustment.values, tangent, np.array([entry.row]))
    used = rows.columns[0] >= 0
    weight = 1.0 / group.sigma[entry.row, entry.component] ** 2
    return rows.columns[0][used], rows.jacobian[0, entry.component][used] * weight
