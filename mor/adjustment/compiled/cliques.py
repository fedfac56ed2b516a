"""Kernels that find out which blocks of the reduced system the rays of a point meet, and where pairs of
them stand.

The unknowns of all rays of a point are merged, block by block, into one short local list, so that a block
that many rays share (a camera) appears once. The list ascends, hence what stands right of a local column in
the list stands below it in the lower triangle. Points whose rays have the very same unknowns form a group:
they share the list, and reach the blocks of the reduced system together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.compiled import compile_inline, compile_kernel
from mor.geometry.arrays import IntArray


class Pattern(NamedTuple):
    """The arrays of a ``BlockStructure``."""

    block_of: IntArray
    offsets: IntArray
    indptr: IntArray
    indices: IntArray
    position: IntArray


class Clique(NamedTuple):
    """The merged blocks of the rays of one point; room for the largest point, of which a part is in use.

    Attributes:
        blocks: ascending block numbers.
        begin: first local unknown of each block, one entry more than blocks.
        local: (rays, K) local number of each column, -1 where it is fixed.
        slot_of_block: working space, -1 throughout.
    """

    blocks: IntArray
    begin: IntArray
    local: IntArray
    slot_of_block: IntArray


@compile_kernel
def survey(columns: IntArray, pointers: IntArray, pattern: Pattern, keys: IntArray) -> tuple[int, int, int]:
    """Set keys of points, equal for equal columns; return the largest counts of rays, blocks and unknowns."""
    block_of, offsets = pattern.block_of, pattern.offsets
    most_rays, most_blocks, most_unknowns = 0, 0, 0
    for p in range(pointers.size - 1):
        key, blocks, unknowns = 0, 0, 0
        for i in range(pointers[p], pointers[p + 1]):
            previous = -1
            for k in range(columns.shape[1]):
                column = columns[i, k]
                if column < 0:
                    continue
                block = block_of[column]
                if block != previous:
                    key = (key * 1000003 + column + 1) & 0xFFFFFFFFFF
                    blocks += 1
                    unknowns += offsets[block + 1] - offsets[block]
                    previous = block
        keys[p] = key
        most_rays = max(most_rays, pointers[p + 1] - pointers[p])
        most_blocks = max(most_blocks, blocks)
        most_unknowns = max(most_unknowns, unknowns)
    return most_rays, most_blocks, most_unknowns


@compile_kernel
def grouped(keys: IntArray) -> IntArray:
    """Return the order that brings points with equal keys together, groups in order of first appearance."""
    room = 4
    while room < 2 * keys.size:
        room *= 2
    table = np.full(room, -1, dtype=np.int64)
    group = np.empty(keys.size, dtype=np.int64)
    place_of = np.zeros(keys.size + 1, dtype=np.int64)
    groups = 0
    for p in range(keys.size):
        place = (keys[p] ^ (keys[p] >> 17)) & (room - 1)
        while table[place] >= 0 and keys[table[place]] != keys[p]:
            place = (place + 1) & (room - 1)
        if table[place] < 0:
            table[place] = p
            group[p] = groups
            groups += 1
        else:
            group[p] = group[table[place]]
        place_of[group[p] + 1] += 1
    for g in range(groups):
        place_of[g + 1] += place_of[g]
    order = np.empty(keys.size, dtype=np.int64)
    for p in range(keys.size):
        order[place_of[group[p]]] = p
        place_of[group[p]] += 1
    return order


@compile_kernel
def same_columns(columns: IntArray, pointers: IntArray, one: int, other: int) -> bool:
    """Return whether the rays of two points have the same columns."""
    rays = pointers[one + 1] - pointers[one]
    if rays != pointers[other + 1] - pointers[other]:
        return False
    for i in range(rays):
        for k in range(columns.shape[1]):
            if columns[pointers[one] + i, k] != columns[pointers[other] + i, k]:
                return False
    return True


@compile_kernel
def merge(columns: IntArray, pattern: Pattern, clique: Clique) -> int:
    """Merge the blocks of the rays of one point, columns (r, K), into the clique; return their number."""
    blocks, begin, local, slot_of_block = clique
    block_of, offsets = pattern.block_of, pattern.offsets
    count = 0
    for i in range(columns.shape[0]):
        for k in range(columns.shape[1]):
            if columns[i, k] < 0:
                continue
            block = block_of[columns[i, k]]
            if slot_of_block[block] < 0:
                slot_of_block[block] = 0
                at = count
                while at > 0 and blocks[at - 1] > block:
                    blocks[at] = blocks[at - 1]
                    at -= 1
                blocks[at] = block
                count += 1
    begin[0] = 0
    for slot in range(count):
        block = blocks[slot]
        slot_of_block[block] = slot
        begin[slot + 1] = begin[slot] + offsets[block + 1] - offsets[block]
    for i in range(columns.shape[0]):
        for k in range(columns.shape[1]):
            local[i, k] = -1
            if columns[i, k] >= 0:
                block = block_of[columns[i, k]]
                local[i, k] = begin[slot_of_block[block]] + columns[i, k] - offsets[block]
    for slot in range(count):
        slot_of_block[blocks[slot]] = -1
    return count


@compile_inline
def find_start(indptr: IntArray, indices: IntArray, position: IntArray, row: int, column: int) -> int:
    """Return where the block (row, column), row >= column, starts in the flat values, -1 where not stored."""
    low = indptr[column]
    end = indptr[column + 1]
    number = low + row - column  # right where the column is full, as the systems of close range are
    if number >= end or indices[number] != row:
        high = end
        while low < high:
            number = (low + high) // 2
            if indices[number] < row:
                low = number + 1
            else:
                high = number
        number = low if low < end and indices[low] == row else -1
    return position[number] if number >= 0 else -1


@compile_kernel
def starts_of_column(
    blocks: IntArray, indptr: IntArray, indices: IntArray, position: IntArray, starts: IntArray
) -> bool:
    """Set where the blocks (blocks[i], blocks[0]), ascending, start; return False where one is not stored."""
    column = blocks[0]
    first, end = indptr[column], indptr[column + 1]
    low = first
    for slot in range(blocks.size):
        row = blocks[slot]
        number = first + row - column
        if number >= end or indices[number] != row:
            high = end
            while low < high:
                number = (low + high) // 2
                if indices[number] < row:
                    low = number + 1
                else:
                    high = number
            if low >= end or indices[low] != row:
                return False
            number = low
        low = number + 1
        starts[slot] = position[number]
    return True


@compile_kernel
def places_of_ray(columns: IntArray, pattern: Pattern, starts: IntArray, places: IntArray) -> bool:
    """Set where the pairs of columns (K,) of a ray stand in the flat values: (K, K).

    It is -1 where one of the two is fixed, and above the diagonal blocks. ``starts`` (K,) is working space.
    Returns False where a pair is not stored.
    """
    block_of, offsets, indptr, indices, position = pattern
    above = -1
    for k in range(columns.size):
        if columns[k] < 0:
            places[k] = -1
            continue
        a = block_of[columns[k]]
        previous = -1
        for m in range(columns.size):
            places[k, m] = -1
            b = block_of[columns[m]] if columns[m] >= 0 else a + 1
            if b > a:
                continue
            if a != above:
                starts[m] = starts[m - 1] if b == previous else find_start(indptr, indices, position, a, b)
                if starts[m] < 0:
                    return False
                previous = b if m + 1 < columns.size and columns[m + 1] >= 0 else -1
            width = offsets[b + 1] - offsets[b]
            places[k, m] = starts[m] + (columns[k] - offsets[a]) * width + columns[m] - offsets[b]
        above = a
    return True
