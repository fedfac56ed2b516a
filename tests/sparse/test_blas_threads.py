"""Threads of linear algebra: let loose on large fronts only, and taken back behind each of them."""

from __future__ import annotations

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from mor.linalg import cholesky, selected_inverse
from mor.linalg import cholesky as blas_threads
from mor.linalg.block_matrix import BlockMatrix, structure_from_cliques
from mor.linalg.cholesky import WORTH_THREADS, alike
from mor.linalg.symbolic import analyse

LIBRARIES = ThreadpoolController().select(user_api="blas")


def test_neighbours_that_are_alike_share_a_run() -> None:
    large = WORTH_THREADS
    assert alike(np.array([], dtype=np.int64)) == []
    assert alike(np.array([3, 70, 5])) == [(70, range(3))]
    orders = np.array([3, large, large + 4, 9, large - 1])
    assert alike(orders) == [(3, range(1)), (large + 4, range(1, 3)), (large - 1, range(3, 5))]


def unit_matrix() -> BlockMatrix:
    """Blocks on a grid, 15 by 15, of six unknowns each."""
    k = np.arange(225).reshape(15, 15)
    ties = [np.stack([k[:-1].ravel(), k[1:].ravel()]), np.stack([k[:, :-1].ravel(), k[:, 1:].ravel()])]
    cliques = np.concatenate(ties, axis=1).T
    structure = structure_from_cliques(np.full(225, 6), 2 * np.arange(len(cliques) + 1), cliques.ravel())
    values = [np.eye(6).ravel() * (i == j) for i, j in zip(structure.indices, structure.columns, strict=True)]
    return BlockMatrix(structure, np.concatenate(values))


def test_small_fronts_have_one_thread_beside_large_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    matrix = unit_matrix()
    elimination = analyse(matrix.structure)
    large = elimination.orders >= elimination.largest_front
    assert large.any()
    assert not large.all()
    monkeypatch.setattr(blas_threads, "WORTH_THREADS", elimination.largest_front)
    found: list[int] = []

    def note_threads(module: object, name: str) -> None:
        """Have a step that is taken once in every front note how many threads it may use."""
        step = getattr(module, name)

        def noted(*arguments: object) -> object:
            found.append(max(one["num_threads"] for one in LIBRARIES.info()))
            return step(*arguments)

        monkeypatch.setattr(module, name, noted)

    note_threads(cholesky, "_factor_in_place")
    note_threads(selected_inverse, "_inverse_of_front")
    with LIBRARIES.limit(limits=2):
        inverse = selected_inverse.selected_inverse(cholesky.factorise(matrix, elimination))
        assert max(one["num_threads"] for one in LIBRARIES.info()) == 2
    np.testing.assert_array_equal(inverse.values, matrix.values)
    threads = np.where(large, 2, 1)
    np.testing.assert_array_equal(found, np.concatenate([threads, threads[::-1]]))
