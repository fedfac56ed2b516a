"""Kernels of the cofactors of points, from the selected inverse Q_cc of the reduced system.

With E = W N_pp⁻¹ and H = Q_cc E, for one point,

    Q_pp = N_pp⁻¹ + Eᵀ H,        Q_cp = −H.
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.compiled import compile_inline, compile_kernel
from mor.adjustment.compiled.cliques import (
    NONE,
    Clique,
    Met,
    Pattern,
    Runs,
    grouped,
    look_up,
    merge,
    room_for_clique,
    runs_of_frames,
    survey,
)
from mor.adjustment.compiled.point_products import FEW_POINTS
from mor.adjustment.compiled.point_store import (
    LARGEST_STORE,
    Store,
    end_of_strip,
    fill_store,
    slots_in_strip,
    store_for,
)
from mor.adjustment.compiled.points import invert_points
from mor.adjustment.compiled.ray_cofactors import ROOM_FOR_FORMS, cofactors_of_rays, gather_frames
from mor.adjustment.compiled.strips import multiply_column_of_point
from mor.geometry.arrays import FloatArray, IntArray


@compile_kernel
def multiply_by_inverse(
    store: Store, groups: int, met: Met, pattern: Pattern, values: FloatArray, products: FloatArray
) -> bool:
    """Set the products H = Q_cc E, laid out as the couplings E, strip by strip; False where a pair is not stored."""
    for k in range(store.first_coupling[groups]):
        products[k] = 0.0
    first, stored = NONE, True
    while first < met.size.size:
        last = end_of_strip(first, met.size)
        stored = (
            multiply_point_by_point(store, groups, met, pattern, values, products, first, last) and stored
        )
        stored = multiply_by_panels(store, groups, met, pattern, values, products, first, last) and stored
        first = last
    return stored


@compile_kernel
def multiply_point_by_point(
    store: Store,
    groups: int,
    met: Met,
    pattern: Pattern,
    values: FloatArray,
    products: FloatArray,
    first: int,
    last: int,
) -> bool:
    """Add to the products of the groups of few points what a strip makes of them; False where a pair is not stored."""
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
                multiply_column_of_point(
                    values, starts, width, couplings, products, base + 3 * q * size, begin, slot, slots
                )
    return True


@compile_kernel
def multiply_by_panels(
    store: Store,
    groups: int,
    met: Met,
    pattern: Pattern,
    values: FloatArray,
    products: FloatArray,
    first: int,
    last: int,
) -> bool:
    """Add to the products of the groups of many points what a strip makes of them; False where a pair is not stored."""
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
            panel = np.empty(width * (size - begin[slot]))
            fetch_panel(values, begin, slot, slots, starts, panel)
            multiply_panel(panel, width, store.couplings, products, base, size, 3 * points, begin[slot])
    return True


@compile_kernel
def fetch_panel(
    values: FloatArray, begin: IntArray, slot: int, slots: int, starts: IntArray, panel: FloatArray
) -> None:
    """Copy the blocks of a column, which start at ``starts``, transposed, to (w, length).

    Multiples of three, as positions and attitudes are, are written out: a loop over three is mostly overhead.
    """
    width, length = begin[slot + 1] - begin[slot], begin[slots] - begin[slot]
    column = panel[: width * length].reshape((width, length))
    for other in range(slot, slots):
        place = starts[other - slot]
        low, high = begin[other] - begin[slot], begin[other + 1] - begin[slot]
        if width % 3 == 0:
            for i in range(low, high):
                for j in range(0, width, 3):
                    column[j, i] = values[place]
                    column[j + 1, i] = values[place + 1]
                    column[j + 2, i] = values[place + 2]
                    place += 3
        else:
            for i in range(low, high):
                for j in range(width):
                    column[j, i] = values[place + j]
                place += width


@compile_kernel
def multiply_panel(
    panel: FloatArray,
    width: int,
    couplings: FloatArray,
    products: FloatArray,
    base: int,
    size: int,
    rows: int,
    first: int,
) -> None:
    """Add to the products of a group what a block column and its mirror image make of its couplings."""
    E = couplings[base : base + rows * size].reshape((rows, size))
    H = products[base : base + rows * size].reshape((rows, size))
    column = panel[: width * (size - first)].reshape((width, size - first))
    multiply(column, E[:, first:], H[:, first:])


@compile_kernel
def multiply(column: FloatArray, E: FloatArray, H: FloatArray) -> None:
    """Add to H what a block column (w, length) of the lower triangle and its mirror image make of E."""
    width = column.shape[0]
    whole = width - width % 3
    for q in range(E.shape[0]):
        source, target = E[q], H[q]
        for j in range(width):
            for i in range(width):
                target[j] += column[j, i] * source[i]
        below, beneath = source[width:], target[width:]
        for j in range(0, whole, 3):
            a, b, c = column[j, width:], column[j + 1, width:], column[j + 2, width:]
            of_a, of_b, of_c = 0.0, 0.0, 0.0
            x, y, z = source[j], source[j + 1], source[j + 2]
            for i in range(below.size):
                of_a += a[i] * below[i]
                of_b += b[i] * below[i]
                of_c += c[i] * below[i]
                beneath[i] += x * a[i] + y * b[i] + z * c[i]
            target[j] += of_a
            target[j + 1] += of_b
            target[j + 2] += of_c
        for j in range(whole, width):
            row, total = column[j, width:], 0.0
            for i in range(below.size):
                total += row[i] * below[i]
                beneath[i] += row[i] * source[j]
            target[j] += total


@compile_kernel
def finish(
    by_point: FloatArray,
    by_others: FloatArray,
    frame: IntArray,
    pointers: IntArray,
    order: IntArray,
    runs: Runs,
    met: Met,
    clique: Clique,
    of_frame: FloatArray,
    store: Store,
    groups: int,
    products: FloatArray,
    of_points: FloatArray,
    of_rays: FloatArray,
    shares: FloatArray,
) -> None:
    """Set the cofactors of the stored points, in this order, and of their rays.

    ``of_points`` holds N_pp⁻¹ on entry.
    """
    done, at, flat, frames, width = 0, 0, by_others.reshape(-1), of_frame.reshape(-1), by_others.shape[2]
    forms = np.empty(ROOM_FOR_FORMS)
    for g in range(groups):
        p = order[done]
        size = clique.begin[merge(frame, pointers[p], pointers[p + 1], runs, met, clique)]
        for k in range(done, done + store.points[g]):
            p = order[k]
            add_products(store.couplings, products, at, size, of_points[p])
            cofactors_of_rays(
                by_point,
                flat,
                width,
                frame,
                pointers[p],
                pointers[p + 1],
                runs,
                clique.local,
                frames,
                products,
                at,
                size,
                of_points[p],
                forms,
                of_rays,
                shares,
            )
            at += 3 * size
        done += store.points[g]


@compile_inline
def add_products(E: FloatArray, H: FloatArray, first: int, size: int, Q: FloatArray) -> None:
    """Add EᵀH of one point, (3, size) both from ``first`` on, to its cofactors (3, 3)."""
    for i in range(3):
        for j in range(i + 1):
            one, other, total = first + i * size, first + j * size, 0.0
            for m in range(size):
                total += E[one + m] * H[other + m]
            Q[i, j] += total
            Q[j, i] = Q[i, j]


@compile_kernel
def cofactors(
    by_point: FloatArray,
    by_others: FloatArray,
    frame: IntArray,
    columns: IntArray,
    pointers: IntArray,
    pattern: Pattern,
    values: FloatArray,
    of_points: FloatArray,
    of_rays: FloatArray,
    shares: FloatArray,
) -> bool:
    """Set Q_pp (p, 3, 3), cofactors (n, 2, 2) and shares (n, 2); return False where a pair of blocks is not stored."""
    keys = np.empty(pointers.size - 1, dtype=np.int64)
    runs, met = runs_of_frames(columns, pattern)
    rays, most_runs, most, room = survey(frame, pointers, runs, met, keys)
    clique = room_for_clique(rays, most_runs, most, met)
    of_frame = np.empty((columns.shape[0], columns.shape[1], columns.shape[1]))
    if not gather_frames(columns, pattern, values, of_frame):
        return False
    factor = np.empty(by_point.shape)
    invert_points(by_point, pointers, factor, of_points)
    store = store_for(max(min(LARGEST_STORE, 3 * keys.size * room), 3 * room))
    products = np.empty(store.couplings.size)
    order, done = grouped(keys), NONE
    while done < order.size:
        last, groups = fill_store(
            store, NONE, order, done, factor, by_others, frame, pointers, runs, met, clique, room
        )
        if not multiply_by_inverse(store, groups, met, pattern, values, products):
            return False
        finish(
            by_point,
            by_others,
            frame,
            pointers,
            order[done:last],
            runs,
            met,
            clique,
            of_frame,
            store,
            groups,
            products,
            of_points,
            of_rays,
            shares,
        )
        done = last
    return True
