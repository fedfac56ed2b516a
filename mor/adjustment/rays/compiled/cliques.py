"""Kernels that find out which blocks of the reduced system the rays of a point meet, and where pairs of
them stand.

The unknowns of all rays of a point are merged, block by block, into one short local list, so that a block
that many rays share (a camera) appears once. The list ascends, hence what stands right of a local column in
the list stands below it in the lower triangle. Points whose rays come from the very same frames form a group:
they share the list, and reach the blocks of the reduced system together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import IntArray
from mor.compilation import compile_inline, compile_kernel

UNKNOWN, COVERED = -2, -3
NONE: int = np.int64(0)  # type: ignore[assignment]
"""A count to begin with. A plain 0 is a type of its own, for which all kernels it is passed to are compiled again."""


class Pattern(NamedTuple):
    """The arrays of a ``BlockStructure``."""

    block_of: IntArray
    offsets: IntArray
    indptr: IntArray
    indices: IntArray
    position: IntArray


class Met(NamedTuple):
    """The blocks that the frames of a chunk meet, numbered from 0 in their order.

    Attributes:
        first: (b,) first unknown of each block.
        size: (b,) number of unknowns.
        column: (b,) block number in the pattern.
        starts: (b, b), by columns, where the blocks (row, column), row >= column, start in the flat
            values, -1 where not stored, ``COVERED`` where the sums of frames hold all there is to it,
            and ``UNKNOWN`` as long as nobody asked.
    """

    first: IntArray
    size: IntArray
    column: IntArray
    starts: IntArray


class Runs(NamedTuple):
    """Columns of frames, in runs that lie side by side in one block.

    Attributes:
        pointers: (f+1,) the runs of frame i are ``pointers[i]:pointers[i+1]`` in what follows.
        first: first column of the Jacobian.
        length: number of columns.
        block: number of the block among those that are met.
        within: first unknown within the block.
    """

    pointers: IntArray
    first: IntArray
    length: IntArray
    block: IntArray
    within: IntArray


class Clique(NamedTuple):
    """The merged blocks of the rays of one point; room for the largest point, of which a part is in use.

    Attributes:
        blocks: ascending numbers of met blocks.
        begin: first local unknown of each block, one entry more than blocks.
        local: (rays, runs) local number of the first unknown of each run.
        slot_of_block: working space, -1 throughout.
    """

    blocks: IntArray
    begin: IntArray
    local: IntArray
    slot_of_block: IntArray


@compile_kernel
def runs_of_frames(columns: IntArray, pattern: Pattern) -> tuple[Runs, Met]:
    """Return the runs of the columns (f, K) of frames, and the blocks they meet."""
    block_of, offsets = pattern.block_of, pattern.offsets
    pointers = np.zeros(columns.shape[0] + 1, dtype=np.int64)
    first, length = np.empty(columns.size, dtype=np.int64), np.empty(columns.size, dtype=np.int64)
    blocks, within = np.empty(columns.size, dtype=np.int64), np.empty(columns.size, dtype=np.int64)
    number = np.zeros(offsets.size, dtype=np.int64)
    count = 0
    for f in range(columns.shape[0]):
        previous = -2
        for k in range(columns.shape[1]):
            column = columns[f, k]
            if column >= 0:
                block = block_of[column]
                if column == previous + 1 and blocks[count - 1] == block:
                    length[count - 1] += 1
                else:
                    first[count], length[count] = k, 1
                    blocks[count], within[count] = block, column - offsets[block]
                    number[block] = 1
                    count += 1
            previous = column if column >= 0 else -2
        pointers[f + 1] = count
    met = 0
    for block in range(number.size):
        if number[block] == 1:
            number[block] = met
            met += 1
    own = Met(
        np.empty(met, dtype=np.int64),
        np.empty(met, dtype=np.int64),
        np.empty(met, dtype=np.int64),
        np.full((met, met), UNKNOWN, dtype=np.int64),
    )
    for t in range(count):
        block = blocks[t]
        blocks[t] = number[block]
        own.first[blocks[t]] = offsets[block]
        own.size[blocks[t]] = offsets[block + 1] - offsets[block]
        own.column[blocks[t]] = block
    return Runs(pointers, first[:count], length[:count], blocks[:count], within[:count]), own


@compile_kernel
def cover_pairs_of_frames(runs: Runs, met: Met) -> bool:
    """Mark the pairs of blocks that meet in a frame as covered; return False, and mark none, if frames are not nested.

    They are where, in every frame, each frame that has the block of an earlier column has that of a later one as well:
    where the pose comes before what it shares with other images, such as the camera. Then a sum over the frames that
    have the former is one over all rays that have to do with both.
    """
    count = met.size.size
    frames, together = np.zeros(count, dtype=np.int64), np.zeros((count, count), dtype=np.int32)
    for f in range(runs.pointers.size - 1):
        first = runs.pointers[f]
        for t in range(first, runs.pointers[f + 1]):
            if stands_before(runs, first, t):
                continue
            frames[runs.block[t]] += 1
            for s in range(first, runs.pointers[f + 1]):
                if not stands_before(runs, first, s):
                    together[runs.block[t], runs.block[s]] += 1
    for f in range(runs.pointers.size - 1):
        for t in range(runs.pointers[f], runs.pointers[f + 1]):
            for s in range(runs.pointers[f], t):
                if together[runs.block[t], runs.block[s]] < frames[runs.block[s]]:
                    return False
    for column in range(count):
        for row in range(column, count):
            if together[row, column] > 0:
                met.starts[column, row] = COVERED
    return True


@compile_inline
def stands_before(runs: Runs, first: int, t: int) -> bool:
    """Return whether the block of a run is that of one before it, from ``first`` on."""
    for s in range(first, t):
        if runs.block[s] == runs.block[t]:
            return True
    return False


@compile_kernel
def survey(
    frame: IntArray, pointers: IntArray, runs: Runs, met: Met, keys: IntArray
) -> tuple[int, int, int, int]:
    """Set keys of points, equal for equal frames; return the largest counts of rays, runs, blocks and unknowns."""
    frames = runs.pointers.size - 1
    unknowns_of_frame = np.zeros(frames, dtype=np.int64)
    most_runs = 0
    for f in range(frames):
        most_runs = max(most_runs, runs.pointers[f + 1] - runs.pointers[f])
        for t in range(runs.pointers[f], runs.pointers[f + 1]):
            unknowns_of_frame[f] += met.size[runs.block[t]]
    most_rays, most_blocks, most_unknowns = 0, 0, 0
    for p in range(pointers.size - 1):
        key, blocks, unknowns = 0, 0, 0
        for i in range(pointers[p], pointers[p + 1]):
            f = frame[i]
            key = (key * 1000003 + f + 1) & 0xFFFFFFFFFF
            blocks += runs.pointers[f + 1] - runs.pointers[f]
            unknowns += unknowns_of_frame[f]
        keys[p] = key
        most_rays = max(most_rays, pointers[p + 1] - pointers[p])
        most_blocks = max(most_blocks, blocks)
        most_unknowns = max(most_unknowns, unknowns)
    return most_rays, most_runs, most_blocks, min(most_unknowns, met.size.sum())


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


@compile_inline
def same_frames(frame: IntArray, pointers: IntArray, one: int, other: int) -> bool:
    """Return whether the rays of two points come from the same frames."""
    rays = pointers[one + 1] - pointers[one]
    if rays != pointers[other + 1] - pointers[other]:
        return False
    for i in range(rays):
        if frame[pointers[one] + i] != frame[pointers[other] + i]:
            return False
    return True


@compile_kernel
def room_for_clique(rays: int, runs: int, blocks: int, met: Met) -> Clique:
    """Return room for the largest point: one of so many rays with so many runs each, in so many blocks."""
    return Clique(
        np.empty(blocks, dtype=np.int64),
        np.empty(blocks + 1, dtype=np.int64),
        np.empty((rays, runs), dtype=np.int64),
        np.full(met.size.size, -1, dtype=np.int64),
    )


@compile_kernel
def merge(frame: IntArray, first: int, end: int, runs: Runs, met: Met, clique: Clique) -> int:
    """Merge the blocks of the rays first … end − 1 of one point into the clique; return their number."""
    blocks, begin, local, slot_of_block = clique
    count = 0
    for i in range(first, end):
        for t in range(runs.pointers[frame[i]], runs.pointers[frame[i] + 1]):
            block = runs.block[t]
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
        begin[slot + 1] = begin[slot] + met.size[block]
    for i in range(first, end):
        start = runs.pointers[frame[i]]
        for t in range(start, runs.pointers[frame[i] + 1]):
            local[i - first, t - start] = begin[slot_of_block[runs.block[t]]] + runs.within[t]
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
def look_up(met: Met, pattern: Pattern, row: int, column: int) -> int:
    """Note where the block (row, column), met blocks both, starts, and return it; -1 where it is not stored."""
    start = find_start(pattern.indptr, pattern.indices, pattern.position, met.column[row], met.column[column])
    met.starts[column, row] = start
    return start


@compile_kernel
def starts_of_column(
    blocks: IntArray, slot: int, met: Met, pattern: Pattern, others: IntArray, starts: IntArray
) -> int:
    """Set which blocks of a clique, from ``slot`` on, are to be visited in the column of ``slot``, and their starts.

    These are all that are not covered. Returns how many, -1 where one of them is not stored.
    """
    column, count = blocks[slot], 0
    for other in range(slot, blocks.size):
        start = met.starts[column, blocks[other]]
        if start == COVERED:
            continue
        if start < 0:
            start = look_up(met, pattern, blocks[other], column)
            if start < 0:
                return -1
        others[count], starts[count] = other, start
        count += 1
    return count


@compile_kernel
def pairs_of_columns(
    blocks: IntArray, low: int, high: int, met: Met, pattern: Pattern, pairs: IntArray
) -> int:
    """Set where the blocks of a clique start in the columns low … high − 1, and their row and column: (n, 3).

    Returns how many, -1 where one of them is not stored.
    """
    count = 0
    for slot in range(low, high):
        column = blocks[slot]
        for other in range(slot, blocks.size):
            start = met.starts[column, blocks[other]]
            if start < 0:
                start = look_up(met, pattern, blocks[other], column)
                if start < 0:
                    return -1
            pairs[count, 0], pairs[count, 1], pairs[count, 2] = start, other, slot
            count += 1
    return count


@compile_kernel
def places_of_frame(columns: IntArray, pattern: Pattern, starts: IntArray, places: IntArray) -> bool:
    """Set where the pairs of columns (K,) of a frame stand in the flat values: (K, K).

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
                previous = -1  # a block may come again behind others, as those of knots do
                continue
            if a != above:
                starts[m] = starts[m - 1] if b == previous else find_start(indptr, indices, position, a, b)
                if starts[m] < 0:
                    return False
                previous = b
            width = offsets[b + 1] - offsets[b]
            places[k, m] = starts[m] + (columns[k] - offsets[a]) * width + columns[m] - offsets[b]
        above = a
    return True
