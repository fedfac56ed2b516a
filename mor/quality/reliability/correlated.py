"""Quality of correlated observations, which have a covariance matrix of their own: all alike clusters at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mor.adjustment.correlated_rows import AlikeClusters, linearised_parts, spread
from mor.adjustment.linearise import linearise
from mor.adjustment.plan import RowClusters, reduced_columns
from mor.adjustment.state import Adjustment
from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant
from mor.quality.reliability.influence_on_position import Directions, counted_columns, lengths_of_rows
from mor.quality.reliability.observation_quality import Correlated, ObservationQuality
from mor.quality.tests.joint_test import joint_statistic
from mor.sparse.block_matrix import BlockMatrix
from mor.sparse.rows import row_cofactors


def cluster_quality(
    adjustment: Adjustment,
    cofactors: BlockMatrix,
    alike: AlikeClusters,
    quality: tuple[ObservationQuality, ...],
    tangent: FloatArray | None,
    extra: Directions,
) -> dict[int, Correlated]:
    """Quality of the entries of alike clusters, by group; what errors carry is set in ``quality``."""
    plan = adjustment.plan
    rows = _derivatives(adjustment, alike, tangent)
    both = np.concatenate([rows.jacobian, rows.own], axis=1)
    q = row_cofactors(cofactors, plan.target.block_of, both, plan.reduced[alike.columns])
    k = rows.jacobian.shape[1]
    image = rows.jacobian @ adjustment.inverse.weak[alike.columns]
    adjusted = q[:, :k, :k] + image @ np.swapaxes(image, 1, 2)
    moved = rows.own @ extra.own[alike.columns]
    through = q[:, k:, :k] + moved @ np.swapaxes(rows.jacobian @ extra.through[alike.columns], 1, 2)
    precision = np.swapaxes(alike.whitening, 1, 2) @ alike.whitening
    weighted = np.einsum("nij,nj->ni", precision, rows.v(quality))
    weighted_cofactors = precision - precision @ adjusted @ precision
    diagonal = _diagonal(precision)
    joint, freedom = _joint_of_clusters(alike, weighted, weighted_cofactors, np.sqrt(diagonal))
    of_entries = {
        "r": 1.0 - _diagonal(adjusted @ precision),
        "q_adjusted": _diagonal(adjusted),
        "q_residual": np.maximum(_diagonal(tolerant.inv(precision) - adjusted), 0.0),
        "weighted": weighted,
        "precision": diagonal,
        "q_weighted": np.clip(_diagonal(weighted_cofactors), 0.0, diagonal),
        "joint": joint,
        "freedom": freedom,
    }
    carried = (np.sum(through * precision, axis=2) * rows.length).ravel()
    found = {}
    for part in alike.parts:
        place = part.rows[part.row], part.component
        quality[part.group].carried[place] = carried[part.entry]
        own = {name: values.ravel()[part.entry] for name, values in of_entries.items()}
        found[part.group] = Correlated(*place, **own)
    return found


def row_cluster_quality(
    adjustment: Adjustment,
    cofactors: BlockMatrix,
    clusters: RowClusters,
    quality: ObservationQuality,
    tangent: FloatArray | None,
    extra: Directions,
) -> dict[int, Correlated]:
    """The same of all clusters of a group that are single rows, together; quality is that of the group."""
    plan, number = adjustment.plan, clusters.group
    group, index = adjustment.problem.groups[number], adjustment.problem.index
    rows = linearise(group, index, adjustment.inverse.values, tangent, clusters.rows)
    counted = counted_columns(adjustment, number, clusters.rows, rows.columns)
    own = np.where(counted[:, None, :], rows.jacobian, 0.0)
    both = np.concatenate([rows.jacobian, own], axis=1)
    q = row_cofactors(cofactors, plan.target.block_of, both, reduced_columns(rows.columns, plan.reduced))
    m = rows.jacobian.shape[1]
    image = rows.jacobian @ _of_columns(adjustment.inverse.weak, rows.columns)
    adjusted = q[:, :m, :m] + image @ np.swapaxes(image, 1, 2)
    moved = own @ _of_columns(extra.own, rows.columns)
    through = q[:, m:, :m] + moved @ np.swapaxes(
        rows.jacobian @ _of_columns(extra.through, rows.columns), 1, 2
    )
    precision = np.swapaxes(clusters.whitening, 1, 2) @ clusters.whitening
    length = lengths_of_rows(adjustment, number, clusters.rows, rows.jacobian, rows.columns)
    carried = np.sum(through * precision, axis=2) * length
    here = np.diagonal(precision, axis1=1, axis2=2) > 0.0
    row, component = np.nonzero(here)
    place = clusters.rows[row], component
    quality.carried[place] = carried[here]
    weighted = np.einsum("nij,nj->ni", precision, np.where(here, quality.v[clusters.rows], 0.0))
    weighted_cofactors = precision - precision @ adjusted @ precision
    # Of what is not observed the variance is 1, apart from all else, so that the others have theirs.
    apart = precision + np.eye(m) * ~here[:, None, :]
    covariance = tolerant.inv(apart)
    scale = np.sqrt(np.diagonal(apart, axis1=1, axis2=2))
    joint, freedom = joint_statistic(
        weighted / scale, weighted_cofactors / (scale[:, :, None] * scale[:, None, :]), here
    )

    def diagonal(matrices: FloatArray) -> FloatArray:
        return np.asarray(np.diagonal(matrices, axis1=1, axis2=2)[here])

    found = Correlated(
        *place,
        r=1.0 - diagonal(adjusted @ precision),
        q_adjusted=diagonal(adjusted),
        q_residual=np.maximum(diagonal(covariance - adjusted), 0.0),
        weighted=weighted[here],
        precision=diagonal(precision),
        q_weighted=np.clip(diagonal(weighted_cofactors), 0.0, diagonal(precision)),
        joint=joint[row],
        freedom=freedom[row],
    )
    return {number: found}


def _of_columns(directions: FloatArray, columns: IntArray) -> FloatArray:
    """(n, K, d) of directions (u, d) at columns (n, K), 0 where fixed."""
    return np.where((columns >= 0)[:, :, None], directions[columns], 0.0)


class _Derivatives(NamedTuple):
    """Of n clusters with k entries and c unknowns each."""

    jacobian: FloatArray
    """(n, k, c)."""
    own: FloatArray
    """(n, k, c) by the coordinates whose movement counts, 0 elsewhere."""
    length: FloatArray
    """(n, k) factors to lengths."""
    alike: AlikeClusters

    def v(self, quality: Sequence[ObservationQuality]) -> FloatArray:
        """(n, k) residuals."""
        v = np.zeros(self.length.size)
        for part in self.alike.parts:
            v[part.entry] = quality[part.group].v[part.rows[part.row], part.component]
        return v.reshape(self.length.shape)


def _derivatives(adjustment: Adjustment, alike: AlikeClusters, tangent: FloatArray | None) -> _Derivatives:
    n, k, c = alike.shape
    jacobian, counted, length = np.zeros((n * k, c)), np.zeros((n * k, c)), np.zeros(n * k)
    for part, rows in linearised_parts(alike, adjustment.problem, adjustment.inverse.values, tangent):
        spread(jacobian, part, part.of(rows.jacobian))
        counts = counted_columns(adjustment, part.group, part.rows, rows.columns)
        spread(counted, part, counts[part.row].astype(float))
        lengths = lengths_of_rows(adjustment, part.group, part.rows, rows.jacobian, rows.columns)
        length[part.entry] = part.of(lengths)
    own = np.where(counted > 0.0, jacobian, 0.0)
    return _Derivatives(jacobian.reshape(n, k, c), own.reshape(n, k, c), length.reshape(n, k), alike)


def _diagonal(matrices: FloatArray) -> FloatArray:
    return np.diagonal(matrices, axis1=1, axis2=2)


def _joint_of_clusters(
    alike: AlikeClusters, weighted: FloatArray, cofactors: FloatArray, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Statistic and freedom (n, k) of the joint tests of rows, those with as many entries together."""
    n, k = weighted.shape
    statistic, freedom = np.zeros((n, k)), np.zeros((n, k))
    for part in alike.parts:
        of_row = part.entry // k * len(part.rows) + part.row
        order = np.argsort(of_row, kind="stable")
        rows = np.split(order, np.flatnonzero(np.diff(of_row[order])) + 1)
        for size in {len(row) for row in rows}:
            entry = part.entry[np.stack([row for row in rows if len(row) == size])]
            one, here = entry[:, :1] // k, entry % k
            factor = scale[one, here]
            S = cofactors[one[:, :, None], here[:, :, None], here[:, None, :]]
            S = S / (factor[:, :, None] * factor[:, None, :])
            found = joint_statistic(weighted[one, here] / factor, S, np.ones(here.shape, dtype=bool))
            statistic[one, here], freedom[one, here] = (values[:, None] for values in found)
    return statistic, freedom
