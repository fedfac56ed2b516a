"""Kernels that add what eliminated points leave to the reduced system.

S += Σ jᵀj − V Vᵀ,        b −= Σ jᵀ residual + V u
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.rays.compiled.cliques import (
    NONE,
    Met,
    Pattern,
    Runs,
    grouped,
    room_for_clique,
    runs_of_frames,
    starts_of_column,
    survey,
)
from mor.adjustment.rays.compiled.frame_sums import FrameSums, carry_frames
from mor.adjustment.rays.compiled.point_store import (
    STORE,
    Store,
    end_in_strip,
    end_of_strip,
    fill_store,
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
    """

    columns: IntArray
    runs: Runs
    met: Met
    store: Store
    waiting: IntArray
    sums: FrameSums


@compile_kernel
def begin_gathering(columns: IntArray, pattern: Pattern) -> Gathering:
    """Return a gathering of points of frames with these columns (f, K)."""
    runs, met = runs_of_frames(columns, pattern)
    numbers = max(STORE, 3 * met.size.sum())  # a point that all frames see
    frames, width = columns.shape
    sums = FrameSums(np.zeros(frames * width * width), np.zeros((frames, width)), np.zeros((frames, width)))
    return Gathering(columns, runs, met, store_for(numbers), np.zeros(1, dtype=np.int64), sums)


@compile_kernel
def store_points(
    gathering: Gathering,
    white: FloatArray,
    by_others: FloatArray,
    frame: IntArray,
    pointers: IntArray,
    pattern: Pattern,
    values: FloatArray,
) -> bool:
    """Store the couplings of whole points, points from the same frames side by side.

    ``white`` is a L⁻ᵀ. Where the store is full it is emptied; returns False where a pair of blocks is not stored.
    """
    _, runs, met, store, waiting, _ = gathering
    keys = np.empty(pointers.size - 1, dtype=np.int64)
    rays, most_runs, most, room = survey(frame, pointers, runs, met, keys)
    clique = room_for_clique(rays, most_runs, most, met)
    order, done, groups = grouped(keys), NONE, waiting[0]
    while True:
        done, groups = fill_store(
            store, groups, order, done, white, by_others, frame, pointers, runs, met, clique, room
        )
        if done == order.size:
            break
        if not subtract_products(store, groups, met, pattern, values):
            return False
        groups = NONE
    waiting[0] = groups
    return True


@compile_kernel
def finish_gathering(gathering: Gathering, pattern: Pattern, system: System) -> bool:
    """Add what is gathered to the reduced system; return False where a pair of blocks is not stored."""
    columns, runs, met, store, waiting, sums = gathering
    subtracted = subtract_products(store, waiting[0], met, pattern, system.values)
    values, right_hand_side, diagonal, gradient = system
    carried = carry_frames(columns, runs, met, pattern, sums, values, right_hand_side, diagonal, gradient)
    return subtracted and carried


@compile_kernel
def subtract_products(store: Store, groups: int, met: Met, pattern: Pattern, values: FloatArray) -> bool:
    """Subtract V Vᵀ of all groups from the reduced matrix, strip by strip; False where a pair is not stored."""
    first, reached = NONE, np.zeros(groups, dtype=np.int64)
    while first < met.size.size:
        last = end_of_strip(first, met.size)
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
    starts = np.empty(met.size.size, dtype=np.int64)
    for g in range(groups):
        block, end, points = store.first_block[g], store.first_block[g + 1], store.points[g]
        low, high = reached[g], end_in_strip(blocks, block + reached[g], end, last) - block
        reached[g] = high
        begin = all_begin[block + g : end + g + 1]
        slots = end - block
        base, size = store.first_coupling[g], begin[slots]
        for slot in range(low, high):
            if not starts_of_column(blocks[block:end], slot, met, pattern, starts):
                return False
            width = begin[slot + 1] - begin[slot]
            for q in range(points):
                subtract_column_of_point(
                    values, starts, width, couplings, base + 3 * q * size, begin, slot, slots
                )
    return True
