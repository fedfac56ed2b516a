"""Block patterns and block matrices against dense matrices built without them."""

from __future__ import annotations

import numpy as np
import pytest

from mor.linalg.block_matrix import (
    BlockMatrix,
    find_blocks,
    find_blocks_by_keys,
    structure_from_cliques,
    union_of_cliques_by_sorting,
)

SIZES = np.array([3, 1, 6, 2, 3, 10])
CLIQUES = [[0, 2, 1], [4], [2, 2, 4], [], [5, 0], [1, 0]]


def _example():
    pointers = np.cumsum([0] + [len(c) for c in CLIQUES])
    return structure_from_cliques(SIZES, pointers, np.array([b for c in CLIQUES for b in c]))


def _pairs():
    return {(max(a, b), min(a, b)) for c in CLIQUES for a in c for b in c} | {(b, b) for b in range(SIZES.size)}


def _random_matrix(seed=0):
    structure = _example()
    values = np.random.default_rng(seed).normal(size=structure.position[-1])
    for j in range(structure.blocks):
        start = structure.position[structure.indptr[j]]
        block = values[start : start + SIZES[j] ** 2].reshape(SIZES[j], SIZES[j])
        block += block.T.copy()
    return BlockMatrix(structure, values)


def test_pattern_is_the_union_of_the_cliques_in_order():
    structure = _example()
    stored = list(zip(structure.indices.tolist(), structure.columns.tolist(), strict=True))
    assert set(stored) == _pairs()
    assert stored == sorted(stored, key=lambda pair: (pair[1], pair[0]))
    assert structure.indices[structure.indptr[:-1]].tolist() == list(range(SIZES.size))
    lengths = [SIZES[i] * SIZES[j] for i, j in stored]
    assert structure.position.tolist() == np.cumsum([0, *lengths]).tolist()
    assert {a.dtype for a in (structure.offsets, structure.indptr, structure.indices)} == {np.dtype(np.int64)}


def test_union_by_sorting_agrees_with_the_union_by_marking(monkeypatch):
    rng = np.random.default_rng(4)
    lengths = rng.integers(0, 6, 300)
    pointers = np.concatenate(([0], np.cumsum(lengths)))
    members = rng.integers(0, 80, pointers[-1])
    structure = structure_from_cliques(np.ones(80, dtype=int), pointers, members)
    monkeypatch.setattr("mor.linalg.block_matrix._PAIRS_AT_A_TIME", 50)
    indptr, indices = union_of_cliques_by_sorting(80, pointers, members)
    assert np.array_equal(indptr, structure.indptr)
    assert np.array_equal(indices, structure.indices)


def test_blocks_are_found_in_either_order_and_absent_ones_reported():
    structure = _example()
    rows, columns = (a.ravel() for a in np.meshgrid(np.arange(6), np.arange(6), indexing="ij"))
    found = find_blocks(structure, rows, columns)
    stored = list(zip(structure.indices.tolist(), structure.columns.tolist(), strict=True))
    for i, j, position in zip(rows.tolist(), columns.tolist(), found.tolist(), strict=True):
        pair = (max(i, j), min(i, j))
        assert position == (structure.position[stored.index(pair)] if pair in stored else -1)
    high, low = np.maximum(rows, columns), np.minimum(rows, columns)
    by_keys = find_blocks_by_keys(structure, high, low)
    assert np.array_equal(np.where(by_keys >= 0, structure.position[by_keys], -1), found)


def test_dense_form_holds_every_block_at_its_place():
    matrix = _random_matrix()
    dense, structure = matrix.to_dense(), matrix.structure
    covered = np.zeros_like(dense, dtype=bool)
    for k, (i, j) in enumerate(zip(structure.indices, structure.columns, strict=True)):
        rows, columns = (slice(structure.offsets[b], structure.offsets[b + 1]) for b in (i, j))
        block = matrix.values[structure.position[k] : structure.position[k + 1]].reshape(SIZES[i], SIZES[j])
        assert np.array_equal(dense[rows, columns], block)
        covered[rows, columns] = covered.T[rows, columns] = True
    assert np.array_equal(dense, dense.T)
    assert not dense[~(covered | covered.T)].any()


@pytest.mark.parametrize("shape", [(25,), (25, 3)])
def test_product_diagonal_and_scaling_equal_the_dense_ones(shape):
    matrix = _random_matrix()
    dense = matrix.to_dense()
    rng = np.random.default_rng(1)
    x, factors = rng.normal(size=shape), rng.uniform(0.5, 2.0, 25)
    np.testing.assert_allclose(matrix.multiply(x), dense @ x, atol=1e-13)
    np.testing.assert_array_equal(matrix.diagonal(), np.diag(dense))
    np.testing.assert_allclose(matrix.scaled(factors).to_dense(), dense * np.outer(factors, factors), rtol=1e-15)
