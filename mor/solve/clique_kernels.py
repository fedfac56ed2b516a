"""Compiled kernels: cliques of images that see common points, normal equations of points and frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.linalg.compilation import compile_inline, compile_kernel
from mor.types import BoolArray, FloatArray, IntArray, SmallIntArray

# ---- Kernels that find out which blocks of the reduced system the rays of a point meet, and where pairs of
# them stand.
#
# The unknowns of all rays of a point are merged, block by block, into one short local list, so that a block
# that many rays share (a camera) appears once. The list ascends, hence what stands right of a local column in
# the list stands below it in the lower triangle. Points whose rays come from the very same frames form a group:
# they share the list, and reach the blocks of the reduced system together.

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
def survey(frame: IntArray, pointers: IntArray, runs: Runs, met: Met, keys: IntArray) -> tuple[int, int, int, int]:
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
def pairs_of_columns(blocks: IntArray, low: int, high: int, met: Met, pattern: Pattern, pairs: IntArray) -> int:
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


# ---- Kernels that eliminate points met by rays alone: their 3×3 systems, and what they leave in the reduced
# system.
#
# For one point, with the Jacobians a (by the point) and j (by the other unknowns) of its rays,
#
#     N_pp = Σ aᵀa = L Lᵀ,    W = Σ jᵀa,    V = W L⁻ᵀ,    b_p = −Σ aᵀ residual,    u = L⁻¹ b_p.

# Pivots of a 3×3 system scaled to unit diagonal carry hardly any round-off.
VANISHING = 1e-12


@compile_kernel
def clear(matrix: FloatArray) -> None:
    """Set a matrix to zero; the assignment to a slice would take seconds to compile."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            matrix[i, j] = 0.0


@compile_inline
def sums_of_point(
    by_point: FloatArray, residual: FloatArray, first: int, end: int
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Return the lower triangle of Σ aᵀa, row by row, and −Σ aᵀ residual of the rays first … end − 1."""
    n00, n10, n11, n20, n21, n22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    g, h, k = 0.0, 0.0, 0.0
    for i in range(first, end):
        for c in range(2):
            x, y, z, r = by_point[i, c, 0], by_point[i, c, 1], by_point[i, c, 2], residual[i, c]
            n00 += x * x
            n10 += x * y
            n11 += y * y
            n20 += x * z
            n21 += y * z
            n22 += z * z
            g -= x * r
            h -= y * r
            k -= z * r
    return n00, n10, n11, n20, n21, n22, g, h, k


@compile_kernel
def root_of_point(
    n00: float, n10: float, n11: float, n20: float, n21: float, n22: float, damping: float
) -> tuple[float, float, float, float, float, float]:
    """Return the reciprocals of the diagonal of L and what stands below it: L10, L20, L21.

    A coordinate whose pivot vanishes is held: its reciprocal is zero, and so are its row and column. (What is not a
    number is not held, but shows.)
    """
    p, q, r, a, b, c = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    pivot = n00 * (1.0 + damping)
    if not pivot <= VANISHING * n00:
        p = 1.0 / np.sqrt(pivot)
        a, b = n10 * p, n20 * p
    pivot = n11 * (1.0 + damping) - a * a
    if not pivot <= VANISHING * n11:
        q = 1.0 / np.sqrt(pivot)
        c = (n21 - a * b) * q
    else:
        a = 0.0
    pivot = n22 * (1.0 + damping) - b * b - c * c
    if not pivot <= VANISHING * n22:
        r = 1.0 / np.sqrt(pivot)
    else:
        b, c = 0.0, 0.0
    return p, q, r, a, b, c


@compile_kernel
def whiten_points(
    by_point: FloatArray,
    residual: FloatArray,
    pointers: IntArray,
    damping: float,
    white: FloatArray,
    moved: FloatArray,
    held: BoolArray,
    gradient: FloatArray,
) -> None:
    """Factorise N_pp of all points and carry its root into their rays.

    Sets a L⁻ᵀ as ``white`` (n, 2, 3), so that V = Σ jᵀ white; residual + white u as ``moved`` (n, 2): the residuals
    after the points have made up for what they can, so that −Σ jᵀ moved is what is left of the right-hand side; whether
    a coordinate is ``held`` (p, 3); and b_p = −Σ aᵀ residual as ``gradient`` (p, 3).
    """
    for point in range(pointers.size - 1):
        first, end = pointers[point], pointers[point + 1]
        n00, n10, n11, n20, n21, n22, g, h, k = sums_of_point(by_point, residual, first, end)
        p, q, r, a, b, c = root_of_point(n00, n10, n11, n20, n21, n22, damping)
        gradient[point, 0], gradient[point, 1], gradient[point, 2] = g, h, k
        held[point, 0], held[point, 1], held[point, 2] = p == 0.0, q == 0.0, r == 0.0
        u = g * p
        v = (h - a * u) * q
        w = (k - b * u - c * v) * r
        for i in range(first, end):
            for m in range(2):
                x = by_point[i, m, 0] * p
                y = (by_point[i, m, 1] - a * x) * q
                z = (by_point[i, m, 2] - b * x - c * y) * r
                white[i, m, 0], white[i, m, 1], white[i, m, 2] = x, y, z
                moved[i, m] = residual[i, m] + x * u + y * v + z * w


@compile_kernel
def invert_points(by_point: FloatArray, pointers: IntArray, factor: FloatArray, inverse: FloatArray) -> None:
    """Set N_pp⁻¹ of all points as ``inverse`` (p, 3, 3), and a N_pp⁻¹ of their rays as ``factor`` (n, 2, 4).

    The fourth number is zero.
    """
    nothing = np.zeros((by_point.shape[0], 2))
    for point in range(pointers.size - 1):
        first, end = pointers[point], pointers[point + 1]
        n00, n10, n11, n20, n21, n22, _, _, _ = sums_of_point(by_point, nothing, first, end)
        p, q, r, a, b, c = root_of_point(n00, n10, n11, n20, n21, n22, 0.0)
        k10, k21 = -a * p * q, -c * q * r  # L⁻¹ below its diagonal
        k20 = -(b * p + c * k10) * r
        n00, n10, n11 = p * p + k10 * k10 + k20 * k20, k10 * q + k20 * k21, q * q + k21 * k21
        n20, n21, n22 = k20 * r, k21 * r, r * r
        inverse[point, 0, 0], inverse[point, 0, 1], inverse[point, 0, 2] = n00, n10, n20
        inverse[point, 1, 0], inverse[point, 1, 1], inverse[point, 1, 2] = n10, n11, n21
        inverse[point, 2, 0], inverse[point, 2, 1], inverse[point, 2, 2] = n20, n21, n22
        for i in range(first, end):
            for m in range(2):
                x, y, z = by_point[i, m, 0], by_point[i, m, 1], by_point[i, m, 2]
                factor[i, m, 0] = x * n00 + y * n10 + z * n20
                factor[i, m, 1] = x * n10 + y * n11 + z * n21
                factor[i, m, 2] = x * n20 + y * n21 + z * n22
                factor[i, m, 3] = 0.0


@compile_kernel
def factor_point(
    by_point: FloatArray,
    residual: FloatArray,
    first: int,
    end: int,
    damping: float,
    L: FloatArray,
    inverse: FloatArray,
    u: FloatArray,
    gradient: FloatArray,
) -> None:
    """Factorise N_pp of the rays first … end − 1 of one point, (n, 2, 3) and (n, 2).

    Sets what stands below the diagonal of L (3, 3), the reciprocals of its diagonal, b_p = −Σ aᵀ residual as
    ``gradient``, and u = L⁻¹ b_p, both zero where a coordinate is held.
    """
    n00, n10, n11, n20, n21, n22, g, h, k = sums_of_point(by_point, residual, first, end)
    p, q, r, a, b, c = root_of_point(n00, n10, n11, n20, n21, n22, damping)
    inverse[0], inverse[1], inverse[2] = p, q, r
    L[1, 0], L[2, 0], L[2, 1] = a, b, c
    gradient[0], gradient[1], gradient[2] = g, h, k
    u[0] = g * p
    u[1] = (h - a * u[0]) * q
    u[2] = (k - b * u[0] - c * u[1]) * r


@compile_kernel
def solve_points(
    residual: FloatArray, by_point: FloatArray, pointers: IntArray, damping: float, point_steps: FloatArray
) -> None:
    """Set the steps (p, 3) of the points, all else known."""
    L, inverse, u, gradient = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    for p in range(pointers.size - 1):
        factor_point(by_point, residual, pointers[p], pointers[p + 1], damping, L, inverse, u, gradient)
        for j in range(2, -1, -1):
            for k in range(j + 1, 3):
                u[j] -= L[k, j] * u[k]
            u[j] *= inverse[j]
            point_steps[p, j] = u[j]


@compile_kernel
def follow_directions(
    by_point: FloatArray,
    by_others: FloatArray,
    frame: IntArray,
    columns: IntArray,
    pointers: IntArray,
    directions: FloatArray,
    of_points: FloatArray,
) -> None:
    """Set how the points follow (p, 3, k) directions (n, k) of the others: −N_pp⁻¹ Wᵀ g."""
    count, width = directions.shape[1], columns.shape[1]
    L, inverse, u, gradient = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    nothing = np.zeros((by_point.shape[0], 2))
    of_frame = np.zeros((columns.shape[0], width, count))
    for f in range(columns.shape[0]):
        for k in range(width):
            if columns[f, k] >= 0:
                for d in range(count):
                    of_frame[f, k, d] = directions[columns[f, k], d]
    moved, right = np.empty((2, count)), np.empty((3, count))
    for p in range(pointers.size - 1):
        clear(right)
        for i in range(pointers[p], pointers[p + 1]):
            clear(moved)
            for k in range(width):
                x, y = by_others[i, 0, k], by_others[i, 1, k]
                for d in range(count):
                    moved[0, d] += x * of_frame[frame[i], k, d]
                    moved[1, d] += y * of_frame[frame[i], k, d]
            for j in range(3):
                x, y = by_point[i, 0, j], by_point[i, 1, j]
                for d in range(count):
                    right[j, d] -= x * moved[0, d] + y * moved[1, d]
        factor_point(by_point, nothing, pointers[p], pointers[p + 1], 0.0, L, inverse, u, gradient)
        for d in range(count):
            a = right[0, d] * inverse[0]
            b = (right[1, d] - L[1, 0] * a) * inverse[1]
            c = (right[2, d] - L[2, 0] * a - L[2, 1] * b) * inverse[2] * inverse[2]
            b = (b - L[2, 1] * c) * inverse[1]
            of_points[p, 0, d] = (a - L[1, 0] * b - L[2, 0] * c) * inverse[0]
            of_points[p, 1, d], of_points[p, 2, d] = b, c


# ---- Kernels that cut points into pieces of so many rays that what is worked out of them stays in the cache.


@compile_kernel
def end_of_piece(pointers: IntArray, first: int, rays: int) -> int:
    """Return the end of the points of the piece of so many rays that begins with the point ``first``, one at least."""
    last = first + 1
    while last < pointers.size - 1 and pointers[last + 1] - pointers[first] <= rays:
        last += 1
    return last


@compile_kernel
def largest_piece(pointers: IntArray, rays: int) -> int:
    """Return the largest number of rays of a piece."""
    largest = 0
    for p in range(pointers.size - 1):
        largest = max(largest, pointers[p + 1] - pointers[p])
    return int(max(largest, min(rays, pointers[-1] - pointers[0])))


# ---- Kernels that bring rays into the order of their points.


@compile_kernel
def by_point_and_frame(point: SmallIntArray, frame: SmallIntArray, points: int) -> tuple[IntArray, IntArray]:
    """Return pointers (points+1,) and the order of the rays by point, then by frame; points < 0 are left out."""
    pointers = np.zeros(points + 1, dtype=np.int64)
    for i in range(point.size):
        if point[i] >= 0:
            pointers[point[i] + 1] += 1
    for p in range(points):
        pointers[p + 1] += pointers[p]
    order = np.empty(pointers[points], dtype=np.int64)
    used = np.zeros(points, dtype=np.int64)
    for i in range(point.size):
        p = point[i]
        if p < 0:
            continue
        at = pointers[p] + used[p]
        used[p] += 1
        while at > pointers[p] and frame[order[at - 1]] > frame[i]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = i
    return pointers, order


@compile_kernel
def local_numbers(
    frame: SmallIntArray, first: IntArray, frames: int, local: SmallIntArray
) -> tuple[IntArray, IntArray]:
    """Number the frames of each chunk from 0, in order of first appearance.

    ``first`` (c+1,) are the chunks' first rays; sets ``local`` (n,). Returns pointers (c+1,) and the frames of each
    chunk.
    """
    pointers = np.zeros(first.size, dtype=np.int64)
    found = np.empty(max(16, 2 * frames), dtype=np.int64)
    number = np.full(frames, -1, dtype=np.int64)
    count = 0
    for c in range(first.size - 1):
        begin = count
        for i in range(first[c], first[c + 1]):
            f = frame[i]
            if number[f] < begin:
                if count == found.size:
                    larger = np.empty(2 * found.size, dtype=np.int64)
                    larger[:count] = found
                    found = larger
                number[f] = count
                found[count] = f
                count += 1
            local[i] = number[f] - begin
        pointers[c + 1] = count
    return pointers, found[:count].copy()


# ---- Kernels that add up what the rays of one frame leave beside the products of their couplings.
#
# Rays are gone through frame by frame, and tiles of a few rows and columns are added up in registers.

ROWS, COLUMNS = 4, 8
"""Rows and columns that are added up together; Jacobians have whole numbers of them."""
_ONE, _TWO, _THREE, _FOUR, _FIVE, _SIX, _SEVEN = (np.uint64(k) for k in range(1, COLUMNS))


class FrameSums(NamedTuple):
    """Sums over the rays of each frame.

    Attributes:
        width: K.
        squares: (frames · K · K,) lower triangles of Σ ĵᵀj; ĵ is j with the point of the ray eliminated, or j itself.
        diagonal: (frames · K,) diagonal of Σ jᵀj.
        gradient: (frames · K,) −Σ jᵀ residual.
        right_hand_side: (frames · K,) the same of the residuals that the points leave.
    """

    width: int
    squares: FloatArray
    diagonal: FloatArray
    gradient: FloatArray
    right_hand_side: FloatArray


@compile_kernel
def add_rays(
    residual: FloatArray,
    moved: FloatArray,
    by_others: FloatArray,
    reduced: FloatArray,
    frame: IntArray,
    sums: FrameSums,
) -> None:
    """Add the rays, (n, 2), (n, 2), j (n, 2, K) and ĵ (n, 2, K), to the sums of their frames."""
    width, frames = sums.width, sums.gradient.size // sums.width
    first, listed = sorted_by_frame(frame, frames)
    flat, rows = by_others.reshape(-1), reduced.reshape(-1)
    plain, shifted = residual.reshape(-1), moved.reshape(-1)
    for f in range(frames):
        if listed[first[f]] < 0:
            continue
        for column in range(0, width, COLUMNS):
            add_products(flat, plain, shifted, listed, first[f], width, column, sums, f)
            for row in range(column, width, ROWS):
                start = f * width * width
                add_tile(flat, rows, listed, first[f], width, row, column, sums.squares, start)


@compile_kernel
def sorted_by_frame(frame: IntArray, frames: int) -> tuple[IntArray, IntArray]:
    """Return where the rays of each frame begin (frames,) in a list of them all, -1 behind those of each frame."""
    count, first = np.zeros(frames, dtype=np.int64), np.zeros(frames, dtype=np.int64)
    for i in range(frame.size):
        count[frame[i]] += 1
    for f in range(1, frames):
        first[f] = first[f - 1] + count[f - 1] + 1
    listed, place = np.full(frame.size + frames, -1, dtype=np.int64), first.copy()
    for i in range(frame.size):
        listed[place[frame[i]]] = i
        place[frame[i]] += 1
    return first, listed


@compile_kernel
def add_products(
    by_others: FloatArray,
    residual: FloatArray,
    moved: FloatArray,
    listed: IntArray,
    first: int,
    width: int,
    column: int,
    sums: FrameSums,
    f: int,
) -> None:
    """Add what else the listed rays of the frame ``f`` leave in ``COLUMNS`` columns."""
    g0, g1, g2, g3, g4, g5, g6, g7 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    h0, h1, h2, h3, h4, h5, h6, h7 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    d0, d1, d2, d3, d4, d5, d6, d7 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    further = np.uint64(width)
    k = np.uint64(first)
    while listed[k] >= 0:
        i = np.uint64(listed[k])
        a = _TWO * further * i + np.uint64(column)
        c, place = a + further, _TWO * i
        r, s, t, u = residual[place], residual[place + _ONE], moved[place], moved[place + _ONE]
        a0, a1, a2, a3 = by_others[a], by_others[a + _ONE], by_others[a + _TWO], by_others[a + _THREE]
        a4, a5, a6, a7 = (by_others[a + _FOUR], by_others[a + _FIVE], by_others[a + _SIX], by_others[a + _SEVEN])
        b0, b1, b2, b3 = by_others[c], by_others[c + _ONE], by_others[c + _TWO], by_others[c + _THREE]
        b4, b5, b6, b7 = (by_others[c + _FOUR], by_others[c + _FIVE], by_others[c + _SIX], by_others[c + _SEVEN])
        g0, g1 = g0 - (a0 * r + b0 * s), g1 - (a1 * r + b1 * s)
        g2, g3 = g2 - (a2 * r + b2 * s), g3 - (a3 * r + b3 * s)
        g4, g5 = g4 - (a4 * r + b4 * s), g5 - (a5 * r + b5 * s)
        g6, g7 = g6 - (a6 * r + b6 * s), g7 - (a7 * r + b7 * s)
        h0, h1 = h0 - (a0 * t + b0 * u), h1 - (a1 * t + b1 * u)
        h2, h3 = h2 - (a2 * t + b2 * u), h3 - (a3 * t + b3 * u)
        h4, h5 = h4 - (a4 * t + b4 * u), h5 - (a5 * t + b5 * u)
        h6, h7 = h6 - (a6 * t + b6 * u), h7 - (a7 * t + b7 * u)
        d0, d1 = d0 + a0 * a0 + b0 * b0, d1 + a1 * a1 + b1 * b1
        d2, d3 = d2 + a2 * a2 + b2 * b2, d3 + a3 * a3 + b3 * b3
        d4, d5 = d4 + a4 * a4 + b4 * b4, d5 + a5 * a5 + b5 * b5
        d6, d7 = d6 + a6 * a6 + b6 * b6, d7 + a7 * a7 + b7 * b7
        k += _ONE
    at = np.uint64(f * width + column)
    add_eight(sums.gradient, at, g0, g1, g2, g3, g4, g5, g6, g7)
    add_eight(sums.right_hand_side, at, h0, h1, h2, h3, h4, h5, h6, h7)
    add_eight(sums.diagonal, at, d0, d1, d2, d3, d4, d5, d6, d7)


@compile_kernel
def add_tile(
    by_others: FloatArray,
    reduced: FloatArray,
    listed: IntArray,
    first: int,
    width: int,
    row: int,
    column: int,
    squares: FloatArray,
    start: int,
) -> None:
    """Add Σ ĵᵀj of ``ROWS`` rows and ``COLUMNS`` columns, of listed rays, from ``first`` on; (K, K) begin at ``start``.

    Places are unsigned, so that numbers side by side are one operation; and where the list ends is not known before,
    or the compiler would work on several rays at a time, whose numbers lie far apart.
    """
    s00, s01, s02, s03, s04, s05, s06, s07 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    s10, s11, s12, s13, s14, s15, s16, s17 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    s20, s21, s22, s23, s24, s25, s26, s27 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    s30, s31, s32, s33, s34, s35, s36, s37 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    further = np.uint64(width)
    k = np.uint64(first)
    while listed[k] >= 0:
        i = np.uint64(listed[k])
        base = _TWO * further * i
        a, b = base + np.uint64(column), base + np.uint64(row)
        c, d = a + further, b + further
        x0, x1, x2, x3 = reduced[b], reduced[b + _ONE], reduced[b + _TWO], reduced[b + _THREE]
        y0, y1, y2, y3 = reduced[d], reduced[d + _ONE], reduced[d + _TWO], reduced[d + _THREE]
        a0, a1, a2, a3 = by_others[a], by_others[a + _ONE], by_others[a + _TWO], by_others[a + _THREE]
        a4, a5, a6, a7 = (by_others[a + _FOUR], by_others[a + _FIVE], by_others[a + _SIX], by_others[a + _SEVEN])
        b0, b1, b2, b3 = by_others[c], by_others[c + _ONE], by_others[c + _TWO], by_others[c + _THREE]
        b4, b5, b6, b7 = (by_others[c + _FOUR], by_others[c + _FIVE], by_others[c + _SIX], by_others[c + _SEVEN])
        s00, s01 = s00 + x0 * a0 + y0 * b0, s01 + x0 * a1 + y0 * b1
        s02, s03 = s02 + x0 * a2 + y0 * b2, s03 + x0 * a3 + y0 * b3
        s04, s05 = s04 + x0 * a4 + y0 * b4, s05 + x0 * a5 + y0 * b5
        s06, s07 = s06 + x0 * a6 + y0 * b6, s07 + x0 * a7 + y0 * b7
        s10, s11 = s10 + x1 * a0 + y1 * b0, s11 + x1 * a1 + y1 * b1
        s12, s13 = s12 + x1 * a2 + y1 * b2, s13 + x1 * a3 + y1 * b3
        s14, s15 = s14 + x1 * a4 + y1 * b4, s15 + x1 * a5 + y1 * b5
        s16, s17 = s16 + x1 * a6 + y1 * b6, s17 + x1 * a7 + y1 * b7
        s20, s21 = s20 + x2 * a0 + y2 * b0, s21 + x2 * a1 + y2 * b1
        s22, s23 = s22 + x2 * a2 + y2 * b2, s23 + x2 * a3 + y2 * b3
        s24, s25 = s24 + x2 * a4 + y2 * b4, s25 + x2 * a5 + y2 * b5
        s26, s27 = s26 + x2 * a6 + y2 * b6, s27 + x2 * a7 + y2 * b7
        s30, s31 = s30 + x3 * a0 + y3 * b0, s31 + x3 * a1 + y3 * b1
        s32, s33 = s32 + x3 * a2 + y3 * b2, s33 + x3 * a3 + y3 * b3
        s34, s35 = s34 + x3 * a4 + y3 * b4, s35 + x3 * a5 + y3 * b5
        s36, s37 = s36 + x3 * a6 + y3 * b6, s37 + x3 * a7 + y3 * b7
        k += _ONE
    at = np.uint64(start + row * width + column)
    add_eight(squares, at, s00, s01, s02, s03, s04, s05, s06, s07)
    at += further
    add_eight(squares, at, s10, s11, s12, s13, s14, s15, s16, s17)
    at += further
    add_eight(squares, at, s20, s21, s22, s23, s24, s25, s26, s27)
    at += further
    add_eight(squares, at, s30, s31, s32, s33, s34, s35, s36, s37)


@compile_inline
def add_eight(
    sums: FloatArray,
    at: np.uint64,
    s0: float,
    s1: float,
    s2: float,
    s3: float,
    s4: float,
    s5: float,
    s6: float,
    s7: float,
) -> None:
    """Add numbers to those side by side."""
    sums[at] += s0
    sums[at + _ONE] += s1
    sums[at + _TWO] += s2
    sums[at + _THREE] += s3
    sums[at + _FOUR] += s4
    sums[at + _FIVE] += s5
    sums[at + _SIX] += s6
    sums[at + _SEVEN] += s7


@compile_kernel
def carry_frames(
    columns: IntArray,
    runs: Runs,
    met: Met,
    pattern: Pattern,
    sums: FrameSums,
    values: FloatArray,
    right_hand_side: FloatArray,
    diagonal: FloatArray,
    gradient: FloatArray,
) -> bool:
    """Add the sums of frames with columns (f, K) to the reduced system; False where a pair of blocks is not stored."""
    frames, width = columns.shape
    squares = sums.squares.reshape((frames, width, width))
    for f in range(frames):
        for k in range(width):
            column = columns[f, k]
            if column >= 0:
                right_hand_side[column] += sums.right_hand_side[f * width + k]
                gradient[column] += sums.gradient[f * width + k]
                diagonal[column] += sums.diagonal[f * width + k]
        for t in range(runs.pointers[f], runs.pointers[f + 1]):
            for s in range(runs.pointers[f], runs.pointers[f + 1]):
                one, other = runs.block[t], runs.block[s]
                if one < other:
                    continue
                start = find_start(
                    pattern.indptr, pattern.indices, pattern.position, met.column[one], met.column[other]
                )
                if start < 0:
                    return False
                for k in range(runs.length[t]):
                    at = start + (runs.within[t] + k) * met.size[other] + runs.within[s]
                    for m in range(runs.length[s]):
                        row, column = runs.first[t] + k, runs.first[s] + m
                        values[at + m] += squares[f, max(row, column), min(row, column)]
    return True
