"""Block-sparse symmetric matrices, and products of rows that fill them."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from mor.linalg import compilation
from mor.linalg.compilation import compile_kernel
from mor.types import BoolArray, FloatArray, IntArray, ranges

# ---- Kernels on the pattern of a block matrix: union of cliques, and search for stored blocks.


@compile_kernel
def find_block(indptr: IntArray, indices: IntArray, row: int, column: int) -> int:
    """Return the number of the stored block (row, column), row >= column; -1 where there is none."""
    low = indptr[column]
    high = indptr[column + 1]
    while low < high:
        middle = (low + high) // 2
        if indices[middle] < row:
            low = middle + 1
        else:
            high = middle
    if low < indptr[column + 1] and indices[low] == row:
        return low  # type: ignore[no-any-return]
    return -1


@compile_kernel
def find_blocks_kernel(indptr: IntArray, indices: IntArray, rows: IntArray, columns: IntArray) -> IntArray:
    """Return the numbers of the stored blocks for pairs of blocks in either order; -1 where there is none."""
    found = np.empty(rows.size, dtype=np.int64)
    for k in range(rows.size):
        found[k] = find_block(indptr, indices, max(rows[k], columns[k]), min(rows[k], columns[k]))
    return found


@compile_kernel
def owners_of_members(blocks: int, pointers: IntArray, members: IntArray) -> tuple[IntArray, IntArray]:
    """Return, block by block, the cliques that contain it: pointers (blocks+1,) and clique numbers."""
    owner_pointers = np.zeros(blocks + 1, dtype=np.int64)
    for member in members:
        owner_pointers[member + 1] += 1
    for j in range(blocks):
        owner_pointers[j + 1] += owner_pointers[j]
    free = owner_pointers[:-1].copy()
    owners = np.empty(members.size, dtype=np.int64)
    for clique in range(pointers.size - 1):
        for member in members[pointers[clique] : pointers[clique + 1]]:
            owners[free[member]] = clique
            free[member] += 1
    return owner_pointers, owners


@compile_kernel
def union_of_cliques(blocks: int, pointers: IntArray, members: IntArray) -> tuple[IntArray, IntArray]:
    """Return the lower triangle by columns of the union of all pairs inside each clique, rows in no order.

    The members (block numbers) of clique i are ``members[pointers[i]:pointers[i+1]]``. Column j is collected
    from the cliques that own j, so the memory needed is that of the result, not of all pairs.
    """
    owner_pointers, owners = owners_of_members(blocks, pointers, members)
    indptr = np.zeros(blocks + 1, dtype=np.int64)
    indices = np.empty(16 * blocks + 16, dtype=np.int64)
    seen = np.full(blocks, -1, dtype=np.int64)
    count = 0
    for j in range(blocks):
        if count + blocks - j > indices.size:
            larger = np.empty(2 * indices.size + blocks, dtype=np.int64)
            larger[:count] = indices[:count]
            indices = larger
        indices[count] = j
        count += 1
        for clique in owners[owner_pointers[j] : owner_pointers[j + 1]]:
            for i in members[pointers[clique] : pointers[clique + 1]]:
                if i > j and seen[i] != j:
                    seen[i] = j
                    indices[count] = i
                    count += 1
        indptr[j + 1] = count
    return indptr, indices[:count].copy()


@compile_kernel
def scale_blocks(
    offsets: IntArray, indptr: IntArray, indices: IntArray, values: FloatArray, factors: FloatArray
) -> FloatArray:
    """Return the values of D N D with D = diag(factors)."""
    scaled = np.empty_like(values)
    place = 0
    for column in range(indptr.size - 1):
        first, end = offsets[column], offsets[column + 1]
        for number in range(indptr[column], indptr[column + 1]):
            for i in range(offsets[indices[number]], offsets[indices[number] + 1]):
                for j in range(first, end):
                    scaled[place] = values[place] * factors[i] * factors[j]
                    place += 1
    return scaled


# ---- Symmetric block-sparse matrices: the pattern once, the values as one flat array.
#
# A normal matrix is made of small dense blocks, one for every pair of parameter blocks that meet in an
# observation. Only the lower triangle is stored, by block columns; a diagonal block is stored in full.

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
        """Return a result computed from the pattern once and kept under a key."""
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
            return BlockMatrix(s, scale_blocks(s.offsets, s.indptr, s.indices, self.values, factors))
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
        indptr, indices = union_of_cliques(block_sizes.size, pointers, members)
        indices = ascending(indptr, indices)
    else:
        indptr, indices = union_of_cliques_by_sorting(block_sizes.size, pointers, members)
    columns = np.repeat(np.arange(block_sizes.size), np.diff(indptr))
    lengths = block_sizes[indices] * block_sizes[columns]
    return BlockStructure(_running_total(block_sizes), indptr, indices, _running_total(lengths))


def union_of_cliques_by_sorting(blocks: int, pointers: IntArray, members: IntArray) -> tuple[IntArray, IntArray]:
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
        numbers = find_blocks_kernel(structure.indptr, structure.indices, high, low)
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
    starts_of_rows, starts_of_columns = (structure.offsets[structure.indices], structure.offsets[structure.columns])
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
    return np.concatenate(([0], np.cumsum(counts))).astype(np.int64)


# ---- A part of a block matrix as one dense matrix: some blocks, and everything that is stored between them.


@dataclass(frozen=True)
class DensePart:
    """Some blocks of a pattern, their unknowns numbered from 0.

    Attributes:
        structure: the pattern.
        blocks: (b,) the blocks, ascending.
        unknowns: (n,) their unknowns, ascending.
        numbers: stored blocks of the pattern with both blocks among them.
    """

    structure: BlockStructure
    blocks: IntArray
    unknowns: IntArray
    numbers: IntArray

    @cached_property
    def stored(self) -> BoolArray:
        """(b, b) whether two blocks meet in the pattern."""
        found = np.zeros((self.blocks.size, self.blocks.size), dtype=np.bool_)
        one, other = (np.searchsorted(self.blocks, part) for part in self._rows_and_columns())
        found[one, other] = found[other, one] = True
        return found

    def numbers_of(self, unknowns: IntArray) -> IntArray:
        """Numbers, of the same shape, of unknowns of the whole matrix; n where they are -1."""
        found: IntArray = np.where(unknowns >= 0, np.searchsorted(self.unknowns, unknowns), self.unknowns.size)
        return found

    def add_to(self, values: FloatArray, dense: FloatArray) -> None:
        """Add a symmetric (n, n) matrix to the values of the whole one, in place; what is not stored is left out."""
        for places, rows, columns in self._places:
            values[places] += dense[rows[:, :, None], columns[:, None, :]]

    def of(self, values: FloatArray) -> FloatArray:
        """The (n, n) part of a matrix with these values, zero if nothing is stored."""
        dense = np.zeros((self.unknowns.size, self.unknowns.size))
        for places, rows, columns in self._places:
            stored = values[places]
            dense[rows[:, :, None], columns[:, None, :]] = stored
            dense[columns[:, :, None], rows[:, None, :]] = stored.transpose(0, 2, 1)
        return dense

    def _rows_and_columns(self) -> tuple[IntArray, IntArray]:
        column = np.searchsorted(self.structure.indptr, self.numbers, side="right") - 1
        return self.structure.indices[self.numbers], column

    @cached_property
    def _places(self) -> list[tuple[IntArray, IntArray, IntArray]]:
        """Shape by shape: places (m, r, c) in the flat values, rows (m, r) and columns (m, c) of blocks."""
        structure, sizes = self.structure, self.structure.sizes
        one, other = self._rows_and_columns()
        first_row, first_column = (self.numbers_of(structure.offsets[part]) for part in (one, other))
        base = int(sizes[self.blocks].max(initial=0)) + 1
        shapes = sizes[one] * base + sizes[other]
        found = []
        for shape in np.unique(shapes).tolist():
            here = np.flatnonzero(shapes == shape)
            r, c = divmod(shape, base)
            start = structure.position[self.numbers[here]]
            places = start[:, None, None] + np.arange(r * c).reshape(r, c)
            rows, columns = first_row[here, None] + np.arange(r), first_column[here, None] + np.arange(c)
            found.append((places, rows, columns))
        return found


def dense_part(structure: BlockStructure, blocks: IntArray) -> DensePart:
    """Some blocks (ascending) of a pattern, to be looked at as one dense matrix."""
    among = np.zeros(structure.blocks, dtype=np.bool_)
    among[blocks] = True
    numbers = ranges(structure.indptr[blocks], np.diff(structure.indptr)[blocks])
    unknowns = ranges(structure.offsets[blocks], structure.sizes[blocks])
    return DensePart(structure, blocks, unknowns, numbers[among[structure.indices[numbers]]])


# ---- Kernels that carry observation rows into a block matrix, and cofactors out of one.


@compile_kernel
def segments(columns: IntArray, block_of: IntArray, blocks: IntArray, starts: IntArray, ends: IntArray) -> int:
    """Split one row of columns into runs of equal blocks; columns that are fixed (−1) are left out."""
    count = 0
    for k in range(columns.size):
        if columns[k] < 0:
            continue
        block = block_of[columns[k]]
        if count > 0 and blocks[count - 1] == block and ends[count - 1] == k:
            ends[count - 1] = k + 1
        else:
            blocks[count] = block
            starts[count] = k
            ends[count] = k + 1
            count += 1
    return count


@compile_kernel
def accumulate_rows_kernel(
    jacobian: FloatArray,
    misclosure: FloatArray,
    columns: IntArray,
    block_of: IntArray,
    offsets: IntArray,
    indptr: IntArray,
    indices: IntArray,
    position: IntArray,
    values: FloatArray,
    rhs: FloatArray,
) -> None:
    """Add JᵀJ and Jᵀl of whitened observations, (n, m, K) and (n, m), to a block matrix and its right-hand side."""
    n, m, width = jacobian.shape
    blocks = np.empty(width, dtype=np.int64)
    starts = np.empty(width, dtype=np.int64)
    ends = np.empty(width, dtype=np.int64)
    for i in range(n):
        count = segments(columns[i], block_of, blocks, starts, ends)
        for a in range(count):
            for k in range(starts[a], ends[a]):
                for c in range(m):
                    rhs[columns[i, k]] += jacobian[i, c, k] * misclosure[i, c]
            for b in range(count):
                if blocks[a] < blocks[b]:
                    continue
                size = offsets[blocks[b] + 1] - offsets[blocks[b]]
                start = position[find_block(indptr, indices, blocks[a], blocks[b])]
                for k in range(starts[a], ends[a]):
                    row = start + (columns[i, k] - offsets[blocks[a]]) * size - offsets[blocks[b]]
                    for k2 in range(starts[b], ends[b]):
                        total = 0.0
                        for c in range(m):
                            total += jacobian[i, c, k] * jacobian[i, c, k2]
                        values[row + columns[i, k2]] += total


@compile_kernel
def row_cofactors_kernel(
    jacobian: FloatArray,
    columns: IntArray,
    block_of: IntArray,
    offsets: IntArray,
    indptr: IntArray,
    indices: IntArray,
    position: IntArray,
    values: FloatArray,
    cofactors: FloatArray,
) -> None:
    """J Q Jᵀ (n, m, m) of observations, from the blocks of Q that the pattern holds."""
    n, m, width = jacobian.shape
    blocks = np.empty(width, dtype=np.int64)
    starts = np.empty(width, dtype=np.int64)
    ends = np.empty(width, dtype=np.int64)
    for i in range(n):
        count = segments(columns[i], block_of, blocks, starts, ends)
        for a in range(count):
            for b in range(count):
                upper = blocks[a] < blocks[b]
                high, low = max(blocks[a], blocks[b]), min(blocks[a], blocks[b])
                size = offsets[low + 1] - offsets[low]
                start = position[find_block(indptr, indices, high, low)]
                for k in range(starts[a], ends[a]):
                    for k2 in range(starts[b], ends[b]):
                        one, other = columns[i, k], columns[i, k2]
                        if upper:
                            one, other = other, one
                        q = values[start + (one - offsets[high]) * size + other - offsets[low]]
                        for c in range(m):
                            for d in range(m):
                                cofactors[i, c, d] += jacobian[i, c, k] * q * jacobian[i, d, k2]


# ---- Between observation rows and the block matrix: JᵀJ in, J Q Jᵀ out; compiled, or plain where there is no compiler.

_ROWS_AT_A_TIME = 5000


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
    into: Target, values: FloatArray, rhs: FloatArray, jacobian: FloatArray, misclosure: FloatArray, columns: IntArray
) -> None:
    """Add JᵀJ to the block values and Jᵀl to the right-hand side.

    ``jacobian`` (n, m, K) and ``misclosure`` (n, m) are whitened; ``columns`` (n, K), −1 where fixed.
    """
    structure = into.structure
    if compilation.wanted():
        accumulate_rows_kernel(
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
    into: Target, values: FloatArray, rhs: FloatArray, jacobian: FloatArray, misclosure: FloatArray, columns: IntArray
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
    # Places of 16 bytes each; for a moment twice as many are kept.
    most_kept = 1_000_000
    if rows * width * width > most_kept:
        return _stored(into, columns)
    key = columns.shape, columns.tobytes()
    if key not in into.known:
        if sum(places.size for _, places in into.known.values()) > most_kept:
            into.known.clear()
        into.known[key] = _stored(into, columns)
    return into.known[key]


def _stored(into: Target, columns: IntArray) -> tuple[IntArray, IntArray]:
    """Return which products (k,) of columns (n, K), of all n·K·K, lie in the lower part, and their places (k,)."""
    places = _places(into, columns, lower_only=True)[0].ravel()
    stored = np.flatnonzero(places >= 0)
    return stored, places[stored]


def row_cofactors(cofactors: BlockMatrix, block_of: IntArray, jacobian: FloatArray, columns: IntArray) -> FloatArray:
    """J Q Jᵀ (n, m, m) of observations with Jacobians (n, m, K), from the selected inverse Q."""
    structure = cofactors.structure
    result = np.zeros((len(jacobian), jacobian.shape[1], jacobian.shape[1]))
    if compilation.wanted():
        row_cofactors_kernel(
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
    local = (high - structure.offsets[high_block]) * structure.sizes[low_block] + low - structure.offsets[low_block]
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
