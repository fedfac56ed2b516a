"""Selected inverse against the inverse of the dense matrix, on the pattern of the matrix."""

from __future__ import annotations

import numpy as np
import pytest

from mor.linalg import compilation
from mor.linalg import selected_inverse as module
from mor.linalg.block_matrix import BlockMatrix, structure_from_cliques
from mor.linalg.cholesky import factorise
from mor.linalg.selected_inverse import selected_inverse
from mor.linalg.symbolic import analyse


def _grid(side):
    k = np.arange(side * side).reshape(side, side)
    return np.concatenate(
        [np.stack([k[:-1].ravel(), k[1:].ravel()], 1), np.stack([k[:, :-1].ravel(), k[:, 1:].ravel()], 1)]
    ).tolist()


SYSTEMS = {
    "single block": (1, []),
    "no ties": (4, []),
    "grid": (196, _grid(14)),
    "grid with ties": (196, _grid(14) + np.random.default_rng(1).integers(0, 196, (20, 2)).tolist()),
    "arrow on a path": (130, [[129, i, i + 1] for i in range(128)]),
    "separate parts": (90, [[i, i + 1, i + 2] for i in range(88) if i % 30 < 28]),
    "one front": (12, [list(range(12))]),
}


def _normal_matrix(blocks, cliques, repeat=0, seed=0):
    """Return a scaled normal matrix; ``repeat`` unknowns have exactly the same effect as their neighbour."""
    rng = np.random.default_rng(seed)
    sizes = rng.integers(2, 8, blocks)
    cliques = [[b] for b in range(blocks)] + list(cliques)
    pointers = np.cumsum([0] + [len(c) for c in cliques])
    structure = structure_from_cliques(sizes, pointers, np.concatenate(cliques).astype(np.int64))
    n = structure.unknowns
    dense = np.zeros((n, n))
    for clique in cliques:
        columns = np.concatenate([np.arange(*structure.offsets[b : b + 2]) for b in set(clique)])
        design = rng.normal(size=(columns.size + 1, columns.size))
        dense[np.ix_(columns, columns)] += design.T @ design
    same = structure.offsets[rng.permutation(blocks)[:repeat]]
    copy = np.eye(n)
    copy[same + 1, same + 1] = 0.0
    copy[same, same + 1] = 1.0
    dense = copy.T @ dense @ copy
    scale = 1.0 / np.sqrt(np.diag(dense))
    dense *= np.outer(scale, scale)
    return _on_pattern(structure, dense), dense


def _on_pattern(structure, dense):
    values = [
        dense[slice(*structure.offsets[i : i + 2]), slice(*structure.offsets[j : j + 2])].ravel()
        for i, j in zip(structure.indices, structure.columns, strict=True)
    ]
    return BlockMatrix(structure, np.concatenate(values))


@pytest.mark.parametrize("name", SYSTEMS)
def test_every_stored_block_equals_that_of_the_dense_inverse(name):
    matrix, dense = _normal_matrix(*SYSTEMS[name])
    inverse = selected_inverse(factorise(matrix, analyse(matrix.structure)))
    assert inverse.structure is matrix.structure
    expected = _on_pattern(matrix.structure, np.linalg.inv(dense)).values
    np.testing.assert_allclose(inverse.values, expected, rtol=1e-8, atol=1e-9 * abs(expected).max())


@pytest.mark.parametrize("name", ["grid", "one front"])
def test_unknowns_set_aside_have_zero_cofactors_and_the_others_those_of_the_rest(name):
    matrix, dense = _normal_matrix(*SYSTEMS[name], repeat=6)
    factor = factorise(matrix, analyse(matrix.structure))
    assert factor.set_aside.size == 6
    held = np.setdiff1d(np.arange(dense.shape[0]), factor.set_aside)
    full = np.zeros_like(dense)
    full[np.ix_(held, held)] = np.linalg.inv(dense[np.ix_(held, held)])
    expected = _on_pattern(matrix.structure, full).values
    inverse = selected_inverse(factor)
    np.testing.assert_allclose(inverse.values, expected, rtol=1e-7, atol=1e-8 * abs(expected).max())
    assert (inverse.diagonal()[factor.set_aside] == 0.0).all()


@pytest.mark.kernels
def test_plain_numpy_gives_the_same_as_compiled_kernels(monkeypatch):
    matrix, _ = _normal_matrix(*SYSTEMS["grid with ties"])
    factor = factorise(matrix, analyse(matrix.structure))
    assert factor.elimination.fronts > 1
    compiled = selected_inverse(factor).values
    monkeypatch.setattr(compilation, "available", False)
    np.testing.assert_allclose(selected_inverse(factor).values, compiled, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_watcher_is_told_all_the_work_and_changes_nothing(name):
    matrix, _ = _normal_matrix(*SYSTEMS[name])
    factor = factorise(matrix, analyse(matrix.structure))
    told = []
    watched = selected_inverse(factor, told.append)
    np.testing.assert_array_equal(watched.values, selected_inverse(factor).values)
    assert sum(told) == pytest.approx(float(module.operations(factor.elimination).sum()), rel=1e-12)
    assert len(told) <= 100
    assert min(told) > 0.0
