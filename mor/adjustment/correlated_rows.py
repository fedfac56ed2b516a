"""Clusters of correlated observations that reach over rows: their Jacobians, of all that are alike together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mor.adjustment.linearise import Linearised, linearise, misclosures
from mor.adjustment.problem import Problem
from mor.arrays import FloatArray, IntArray
from mor.observations import ObservationGroup
from mor.parameters.index import Index, Values

_TOGETHER = 2_000_000
"""Entries of Jacobians and whitening matrices that are in memory together."""


class ClusterRows(NamedTuple):
    """A correlated cluster: where its entries stand, and the matrix that makes them uncorrelated."""

    groups: IntArray
    rows: IntArray
    components: IntArray
    whitening: FloatArray
    """(k, k) W with W Σ Wᵀ = I."""


class PartOfClusters(NamedTuple):
    """What of alike clusters is in one group: e entries in r of its rows."""

    group: int
    rows: IntArray
    """(r,) each once."""
    entry: IntArray
    """(e,) numbers of the entries, those of the first cluster first."""
    row: IntArray
    """(e,) places of their rows among ``rows``."""
    component: IntArray
    """(e,)."""
    place: IntArray
    """(e, K) places of the columns of the rows among those of the cluster, −1 where fixed."""

    def of(self, values: FloatArray) -> FloatArray:
        """What the entries have (e, …) of values (r, m, …) of the rows."""
        chosen: FloatArray = values[self.row, self.component]
        return chosen


class AlikeClusters(NamedTuple):
    """n clusters of as many entries k and unknowns c each."""

    whitening: FloatArray
    """(n, k, k)."""
    columns: IntArray
    """(n, c) unknowns, sorted, each once."""
    parts: tuple[PartOfClusters, ...]

    @property
    def shape(self) -> tuple[int, int, int]:
        """n, k, c."""
        return *self.whitening.shape[:2], self.columns.shape[1]

    def rows(
        self, problem: Problem, values: Values, tangent: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Misclosures (n, k) and Jacobians (n, k, c), not whitened."""
        n, k, c = self.shape
        misclosure, jacobian = np.zeros(n * k), np.zeros((n * k, c))
        for part in self.parts:
            found = linearise(problem.groups[part.group], problem.index, values, tangent, part.rows)
            misclosure[part.entry] = part.of(found.misclosure)
            spread(jacobian, part, part.of(found.jacobian))
        return misclosure.reshape(n, k), jacobian.reshape(n, k, c)

    def misclosures(self, problem: Problem, values: Values) -> FloatArray:
        """Misclosures (n, k) alone."""
        n, k, _ = self.shape
        misclosure = np.zeros(n * k)
        for part in self.parts:
            misclosure[part.entry] = part.of(misclosures(problem.groups[part.group], values, part.rows))
        return misclosure.reshape(n, k)


def spread(matrix: FloatArray, part: PartOfClusters, values: FloatArray) -> None:
    """Add values (e, K) to the rows of a matrix (n·k, c), where the columns of their cluster are."""
    free = part.place >= 0
    entry = np.broadcast_to(part.entry[:, None], free.shape)[free]
    np.add.at(matrix, (entry, part.place[free]), values[free])


def alike_clusters(problem: Problem, clusters: Sequence[ClusterRows]) -> tuple[AlikeClusters, ...]:
    """Clusters by their numbers of entries and unknowns, in pieces that have room in memory."""
    alike: dict[tuple[int, int], list[tuple[ClusterRows, IntArray]]] = {}
    for cluster, columns in zip(clusters, columns_of_clusters(problem, clusters), strict=True):
        alike.setdefault((len(cluster.rows), len(columns)), []).append((cluster, columns))
    found = []
    for (k, c), some in alike.items():
        many = max(_TOGETHER // (k * (k + c)), 1)
        found += [_together(problem, some[first : first + many]) for first in range(0, len(some), many)]
    return tuple(found)


def _together(problem: Problem, some: Sequence[tuple[ClusterRows, IntArray]]) -> AlikeClusters:
    groups, rows, components = (
        np.concatenate([getattr(cluster, name) for cluster, _ in some])
        for name in ("groups", "rows", "components")
    )
    columns = np.stack([columns for _, columns in some])
    parts = []
    for number in np.unique(groups).tolist():
        entry = np.flatnonzero(groups == number)
        own, row = np.unique(rows[entry], return_inverse=True)
        of_rows = group_columns(problem.groups[number], problem.index, own)[row.ravel()]
        place = _places(columns, entry // (len(rows) // len(some)), of_rows, problem.index.count)
        parts.append(PartOfClusters(number, own, entry, row.ravel(), components[entry], place))
    return AlikeClusters(np.stack([cluster.whitening for cluster, _ in some]), columns, tuple(parts))


def _places(columns: IntArray, cluster: IntArray, wanted: IntArray, count: int) -> IntArray:
    """Places (e, K) of unknowns among the sorted ``columns`` (n, c) of their clusters (e,); −1 stays."""
    ahead = np.arange(len(columns))[:, None] * count
    found = np.searchsorted((columns + ahead).ravel(), wanted + cluster[:, None] * count)
    return np.where(wanted >= 0, found - cluster[:, None] * columns.shape[1], -1)


def cluster_rows(
    problem: Problem, cluster: ClusterRows, values: Values, tangent: FloatArray | None
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Misclosures (k,), dense Jacobian (k, c) and unknowns (c,) of one cluster, not whitened."""
    (alone,) = alike_clusters(problem, [cluster])
    misclosure, jacobian = alone.rows(problem, values, tangent)
    return misclosure[0], jacobian[0], alone.columns[0]


def linearised_parts(
    alike: AlikeClusters, problem: Problem, values: Values, tangent: FloatArray | None
) -> list[tuple[PartOfClusters, Linearised]]:
    """The parts of alike clusters with their linearised rows."""
    groups, index = problem.groups, problem.index
    return [(part, linearise(groups[part.group], index, values, tangent, part.rows)) for part in alike.parts]


def group_columns(group: ObservationGroup, index: Index, rows: IntArray) -> IntArray:
    """(n, K) unknowns of the chosen rows, over all slots that are not fixed throughout."""
    parts = [
        index.columns[slot.kind][number[rows]]
        for slot, number in zip(group.type.slots, group.blocks, strict=True)
    ]
    used = [part for part in parts if (part >= 0).any()]
    return np.concatenate(used, axis=1) if used else np.zeros((len(rows), 0), dtype=np.int64)


def columns_of_clusters(problem: Problem, clusters: Sequence[ClusterRows]) -> list[IntArray]:
    """Unknowns (sorted, each once) that the entries of each cluster depend on."""
    if not clusters:
        return []
    groups, rows = (np.concatenate([getattr(c, name) for c in clusters]) for name in ("groups", "rows"))
    cluster = np.repeat(np.arange(len(clusters)), [len(one.rows) for one in clusters])
    count = problem.index.count
    found = [np.zeros(0, dtype=np.int64)]
    for number in np.unique(groups).tolist():
        own = groups == number
        columns = group_columns(problem.groups[number], problem.index, rows[own])
        found.append((columns + cluster[own, None] * count)[columns >= 0])
    which, columns = np.divmod(np.unique(np.concatenate(found)), max(count, 1))
    return np.split(columns, np.searchsorted(which, np.arange(1, len(clusters))))
