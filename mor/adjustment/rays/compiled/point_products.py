"""Kernels that add what eliminated points leave to the reduced system.

S += Σ jᵀj − V Vᵀ,        b −= Σ jᵀ residual + V u
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.rays.compiled.cliques import (
    NONE,
    Clique,
    Met,
    Pattern,
    Runs,
    cover_pairs_of_frames,
    grouped,
    room_for_clique,
    runs_of_frames,
    same_frames,
    starts_of_column,
    survey,
)
from mor.adjustment.rays.compiled.couplings import couple, reduce_rays
from mor.adjustment.rays.compiled.frame_sums import FrameSums, carry_frames
from mor.adjustment.rays.compiled.point_store import (
    LARGE_STORE,
    STRIP,
    Store,
    append_point,
    end_in_strip,
    end_of_strip,
    is_full,
    open_group,
    size_of_store,
    store_for,
)
from mor.adjustment.rays.compiled.strips import subtract_column_of_point
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_kernel


class System(NamedTuple):
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
def finish_gathering(gathering: Gathering, pattern: Pattern, system: System) -> bool:
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
