"""Factorisation and solution against dense linear algebra, and what becomes of singular systems."""

from __future__ import annotations

import numpy as np
import pytest

from mor.linalg import compilation
from mor.linalg.block_matrix import BlockMatrix, structure_from_cliques
from mor.linalg.cholesky import factorise
from mor.linalg.symbolic import analyse


def _grid(side, ties, seed=0):
    k = np.arange(side * side).reshape(side, side)
    rng = np.random.default_rng(seed)
    pairs = [np.stack([k[:-1].ravel(), k[1:].ravel()], 1), np.stack([k[:, :-1].ravel(), k[:, 1:].ravel()], 1)]
    return np.concatenate([*pairs, rng.integers(0, side * side, (ties, 2))]).tolist()


SYSTEMS = {
    "single block": (1, []),
    "no ties": (5, []),
    "grid with ties": (225, _grid(15, 12)),
    "arrow": (120, [[0, i] for i in range(1, 120)]),
    "arrow on a path": (150, [[149, i, i + 1] for i in range(148)]),
    "separate parts": (90, [[i, i + 1, i + 2] for i in range(88) if i % 30 < 28]),
    "one front": (12, [list(range(12))]),
    "random": (200, np.random.default_rng(5).integers(0, 200, (260, 2)).tolist()),
}


def normal_matrix(blocks, cliques, seed=0, size=None, equations=None):
    """Return AᵀA of observations that each see one clique, scaled to unit diagonal, also as dense matrix."""
    rng = np.random.default_rng(seed)
    sizes = np.full(blocks, size) if size else rng.integers(1, 9, blocks)
    cliques = [[b] for b in range(blocks)] + list(cliques)
    pointers = np.cumsum([0] + [len(c) for c in cliques])
    structure = structure_from_cliques(sizes, pointers, np.concatenate(cliques).astype(np.int64))
    dense = np.zeros((structure.unknowns, structure.unknowns))
    for clique in cliques:
        columns = np.concatenate([np.arange(*structure.offsets[b : b + 2]) for b in set(clique)])
        design = rng.normal(size=(columns.size + 1, columns.size))
        dense[np.ix_(columns, columns)] += design.T @ design
    return from_dense(structure, dense)


def from_dense(structure, dense):
    scale = 1.0 / np.sqrt(np.diag(dense))
    dense = dense * np.outer(scale, scale)
    values = [
        dense[slice(*structure.offsets[i : i + 2]), slice(*structure.offsets[j : j + 2])].ravel()
        for i, j in zip(structure.indices, structure.columns, strict=True)
    ]
    return BlockMatrix(structure, np.concatenate(values)), dense


def levelling(blocks, cliques, size=3):
    """Return the matrix of coordinate differences between tied blocks: one null vector per component."""
    pointers = np.cumsum([0] + [len(c) for c in cliques])
    structure = structure_from_cliques(np.full(blocks, size), pointers, np.concatenate(cliques))
    dense = np.zeros((structure.unknowns, structure.unknowns))
    rng = np.random.default_rng(2)
    for one, other in cliques:
        if one == other:
            continue
        for c in range(size):
            at = np.ix_([size * one + c, size * other + c], [size * one + c, size * other + c])
            dense[at] += rng.uniform(0.5, 2.0) * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return from_dense(structure, dense)


@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize("columns", [(), (4,)])
def test_solution_equals_the_dense_one(name, columns):
    matrix, dense = normal_matrix(*SYSTEMS[name])
    right = np.random.default_rng(9).normal(size=(dense.shape[0], *columns))
    kept = right.copy()
    factor = factorise(matrix, analyse(matrix.structure))
    assert factor.set_aside.size == 0
    np.testing.assert_allclose(factor.solve(right), np.linalg.solve(dense, right), rtol=1e-8, atol=1e-8)
    np.testing.assert_array_equal(right, kept)


@pytest.mark.kernels
@pytest.mark.parametrize("name", ["grid with ties", "arrow", "random"])
def test_plain_numpy_gives_the_same_as_compiled_kernels(name, monkeypatch):
    matrix, dense = normal_matrix(*SYSTEMS[name])
    right = np.random.default_rng(9).normal(size=dense.shape[0])
    plan = analyse(matrix.structure)
    assert plan.fronts > 1
    compiled = factorise(matrix, plan).solve(right)
    monkeypatch.setattr(compilation, "available", False)
    np.testing.assert_allclose(factorise(matrix, plan).solve(right), compiled, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("side", [4, 12, 30])
def test_a_free_network_sets_aside_as_many_unknowns_as_its_defect(side):
    matrix, dense = levelling(side * side, _grid(side, side))
    factor = factorise(matrix, analyse(matrix.structure))
    assert factor.set_aside.size == 3
    assert sorted(factor.set_aside % 3) == [0, 1, 2]
    right = dense @ np.random.default_rng(0).normal(size=dense.shape[0])
    solution = factor.solve(right)
    assert (solution[factor.set_aside] == 0.0).all()
    np.testing.assert_allclose(dense @ solution, right, atol=1e-10)


def test_every_separate_part_has_its_own_defect():
    cliques = [[i, i + 1] for i in range(99) if i % 20 != 19]
    matrix, _ = levelling(100, cliques)
    factor = factorise(matrix, analyse(matrix.structure))
    assert factor.set_aside.size == 3 * 5
    assert sorted(factor.set_aside // 60) == [part for part in range(5) for _ in range(3)]


@pytest.mark.parametrize("defect", [1, 7, 40])
def test_a_dense_front_finds_a_defect_of_any_size(defect):
    rng = np.random.default_rng(defect)
    structure = structure_from_cliques(np.full(50, 6), [0, 50], np.arange(50))
    design = rng.normal(size=(300 - defect, 300))
    matrix, dense = from_dense(structure, design.T @ design)
    factor = factorise(matrix, analyse(structure))
    assert factor.elimination.fronts == 1
    assert factor.set_aside.size == defect
    held = np.setdiff1d(np.arange(300), factor.set_aside)
    right = rng.normal(size=300)
    expected = np.zeros(300)
    expected[held] = np.linalg.solve(dense[np.ix_(held, held)], right[held])
    np.testing.assert_allclose(factor.solve(right), expected, rtol=1e-5, atol=1e-5)


def test_unknowns_set_aside_in_the_middle_leave_the_rest_exact():
    """Columns repeated in the design vanish wherever they are eliminated, also far below the root."""
    matrix, dense = normal_matrix(225, _grid(15, 0), size=2)
    n = dense.shape[0]
    double = np.arange(0, n, 50)
    copy = np.eye(n)
    copy[double + 1, double + 1] = 0.0
    copy[double, double + 1] = 1.0  # the second unknown of some blocks acts as the first one does
    matrix, dense = from_dense(matrix.structure, copy.T @ dense @ copy)
    factor = factorise(matrix, analyse(matrix.structure))
    assert factor.set_aside.size == double.size
    held = np.setdiff1d(np.arange(n), factor.set_aside)
    right = np.random.default_rng(3).normal(size=n)
    expected = np.zeros(n)
    expected[held] = np.linalg.solve(dense[np.ix_(held, held)], right[held])
    np.testing.assert_allclose(factor.solve(right), expected, rtol=1e-7, atol=1e-7)


def test_weak_but_determined_unknowns_are_not_set_aside():
    structure = structure_from_cliques([2], [0, 1], [0])
    matrix, _ = from_dense(structure, np.array([[1.0, 1.0 - 1e-8], [1.0 - 1e-8, 1.0]]))
    plan = analyse(structure)
    assert factorise(matrix, plan).set_aside.size == 0
    assert factorise(matrix, plan, tolerance=1e-6).set_aside.tolist() == [1]


def test_values_that_are_not_finite_are_refused():
    structure = structure_from_cliques([2], [0, 1], [0])
    with pytest.raises(ValueError, match="not finite"):
        factorise(BlockMatrix(structure, np.array([1.0, 0.0, 0.0, np.nan])), analyse(structure))


def test_a_system_without_unknowns_has_solutions_of_its_shape():
    none = np.zeros(0, dtype=np.int64)
    structure = structure_from_cliques(none, np.zeros(1, dtype=np.int64), none)
    factor = factorise(BlockMatrix(structure, np.zeros(0)), analyse(structure))
    for shape in ((0,), (0, 3), (0, 0)):
        assert factor.solve(np.zeros(shape)).shape == shape
