"""Between observation rows and the block matrix: JᵀJ in, J Q Jᵀ out; compiled, or plain where there is no compiler."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mor import compilation
from mor.arrays import FloatArray, IntArray
from mor.sparse.block_matrix import BlockMatrix, BlockStructure, find_blocks
from mor.sparse.compiled import rows as kernels

_ROWS_AT_A_TIME = 5000
_REMEMBERED = 1_000_000
"""Places (16 bytes each) that are kept at the most, twice as many for a moment."""


@dataclass(frozen=True)
class Target:
    """A block pattern together with the block of every scalar unknown."""

    structure: BlockStructure
    block_of: IntArray
    known: dict[tuple[tuple[int, ...], bytes], tuple[IntArray, IntArray]] = field(
        default_factory=dict, repr=False, compare=False
    )
    """Products and places of rows by their columns, kept from one iteration to the next: to look them up takes half
    of its time."""


def target(structure: BlockStructure) -> Target:
    """Block pattern with its unknowns looked up."""
    return Target(structure, np.repeat(np.arange(structure.blocks, dtype=np.int64), structure.sizes))


def accumulate_rows(
    into: Target,
    values: FloatArray,
    rhs: FloatArray,
    jacobian: FloatArray,
    misclosure: FloatArray,
    columns: IntArray,
) -> None:
    """Add JᵀJ to the block values and Jᵀl to the right-hand side.

    ``jacobian`` (n, m, K) and ``misclosure`` (n, m) are whitened; ``columns`` (n, K), −1 where fixed.
    """
    structure = into.structure
    if compilation.wanted():
        kernels.accumulate_rows(
            np.ascontiguousarray(jacobian),
            np.ascontiguousarray(misclosure),
            columns,
            into.block_of,
            structure.offsets,
            structure.indptr,
            structure.indices,
            structure.position,
            values,
            rhs,
        )
        return
    for first in range(0, len(jacobian), _ROWS_AT_A_TIME):
        part = slice(first, first + _ROWS_AT_A_TIME)
        accumulate_rows_plainly(into, values, rhs, jacobian[part], misclosure[part], columns[part])


def accumulate_rows_plainly(
    into: Target,
    values: FloatArray,
    rhs: FloatArray,
    jacobian: FloatArray,
    misclosure: FloatArray,
    columns: IntArray,
) -> None:
    """Accumulate in NumPy; the reference that the compiled form is tested against."""
    free = columns >= 0
    jacobian = np.where(free[:, None, :], jacobian, 0.0)
    gradient = np.einsum("nmk,nm->nk", jacobian, misclosure)
    np.add.at(rhs, columns[free], gradient[free])
    products = np.einsum("nmk,nml->nkl", jacobian, jacobian)
    stored, places = _stored_in_every_iteration(into, columns)
    np.add.at(values, places, products.ravel()[stored])


def _stored_in_every_iteration(into: Target, columns: IntArray) -> tuple[IntArray, IntArray]:
    """As ``_stored``, remembered where rows are few."""
    rows, width = columns.shape
    if rows * width * width > _REMEMBERED:
        return _stored(into, columns)
    key = columns.shape, columns.tobytes()
    if key not in into.known:
        if sum(places.size for _, places in into.known.values()) > _REMEMBERED:
            into.known.clear()
        into.known[key] = _stored(into, columns)
    return into.known[key]


def _stored(into: Target, columns: IntArray) -> tuple[IntArray, IntArray]:
    """Which products (k,) of columns (n, K), of all n·K·K, are in the lower part, and their places (k,)."""
    places = _places(into, columns, lower_only=True)[0].ravel()
    stored = np.flatnonzero(places >= 0)
    return stored, places[stored]


def row_cofactors(
    cofactors: BlockMatrix, block_of: IntArray, jacobian: FloatArray, columns: IntArray
) -> FloatArray:
    """J Q Jᵀ (n, m, m) of observations with Jacobians (n, m, K), from the selected inverse Q."""
    structure = cofactors.structure
    result = np.zeros((len(jacobian), jacobian.shape[1], jacobian.shape[1]))
    if compilation.wanted():
        kernels.row_cofactors(
            np.ascontiguousarray(jacobian),
            columns,
            block_of,
            structure.offsets,
            structure.indptr,
            structure.indices,
            structure.position,
            cofactors.values,
            result,
        )
        return result
    for first in range(0, len(jacobian), _ROWS_AT_A_TIME):
        part = slice(first, first + _ROWS_AT_A_TIME)
        result[part] = row_cofactors_plainly(cofactors, block_of, jacobian[part], columns[part])
    return result


def row_cofactors_plainly(
    cofactors: BlockMatrix, block_of: IntArray, jacobian: FloatArray, columns: IntArray
) -> FloatArray:
    """Compute in NumPy; the reference that the compiled form is tested against."""
    places, _ = _places(Target(cofactors.structure, block_of), columns, lower_only=False)
    q = np.where(places >= 0, cofactors.values[places], 0.0)
    free = np.where((columns >= 0)[:, None, :], jacobian, 0.0)
    result: FloatArray = np.einsum("nmk,nkl,npl->nmp", free, q, jacobian)
    return result


def gather(matrix: BlockMatrix, block_of: IntArray, columns: IntArray) -> FloatArray:
    """Dense (k, k) part of a block matrix for the unknowns ``columns`` (k,), all in stored blocks."""
    places, _ = _places(Target(matrix.structure, block_of), columns[None, :], lower_only=False)
    return np.where(places[0] >= 0, matrix.values[places[0]], 0.0)


def scatter(into: Target, values: FloatArray, columns: IntArray, dense: FloatArray) -> None:
    """Add a dense symmetric (k, k) matrix to the unknowns ``columns`` (k,), all different."""
    places, _ = _places(into, columns[None, :], lower_only=True)
    stored = places[0] >= 0
    np.add.at(values, places[0][stored], dense[stored])


def _places(into: Target, columns: IntArray, *, lower_only: bool) -> tuple[IntArray, IntArray]:
    """Places (n, K, K) in the flat values of all pairs of columns (n, K); −1 where fixed (or not in the lower part)."""
    structure = into.structure
    free = columns >= 0
    block = np.where(free, into.block_of[columns], 0)
    row, column = block[:, :, None], block[:, None, :]
    start = find_blocks(structure, row, column)
    high = np.where(row >= column, columns[:, :, None], columns[:, None, :])
    low = np.where(row >= column, columns[:, None, :], columns[:, :, None])
    high_block, low_block = np.maximum(row, column), np.minimum(row, column)
    local = (
        (high - structure.offsets[high_block]) * structure.sizes[low_block]
        + low
        - structure.offsets[low_block]
    )
    usable = free[:, :, None] & free[:, None, :] & (start >= 0)
    if lower_only:
        usable &= row >= column
    return np.where(usable, start + local, -1), block


def block_cofactors(pattern: Target, values: FloatArray, columns: IntArray) -> FloatArray:
    """(n, k, k) cofactors of n small sets of unknowns ``columns`` (n, k), zero if fixed, NaN if not stored."""
    free = columns >= 0
    both = free[:, :, None] & free[:, None, :]
    if values.size == 0:
        return np.zeros(both.shape)
    places, _ = _places(pattern, columns, lower_only=False)
    return np.where(both, np.where(places >= 0, values[places], np.nan), 0.0)
