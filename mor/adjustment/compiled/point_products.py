"""Kernels that add what eliminated points leave to the reduced system.

S += Σ jᵀj − V Vᵀ,        b −= Σ jᵀ residual + V u
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.compiled import compile_kernel
from mor.adjustment.compiled.cliques import (
    NONE,
    Met,
    Pattern,
    Runs,
    grouped,
    look_up,
    room_for_clique,
    runs_of_frames,
    survey,
)
from mor.adjustment.compiled.frame_sums import FrameSums, add_rays, carry_frames
from mor.adjustment.compiled.point_store import (
    STORE,
    Store,
    end_in_strip,
    end_of_strip,
    fill_store,
    store_for,
)
from mor.adjustment.compiled.points import clear, whiten_points
from mor.adjustment.compiled.strips import subtract_column_of_point
from mor.geometry.arrays import BoolArray, FloatArray, IntArray

# Up to so many points with the same unknowns their products go straight to the blocks; more of them are added up first.
FEW_POINTS = 4


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
def gather(
    gathering: Gathering,
    residual: FloatArray,
    by_point: FloatArray,
    by_others: FloatArray,
    frame: IntArray,
    pointers: IntArray,
    damping: float,
    pattern: Pattern,
    values: FloatArray,
    held: BoolArray,
    gradient: FloatArray,
) -> bool:
    """Gather whole points; where the store is full it is emptied. False where a pair of blocks is not stored."""
    white, moved = np.empty(by_point.shape), np.empty(residual.shape)
    whiten_points(by_point, residual, pointers, damping, white, moved, held, gradient)
    add_rays(residual, moved, by_others, frame, gathering.sums)
    return store_points(gathering, white, by_others, frame, pointers, pattern, values)


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
    """Store the couplings of points, points from the same frames side by side."""
    _, runs, met, store, waiting, _ = gathering
    keys = np.empty(pointers.size - 1, dtype=np.int64)
    rays, most_runs, most, room = survey(frame, pointers, runs, met, keys)
    clique = room_for_clique(rays, most_runs, most, met)
    order, done, groups = grouped(keys), 0, waiting[0]
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
    first, stored = NONE, True
    reached = np.zeros(groups, dtype=np.int64)
    while first < met.size.size:
        last = end_of_strip(first, met.size)
        stored = subtract_point_by_point(store, groups, met, pattern, values, last, reached) and stored
        stored = subtract_by_panels(store, groups, met, pattern, values, last, reached) and stored
        first = last
    return stored


@compile_kernel
def subtract_point_by_point(
    store: Store, groups: int, met: Met, pattern: Pattern, values: FloatArray, last: int, reached: IntArray
) -> bool:
    """Subtract V Vᵀ of the groups of few points from a strip that ends before the block ``last``.

    ``reached`` (groups,) counts the blocks of each group that are done. Returns False where a pair is not stored.
    """
    couplings, blocks, all_begin = store.couplings, store.blocks, store.begin
    known, starts = met.starts, np.empty(met.size.size, dtype=np.int64)
    for g in range(groups):
        block, end, points = store.first_block[g], store.first_block[g + 1], store.points[g]
        if points > FEW_POINTS:
            continue
        low, high = reached[g], end_in_strip(blocks, block + reached[g], end, last) - block
        reached[g] = high
        begin = all_begin[block + g : end + g + 1]
        slots = end - block
        base, size = store.first_coupling[g], begin[slots]
        for slot in range(low, high):
            column = blocks[block + slot]
            for other in range(slot, slots):
                row = blocks[block + other]
                start = known[column, row]
                if start < 0:
                    start = look_up(met, pattern, row, column)
                    if start < 0:
                        return False
                starts[other - slot] = start
            width = begin[slot + 1] - begin[slot]
            for q in range(points):
                subtract_column_of_point(
                    values, starts, width, couplings, base + 3 * q * size, begin, slot, slots
                )
    return True


@compile_kernel
def subtract_by_panels(
    store: Store, groups: int, met: Met, pattern: Pattern, values: FloatArray, last: int, reached: IntArray
) -> bool:
    """The same for the groups of many points."""
    blocks, known, starts = store.blocks, met.starts, np.empty(met.size.size, dtype=np.int64)
    for g in range(groups):
        block, end, points = store.first_block[g], store.first_block[g + 1], store.points[g]
        if points <= FEW_POINTS:
            continue
        low, high = reached[g], end_in_strip(blocks, block + reached[g], end, last) - block
        reached[g] = high
        begin = store.begin[block + g : end + g + 1]
        slots = end - block
        base, size = store.first_coupling[g], begin[slots]
        for slot in range(low, high):
            column = blocks[block + slot]
            for other in range(slot, slots):
                row = blocks[block + other]
                start = known[column, row]
                if start < 0:
                    start = look_up(met, pattern, row, column)
                    if start < 0:
                        return False
                starts[other - slot] = start
            width, length = begin[slot + 1] - begin[slot], size - begin[slot]
            panel = np.empty(width * length)
            multiply_panel(store.couplings, base, size, 3 * points, begin[slot], width, panel)
            subtract_panel(panel, begin, slot, slots, starts, values)
    return True


@compile_kernel
def multiply_panel(
    couplings: FloatArray, base: int, size: int, rows: int, first: int, width: int, panel: FloatArray
) -> None:
    """Set the product (width, length) of the unknowns from ``first`` on with all from ``first`` on."""
    V = couplings[base : base + rows * size].reshape((rows, size))
    multiply(V, first, panel[: width * (size - first)].reshape((width, size - first)))


@compile_kernel
def multiply(V: FloatArray, first: int, product: FloatArray) -> None:
    """Set the product (w, length) of the w unknowns from ``first`` on with all from ``first`` on.

    Three rows at a time: every number that is fetched serves three products.
    """
    clear(product)
    width, length = product.shape
    whole = width - width % 3
    for q in range(0, V.shape[0], 3):
        one, two, three = V[q, first:], V[q + 1, first:], V[q + 2, first:]
        for j in range(0, whole, 3):
            a, b, c = product[j], product[j + 1], product[j + 2]
            ax, ay, az = one[j], two[j], three[j]
            bx, by, bz = one[j + 1], two[j + 1], three[j + 1]
            cx, cy, cz = one[j + 2], two[j + 2], three[j + 2]
            for i in range(length):
                a[i] += ax * one[i] + ay * two[i] + az * three[i]
                b[i] += bx * one[i] + by * two[i] + bz * three[i]
                c[i] += cx * one[i] + cy * two[i] + cz * three[i]
        for j in range(whole, width):
            x, y, z = one[j], two[j], three[j]
            row = product[j]
            for i in range(length):
                row[i] += x * one[i] + y * two[i] + z * three[i]


@compile_kernel
def subtract_panel(
    panel: FloatArray, begin: IntArray, slot: int, slots: int, starts: IntArray, values: FloatArray
) -> None:
    """Subtract a product (w, length) from the blocks of a column, which start at ``starts``.

    Multiples of three, as positions and attitudes are, are written out: a loop over three is mostly overhead.
    """
    width, length = begin[slot + 1] - begin[slot], begin[slots] - begin[slot]
    product = panel[: width * length].reshape((width, length))
    for other in range(slot, slots):
        place = starts[other - slot]
        low, high = begin[other] - begin[slot], begin[other + 1] - begin[slot]
        if width % 3 == 0:
            for i in range(low, high):
                for j in range(0, width, 3):
                    values[place] -= product[j, i]
                    values[place + 1] -= product[j + 1, i]
                    values[place + 2] -= product[j + 2, i]
                    place += 3
        else:
            for i in range(low, high):
                for j in range(width):
                    values[place + j] -= product[j, i]
                place += width
