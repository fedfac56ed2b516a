"""Kernels on the pattern of a block matrix: union of cliques, and search for stored blocks."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_kernel


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
def find_blocks(indptr: IntArray, indices: IntArray, rows: IntArray, columns: IntArray) -> IntArray:
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
