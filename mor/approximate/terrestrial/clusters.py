"""Points that differences tie to one another: their values up to a common shift."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components

from mor.approximate.terrestrial.sights import Lengths
from mor.arrays import FloatArray, IntArray


class Cluster(NamedTuple):
    """Points tied by differences."""

    points: IntArray
    """(n,) blocks."""
    values: FloatArray
    """(n, m) heights or coordinates, the first point at zero."""


def clusters(differences: Lengths) -> list[Cluster]:
    """Clusters by height differences (m = 1) or vectors (m = 3), heights of instrument and target taken off."""
    values = differences.value.copy()
    values[:, -1] += differences.start_height - differences.end_height
    whole = np.isfinite(values).all(axis=1)
    start, end, values = differences.start[whole], differences.end[whole], values[whole]
    if len(start) == 0:
        return []
    points, numbers = np.unique(np.concatenate([start, end]), return_inverse=True)
    a, b = numbers[: len(start)], numbers[len(start) :]
    edge = {(int(i), int(j)): v for i, j, v in zip((*a, *b), (*b, *a), (*values, *-values), strict=True)}
    graph = scipy.sparse.csr_array((np.ones(len(a)), (a, b)), shape=(len(points),) * 2)
    count, labels = connected_components(graph, directed=False)
    return [_cluster(graph, edge, points, int(np.flatnonzero(labels == k)[0])) for k in range(count)]


def _cluster(
    graph: scipy.sparse.csr_array, edge: dict[tuple[int, int], FloatArray], points: IntArray, first: int
) -> Cluster:
    order, before = breadth_first_order(graph, first, directed=False)
    placed = {first: np.zeros_like(next(iter(edge.values())))}
    for number in order[1:].tolist():
        placed[number] = placed[int(before[number])] + edge[int(before[number]), number]
    return Cluster(points[order], np.array([placed[number] for number in order.tolist()]))
