"""Kernels that add what eliminated points leave to the reduced system.

S += Σ jᵀj − V Vᵀ,        b −= Σ jᵀ residual + V u
"""

from __future__ import annotations

from typing import NamedTuple

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
from mor.geometry.arrays import BoolArray, FloatArray, IntArray


class Rest(NamedTuple):
    """What the rays of one group leave beside the products of their couplings.

    Attributes:
        squares: (rays, K, K) lower triangle of Σ jᵀj.
        gradient: (rays, K) −Σ jᵀ residual.
        reduction: (m,) Σ V u.
    """

    squares: FloatArray
    gradient: FloatArray
    reduction: FloatArray


@compile_kernel
def add_rest(residual: FloatArray, by_others: FloatArray, V: FloatArray, u: FloatArray, rest: Rest) -> None:
    """Add the squares and gradients of the rays of one point to those of its group."""
    squares, gradient, reduction = rest
    for i in range(by_others.shape[0]):
        first, second = by_others[i, 0], by_others[i, 1]
        r, s = residual[i, 0], residual[i, 1]
        for k in range(first.size):
            gradient[i, k] -= first[k] * r + second[k] * s
        add_square(first, second, squares[i])
    one, two, three = V[0], V[1], V[2]
    for m in range(one.size):
        reduction[m] += u[0] * one[m] + u[1] * two[m] + u[2] * three[m]


@compile_kernel
def add_square(first: FloatArray, second: FloatArray, square: FloatArray) -> None:
    """Add the products of two Jacobian rows with themselves, (K, K), four rows at a time.

    Only what stands left of the diagonal, or in the diagonal blocks of four, is set.
    """
    width = first.size
    whole = width - width % 4
    for k in range(0, whole, 4):
        a, b, c, d = square[k], square[k + 1], square[k + 2], square[k + 3]
        ax, bx, cx, dx = first[k], first[k + 1], first[k + 2], first[k + 3]
        ay, by, cy, dy = second[k], second[k + 1], second[k + 2], second[k + 3]
        for m in range(k + 4):
            a[m] += ax * first[m] + ay * second[m]
            b[m] += bx * first[m] + by * second[m]
            c[m] += cx * first[m] + cy * second[m]
            d[m] += dx * first[m] + dy * second[m]
    for k in range(whole, width):
        for m in range(k + 1):
            square[k, m] += first[k] * first[m] + second[k] * second[m]


@compile_kernel
def carry_rest(
    columns: IntArray,
    pattern: Pattern,
    clique: Clique,
    count: int,
    rest: Rest,
    values: FloatArray,
    right_hand_side: FloatArray,
    diagonal: FloatArray,
) -> bool:
    """Add what a group with these columns (r, K) left to the reduced system; False where a pair is not stored."""
    squares, gradient, reduction = rest
    width = columns.shape[1]
    starts, places = np.empty(width, dtype=np.int64), np.empty((width, width), dtype=np.int64)
    for i in range(columns.shape[0]):
        if not places_of_ray(columns[i], pattern, starts, places):
            return False
        for k in range(width):
            if columns[i, k] >= 0:
                right_hand_side[columns[i, k]] += gradient[i, k]
                diagonal[columns[i, k]] += squares[i, k, k]
            for m in range(width):
                if places[k, m] >= 0:
                    values[places[k, m]] += squares[i, max(k, m), min(k, m)]
    for slot in range(count):
        shift = pattern.offsets[clique.blocks[slot]] - clique.begin[slot]
        for m in range(clique.begin[slot], clique.begin[slot + 1]):
            right_hand_side[shift + m] -= reduction[m]
    for i in range(columns.shape[0]):
        clear(squares[i])
    clear(gradient)
    for m in range(clique.begin[count]):
        reduction[m] = 0.0
    return True


@compile_kernel
def subtract_products(store: Store, groups: int, pattern: Pattern, values: FloatArray) -> bool:
    """Subtract V Vᵀ of all groups from the reduced matrix; return False where a pair is not stored."""
    _, offsets, indptr, _, position = pattern
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
            V = store.couplings[store.first_coupling[g] : store.first_coupling[g + 1]]
            V = V.reshape((3 * store.points[g], V.size // (3 * store.points[g])))
            for slot in range(low, high):
                width = offsets[blocks[slot] + 1] - offsets[blocks[slot]]
                length = V.shape[1] - begin[slot]
                if panel.size < width * length:
                    panel = np.empty(2 * width * length)
                product = panel[: width * length].reshape((width, length))
                multiply(V, begin[slot], product)
                if not subtract_column(product, blocks[slot:], begin[slot:], pattern, starts, values):
                    return False
        first = last
    return True


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
def subtract_column(
    product: FloatArray,
    blocks: IntArray,
    begin: IntArray,
    pattern: Pattern,
    starts: IntArray,
    values: FloatArray,
) -> bool:
    """Subtract a product from the blocks of the column ``blocks[0]``; False where one is not stored.

    Multiples of three, as positions and attitudes are, are written out: a loop over three is mostly overhead.
    """
    _, _, indptr, indices, position = pattern
    width = product.shape[0]
    if not starts_of_column(blocks, indptr, indices, position, starts):
        return False
    for slot in range(blocks.size):
        place = starts[slot]
        low = begin[slot] - begin[0]
        high = begin[slot + 1] - begin[0] if slot + 1 < blocks.size else product.shape[1]
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
    return True


@compile_kernel
def accumulate(
    residual: FloatArray,
    by_point: FloatArray,
    by_others: FloatArray,
    columns: IntArray,
    pointers: IntArray,
    damping: float,
    pattern: Pattern,
    values: FloatArray,
    right_hand_side: FloatArray,
    diagonal: FloatArray,
    held: BoolArray,
) -> bool:
    """Add the points to the reduced system; return False where a pair of blocks is not stored."""
    keys = np.empty(pointers.size - 1, dtype=np.int64)
    rays, most, room = survey(columns, pointers, pattern, keys)
    K = columns.shape[1]
    unseen = np.full(pattern.offsets.size - 1, -1, dtype=np.int64)
    begin, local = np.empty(most + 1, dtype=np.int64), np.empty((rays, K), dtype=np.int64)
    clique = Clique(np.empty(most, dtype=np.int64), begin, local, unseen)
    rest = Rest(np.zeros((rays, K, K)), np.zeros((rays, K)), np.zeros(room))
    store = empty_store(keys.size, room)
    L, inverse, u = np.empty((3, 3)), np.empty(3), np.empty(3)
    groups, count, before = 0, 0, -1
    for p in grouped(keys):
        part = slice(pointers[p], pointers[p + 1])
        full = store.first_coupling[groups] + 3 * room > store.couplings.size
        if full or before < 0 or not same_columns(columns, pointers, p, before):
            if before >= 0:
                shared = columns[pointers[before] : pointers[before + 1]]
                if not carry_rest(shared, pattern, clique, count, rest, values, right_hand_side, diagonal):
                    return False
            if full:
                if not subtract_products(store, groups, pattern, values):
                    return False
                groups = 0
            count = merge(columns[part], pattern, clique)
            open_group(store, groups, clique, count)
            groups += 1
        before = p
        factor_point(by_point[part], residual[part], damping, L, inverse, u)
        for j in range(3):
            held[p, j] = inverse[j] == 0.0
        V = append_point(store, groups, begin[count])
        couple(by_point[part], by_others[part], local, L, inverse, V)
        add_rest(residual[part], by_others[part], V, u, rest)
    if before < 0:
        return True
    shared = columns[pointers[before] : pointers[before + 1]]
    stored = carry_rest(shared, pattern, clique, count, rest, values, right_hand_side, diagonal)
    return stored and subtract_products(store, groups, pattern, values)
