"""Kernels of the cofactors of points and rays, from the selected inverse Q_cc of the reduced system.

With E = W N_pp⁻¹ and H = Q_cc E, for one point,

    Q_pp = N_pp⁻¹ + Eᵀ H,        Q_cp = −H.
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.compiled import compile_kernel
from mor.adjustment.compiled.cliques import (
    Clique,
    Pattern,
    grouped,
    merge,
    places_of_ray,
    same_columns,
    starts_of_column,
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
    store: Store, groups: int, pattern: Pattern, values: FloatArray, products: FloatArray
) -> bool:
    """Set the products H = Q_cc E, laid out as the couplings E; return False where a pair is not stored."""
    _, offsets, indptr, _, position = pattern
    for k in range(store.first_coupling[groups]):
        products[k] = 0.0
    panel, starts = np.empty(16), np.empty(indptr.size - 1, dtype=np.int64)
    first = 0
    while first < indptr.size - 1:
        last = end_of_strip(first, indptr, position)
        for g in range(groups):
            part = slice(store.first_block[g], store.first_block[g + 1])
            blocks, begin = store.blocks[part], store.begin[part]
            low, high = slots_in_strip(blocks, first, last)
            if low == high:
                continue
            of_group = slice(store.first_coupling[g], store.first_coupling[g + 1])
            shape = (3 * store.points[g], (of_group.stop - of_group.start) // (3 * store.points[g]))
            E, H = store.couplings[of_group].reshape(shape), products[of_group].reshape(shape)
            for slot in range(low, high):
                width = offsets[blocks[slot] + 1] - offsets[blocks[slot]]
                length = shape[1] - begin[slot]
                if panel.size < width * length:
                    panel = np.empty(2 * width * length)
                column = panel[: width * length].reshape((width, length))
                if not fetch_column(values, blocks[slot:], begin[slot:], pattern, starts, column):
                    return False
                multiply(column, E[:, begin[slot] :], H[:, begin[slot] :])
        first = last
    return True


@compile_kernel
def fetch_column(
    values: FloatArray,
    blocks: IntArray,
    begin: IntArray,
    pattern: Pattern,
    starts: IntArray,
    column: FloatArray,
) -> bool:
    """Copy the blocks of the column ``blocks[0]``, transposed, to (w, length); False where one is not stored.

    Multiples of three, as positions and attitudes are, are written out: a loop over three is mostly overhead.
    """
    _, _, indptr, indices, position = pattern
    width = column.shape[0]
    if not starts_of_column(blocks, indptr, indices, position, starts):
        return False
    for slot in range(blocks.size):
        place = starts[slot]
        low = begin[slot] - begin[0]
        high = begin[slot + 1] - begin[0] if slot + 1 < blocks.size else column.shape[1]
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
    return True


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
def gather_rays(columns: IntArray, pattern: Pattern, values: FloatArray, of_ray: FloatArray) -> bool:
    """Set the part (K, K) of Q_cc for the columns (r, K) of each ray, folded into its lower triangle.

    What stands off the diagonal is doubled, so that quadratic forms come out right. Returns False where a
    pair is not stored.
    """
    width = columns.shape[1]
    starts, places = np.empty(width, dtype=np.int64), np.empty((width, width), dtype=np.int64)
    for i in range(columns.shape[0]):
        clear(of_ray[i])
        if not places_of_ray(columns[i], pattern, starts, places):
            return False
        for k in range(width):
            for m in range(width):
                place = places[k, m]
                if place >= 0:
                    factor = 2.0 if places[m, k] < 0 else 1.0
                    of_ray[i, max(k, m), min(k, m)] += factor * values[place]
    return True


@compile_kernel
def cofactors_of_rays(
    by_point: FloatArray,
    by_others: FloatArray,
    local: IntArray,
    of_ray: FloatArray,
    H: FloatArray,
    Q: FloatArray,
    of_rays: FloatArray,
) -> None:
    """Set the variances (r, 2) of the computed values of the rays of one point with Q_pp = Q."""
    for i in range(by_point.shape[0]):
        first, second, a, b = by_others[i, 0], by_others[i, 1], by_point[i, 0], by_point[i, 1]
        of_first, of_second = 0.0, 0.0
        for d in range(3):
            of_first += a[d] * (Q[d, 0] * a[0] + Q[d, 1] * a[1] + Q[d, 2] * a[2])
            of_second += b[d] * (Q[d, 0] * b[0] + Q[d, 1] * b[1] + Q[d, 2] * b[2])
        for k in range(first.size):
            at = local[i, k]
            if at < 0:
                continue
            row = of_ray[i, k]
            x, y = 0.0, 0.0
            for m in range(k + 1):
                x += row[m] * first[m]
                y += row[m] * second[m]
            x -= 2.0 * (H[0, at] * a[0] + H[1, at] * a[1] + H[2, at] * a[2])
            y -= 2.0 * (H[0, at] * b[0] + H[1, at] * b[1] + H[2, at] * b[2])
            of_first += first[k] * x
            of_second += second[k] * y
        of_rays[i, 0] = of_first
        of_rays[i, 1] = of_second


@compile_kernel
def finish(
    by_point: FloatArray,
    by_others: FloatArray,
    columns: IntArray,
    pointers: IntArray,
    order: IntArray,
    pattern: Pattern,
    clique: Clique,
    values: FloatArray,
    store: Store,
    groups: int,
    products: FloatArray,
    of_points: FloatArray,
    of_rays: FloatArray,
) -> bool:
    """Set the cofactors of the stored points, in this order, and of their rays; False where a pair is not
    stored.

    ``of_points`` holds N_pp⁻¹ on entry.
    """
    if not multiply_by_inverse(store, groups, pattern, values, products):
        return False
    of_ray = np.empty((clique.local.shape[0], columns.shape[1], columns.shape[1]))
    done, at = 0, 0
    for g in range(groups):
        p = order[done]
        shared = columns[pointers[p] : pointers[p + 1]]
        size = clique.begin[merge(shared, pattern, clique)]
        if not gather_rays(shared, pattern, values, of_ray):
            return False
        for p in order[done : done + store.points[g]]:
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
            part = slice(pointers[p], pointers[p + 1])
            cofactors_of_rays(by_point[part], by_others[part], clique.local, of_ray, H, Q, of_rays[part])
        done += store.points[g]
    return True


@compile_kernel
def cofactors(
    by_point: FloatArray,
    by_others: FloatArray,
    columns: IntArray,
    pointers: IntArray,
    pattern: Pattern,
    values: FloatArray,
    of_points: FloatArray,
    of_rays: FloatArray,
) -> bool:
    """Set Q_pp (p, 3, 3) and the variances (n, 2); return False where a pair of blocks is not stored."""
    keys = np.empty(pointers.size - 1, dtype=np.int64)
    rays, most, room = survey(columns, pointers, pattern, keys)
    unseen = np.full(pattern.offsets.size - 1, -1, dtype=np.int64)
    begin, local = np.empty(most + 1, dtype=np.int64), np.empty((rays, columns.shape[1]), dtype=np.int64)
    clique = Clique(np.empty(most, dtype=np.int64), begin, local, unseen)
    store = empty_store(keys.size, room)
    products = np.empty(store.couplings.size)
    nothing = np.zeros((rays, 2))
    L, inverse, u = np.empty((3, 3)), np.empty(3), np.empty(3)
    order = grouped(keys)
    groups, count, first, before = 0, 0, 0, -1
    for k in range(order.size + 1):
        full = k == order.size or store.first_coupling[groups] + 3 * room > store.couplings.size
        if full and k > first:
            if not finish(
                by_point,
                by_others,
                columns,
                pointers,
                order[first:k],
                pattern,
                clique,
                values,
                store,
                groups,
                products,
                of_points,
                of_rays,
            ):
                return False
            groups, first = 0, k
        if k == order.size:
            break
        p = order[k]
        part = slice(pointers[p], pointers[p + 1])
        if full or before < 0 or not same_columns(columns, pointers, p, before):
            count = merge(columns[part], pattern, clique)
            open_group(store, groups, clique, count)
            groups += 1
        before = p
        factor_point(by_point[part], nothing, 0.0, L, inverse, u)
        inverse_of_point(L, inverse, of_points[p])
        E = append_point(store, groups, begin[count])
        couple(by_point[part], by_others[part], local, L, inverse, E)
        solve_from_the_right(E, L, inverse)
    return True
