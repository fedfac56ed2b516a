"""Kernels of the cofactors of points, from the selected inverse Q_cc of the reduced system.

With E = W N_pp⁻¹ and H = Q_cc E, for one point,

    Q_pp = N_pp⁻¹ + Eᵀ H,        Q_cp = −H.
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.rays.compiled.cliques import (
    NONE,
    Clique,
    Met,
    Pattern,
    Runs,
    grouped,
    merge,
    room_for_clique,
    runs_of_frames,
    starts_of_column,
    survey,
)
from mor.adjustment.rays.compiled.cofactor_strips import multiply_column_of_point
from mor.adjustment.rays.compiled.point_store import (
    Store,
    end_in_strip,
    end_of_strip,
    fill_store,
    size_of_store,
    store_for,
)
from mor.adjustment.rays.compiled.points import invert_points
from mor.adjustment.rays.compiled.ray_cofactors import ROOM_FOR_FORMS, cofactors_of_rays, gather_frames
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_inline, compile_kernel

LARGEST_STORE = 400_000
"""Numbers in a store at most: couplings and products take eight thirds of its room besides, anew for each piece."""


@compile_kernel
def multiply_by_inverse(
    store: Store, groups: int, met: Met, pattern: Pattern, values: FloatArray, E: FloatArray, H: FloatArray
) -> bool:
    """Set the couplings E of the stored points, (m, 4) each, and the products H = Q_cc E, strip by strip.

    Returns False where a pair of blocks is not stored.
    """
    interleave(store, groups, E)
    for k in range(4 * (store.first_coupling[groups] // 3)):
        H[k] = 0.0
    first, reached = NONE, np.zeros(groups, dtype=np.int64)
    while first < met.size.size:
        last = end_of_strip(first, met.size)
        if not multiply_by_strip(store, groups, met, pattern, values, E, H, last, reached):
            return False
        first = last
    return True


@compile_kernel
def interleave(store: Store, groups: int, E: FloatArray) -> None:
    """Copy the couplings (3, m) of the stored points to E, (m, 4) each with a zero behind."""
    for g in range(groups):
        size = store.begin[store.first_block[g + 1] + g]
        for q in range(store.points[g]):
            one = store.first_coupling[g] + 3 * q * size
            two, three, at = one + size, one + 2 * size, 4 * (one // 3)
            for m in range(size):
                E[at + 4 * m] = store.couplings[one + m]
                E[at + 4 * m + 1] = store.couplings[two + m]
                E[at + 4 * m + 2] = store.couplings[three + m]
                E[at + 4 * m + 3] = 0.0


@compile_kernel
def multiply_by_strip(
    store: Store,
    groups: int,
    met: Met,
    pattern: Pattern,
    values: FloatArray,
    E: FloatArray,
    H: FloatArray,
    last: int,
    reached: IntArray,
) -> bool:
    """Add to the products what a strip that ends before the block ``last`` makes of the couplings.

    ``reached`` (groups,) counts the blocks of each group that are done. Returns False where a pair is not stored.
    """
    blocks, all_begin = store.blocks, store.begin
    others, starts = np.empty(met.size.size, dtype=np.int64), np.empty(met.size.size, dtype=np.int64)
    for g in range(groups):
        block, end, points = store.first_block[g], store.first_block[g + 1], store.points[g]
        low, high = reached[g], end_in_strip(blocks, block + reached[g], end, last) - block
        reached[g] = high
        begin = all_begin[block + g : end + g + 1]
        slots = end - block
        base, size = store.first_coupling[g] // 3, begin[slots]
        for slot in range(low, high):
            count = starts_of_column(blocks[block:end], slot, met, pattern, others, starts)
            if count < 0:
                return False
            width = begin[slot + 1] - begin[slot]
            for q in range(points):
                multiply_column_of_point(
                    values, others, starts, count, width, E, H, base + q * size, begin, slot, slots
                )
    return True


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
    E: FloatArray,
    H: FloatArray,
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
            add_products(E, H, at, size, of_points[p])
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
                H,
                at,
                of_points[p],
                forms,
                of_rays,
                shares,
            )
            at += size
        done += store.points[g]


@compile_inline
def add_products(E: FloatArray, H: FloatArray, first: int, size: int, Q: FloatArray) -> None:
    """Add EᵀH of one point, (size, 4) both from the unknown ``first`` on, to its cofactors (3, 3)."""
    n00, n10, n11, n20, n21, n22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for m in range(4 * first, 4 * (first + size), 4):
        x, y, z = H[m], H[m + 1], H[m + 2]
        n00 += E[m] * x
        n10 += E[m + 1] * x
        n11 += E[m + 1] * y
        n20 += E[m + 2] * x
        n21 += E[m + 2] * y
        n22 += E[m + 2] * z
    Q[0, 0] += n00
    Q[1, 1] += n11
    Q[2, 2] += n22
    Q[1, 0] += n10
    Q[2, 0] += n20
    Q[2, 1] += n21
    Q[0, 1], Q[0, 2], Q[1, 2] = Q[1, 0], Q[2, 0], Q[2, 1]


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
    store = store_for(max(size_of_store(met, LARGEST_STORE), 3 * room))
    E, H = np.empty(4 * (store.couplings.size // 3)), np.empty(4 * (store.couplings.size // 3))
    order, done = grouped(keys), NONE
    while done < order.size:
        last, groups = fill_store(
            store, NONE, order, done, factor, by_others, frame, pointers, runs, met, clique, room
        )
        if not multiply_by_inverse(store, groups, met, pattern, values, E, H):
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
            E,
            H,
            of_points,
            of_rays,
            shares,
        )
        done = last
    return True
