"""Kernels that add what eliminated points leave to the reduced system.

S += Σ jᵀj − V Vᵀ,        b −= Σ jᵀ residual + V u
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.compiled import compile_kernel
from mor.adjustment.compiled.cliques import (
    NONE,
    Clique,
    Met,
    Pattern,
    grouped,
    look_up_pairs,
    merge,
    places_of_frame,
    runs_of_frames,
    same_frames,
    survey,
)
from mor.adjustment.compiled.point_store import (
    Store,
    append_point,
    empty_store,
    end_of_strip,
    open_group,
    slots_in_strip,
)
from mor.adjustment.compiled.points import clear, couple, factor_point
from mor.adjustment.compiled.strips import subtract_column_of_point
from mor.geometry.arrays import BoolArray, FloatArray, IntArray

_ONE, _TWO, _THREE = (np.uint64(k) for k in range(1, 4))
# Up to so many points with the same unknowns their products go straight to the blocks; more of them are added up first.
FEW_POINTS = 4


class System(NamedTuple):
    """The arrays of a ``ReducedSystem``."""

    values: FloatArray
    right_hand_side: FloatArray
    diagonal: FloatArray
    gradient: FloatArray


class Rest(NamedTuple):
    """What the rays leave beside the products of their couplings.

    Attributes:
        squares: (frames · K · K,) lower triangles of Σ jᵀj.
        gradient: (frames, K) −Σ jᵀ residual.
        reduction: (m,) Σ V u of one group of points.
    """

    squares: FloatArray
    gradient: FloatArray
    reduction: FloatArray


@compile_kernel
def add_rest(
    residual: FloatArray,
    by_others: FloatArray,
    frame: IntArray,
    first: int,
    end: int,
    V: FloatArray,
    u: FloatArray,
    rest: Rest,
) -> None:
    """Add the squares and gradients of the rays first … end − 1 of one point to those of their frames.

    ``by_others`` is flat.
    """
    reduction, gradient, width = rest.reduction, rest.gradient, rest.gradient.shape[1]
    for i in range(first, end):
        r, s, f = residual[i, 0], residual[i, 1], frame[i]
        at = 2 * i * width
        for k in range(width):
            gradient[f, k] -= by_others[at + k] * r + by_others[at + width + k] * s
        add_square(by_others, at, width, rest.squares, f * width * width)
    one, two, three = V[0], V[1], V[2]
    a, b, c = u[0], u[1], u[2]
    for m in range(one.size):
        reduction[m] += a * one[m] + b * two[m] + c * three[m]


@compile_kernel
def add_square(by_others: FloatArray, first: int, width: int, squares: FloatArray, start: int) -> None:
    """Add the products of two Jacobian rows, side by side from ``first`` on, with themselves: (K, K) from ``start`` on.

    Only what stands left of the diagonal, or in the diagonal tiles of four by four, is set. Arrays are flat and places
    unsigned, so that a row of a tile is one operation.
    """
    whole = width - width % 4
    for k in range(0, whole, 4):
        row = np.uint64(first + k)
        under = row + np.uint64(width)
        x0, y0 = by_others[row], by_others[under]
        x1, y1 = by_others[row + _ONE], by_others[under + _ONE]
        x2, y2 = by_others[row + _TWO], by_others[under + _TWO]
        x3, y3 = by_others[row + _THREE], by_others[under + _THREE]
        for m in range(0, k + 4, 4):
            column = np.uint64(first + m)
            below = column + np.uint64(width)
            a0, b0 = by_others[column], by_others[below]
            a1, b1 = by_others[column + _ONE], by_others[below + _ONE]
            a2, b2 = by_others[column + _TWO], by_others[below + _TWO]
            a3, b3 = by_others[column + _THREE], by_others[below + _THREE]
            at, further = np.uint64(start + k * width + m), np.uint64(width)
            s0, s1, s2, s3 = squares[at], squares[at + _ONE], squares[at + _TWO], squares[at + _THREE]
            squares[at] = s0 + x0 * a0 + y0 * b0
            squares[at + _ONE] = s1 + x0 * a1 + y0 * b1
            squares[at + _TWO] = s2 + x0 * a2 + y0 * b2
            squares[at + _THREE] = s3 + x0 * a3 + y0 * b3
            at += further
            s0, s1, s2, s3 = squares[at], squares[at + _ONE], squares[at + _TWO], squares[at + _THREE]
            squares[at] = s0 + x1 * a0 + y1 * b0
            squares[at + _ONE] = s1 + x1 * a1 + y1 * b1
            squares[at + _TWO] = s2 + x1 * a2 + y1 * b2
            squares[at + _THREE] = s3 + x1 * a3 + y1 * b3
            at += further
            s0, s1, s2, s3 = squares[at], squares[at + _ONE], squares[at + _TWO], squares[at + _THREE]
            squares[at] = s0 + x2 * a0 + y2 * b0
            squares[at + _ONE] = s1 + x2 * a1 + y2 * b1
            squares[at + _TWO] = s2 + x2 * a2 + y2 * b2
            squares[at + _THREE] = s3 + x2 * a3 + y2 * b3
            at += further
            s0, s1, s2, s3 = squares[at], squares[at + _ONE], squares[at + _TWO], squares[at + _THREE]
            squares[at] = s0 + x3 * a0 + y3 * b0
            squares[at + _ONE] = s1 + x3 * a1 + y3 * b1
            squares[at + _TWO] = s2 + x3 * a2 + y3 * b2
            squares[at + _THREE] = s3 + x3 * a3 + y3 * b3
    for k in range(whole, width):
        x, y = by_others[first + k], by_others[first + width + k]
        for m in range(k + 1):
            squares[start + k * width + m] += x * by_others[first + m] + y * by_others[first + width + m]


@compile_kernel
def carry_reduction(
    met: Met, clique: Clique, count: int, reduction: FloatArray, right_hand_side: FloatArray
) -> None:
    """Subtract Σ V u of a group from the right-hand side, and begin anew."""
    for slot in range(count):
        shift = met.first[clique.blocks[slot]] - clique.begin[slot]
        for m in range(clique.begin[slot], clique.begin[slot + 1]):
            right_hand_side[shift + m] -= reduction[m]
            reduction[m] = 0.0


@compile_kernel
def carry_rest(columns: IntArray, pattern: Pattern, rest: Rest, system: System) -> bool:
    """Add what frames with columns (f, K) left to the reduced system; False where a pair is not stored."""
    gradient, width = rest.gradient, columns.shape[1]
    squares = rest.squares.reshape((columns.shape[0], width, width))
    starts, places = np.empty(width, dtype=np.int64), np.empty((width, width), dtype=np.int64)
    for f in range(columns.shape[0]):
        if not places_of_frame(columns[f], pattern, starts, places):
            return False
        for k in range(width):
            column = columns[f, k]
            if column >= 0:
                system.right_hand_side[column] += gradient[f, k]
                system.gradient[column] += gradient[f, k]
                system.diagonal[column] += squares[f, k, k]
            for m in range(width):
                if places[k, m] >= 0:
                    system.values[places[k, m]] += squares[f, max(k, m), min(k, m)]
    return True


@compile_kernel
def subtract_products(store: Store, groups: int, met: Met, values: FloatArray) -> None:
    """Subtract V Vᵀ of all groups from the reduced matrix, strip by strip."""
    first = NONE
    while first < met.size.size:
        last = end_of_strip(first, met.size)
        subtract_point_by_point(store, groups, met, values, first, last)
        subtract_by_panels(store, groups, met, values, first, last)
        first = last


@compile_kernel
def subtract_point_by_point(
    store: Store, groups: int, met: Met, values: FloatArray, first: int, last: int
) -> None:
    """Subtract V Vᵀ of the groups of few points from a strip."""
    couplings, blocks, all_begin = store.couplings, store.blocks, store.begin
    known, starts = met.starts, np.empty(met.size.size, dtype=np.int64)
    for g in range(groups):
        block, end, points = store.first_block[g], store.first_block[g + 1], store.points[g]
        if points > FEW_POINTS:
            continue
        low, high = slots_in_strip(blocks, block, end, first, last)
        begin = all_begin[block + g : end + g + 1]
        slots = end - block
        base, size = store.first_coupling[g], begin[slots]
        for slot in range(low, high):
            for other in range(slot, slots):
                starts[other - slot] = known[blocks[block + slot], blocks[block + other]]
            width = begin[slot + 1] - begin[slot]
            for q in range(points):
                subtract_column_of_point(
                    values, starts, width, couplings, base + 3 * q * size, begin, slot, slots
                )


@compile_kernel
def subtract_by_panels(
    store: Store, groups: int, met: Met, values: FloatArray, first: int, last: int
) -> None:
    """Subtract V Vᵀ of the groups of many points from a strip."""
    blocks, known, starts = store.blocks, met.starts, np.empty(met.size.size, dtype=np.int64)
    for g in range(groups):
        block, end, points = store.first_block[g], store.first_block[g + 1], store.points[g]
        if points <= FEW_POINTS:
            continue
        low, high = slots_in_strip(blocks, block, end, first, last)
        begin = store.begin[block + g : end + g + 1]
        slots = end - block
        base, size = store.first_coupling[g], begin[slots]
        for slot in range(low, high):
            for other in range(slot, slots):
                starts[other - slot] = known[blocks[block + slot], blocks[block + other]]
            width, length = begin[slot + 1] - begin[slot], size - begin[slot]
            panel = np.empty(width * length)
            multiply_panel(store.couplings, base, size, 3 * points, begin[slot], width, panel)
            subtract_panel(panel, begin, slot, slots, starts, values)


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


@compile_kernel
def accumulate(
    residual: FloatArray,
    by_point: FloatArray,
    by_others: FloatArray,
    frame: IntArray,
    columns: IntArray,
    pointers: IntArray,
    damping: float,
    pattern: Pattern,
    system: System,
    held: BoolArray,
    gradient: FloatArray,
) -> bool:
    """Add the points to the reduced system; return False where a pair of blocks is not stored."""
    keys = np.empty(pointers.size - 1, dtype=np.int64)
    runs, met = runs_of_frames(columns, pattern)
    rays, most_runs, most, room = survey(frame, pointers, runs, met, keys)
    frames, K = columns.shape
    unseen = np.full(met.size.size, -1, dtype=np.int64)
    begin, local = np.empty(most + 1, dtype=np.int64), np.empty((rays, most_runs), dtype=np.int64)
    clique = Clique(np.empty(most, dtype=np.int64), begin, local, unseen)
    rest = Rest(np.zeros(frames * K * K), np.zeros((frames, K)), np.zeros(room))
    flat = by_others.reshape(-1)
    store = empty_store(keys.size, room)
    L, inverse, u = np.empty((3, 3)), np.empty(3), np.empty(3)
    groups, count, before, stored = NONE, NONE, -1, True
    for p in grouped(keys):
        first, end = pointers[p], pointers[p + 1]
        full = store.first_coupling[groups] + 3 * room > store.couplings.size
        if full or before < 0 or not same_frames(frame, pointers, p, before):
            carry_reduction(met, clique, count, rest.reduction, system.right_hand_side)
            if full and stored:
                subtract_products(store, groups, met, system.values)
            if full:
                groups = NONE
            count = merge(frame, first, end, runs, met, clique)
            stored = look_up_pairs(clique.blocks, count, met, pattern) and stored
            open_group(store, groups, clique, count)
            groups += 1
        before = p
        factor_point(by_point, residual, first, end, damping, L, inverse, u, gradient[p])
        for j in range(3):
            held[p, j] = inverse[j] == 0.0
        V = append_point(store, groups, begin[count])
        couple(by_point, by_others, frame, first, end, runs, local, L, inverse, V)
        add_rest(residual, flat, frame, first, end, V, u, rest)
    carry_reduction(met, clique, count, rest.reduction, system.right_hand_side)
    if stored:
        subtract_products(store, groups, met, system.values)
    return carry_rest(columns, pattern, rest, system) and stored
