"""Rows into and out of the block matrix, compiled and plain, against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

from mor.linalg import block_matrix as rows
from mor.linalg import compilation
from mor.linalg.block_matrix import BlockMatrix, structure_from_cliques

N, M = 40, 2
SIZES = np.array([3, 1, 6, 3, 2, 3])


@pytest.fixture(params=[pytest.param("compiled", marks=pytest.mark.kernels), "plain"])
def way(request, monkeypatch):
    if request.param == "plain":
        monkeypatch.setattr(compilation, "available", False)
        monkeypatch.setattr(rows, "_ROWS_AT_A_TIME", 7)


@pytest.fixture
def system():
    """Rows over three of six blocks each, some columns fixed, some blocks met twice, in any order."""
    random = np.random.default_rng(11)
    offsets = np.concatenate([[0], np.cumsum(SIZES)])
    columns = np.full((N, 14), -1)
    members, lengths = [], []
    for i in range(N):
        blocks = random.permutation(len(SIZES))[:3]
        numbers = np.concatenate([np.arange(offsets[b], offsets[b + 1]) for b in blocks])
        numbers = np.concatenate([numbers, random.permutation(numbers)])[:14]  # some unknowns twice
        numbers[random.random(len(numbers)) < 0.2] = -1
        columns[i, : len(numbers)] = numbers
        members.append(blocks)
        lengths.append(len(blocks))
    structure = structure_from_cliques(SIZES, np.concatenate([[0], np.cumsum(lengths)]), np.concatenate(members))
    jacobian = random.standard_normal((N, M, 14))
    misclosure = random.standard_normal((N, M))
    dense = np.zeros((N, M, int(SIZES.sum())))
    for i in range(N):
        for k, column in enumerate(columns[i]):
            if column >= 0:
                dense[i, :, column] += jacobian[i, :, k]
    return structure, columns.astype(np.int64), jacobian, misclosure, dense


def test_accumulated_rows_are_the_normal_equations(system, way):
    structure, columns, jacobian, misclosure, dense = system
    into = rows.target(structure)
    values, rhs = np.zeros(int(structure.position[-1])), np.zeros(structure.unknowns)
    rows.accumulate_rows(into, values, rhs, jacobian, misclosure, columns)
    A = dense.reshape(N * M, -1)
    np.testing.assert_allclose(BlockMatrix(structure, values).to_dense(), A.T @ A, atol=1e-12)
    np.testing.assert_allclose(rhs, A.T @ misclosure.ravel(), atol=1e-12)


def test_accumulating_adds_to_what_is_there(system, way):
    structure, columns, jacobian, misclosure, _ = system
    into = rows.target(structure)
    whole, parts = ([np.zeros(int(structure.position[-1])), np.zeros(structure.unknowns)] for _ in range(2))
    rows.accumulate_rows(into, *whole, jacobian, misclosure, columns)
    for part in (slice(0, 15), slice(15, N)):
        rows.accumulate_rows(into, *parts, jacobian[part], misclosure[part], columns[part])
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


def test_rows_of_no_unknowns_add_nothing_however_many_they_are(system, way):
    """Between fixed points only: as many columns as there are none, but not as many rows."""
    structure, columns, jacobian, misclosure, _ = system
    into = rows.target(structure)
    values, rhs = np.zeros(int(structure.position[-1])), np.zeros(structure.unknowns)
    for count in (4, 2):
        rows.accumulate_rows(into, values, rhs, jacobian[:count, :, :0], misclosure[:count], columns[:count, :0])
    assert not values.any()
    assert not rhs.any()


def _symmetric(structure, seed=5):
    """A matrix that is known at the stored blocks and, dense, zero elsewhere."""
    random = np.random.default_rng(seed)
    matrix = BlockMatrix(structure, random.standard_normal(int(structure.position[-1])))
    for block in range(structure.blocks):  # diagonal blocks are stored in full and symmetric
        start, size = structure.position[structure.indptr[block]], structure.sizes[block]
        square = matrix.values[start : start + size * size].reshape(size, size)
        square[:] = square + square.T
    return matrix


def test_cofactors_of_rows(system, way):
    structure, columns, jacobian, _, dense = system
    Q = _symmetric(structure)
    found = rows.row_cofactors(Q, rows.target(structure).block_of, jacobian, columns)
    expected = dense @ Q.to_dense() @ np.swapaxes(dense, 1, 2)
    np.testing.assert_allclose(found, expected, atol=1e-11)


def test_cofactors_of_blocks_are_zero_where_fixed_and_not_a_number_where_not_stored():
    structure = structure_from_cliques([2, 1, 2], [0, 2], [0, 1])  # blocks 0 and 1 meet, block 2 stands alone
    Q = _symmetric(structure)
    dense = Q.to_dense()
    found = rows.block_cofactors(rows.target(structure), Q.values, np.array([[0, 1, 2], [-1, 2, 4]]))
    np.testing.assert_array_equal(found[0], dense[:3, :3])
    np.testing.assert_array_equal(found[1, 0], 0.0)
    assert found[1, 1, 1] == dense[2, 2]
    assert np.isnan(found[1, 1, 2])


def test_cofactors_of_blocks_without_any_unknown():
    structure = structure_from_cliques([], [0], [])
    found = rows.block_cofactors(rows.target(structure), np.zeros(0), np.full((3, 2), -1))
    np.testing.assert_array_equal(found, np.zeros((3, 2, 2)))
