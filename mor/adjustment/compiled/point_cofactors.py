"""Kernels of the cofactors of points, from the selected inverse Q_cc of the reduced system.

With E = W N_pp⁻¹ and H = Q_cc E, for one point,

    Q_pp = N_pp⁻¹ + Eᵀ H,        Q_cp = −H.
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.compiled import compile_kernel
from mor.adjustment.compiled.cliques import (
    NONE,
    Clique,
    Met,
    Pattern,
    Runs,
    grouped,
    look_up_pairs,
    merge,
    runs_of_frames,
    same_frames,
    survey,
)
from mor.adjustment.compiled.point_products import FEW_POINTS
from mor.adjustment.compiled.point_store import (
    Store,
    append_point,
    empty_store,
    end_of_strip,
    open_group,
    slots_in_strip,
)
from mor.adjustment.compiled.points import couple, factor_point
from mor.adjustment.compiled.ray_cofactors import cofactors_of_rays, gather_frames
from mor.adjustment.compiled.strips import multiply_column_of_point
from mor.geometry.arrays import FloatArray, IntArray


@compile_kernel
def solve_from_the_right(V: FloatArray, L: FloatArray, inverse: FloatArray) -> None:
    """Replace V, transposed (3, m), by V L⁻¹."""
    for m in range(V.shape[1]):
        third = V[2, m] * inverse[2]
        second = (V[1, m] - L[2, 1] * third) * inverse[1]
        V[2, m] = third
        V[1, m] = second
        V[0, m] = (V[0, m] - L[1, 0] * second - L[2, 0] * third) * inverse[0]


@compile_kernel
def inverse_of_point(L: FloatArray, inverse: FloatArray, N: FloatArray) -> None:
    """Set N = L⁻ᵀ L⁻¹."""
    root = np.zeros((3, 3))  # L⁻¹
    for j in range(3):
        root[j, j] = inverse[j]
        for i in range(j + 1, 3):
            for k in range(j, i):
                root[i, j] -= L[i, k] * root[k, j]
            root[i, j] *= inverse[i]
    for i in range(3):
        for j in range(3):
            N[i, j] = root[0, i] * root[0, j] + root[1, i] * root[1, j] + root[2, i] * root[2, j]


@compile_kernel
def multiply_by_inverse(
    store: Store, groups: int, met: Met, values: FloatArray, products: FloatArray
) -> None:
    """Set the products H = Q_cc E, laid out as the couplings E, strip by strip."""
    for k in range(store.first_coupling[groups]):
        products[k] = 0.0
    first = NONE
    while first < met.size.size:
        last = end_of_strip(first, met.size)
        multiply_point_by_point(store, groups, met, values, products, first, last)
        multiply_by_panels(store, groups, met, values, products, first, last)
        first = last


@compile_kernel
def multiply_point_by_point(
    store: Store, groups: int, met: Met, values: FloatArray, products: FloatArray, first: int, last: int
) -> None:
    """Add to the products of the groups of few points what a strip makes of their couplings."""
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
                multiply_column_of_point(
                    values, starts, width, couplings, products, base + 3 * q * size, begin, slot, slots
                )


@compile_kernel
def multiply_by_panels(
    store: Store, groups: int, met: Met, values: FloatArray, products: FloatArray, first: int, last: int
) -> None:
    """Add to the products of the groups of many points what a strip makes of their couplings."""
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
            width = begin[slot + 1] - begin[slot]
            panel = np.empty(width * (size - begin[slot]))
            fetch_panel(values, begin, slot, slots, starts, panel)
            multiply_panel(panel, width, store.couplings, products, base, size, 3 * points, begin[slot])


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
    values: FloatArray,
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
    multiply_by_inverse(store, groups, met, values, products)
    done, at = 0, 0
    for g in range(groups):
        p = order[done]
        size = clique.begin[merge(frame, pointers[p], pointers[p + 1], runs, met, clique)]
        for k in range(done, done + store.points[g]):
            p = order[k]
            E = store.couplings[at : at + 3 * size].reshape((3, size))
            H = products[at : at + 3 * size].reshape((3, size))
            at += 3 * size
            Q = of_points[p]
            for i in range(3):
                for j in range(i + 1):
                    total = 0.0
                    for m in range(size):
                        total += E[i, m] * H[j, m]
                    Q[i, j] += total
                    Q[j, i] = Q[i, j]
            cofactors_of_rays(
                by_point,
                by_others,
                frame,
                pointers[p],
                pointers[p + 1],
                runs,
                clique.local,
                of_frame,
                H,
                Q,
                of_rays,
                shares,
            )
        done += store.points[g]


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
    unseen = np.full(met.size.size, -1, dtype=np.int64)
    begin, local = np.empty(most + 1, dtype=np.int64), np.empty((rays, most_runs), dtype=np.int64)
    clique = Clique(np.empty(most, dtype=np.int64), begin, local, unseen)
    of_frame = np.empty((columns.shape[0], columns.shape[1], columns.shape[1]))
    if not gather_frames(columns, pattern, values, of_frame):
        return False
    store = empty_store(keys.size, room)
    products = np.empty(store.couplings.size)
    nothing = np.zeros((by_point.shape[0], 2))
    L, inverse, u, gradient = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    order = grouped(keys)
    groups, count, done, before, stored = NONE, NONE, NONE, -1, True
    for k in range(order.size + 1):
        full = k == order.size or store.first_coupling[groups] + 3 * room > store.couplings.size
        if full and k > done and not stored:
            return False
        if full and k > done:
            finish(
                by_point,
                by_others,
                frame,
                pointers,
                order[done:k],
                runs,
                met,
                clique,
                values,
                of_frame,
                store,
                groups,
                products,
                of_points,
                of_rays,
                shares,
            )
            groups, done = NONE, k
        if k == order.size:
            break
        p = order[k]
        first, end = pointers[p], pointers[p + 1]
        if full or before < 0 or not same_frames(frame, pointers, p, before):
            count = merge(frame, first, end, runs, met, clique)
            stored = look_up_pairs(clique.blocks, count, met, pattern) and stored
            open_group(store, groups, clique, count)
            groups += 1
        before = p
        factor_point(by_point, nothing, first, end, 0.0, L, inverse, u, gradient)
        inverse_of_point(L, inverse, of_points[p])
        base = append_point(store, groups, begin[count])
        E = store.couplings[base : base + 3 * begin[count]].reshape((3, begin[count]))
        couple(by_point, by_others, frame, first, end, runs, local, L, inverse, E)
        solve_from_the_right(E, L, inverse)
    return stored
