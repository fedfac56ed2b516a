"""The elimination order: a permutation, that fills little, with hubs at its end."""

from __future__ import annotations

import numpy as np

from mor.linalg.block_matrix import structure_from_cliques
from mor.linalg.ordering import block_graph, fill_reducing_order


def _graph(blocks, pairs):
    pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
    return block_graph(structure_from_cliques(np.full(blocks, 2), np.arange(len(pairs) + 1) * 2, pairs.ravel()))


def _fill(graph, order):
    """Number of entries below the diagonal of the factor, by plain elimination on sets."""
    step = np.argsort(order)
    adjacent = [set() for _ in order]
    coordinates = graph.tocoo()
    for i, j in zip(step[coordinates.row], step[coordinates.col], strict=True):
        adjacent[min(i, j)].add(max(i, j))
    for later in adjacent:
        if later:
            adjacent[min(later)] |= later - {min(later)}
    return sum(len(later) for later in adjacent)


def test_a_path_and_a_tree_are_eliminated_without_fill():
    rng = np.random.default_rng(0)
    parents = [(i, int(rng.integers(0, i))) for i in range(1, 60)]
    for pairs in ([(i, i + 1) for i in range(59)], parents):
        graph = _graph(60, pairs)
        assert _fill(graph, fill_reducing_order(graph)) == 59


def test_a_grid_fills_far_less_than_in_its_natural_order():
    k = np.arange(400).reshape(20, 20)
    across = np.stack([k[:, :-1].ravel(), k[:, 1:].ravel()], 1)
    along = np.stack([k[:-1].ravel(), k[1:].ravel()], 1)
    graph = _graph(400, np.concatenate((across, along)))
    order = fill_reducing_order(graph)
    assert sorted(order.tolist()) == list(range(400))
    assert _fill(graph, order) < 0.5 * _fill(graph, np.arange(400))


def test_a_hub_comes_last_and_isolated_blocks_are_not_lost():
    hub = [(0, i) for i in range(1, 300)]
    order = fill_reducing_order(_graph(310, hub))
    assert order[-1] == 0
    assert sorted(order.tolist()) == list(range(310))
