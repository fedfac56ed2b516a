"""Symmetric block-sparse matrices: the pattern once, the values as one flat array.

A normal matrix is made of small dense blocks, one for every pair of parameter blocks that meet in an
observation. Only the lower triangle is stored, by block columns; a diagonal block is stored in full.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from mor import compilation
from mor.arrays import FloatArray, IntArray
from mor.sparse.compiled import patterns

# Pairs handled at a time where no compiler is at hand: bounds the memory, not the result.
_PAIRS_AT_A_TIME = 2_000_000


@dataclass(frozen=True)
class BlockStructure:
    """Pattern of a symmetric block matrix: its lower triangle by block columns.

    Attributes:
        offsets: (b+1,) first scalar unknown of each block.
        indptr: (b+1,) the stored block rows of column j are ``indices[indptr[j]:indptr[j+1]]``, ascending,
            the diagonal block first.
        indices: (nnzb,) block rows, never smaller than their block column.
        position: (nnzb+1,) start of each stored block in the flat array of values; a block is row-major,
            (size of block row) × (size of block column).
    """

    offsets: IntArray
    indptr: IntArray
    indices: IntArray
    position: IntArray

    @property
    def blocks(self) -> int:
        """Number of blocks b."""
        return self.offsets.size - 1

    @property
    def unknowns(self) -> int:
        """Number of scalar unknowns."""
        return int(self.offsets[-1])

    @property
    def sizes(self) -> IntArray:
        """(b,) number of scalar unknowns in each block."""
        return np.diff(self.offsets)

    @property
    def columns(self) -> IntArray:
        """(nnzb,) block column of each stored block."""
        return np.repeat(np.arange(self.blocks, dtype=np.int64), np.diff(self.indptr))

    @cached_property
    def block_of(self) -> IntArray:
        """(n,) block of each scalar unknown."""
        return np.repeat(np.arange(self.blocks, dtype=np.int64), self.sizes)

    @cached_property
    def known(self) -> dict[Hashable, Any]:
        """What was worked out of the pattern for one who asks for it again in every iteration, by whatever he asks."""
        return {}

    def shapes(self) -> Iterator[tuple[int, int, IntArray]]:
        """Yield (rows, columns, numbers of the stored blocks of that shape) for each shape that occurs."""
        sizes = self.sizes
        rows, columns = sizes[self.indices], sizes[self.columns]
        base = int(sizes.max(initial=0)) + 1
        keys = rows * base + columns
        order = np.argsort(keys, kind="stable")
        distinct, starts = np.unique(keys[order], return_index=True)
        for key, members in zip(distinct, np.split(order, starts)[1:], strict=True):
            yield int(key) // base, int(key) % base, members


class BlockMatrix(NamedTuple):
    """Symmetric block matrix: a pattern and the flat array of the values of its stored blocks."""

    structure: BlockStructure
    values: FloatArray

    def to_dense(self) -> FloatArray:
        """Return the full (n, n) matrix; meant for tests and small systems."""
        dense = np.zeros((self.structure.unknowns, self.structure.unknowns))
        for rows, columns, blocks in _scalar_unknowns(self.structure):
            block_values = self.values[_entries(self.structure, rows.shape[1], columns.shape[1], blocks)]
            dense[rows[:, :, None], columns[:, None, :]] = block_values
            dense[columns[:, :, None], rows[:, None, :]] = block_values.transpose(0, 2, 1)
        return dense

    def diagonal(self) -> FloatArray:
        """Return the (n,) diagonal."""
        sizes = self.structure.sizes
        within = np.arange(self.structure.unknowns) - np.repeat(self.structure.offsets[:-1], sizes)
        starts = np.repeat(self.structure.position[self.structure.indptr[:-1]], sizes)
        diagonal: FloatArray = self.values[starts + within * (np.repeat(sizes, sizes) + 1)]
        return diagonal

    def scaled(self, factors: FloatArray) -> BlockMatrix:
        """Return D N D with D = diag(factors), factors (n,)."""
        if compilation.wanted():
            s = self.structure
            return BlockMatrix(s, patterns.scale_blocks(s.offsets, s.indptr, s.indices, self.values, factors))
        values = np.empty_like(self.values)
        for rows, columns, blocks in _scalar_unknowns(self.structure):
            entries = _entries(self.structure, rows.shape[1], columns.shape[1], blocks)
            values[entries] = self.values[entries] * factors[rows][:, :, None] * factors[columns][:, None, :]
        return BlockMatrix(self.structure, values)

    def multiply(self, x: FloatArray) -> FloatArray:
        """Return N x for x (n,) or (n, k)."""
        flat = x.reshape(x.shape[0], -1)
        product = np.zeros_like(flat)
        for rows, columns, blocks in _scalar_unknowns(self.structure):
            block_values = self.values[_entries(self.structure, rows.shape[1], columns.shape[1], blocks)]
            np.add.at(product, rows, block_values @ flat[columns])
            beside = rows[:, 0] != columns[:, 0]
            mirrored = block_values[beside].transpose(0, 2, 1)
            np.add.at(product, columns[beside], mirrored @ flat[rows[beside]])
        return product.reshape(x.shape)


def structure_from_cliques(
    sizes: npt.ArrayLike, clique_pointers: npt.ArrayLike, clique_blocks: npt.ArrayLike
) -> BlockStructure:
    """Return the pattern in which all blocks of a clique meet each other; the diagonal is always stored.

    Args:
        sizes: (b,) number of scalar unknowns in each block.
        clique_pointers: (c+1,) clique i has the blocks
            ``clique_blocks[clique_pointers[i]:clique_pointers[i+1]]``, in any order, repetitions allowed.
        clique_blocks: block numbers.
    """
    block_sizes = np.asarray(sizes, dtype=np.int64)
    pointers = np.asarray(clique_pointers, dtype=np.int64)
    members = np.asarray(clique_blocks, dtype=np.int64)
    if compilation.wanted():
        indptr, indices = patterns.union_of_cliques(block_sizes.size, pointers, members)
        indices = ascending(indptr, indices)
    else:
        indptr, indices = union_of_cliques_by_sorting(block_sizes.size, pointers, members)
    columns = np.repeat(np.arange(block_sizes.size), np.diff(indptr))
    lengths = block_sizes[indices] * block_sizes[columns]
    return BlockStructure(_running_total(block_sizes), indptr, indices, _running_total(lengths))


def union_of_cliques_by_sorting(
    blocks: int, pointers: IntArray, members: IntArray
) -> tuple[IntArray, IntArray]:
    """Return (indptr, indices) of the union of cliques by sorting all pairs; needs no compiler."""
    lengths = np.diff(pointers)
    pairs_before = _running_total(lengths**2)
    keys = [np.arange(blocks, dtype=np.int64) * (blocks + 1)]
    first = 0
    while first < lengths.size:
        last = int(np.searchsorted(pairs_before, pairs_before[first] + _PAIRS_AT_A_TIME, side="right")) - 1
        last = max(last, first + 1)
        partners = np.repeat(lengths[first:last], lengths[first:last])
        one = np.repeat(members[pointers[first] : pointers[last]], partners)
        starts = np.repeat(np.repeat(pointers[first:last], lengths[first:last]), partners)
        within = np.arange(one.size) - np.repeat(_running_total(partners)[:-1], partners)
        other = members[starts + within]
        keys.append(np.unique(np.minimum(one, other) * blocks + np.maximum(one, other)))
        first = last
    union = np.unique(np.concatenate(keys))
    indptr = np.searchsorted(union, np.arange(blocks + 1, dtype=np.int64) * blocks).astype(np.int64)
    return indptr, union % max(blocks, 1)


def find_blocks(structure: BlockStructure, rows: npt.ArrayLike, columns: npt.ArrayLike) -> IntArray:
    """Return where the blocks (rows[i], columns[i]) start in the flat array of values; -1 where not stored.

    Pairs may be given in either order. Where rows[i] < columns[i], what is found is the transposed block.
    """
    one, other = np.broadcast_arrays(np.asarray(rows, dtype=np.int64), np.asarray(columns, dtype=np.int64))
    low, high = np.minimum(one, other).ravel(), np.maximum(one, other).ravel()
    if compilation.wanted():
        numbers = patterns.find_blocks(structure.indptr, structure.indices, high, low)
    else:
        numbers = find_blocks_by_keys(structure, high, low)
    return np.where(numbers >= 0, structure.position[numbers], -1).reshape(one.shape)


def find_blocks_by_keys(structure: BlockStructure, rows: IntArray, columns: IntArray) -> IntArray:
    """Return the numbers of stored blocks (rows >= columns), -1 where not stored; needs no compiler."""
    stored = structure.columns * structure.blocks + structure.indices
    wanted = columns * structure.blocks + rows
    numbers = np.minimum(np.searchsorted(stored, wanted), max(stored.size - 1, 0))
    return np.where(stored[numbers] == wanted, numbers, -1).astype(np.int64)


def ascending(pointers: IntArray, numbers: IntArray) -> IntArray:
    """Return the numbers with each part ``numbers[pointers[i]:pointers[i+1]]`` sorted."""
    if numbers.size == 0:
        return numbers
    import scipy.sparse  # loads longer than a small system is solved, which is one dense front: nothing to sort

    shape = (pointers.size - 1, int(numbers.max(initial=0)) + 1)
    rows = scipy.sparse.csr_array((np.empty(numbers.size, dtype=np.int8), numbers, pointers), shape=shape)
    rows.sort_indices()
    return rows.indices.astype(np.int64)


def _scalar_unknowns(structure: BlockStructure) -> Iterator[tuple[IntArray, IntArray, IntArray]]:
    """Yield, shape by shape, the scalar rows (m, r) and columns (m, c) of m blocks, and their numbers."""
    starts_of_rows, starts_of_columns = (
        structure.offsets[structure.indices],
        structure.offsets[structure.columns],
    )
    for rows, columns, blocks in structure.shapes():
        yield (
            starts_of_rows[blocks, None] + np.arange(rows),
            starts_of_columns[blocks, None] + np.arange(columns),
            blocks,
        )


def _entries(structure: BlockStructure, rows: int, columns: int, blocks: IntArray) -> IntArray:
    """Return where the entries (m, rows, columns) of blocks of one shape stand in the flat values."""
    return structure.position[blocks, None, None] + np.arange(rows * columns).reshape(rows, columns)


def _running_total(counts: IntArray) -> IntArray:
    """Return the pointers (n+1,) that n counts make."""
    return np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
