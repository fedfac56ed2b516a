"""Compiled kernels: the reduced normal equations after eliminating points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.linalg.compilation import compile_inline, compile_kernel
from mor.linalg.registers import each, fetch, four, put, same
from mor.solve.clique_kernels import (
    NONE,
    Clique,
    FrameSums,
    Met,
    Pattern,
    Runs,
    add_rays,
    carry_frames,
    cover_pairs_of_frames,
    end_of_piece,
    grouped,
    largest_piece,
    merge,
    room_for_clique,
    runs_of_frames,
    same_frames,
    solve_points,
    starts_of_column,
    survey,
    whiten_points,
)
from mor.solve.moving_ray_kernels import follow_along, follow_moving, linearise_along, linearise_moving
from mor.solve.ray_kernels import MOVING, FrameChange, FrameValues, Layout, Paths, RayMeasurements, follow, linearise
from mor.types import BoolArray, FloatArray, IntArray, SmallIntArray

# ---- Kernels that couple points to the other unknowns of their rays.
#
# With the Jacobians j of the rays by the others, and any right factor c (n, 2, 3), the coupling of a point is Σ jᵀc,
# kept transposed (3, m), where m counts the merged unknowns of its rays; or as fours (m, 4), the last number zero.


@compile_inline
def couple(
    factor: FloatArray,
    by_others: FloatArray,
    width: int,
    frame: IntArray,
    first: int,
    end: int,
    runs: Runs,
    local: IntArray,
    couplings: FloatArray,
    base: int,
    size: int,
) -> None:
    """Set the coupling (3, size) of one point, from ``base`` on, by its rays first … end − 1; ``by_others`` is flat."""
    for entry in range(3 * size):
        couplings[np.uint64(base) + np.uint64(entry)] = 0.0
    for i in range(first, end):
        a, b, c = factor[i, 0, 0], factor[i, 0, 1], factor[i, 0, 2]
        d, e, f = factor[i, 1, 0], factor[i, 1, 1], factor[i, 1, 2]
        start = runs.pointers[frame[i]]
        for t in range(start, runs.pointers[frame[i] + 1]):
            at = np.uint64(base + local[i - first, t - start])
            x = np.uint64(2 * i * width + runs.first[t])
            for k in range(runs.length[t]):
                step = np.uint64(k)
                x0, y0 = by_others[x + step], by_others[x + step + np.uint64(width)]
                couplings[at + step] += x0 * a + y0 * d
                couplings[at + step + np.uint64(size)] += x0 * b + y0 * e
                couplings[at + step + np.uint64(2 * size)] += x0 * c + y0 * f


@compile_inline
def reduce_rays(
    factor: FloatArray,
    by_others: FloatArray,
    width: int,
    frame: IntArray,
    first: int,
    end: int,
    runs: Runs,
    local: IntArray,
    couplings: FloatArray,
    base: int,
    size: int,
    reduced: FloatArray,
) -> None:
    """Set j − c Vᵀ of the rays of one point, at their own columns, from its coupling; the Jacobians are flat."""
    for i in range(first, end):
        a, b, c = factor[i, 0, 0], factor[i, 0, 1], factor[i, 0, 2]
        d, e, f = factor[i, 1, 0], factor[i, 1, 1], factor[i, 1, 2]
        start = runs.pointers[frame[i]]
        for t in range(start, runs.pointers[frame[i] + 1]):
            at = np.uint64(base + local[i - first, t - start])
            x = np.uint64(2 * i * width + runs.first[t])
            for k in range(runs.length[t]):
                here, x0 = at + np.uint64(k), x + np.uint64(k)
                y0 = x0 + np.uint64(width)
                p, q, r = couplings[here], couplings[here + np.uint64(size)], couplings[here + np.uint64(2 * size)]
                reduced[x0] = by_others[x0] - (a * p + b * q + c * r)
                reduced[y0] = by_others[y0] - (d * p + e * q + f * r)


@compile_inline
def couple_fours(
    factor: FloatArray,
    by_others: FloatArray,
    width: int,
    frame: IntArray,
    first: int,
    end: int,
    runs: Runs,
    local: IntArray,
    shared: FloatArray,
    z: int,
    couplings: FloatArray,
    base: int,
    size: int,
) -> None:
    """Set the coupling (size + z, 4) of one point, from ``base`` on: with its unknowns, and with what is common.

    The factor (n, 2, 4), the Jacobians of both, ``shared`` (n, 2, z), and all else are flat.
    """
    for at in range(base, base + 4 * (size + z), 4):
        put(couplings, at, same(0.0))
    for i in range(first, end):
        a, b = four(factor, 8 * i), four(factor, 8 * i + 4)
        start = runs.pointers[frame[i]]
        for t in range(start, runs.pointers[frame[i] + 1]):
            at, x = base + 4 * local[i - first, t - start], 2 * i * width + runs.first[t]
            for k in range(x, x + runs.length[t]):
                moved = each(by_others, k) * a + each(by_others, k + width) * b
                put(couplings, at, four(couplings, at) + moved)
                at += 4
        at = base + 4 * size
        for k in range(2 * i * z, 2 * i * z + z):
            put(couplings, at, four(couplings, at) + each(shared, k) * a + each(shared, k + z) * b)
            at += 4


# ---- Kernels of the store in which groups of points wait until they reach the blocks of the reduced system
# together.
#
# It is the way to the memory that costs, not the arithmetic. The blocks of the reduced system are therefore
# visited in strips of columns that stay in the cache, and every strip by all groups in the store.

STRIP = 60_000
"""Numbers in a strip of columns of the reduced system, 0.5 MB: it stays in the cache while the store goes by."""
SMALL_STORE, LARGE_STORE = 200_000, 1_000_000
"""Numbers in a store: 1.6 MB, which stays in the cache itself, to 8 MB. See ``size_of_store``."""

AHEAD, NUMBERS_AHEAD = 4, 40
"""How many blocks ahead of the one that is worked on are fetched, and how much of each: 6 × 6, beginning anywhere."""


class Store(NamedTuple):
    """Groups of points with the same unknowns.

    Attributes:
        couplings: group after group, those of its points with its m unknowns, (3, m) or (m, 4).
        first_coupling: (groups+1,) where those of a group start.
        points: (groups,) number of points.
        blocks: group after group, ascending block numbers of its unknowns.
        begin: the first local unknown of each of these blocks, and behind them the number of unknowns.
        first_block: (groups+1,) where the blocks of a group start; ``begin`` has one entry more for each group.
    """

    couplings: FloatArray
    first_coupling: IntArray
    points: IntArray
    blocks: IntArray
    begin: IntArray
    first_block: IntArray


@compile_kernel
def size_of_store(met: Met, largest: int) -> int:
    """Return the numbers of a store for these blocks: a quarter of those of their system, within limits.

    Every emptying goes through the whole system. Where that is larger than the cache, and points are seen by images at
    random, it should be a seldom one.
    """
    unknowns = met.size.sum()
    return int(max(SMALL_STORE, min(unknowns * unknowns // 8, largest)))


@compile_kernel
def store_for(numbers: int) -> Store:
    """Return an empty store for so many couplings."""
    points = numbers // 3 + 2
    return Store(
        np.empty(numbers),
        np.zeros(points + 1, dtype=np.int64),
        np.zeros(points, dtype=np.int64),
        np.empty(points, dtype=np.int64),
        np.empty(2 * points, dtype=np.int64),
        np.zeros(points + 1, dtype=np.int64),
    )


@compile_inline
def is_full(store: Store, groups: int, numbers: int) -> bool:
    """Return whether there may be no room for another group with a point whose coupling takes so many numbers."""
    return groups + 1 >= store.points.size or store.first_coupling[groups] + numbers > store.couplings.size


@compile_kernel
def open_group(
    store: Store, groups: int, frame: IntArray, first_ray: int, end: int, runs: Runs, met: Met, clique: Clique
) -> int:
    """Append a group without points, for those with the frames of these rays; return the number of its unknowns."""
    count = merge(frame, first_ray, end, runs, met, clique)
    first = store.first_block[groups]
    for slot in range(count):
        store.blocks[first + slot] = clique.blocks[slot]
    for slot in range(count + 1):
        store.begin[groups + first + slot] = clique.begin[slot]
    store.first_block[groups + 1] = first + count
    store.first_coupling[groups + 1] = store.first_coupling[groups]
    store.points[groups] = 0
    return int(clique.begin[count])


@compile_inline
def append_point(store: Store, groups: int, numbers: int) -> int:
    """Append a point to the last of so many groups; return where its coupling of so many numbers starts."""
    first = store.first_coupling[groups]
    store.first_coupling[groups] = first + numbers
    store.points[groups - 1] += 1
    return int(first)


@compile_kernel
def end_of_strip(first: int, size: IntArray, most: int) -> int:
    """Return the end of the strip of met blocks, of these sizes, that begins with ``first``, with so many numbers."""
    below = size[first:].sum()
    last, numbers = first, 0
    while last < size.size and (last == first or numbers + size[last] * below <= most):
        numbers += size[last] * below
        below -= size[last]
        last += 1
    return last


@compile_inline
def end_in_strip(blocks: IntArray, first: int, end: int, last: int) -> int:
    """Return the end of the ascending blocks ``blocks[first:end]`` that lie before the end ``last`` of a strip."""
    while first < end and blocks[first] < last:
        first += 1
    return first


@compile_kernel
def room_for_pairs(store: Store, groups: int) -> IntArray:
    """Return room for the pairs of blocks (n, 3) of the largest group."""
    most = 0
    for g in range(groups):
        most = max(most, store.first_block[g + 1] - store.first_block[g])
    return np.empty((most * (most + 1) // 2, 3), dtype=np.int64)


@compile_inline
def fetch_block(values: FloatArray, start: int) -> None:
    """Have a block brought into the cache that will be worked on soon."""
    for line in range(0, NUMBERS_AHEAD, 8):
        fetch(values, start + line)


# ---- Kernels that carry the coupling of a single point into blocks of the reduced system.
#
# A block column is worked on in strips of six columns, then single ones; what belongs to the columns stays in
# registers. Without strips, normal equations of an aerial block take a fifth longer. Places are unsigned
# numbers: signed ones would be tested, entry by entry, for counting from the end.
#
# In all of them ``couplings`` holds the transposed coupling (3, m) of the point from ``first`` on. The
# unknowns of its blocks, ``slots`` in number, are ``begin[k]:begin[k+1]``; ``count`` blocks of the column of
# block ``slot``, that many columns wide, are visited: those of ``others``, which start at ``starts`` in the
# values.

_STRIPS_ONE, _STRIPS_TWO, _THREE, _FOUR, _FIVE = (np.uint64(k) for k in range(1, 6))


@compile_inline
def subtract_six(
    values: FloatArray,
    others: IntArray,
    starts: IntArray,
    count: int,
    width: int,
    couplings: FloatArray,
    first: int,
    begin: IntArray,
    slot: int,
    slots: int,
    strip: int,
) -> None:
    """Subtract V Vᵀ from six columns of the blocks, from column ``strip`` on."""
    size = begin[slots]
    one, two, three = np.uint64(first), np.uint64(first + size), np.uint64(first + 2 * size)
    k = np.uint64(begin[slot] + strip)
    a0 = couplings[one + k]
    a1 = couplings[one + k + _STRIPS_ONE]
    a2 = couplings[one + k + _STRIPS_TWO]
    a3 = couplings[one + k + _THREE]
    a4 = couplings[one + k + _FOUR]
    a5 = couplings[one + k + _FIVE]
    b0 = couplings[two + k]
    b1 = couplings[two + k + _STRIPS_ONE]
    b2 = couplings[two + k + _STRIPS_TWO]
    b3 = couplings[two + k + _THREE]
    b4 = couplings[two + k + _FOUR]
    b5 = couplings[two + k + _FIVE]
    c0 = couplings[three + k]
    c1 = couplings[three + k + _STRIPS_ONE]
    c2 = couplings[three + k + _STRIPS_TWO]
    c3 = couplings[three + k + _THREE]
    c4 = couplings[three + k + _FOUR]
    c5 = couplings[three + k + _FIVE]
    further = np.uint64(width)
    for visit in range(count):
        other, p = others[visit], np.uint64(starts[visit] + strip)
        for row in range(begin[other], begin[other + 1]):
            i = np.uint64(row)
            x, y, z = couplings[one + i], couplings[two + i], couplings[three + i]
            values[p] -= x * a0 + y * b0 + z * c0
            values[p + _STRIPS_ONE] -= x * a1 + y * b1 + z * c1
            values[p + _STRIPS_TWO] -= x * a2 + y * b2 + z * c2
            values[p + _THREE] -= x * a3 + y * b3 + z * c3
            values[p + _FOUR] -= x * a4 + y * b4 + z * c4
            values[p + _FIVE] -= x * a5 + y * b5 + z * c5
            p += further


@compile_inline
def subtract_one(
    values: FloatArray,
    others: IntArray,
    starts: IntArray,
    count: int,
    width: int,
    couplings: FloatArray,
    first: int,
    begin: IntArray,
    slot: int,
    slots: int,
    strip: int,
) -> None:
    """The same for a single column."""
    size = begin[slots]
    one, two, three = np.uint64(first), np.uint64(first + size), np.uint64(first + 2 * size)
    k = np.uint64(begin[slot] + strip)
    a0 = couplings[one + k]
    b0 = couplings[two + k]
    c0 = couplings[three + k]
    further = np.uint64(width)
    for visit in range(count):
        other, p = others[visit], np.uint64(starts[visit] + strip)
        for row in range(begin[other], begin[other + 1]):
            i = np.uint64(row)
            x, y, z = couplings[one + i], couplings[two + i], couplings[three + i]
            values[p] -= x * a0 + y * b0 + z * c0
            p += further


@compile_inline
def subtract_column_of_point(
    values: FloatArray,
    others: IntArray,
    starts: IntArray,
    count: int,
    width: int,
    couplings: FloatArray,
    first: int,
    begin: IntArray,
    slot: int,
    slots: int,
) -> None:
    """Subtract V Vᵀ from the blocks of a column."""
    strip = 0
    while width - strip >= 6:
        subtract_six(values, others, starts, count, width, couplings, first, begin, slot, slots, strip)
        strip += 6
    while strip < width:
        subtract_one(values, others, starts, count, width, couplings, first, begin, slot, slots, strip)
        strip += 1


# ---- Kernels that add what eliminated points leave to the reduced system.
#
# S += Σ jᵀj − V Vᵀ,        b −= Σ jᵀ residual + V u


class ReducedSystemArrays(NamedTuple):
    """The arrays of a ``ReducedSystem``."""

    values: FloatArray
    right_hand_side: FloatArray
    diagonal: FloatArray
    gradient: FloatArray


class Gathering(NamedTuple):
    """Points on their way into the reduced system.

    Attributes:
        columns: (f, K) unknowns of the frames.
        runs, met: the same in blocks.
        store: the couplings of points that wait.
        waiting: (1,) number of groups of them.
        sums: what else their rays leave.
        nested: whether the sums of frames hold all there is to pairs of blocks that meet in a frame.
    """

    columns: IntArray
    runs: Runs
    met: Met
    store: Store
    waiting: IntArray
    sums: FrameSums
    nested: bool


@compile_kernel
def begin_gathering(columns: IntArray, pattern: Pattern) -> Gathering:
    """Return a gathering of points of frames with these columns (f, K)."""
    runs, met = runs_of_frames(columns, pattern)
    nested = cover_pairs_of_frames(runs, met)
    numbers = max(size_of_store(met, LARGE_STORE), 3 * met.size.sum())  # a point that all frames see
    frames, width = columns.shape
    sums = FrameSums(
        width,
        np.zeros(frames * width * width),
        np.zeros(frames * width),
        np.zeros(frames * width),
        np.zeros(frames * width),
    )
    return Gathering(columns, runs, met, store_for(numbers), np.zeros(1, dtype=np.int64), sums, nested)


@compile_kernel
def store_points(
    gathering: Gathering,
    white: FloatArray,
    by_others: FloatArray,
    reduced: FloatArray,
    frame: IntArray,
    pointers: IntArray,
    pattern: Pattern,
    values: FloatArray,
) -> bool:
    """Store the couplings of whole points, points from the same frames side by side.

    ``white`` is a L⁻ᵀ. Where frames are nested, the Jacobians with the points eliminated are set, ``reduced``
    (n, 2, K); those of fixed columns are left alone. Where the store is full it is emptied; returns False where a pair
    of blocks is not stored.
    """
    runs, met, store, waiting = gathering.runs, gathering.met, gathering.store, gathering.waiting
    keys = np.empty(pointers.size - 1, dtype=np.int64)
    rays, most_runs, most, room = survey(frame, pointers, runs, met, keys)
    clique = room_for_clique(rays, most_runs, most, met)
    order, done, groups = grouped(keys), NONE, waiting[0]
    while True:
        done, groups = gather_points(
            gathering, groups, order, done, white, by_others, reduced, frame, pointers, clique, room
        )
        if done == order.size:
            break
        if not subtract_products(store, groups, met, pattern, values):
            return False
        groups = NONE
    waiting[0] = groups
    return True


@compile_kernel
def gather_points(
    gathering: Gathering,
    groups: int,
    order: IntArray,
    done: int,
    white: FloatArray,
    by_others: FloatArray,
    reduced: FloatArray,
    frame: IntArray,
    pointers: IntArray,
    clique: Clique,
    room: int,
) -> tuple[int, int]:
    """Store points in this order, from the place ``done`` on, behind so many groups, until the store is full.

    There it may be that there is no room for a point with ``room`` unknowns. Returns the place, and the number of
    groups.
    """
    runs, met, store, nested = gathering.runs, gathering.met, gathering.store, gathering.nested
    flat, rows, width, local = by_others.reshape(-1), reduced.reshape(-1), by_others.shape[2], clique.local
    couplings, before, size = store.couplings, -1, 0
    while done < order.size and not is_full(store, groups, 3 * room):
        p = order[done]
        first, end = pointers[p], pointers[p + 1]
        if before < 0 or not same_frames(frame, pointers, p, before):
            size = open_group(store, groups, frame, first, end, runs, met, clique)
            groups += 1
        base = append_point(store, groups, 3 * size)
        couple(white, flat, width, frame, first, end, runs, local, couplings, base, size)
        if nested:
            reduce_rays(white, flat, width, frame, first, end, runs, local, couplings, base, size, rows)
        before = p
        done += 1
    return done, groups


@compile_kernel
def finish_gathering(gathering: Gathering, pattern: Pattern, system: ReducedSystemArrays) -> bool:
    """Add what is gathered to the reduced system; return False where a pair of blocks is not stored."""
    columns, runs, met, store, waiting, sums, _ = gathering
    subtracted = subtract_products(store, waiting[0], met, pattern, system.values)
    values, right_hand_side, diagonal, gradient = system
    carried = carry_frames(columns, runs, met, pattern, sums, values, right_hand_side, diagonal, gradient)
    return subtracted and carried


@compile_kernel
def subtract_products(store: Store, groups: int, met: Met, pattern: Pattern, values: FloatArray) -> bool:
    """Subtract V Vᵀ of all groups from the reduced matrix, strip by strip; False where a pair is not stored."""
    first, reached = NONE, np.zeros(groups, dtype=np.int64)
    while first < met.size.size:
        last = end_of_strip(first, met.size, STRIP)
        if not subtract_from_strip(store, groups, met, pattern, values, last, reached):
            return False
        first = last
    return True


@compile_kernel
def subtract_from_strip(
    store: Store, groups: int, met: Met, pattern: Pattern, values: FloatArray, last: int, reached: IntArray
) -> bool:
    """Subtract V Vᵀ of all groups from a strip that ends before the block ``last``.

    ``reached`` (groups,) counts the blocks of each group that are done. Returns False where a pair is not stored.
    """
    couplings, blocks, all_begin = store.couplings, store.blocks, store.begin
    others, starts = np.empty(met.size.size, dtype=np.int64), np.empty(met.size.size, dtype=np.int64)
    for g in range(groups):
        block, end, points = store.first_block[g], store.first_block[g + 1], store.points[g]
        low, high = reached[g], end_in_strip(blocks, block + reached[g], end, last) - block
        reached[g] = high
        begin = all_begin[block + g : end + g + 1]
        slots = end - block
        base, size = store.first_coupling[g], begin[slots]
        for slot in range(low, high):
            count = starts_of_column(blocks[block:end], slot, met, pattern, others, starts)
            if count < 0:
                return False
            if count == 0:
                continue
            width = begin[slot + 1] - begin[slot]
            for q in range(points):
                subtract_column_of_point(
                    values, others, starts, count, width, couplings, base + 3 * q * size, begin, slot, slots
                )
    return True


# ---- Kernels that linearise image rays and eliminate their points, or find their steps, piece by piece.
#
# A piece is so small that its Jacobians, and the couplings they become, stay in the cache.

RAYS_OF_A_PIECE = 1024


class ImageRays(NamedTuple):
    """Image rays of whole points, not yet linearised.

    Attributes:
        values, layout: see there.
        frames: (f,) numbers of their frames in ``values``.
        local: (n,) frame of each ray, as its place in ``frames``.
        pointers: (p+1,) rays of each point.
        points: (p, 3) coordinates.
        measured: see there.
    """

    values: FrameValues
    layout: Layout
    frames: IntArray
    local: SmallIntArray
    pointers: IntArray
    points: FloatArray
    measured: RayMeasurements

    @property
    def paths(self) -> Paths | None:
        """Paths of the frames, ``None`` where no pose is one between knots."""
        return self.values.paths if len(self.values.paths.knots) else None


@compile_kernel
def gather_image_rays(
    gathering: Gathering,
    rays: ImageRays,
    paths: Paths | None,
    damping: float,
    pattern: Pattern,
    matrix: FloatArray,
    held: BoolArray,
    gradient: FloatArray,
) -> tuple[bool, float]:
    """Gather the points; return whether all pairs of blocks are stored, and the sum of the squared residuals.

    ``paths`` are those of the rays; where they are ``None`` nothing is compiled for them, which takes its time.
    """
    values, layout, frames, local, pointers, points, (observed, weight, measured, clock) = rays
    count, width = points.shape[0], gathering.columns.shape[1]
    room = largest_piece(pointers, RAYS_OF_A_PIECE)
    residuals, by_points = np.empty((room, 2)), np.empty((room, 2, 3))
    shifted, whites = np.empty((room, 2)), np.empty((room, 2, 3))
    by_others, without = np.empty((room, 2, width)), np.zeros((room, 2, width))
    in_chunk, overall = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64)
    squares, first, moving = 0.0, NONE, (values.model[frames] >= MOVING).any()
    while first < count:
        last = end_of_piece(pointers, first, RAYS_OF_A_PIECE)
        begin, end = pointers[first], pointers[last]
        n = end - begin
        for i in range(n):
            in_chunk[i] = local[begin + i]
            overall[i] = frames[in_chunk[i]]
        own = pointers[first : last + 1] - begin
        piece = RayMeasurements(observed[begin:end], weight[begin:end], measured[begin:end], clock[begin:end])
        residual, by_point, by_other = residuals[:n], by_points[:n], by_others[:n]
        linearise(values, layout, overall[:n], own, points[first:last], piece, residual, by_point, by_other)
        if moving:
            linearise_moving(values, layout, overall[:n], own, points[first:last], piece, residual, by_point, by_other)
        if paths is not None:
            linearise_along(values, layout, overall[:n], own, points[first:last], piece, residual, by_point, by_other)
        for i in range(n):
            squares += residual[i, 0] * residual[i, 0] + residual[i, 1] * residual[i, 1]
        white, moved = whites[:n], shifted[:n]
        gradients, holds = gradient[first:last], held[first:last]
        whiten_points(by_point, residual, own, damping, white, moved, holds, gradients)
        reduced = without[:n] if gathering.nested else by_other
        if not store_points(gathering, white, by_other, reduced, in_chunk[:n], own, pattern, matrix):
            return False, squares
        add_rays(residual, moved, by_other, reduced, in_chunk[:n], gathering.sums)
        first = last
    return True, squares


@compile_kernel
def solve_image_points(
    rays: ImageRays, paths: Paths | None, change: FrameChange, damping: float, steps: FloatArray
) -> None:
    """Set the steps (p, 3) of the points after a small change of the frames."""
    values, _, frames, local, pointers, points, (observed, weight, measured, clock) = rays
    room = largest_piece(pointers, RAYS_OF_A_PIECE)
    residuals, by_points, overall = (np.empty((room, 2)), np.empty((room, 2, 3)), np.empty(room, dtype=np.int64))
    first, moving = NONE, (values.model[frames] >= MOVING).any()
    while first < points.shape[0]:
        last = end_of_piece(pointers, first, RAYS_OF_A_PIECE)
        begin, end = pointers[first], pointers[last]
        n = end - begin
        for i in range(n):
            overall[i] = frames[local[begin + i]]
        own = pointers[first : last + 1] - begin
        piece = RayMeasurements(observed[begin:end], weight[begin:end], measured[begin:end], clock[begin:end])
        residual, by_point = residuals[:n], by_points[:n]
        follow(values, change, overall[:n], own, points[first:last], piece, residual, by_point)
        if moving:
            follow_moving(values, change, overall[:n], own, points[first:last], piece, residual, by_point)
        if paths is not None:
            follow_along(values, change, overall[:n], own, points[first:last], piece, residual, by_point)
        solve_points(residual, by_point, own, damping, steps[first:last])
        first = last
