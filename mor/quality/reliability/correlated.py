"""Quality of correlated observations, which have a covariance matrix of their own: one cluster of them at a time."""

from __future__ import annotations

import numpy as np

from mor.adjustment.linearise import linearise
from mor.adjustment.normals import cluster_rows
from mor.adjustment.plan import ClusterRows, RowClusters, reduced_columns
from mor.adjustment.state import Adjustment
from mor.arrays import FloatArray, IntArray
from mor.quality.reliability.influence_on_position import Directions, counted_columns, lengths_of_rows
from mor.quality.reliability.observation_quality import Correlated, ObservationQuality
from mor.quality.tests.joint_test import joint_statistic
from mor.sparse.block_matrix import BlockMatrix
from mor.sparse.rows import gather, row_cofactors


def cluster_quality(
    adjustment: Adjustment,
    cofactors: BlockMatrix,
    cluster: ClusterRows,
    quality: tuple[ObservationQuality, ...],
    tangent: FloatArray | None,
    extra: Directions,
) -> dict[int, Correlated]:
    """Quality of the entries of a cluster, by group; what errors carry is set in ``quality``."""
    plan = adjustment.plan
    _, jacobian, columns = cluster_rows(plan, cluster, adjustment.inverse.values, tangent)
    q = gather(cofactors, plan.target.block_of, plan.reduced[columns])
    weak = adjustment.inverse.weak[columns]
    adjusted = jacobian @ (q + weak @ weak.T) @ jacobian.T
    precision = cluster.whitening.T @ cluster.whitening
    own, length = _what_counts(adjustment, cluster, jacobian, columns, tangent)
    through = own @ q @ jacobian.T + (own @ extra.own[columns]) @ (jacobian @ extra.through[columns]).T
    carried = np.sum(through * precision, axis=1) * length
    covariance = np.linalg.inv(precision)
    misclosure = quality_at(cluster, [group.v for group in quality])
    weighted_cofactors = precision - precision @ adjusted @ precision
    joint, freedom = _joint_of_cluster(cluster, precision @ misclosure, weighted_cofactors)
    found = {}
    for number in np.unique(cluster.groups):
        here = cluster.groups == number
        rows, components = place = cluster.rows[here], cluster.components[here]
        quality[number].carried[place] = carried[here]
        found[int(number)] = Correlated(
            rows,
            components,
            r=1.0 - np.diagonal(adjusted @ precision)[here],
            q_adjusted=np.diagonal(adjusted)[here],
            q_residual=np.maximum(np.diagonal(covariance - adjusted), 0.0)[here],
            weighted=(precision @ misclosure)[here],
            precision=np.diagonal(precision)[here],
            q_weighted=np.clip(np.diagonal(weighted_cofactors), 0.0, np.diagonal(precision))[here],
            joint=joint[here],
            freedom=freedom[here],
        )
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
    covariance = np.linalg.inv(apart)
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


def _what_counts(
    adjustment: Adjustment,
    cluster: ClusterRows,
    jacobian: FloatArray,
    columns: IntArray,
    tangent: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """Derivatives (k, c) of the entries of a cluster by the coordinates that count, and factors (k,) to lengths."""
    problem = adjustment.problem
    counted, length = np.zeros(jacobian.shape, dtype=bool), np.zeros(len(jacobian))
    for number in np.unique(cluster.groups):
        here = np.flatnonzero(cluster.groups == number)
        rows, inverse = np.unique(cluster.rows[here], return_inverse=True)
        part = linearise(problem.groups[number], problem.index, adjustment.inverse.values, tangent, rows)
        counts = counted_columns(adjustment, int(number), rows, part.columns)[inverse]
        entry = np.broadcast_to(here[:, None], counts.shape)[counts]
        counted[entry, np.searchsorted(columns, part.columns[inverse][counts])] = True
        lengths = lengths_of_rows(adjustment, int(number), rows, part.jacobian, part.columns)
        length[here] = lengths[inverse, cluster.components[here]]
    return np.where(counted, jacobian, 0.0), length


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
