"""Kernels of the cofactors of points, from the selected inverse Q_cc of the reduced system.

With the coupling E = Σ jᵀa N_pp⁻¹ of one point, H = Q_cc E, and Q_pp = N_pp⁻¹ + Eᵀ H, Q_cp = −H. What is common to all
frames is taken out of Q_cc before (``common_columns``): it is coupled like all else, by j W, and multiplied by nothing.
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
    pairs_of_columns,
    room_for_clique,
    runs_of_frames,
    same_frames,
    survey,
)
from mor.adjustment.rays.compiled.cofactor_blocks import multiply_block
from mor.adjustment.rays.compiled.common_columns import gather_frames
from mor.adjustment.rays.compiled.couplings import couple_fours
from mor.adjustment.rays.compiled.pieces import end_of_piece, largest_piece
from mor.adjustment.rays.compiled.point_store import (
    AHEAD,
    Store,
    append_point,
    end_in_strip,
    end_of_strip,
    fetch_block,
    open_group,
    room_for_pairs,
    store_for,
)
from mor.adjustment.rays.compiled.points import invert_points
from mor.adjustment.rays.compiled.ray_cofactors import (
    cofactors_of_point,
    cofactors_of_rays,
    forms_of_rays,
)
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_kernel

FEW_RAYS, MANY_RAYS = 1024, 16_384
"""Rays of a batch: so few that all there is of them stays in the cache, or so many that a large R is seldom fetched."""

NUMBERS_OF_A_STRIP = 1_000_000
"""Numbers in a strip of columns of R, 8 MB."""


@compile_kernel
def cofactors(
    by_point: FloatArray,
    by_others: FloatArray,
    frame: IntArray,
    columns: IntArray,
    pointers: IntArray,
    own: int,
    pattern: Pattern,
    rest: FloatArray,
    by_common: FloatArray,
    of_points: FloatArray,
    of_rays: FloatArray,
    shares: FloatArray,
) -> bool:
    """Set Q_pp (p, 3, 3), cofactors (n, 2, 2) and shares (n, 2); return False where a pair of blocks is not stored.

    All columns from ``own`` on are common; R and W are those of ``common_columns``.
    """
    (frames, width), z = columns.shape, by_common.shape[1]
    folded, rows = np.empty((frames, own + -own % 4, own + -own % 4)), np.empty((frames, width, z))
    if not gather_frames(columns, own, pattern, rest, by_common, folded, rows):
        return False
    runs, met = runs_of_frames(np.ascontiguousarray(columns[:, :own]), pattern)
    most = rays_of_a_batch(met)
    room = largest_piece(pointers, most)
    forms, shared = np.empty((room, 3)), np.empty((room, 2, z))
    factor, moved = np.empty((room, 2, 4)), np.empty((room, 2, 4))
    store = store_for(numbers_of_store(runs, met, room, z))
    H, first = np.empty(store.couplings.size), NONE
    while first < pointers.size - 1:
        last = end_of_piece(pointers, first, most)
        begin, end = pointers[first], pointers[last]
        rays, points = pointers[first : last + 1] - begin, of_points[first:last]
        by_these, by_other, of_frame = by_point[begin:end], by_others[begin:end], frame[begin:end]
        forms_of_rays(by_other, of_frame, folded, rows, forms, shared)
        invert_points(by_these, rays, factor, points)
        arrays = factor, by_other, shared, of_frame, rays
        if not cofactors_of_points(*arrays, runs, met, pattern, rest, store, H, moved, points):
            return False
        cofactors_of_rays(by_these, rays, points, forms, moved, of_rays[begin:end], shares[begin:end])
        first = last
    return True


@compile_kernel
def rays_of_a_batch(met: Met) -> int:
    """Return how many rays are worked on together: the more, the larger R is."""
    unknowns = met.size.sum()
    return int(max(FEW_RAYS, min(unknowns * unknowns // 256, MANY_RAYS)))


@compile_kernel
def numbers_of_store(runs: Runs, met: Met, rays: int, z: int) -> int:
    """Return what the couplings of so many rays take at most."""
    largest = 0
    for f in range(runs.pointers.size - 1):
        unknowns = 0
        for t in range(runs.pointers[f], runs.pointers[f + 1]):
            unknowns += met.size[runs.block[t]]
        largest = max(largest, unknowns)
    return 4 * rays * (largest + z)


@compile_kernel
def cofactors_of_points(
    factor: FloatArray,
    by_others: FloatArray,
    shared: FloatArray,
    frame: IntArray,
    pointers: IntArray,
    runs: Runs,
    met: Met,
    pattern: Pattern,
    rest: FloatArray,
    store: Store,
    H: FloatArray,
    moved: FloatArray,
    of_points: FloatArray,
) -> bool:
    """Make Q_pp (p, 3, 3) of N_pp⁻¹, and set j H of all rays as ``moved`` (n, 2, 4).

    Returns False where a pair of blocks is not stored.
    """
    keys = np.empty(pointers.size - 1, dtype=np.int64)
    rays, most_runs, most, _ = survey(frame, pointers, runs, met, keys)
    clique, order = room_for_clique(rays, most_runs, most, met), grouped(keys)
    arrays = factor, by_others, shared, frame, pointers, order, runs, met, clique, store
    groups = fill_store(*arrays)
    if not multiply_by_inverse(store, groups, met, pattern, rest, H, shared.shape[2]):
        return False
    finish(*arrays, groups, H, moved, of_points)
    return True


@compile_kernel
def fill_store(
    factor: FloatArray,
    by_others: FloatArray,
    shared: FloatArray,
    frame: IntArray,
    pointers: IntArray,
    order: IntArray,
    runs: Runs,
    met: Met,
    clique: Clique,
    store: Store,
) -> int:
    """Store the couplings E = Σ jᵀ factor of points in this order; return the number of groups of points."""
    flat, factors, width = by_others.reshape(-1), factor.reshape(-1), by_others.shape[2]
    common, z = shared.reshape(-1), shared.shape[2]
    before, size, groups, local, E = -1, 0, NONE, clique.local, store.couplings
    for p in order:
        first, end = pointers[p], pointers[p + 1]
        if before < 0 or not same_frames(frame, pointers, p, before):
            size = open_group(store, groups, frame, first, end, runs, met, clique)
            groups += 1
        base = append_point(store, groups, 4 * (size + z))
        couple_fours(factors, flat, width, frame, first, end, runs, local, common, z, E, base, size)
        before = p
    return groups


@compile_kernel
def multiply_by_inverse(
    store: Store, groups: int, met: Met, pattern: Pattern, rest: FloatArray, H: FloatArray, z: int
) -> bool:
    """Set the products H = R E of the stored couplings, strip by strip; return False where a pair is not stored."""
    for k in range(store.first_coupling[groups]):
        H[k] = 0.0
    pairs = room_for_pairs(store, groups)
    first, reached = NONE, np.zeros(groups, dtype=np.int64)
    while first < met.size.size:
        last = end_of_strip(first, met.size, NUMBERS_OF_A_STRIP)
        if not multiply_by_strip(store, groups, met, pattern, rest, H, z, last, reached, pairs):
            return False
        first = last
    return True


@compile_kernel
def multiply_by_strip(
    store: Store,
    groups: int,
    met: Met,
    pattern: Pattern,
    rest: FloatArray,
    H: FloatArray,
    z: int,
    last: int,
    reached: IntArray,
    pairs: IntArray,
) -> bool:
    """Add to the products what a strip that ends before the block ``last`` makes of the couplings.

    ``reached`` (groups,) counts the blocks of each group that are done; ``pairs`` is working space. Returns False where
    a pair is not stored.
    """
    E = store.couplings
    for g in range(groups):
        block, end, points = store.first_block[g], store.first_block[g + 1], store.points[g]
        low, high = reached[g], end_in_strip(store.blocks, block + reached[g], end, last) - block
        reached[g] = high
        blocks, begin = store.blocks[block:end], store.begin[block + g : end + g + 1]
        count = pairs_of_columns(blocks, low, high, met, pattern, pairs)
        if count < 0:
            return False
        at, size = store.first_coupling[g], 4 * (begin[end - block] + z)
        for _ in range(points):
            for k in range(count):
                fetch_block(rest, pairs[min(k + AHEAD, count - 1), 0])
                start, row, column = pairs[k, 0], pairs[k, 1], pairs[k, 2]
                width = begin[column + 1] - begin[column]
                one, two, three = at + 4 * begin[row], at + 4 * begin[row + 1], at + 4 * begin[column]
                multiply_block(rest, start, width, E, H, one, two, three)
            at += size
    return True


@compile_kernel
def finish(
    factor: FloatArray,
    by_others: FloatArray,
    shared: FloatArray,
    frame: IntArray,
    pointers: IntArray,
    order: IntArray,
    runs: Runs,
    met: Met,
    clique: Clique,
    store: Store,
    groups: int,
    H: FloatArray,
    moved: FloatArray,
    of_points: FloatArray,
) -> None:
    """Do with the stored points, in this order, what ``cofactors_of_points`` does, from their products H."""
    flat, factors, products, width = (
        by_others.reshape(-1),
        factor.reshape(-1),
        moved.reshape(-1),
        by_others.shape[2],
    )
    common, z, E = shared.reshape(-1), shared.shape[2], store.couplings
    done, at, sums, local = 0, 0, np.empty(12), clique.local
    for g in range(groups):
        p = order[done]
        size = clique.begin[merge(frame, pointers[p], pointers[p + 1], runs, met, clique)]
        for k in range(done, done + store.points[g]):
            p = order[k]
            first, end = pointers[p], pointers[p + 1]
            cofactors_of_point(
                factors,
                flat,
                width,
                frame,
                first,
                end,
                runs,
                local,
                common,
                z,
                E,
                H,
                at,
                size,
                products,
                sums,
                of_points[p],
            )
            at += 4 * (size + z)
        done += store.points[g]
