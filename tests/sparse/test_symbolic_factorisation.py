"""The plan of the elimination against elimination carried out on sets of unknowns."""

from __future__ import annotations

import numpy as np
import pytest

from mor.linalg import symbolic
from mor.linalg.block_matrix import structure_from_cliques
from mor.linalg.symbolic import _PRICES, analyse


def _structure(blocks, cliques, seed=0):
    sizes = np.random.default_rng(seed).integers(1, 8, blocks)
    pointers = np.cumsum([0] + [len(c) for c in cliques])
    return structure_from_cliques(sizes, pointers, np.array([b for c in cliques for b in c], dtype=np.int64))


def _random_cliques(blocks, count, seed):
    rng = np.random.default_rng(seed)
    return [rng.integers(0, blocks, rng.integers(2, 5)).tolist() for _ in range(count)]


CASES = {
    "single block": (1, []),
    "no ties": (7, []),
    "sparse": (150, _random_cliques(150, 130, 1)),
    "path": (80, [[i, i + 1] for i in range(79)]),
    "two parts": (60, [[i, i + 1] for i in range(59) if i != 30]),
    "full": (20, [list(range(20))]),
}


def _factor_pattern(structure, permutation):
    """Rows of each scalar column of the factor in elimination order, by plain elimination."""
    n = structure.unknowns
    block = np.repeat(np.arange(structure.blocks), structure.sizes)[permutation]
    meets = np.zeros((structure.blocks,) * 2, dtype=bool)
    meets[structure.indices, structure.columns] = meets[structure.columns, structure.indices] = True
    full = meets[np.ix_(block, block)]
    for j in range(n):
        later = j + 1 + np.flatnonzero(full[j + 1 :, j])
        full[np.ix_(later, later)] = True
    return full


@pytest.mark.parametrize("name", CASES)
def test_fronts_hold_the_pattern_of_the_factor(name):
    structure = _structure(*CASES[name])
    plan = analyse(structure)
    n = structure.unknowns
    assert sorted(plan.permutation.tolist()) == list(range(n))
    full = _factor_pattern(structure, plan.permutation)
    for f in range(plan.fronts):
        first, end = plan.pivot_pointers[f : f + 2]
        rows = plan.rows[plan.row_pointers[f] : plan.row_pointers[f + 1]]
        assert (np.diff(rows) > 0).all()
        assert (rows >= end).all()
        needed = end + np.flatnonzero(full[end:, first:end].any(axis=1))
        assert set(needed) <= set(rows)
        if rows.size:
            p = plan.parent[f]
            of_parent = np.concatenate(
                (
                    np.arange(*plan.pivot_pointers[p : p + 2]),
                    plan.rows[plan.row_pointers[p] : plan.row_pointers[p + 1]],
                )
            )
            places = plan.row_in_parent[plan.row_pointers[f] : plan.row_pointers[f + 1]]
            assert p > f
            assert np.array_equal(of_parent[places], rows)


def test_nearly_full_systems_become_one_front():
    assert analyse(_structure(20, [list(range(20))])).fronts == 1
    banded = [list(range(i, i + 30)) for i in range(0, 70, 5)]
    assert analyse(_structure(95, banded)).fronts == 1


def test_many_separate_parts_do_not_become_one_front():
    parts = [list(range(i, i + 40)) for i in range(0, 2000, 40)]
    plan = analyse(_structure(2000, parts))
    assert plan.fronts == 50
    assert (plan.parent == -1).all()


def test_column_orders_count_the_rows_of_the_factor():
    structure = _structure(*CASES["sparse"])
    plan = analyse(structure)
    indptr, indices = np.zeros(5, dtype=np.int64), np.array([1, 2, 0, 3, 0, 3, 1, 2])
    indptr[:] = [0, 2, 4, 6, 8]  # a square: eliminating 0 ties 1 to 2
    parent = symbolic.elimination_tree(indptr, indices)
    assert parent.tolist() == [1, 2, 3, -1]
    assert symbolic.column_orders(indptr, indices, parent, np.array([1, 2, 3, 4])).tolist() == [6, 9, 7, 4]
    assert plan.largest_front < structure.unknowns


def test_postorder_keeps_subtrees_together():
    parent = np.array([3, 4, 3, -1, -1, 4])
    assert symbolic.postorder(parent).tolist() == [0, 2, 3, 1, 5, 4]


@pytest.mark.parametrize("size", [1, 3, 6])
def test_a_long_chain_becomes_fronts_of_the_cheapest_order(size):
    """Against every order that all fronts of a chain might have, priced one by one."""
    blocks = 6000 // size
    ties = np.stack([np.arange(blocks - 1), np.arange(1, blocks)], axis=1)
    structure = structure_from_cliques(np.full(blocks, size), 2 * np.arange(blocks), ties.ravel())
    plan = analyse(structure)

    def price(pivots, order):
        k, m = np.asarray(pivots, dtype=float), np.asarray(order, dtype=float)
        return _PRICES[0] + _PRICES[1] * m**2 + _PRICES[2] * (k * m**2 - k**2 * m + k**3 / 3.0)

    found = price(plan.pivots, plan.orders).sum()
    together = size * np.arange(1, 400 // size)
    cheapest = (price(together, together + size) * structure.unknowns / together).min()
    assert found < 1.1 * cheapest
