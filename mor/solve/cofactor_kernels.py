"""Compiled kernels: cofactors of points and rays."""

from __future__ import annotations

import numpy as np

from mor.linalg.compilation import compile_inline, compile_kernel
from mor.linalg.registers import Four, each, four, put, same, total
from mor.solve.clique_kernels import (
    NONE,
    Clique,
    Met,
    Pattern,
    Runs,
    clear,
    end_of_piece,
    find_start,
    grouped,
    invert_points,
    largest_piece,
    merge,
    pairs_of_columns,
    places_of_frame,
    room_for_clique,
    runs_of_frames,
    same_frames,
    sorted_by_frame,
    survey,
)
from mor.solve.product_kernels import (
    AHEAD,
    Store,
    append_point,
    couple_fours,
    end_in_strip,
    end_of_strip,
    fetch_block,
    open_group,
    room_for_pairs,
    store_for,
)
from mor.types import FloatArray, IntArray

# ---- Kernels that multiply the coupling of a single point with one block of R, and with its mirror image.
#
# A block is worked on in strips of six columns, then two, then single ones; what belongs to the columns stays
# in registers. It begins at ``start`` in the values, row by row, ``width`` numbers in a row. The couplings E
# and the products H are (m, 4), flat, the fourth number zero, so that a number of a block is fetched once,
# and meets the three of the point side by side. Those of the rows are ``first:end``, those of the first
# column of the strip begin at ``at``. Rows and columns may be the same ones.


@compile_inline
def multiply_block(
    values: FloatArray, start: int, width: int, E: FloatArray, H: FloatArray, first: int, end: int, column: int
) -> None:
    """Add to the products what a block, and its mirror image, make of E; those of its columns begin at ``column``."""
    strip = 0
    while width - strip >= 6:
        multiply_six(values, start + strip, width, E, H, first, end, column + 4 * strip)
        strip += 6
    while width - strip >= 2:
        multiply_two(values, start + strip, width, E, H, first, end, column + 4 * strip)
        strip += 2
    if strip < width:
        multiply_one(values, start + strip, width, E, H, first, end, column + 4 * strip)


@compile_inline
def multiply_six(
    values: FloatArray, start: int, width: int, E: FloatArray, H: FloatArray, first: int, end: int, at: int
) -> None:
    """The same for six columns."""
    a, b, c = four(E, at), four(E, at + 4), four(E, at + 8)
    d, e, f = four(E, at + 12), four(E, at + 16), four(E, at + 20)
    u, v, w, x, y, z = same(0.0), same(0.0), same(0.0), same(0.0), same(0.0), same(0.0)
    p = start
    for row in range(first, end, 4):
        own = four(E, row)
        k, m, n = each(values, p), each(values, p + 1), each(values, p + 2)
        q, r, s = each(values, p + 3), each(values, p + 4), each(values, p + 5)
        u, v, w = u + k * own, v + m * own, w + n * own
        x, y, z = x + q * own, y + r * own, z + s * own
        put(H, row, (four(H, row) + k * a + m * b + n * c) + (q * d + r * e + s * f))
        p += width
    put(H, at, four(H, at) + u)
    put(H, at + 4, four(H, at + 4) + v)
    put(H, at + 8, four(H, at + 8) + w)
    put(H, at + 12, four(H, at + 12) + x)
    put(H, at + 16, four(H, at + 16) + y)
    put(H, at + 20, four(H, at + 20) + z)


@compile_inline
def multiply_two(
    values: FloatArray, start: int, width: int, E: FloatArray, H: FloatArray, first: int, end: int, at: int
) -> None:
    """The same for two columns."""
    a, b, u, v = four(E, at), four(E, at + 4), same(0.0), same(0.0)
    p = start
    for row in range(first, end, 4):
        own, k, m = four(E, row), each(values, p), each(values, p + 1)
        u, v = u + k * own, v + m * own
        put(H, row, four(H, row) + k * a + m * b)
        p += width
    put(H, at, four(H, at) + u)
    put(H, at + 4, four(H, at + 4) + v)


@compile_inline
def multiply_one(
    values: FloatArray, start: int, width: int, E: FloatArray, H: FloatArray, first: int, end: int, at: int
) -> None:
    """The same for a single column."""
    a, u = four(E, at), same(0.0)
    p = start
    for row in range(first, end, 4):
        own, k = four(E, row), each(values, p)
        u = u + k * own
        put(H, row, four(H, row) + k * a)
        p += width
    put(H, at, four(H, at) + u)


# ---- Kernels that take out of the cofactors Q of the reduced system what the columns bring that all frames have
# in common.
#
# These are the last ones, the interior orientation of a single camera. With Q_zz = C Cᵀ theirs,
#
#     Q = R + W Wᵀ,        W = Q_·z C⁻ᵀ,
#
# and R vanishes in their rows and columns: they become unknowns with unit cofactors, correlated with nothing. What is
# left for products are the blocks of R of the frames' own unknowns. Those on its diagonal are stored halved: so R is
# what is stored and its mirror image.


@compile_kernel
def split_cofactors(
    common: IntArray, pattern: Pattern, values: FloatArray, by_common: FloatArray, rest: FloatArray
) -> None:
    """Set W (n, z) as ``by_common`` and the stored blocks of R as ``rest``, for common columns (z,).

    Columns that are −1 have nothing to do with anything, as have pairs that are not stored. z is a multiple of four.
    """
    inverse, block_of = np.zeros(common.size), pattern.block_of
    for k in range(common.size):
        if common[k] < 0:
            continue
        row = by_common[common[k]]
        fetch_row(common[k], common, k + 1, pattern, values, row)
        pivot = row[k]
        for m in range(k):
            for j in range(m):
                row[m] -= row[j] * by_common[common[m], j]
            row[m] *= inverse[m]
            pivot -= row[m] * row[m]
        row[k] = np.sqrt(max(pivot, 0.0))
        inverse[k] = 1.0 / row[k] if row[k] > 0.0 else 0.0
    is_common = np.zeros(block_of.size, dtype=np.bool_)
    for k in range(common.size):
        if common[k] >= 0:
            is_common[common[k]] = True
    for unknown in range(block_of.size):
        if is_common[unknown]:
            continue
        row = by_common[unknown]
        fetch_row(unknown, common, common.size, pattern, values, row)
        for m in range(common.size):
            if common[m] >= 0:
                for j in range(m):
                    row[m] -= row[j] * by_common[common[m], j]
            row[m] *= inverse[m]
    subtract_squares(pattern, values, by_common, rest)


@compile_kernel
def fetch_row(
    unknown: int, common: IntArray, count: int, pattern: Pattern, values: FloatArray, row: FloatArray
) -> None:
    """Set the cofactors of an unknown with the first common columns, so many; zero where they are not stored."""
    block_of, offsets, indptr, indices, position = pattern
    own, before, start = block_of[unknown], -1, -1
    for k in range(count):
        row[k] = 0.0
        if common[k] < 0:
            continue
        other = block_of[common[k]]
        if other != before:
            start = find_start(indptr, indices, position, max(own, other), min(own, other))
        before = other
        if start >= 0:
            above, below = (other, own) if own > other else (own, other)
            column, line = (common[k], unknown) if own > other else (unknown, common[k])
            width = offsets[above + 1] - offsets[above]
            row[k] = values[start + (line - offsets[below]) * width + column - offsets[above]]


@compile_kernel
def subtract_squares(pattern: Pattern, values: FloatArray, by_common: FloatArray, rest: FloatArray) -> None:
    """Set the stored blocks of Q − W Wᵀ, those on the diagonal divided by two."""
    _, offsets, indptr, indices, position = pattern
    flat, z = by_common.reshape(-1), by_common.shape[1]
    for column in range(offsets.size - 1):
        for number in range(indptr[column], indptr[column + 1]):
            at, row = position[number], indices[number]
            for i in range(offsets[row], offsets[row + 1]):
                for k in range(offsets[column], offsets[column + 1]):
                    product = same(0.0)
                    for m in range(0, z, 4):
                        product = product + four(flat, i * z + m) * four(flat, k * z + m)
                    rest[at] = (0.5 if row == column else 1.0) * (values[at] - total(product))
                    at += 1


@compile_kernel
def gather_frames(
    columns: IntArray,
    own: int,
    pattern: Pattern,
    rest: FloatArray,
    by_common: FloatArray,
    folded: FloatArray,
    rows: FloatArray,
) -> bool:
    """Set what frames with columns (f, K) have of R and W.

    Of R the part (F, F) of their first columns, ``own`` of them and some more, folded into its lower triangle, so that
    quadratic forms come out right. Of W the rows (K, z) of all columns.
    Returns False where a pair is not stored.
    """
    width = folded.shape[1]
    starts, places = np.empty(width, dtype=np.int64), np.empty((width, width), dtype=np.int64)
    of_frame = np.full(width, -1)
    for f in range(columns.shape[0]):
        for k in range(own):
            of_frame[k] = columns[f, k]
        clear(folded[f])
        if not places_of_frame(of_frame, pattern, starts, places):
            return False
        for k in range(own):
            for m in range(own):
                place = places[k, m]
                if place >= 0:
                    folded[f, max(k, m), min(k, m)] += 2.0 * rest[place]
        for k in range(columns.shape[1]):
            for m in range(by_common.shape[1]):
                rows[f, k, m] = by_common[columns[f, k], m] if columns[f, k] >= 0 else 0.0
    return True


# ---- Kernels of the cofactors of rays, from those of their points and the selected inverse Q_cc of the reduced system.
#
# With E = W N_pp⁻¹ and H = Q_cc E of its point, a ray with the derivatives a by the point and j by all else has a
# computed value of the cofactor
#
#     a Q_pp aᵀ − 2 a Hᵀ jᵀ + j Q_cc jᵀ,        Q_pp = N_pp⁻¹ + Σ (a N_pp⁻¹)ᵀ j H,
#
# and an error of 1 in it moves the point by (Q Aᵀ)_p = Q_pp aᵀ − Hᵀ jᵀ: the *share* of it that goes into the point is
# a Q_pp aᵀ − a Hᵀ jᵀ.


@compile_kernel
def forms_of_rays(
    by_others: FloatArray,
    frame: IntArray,
    folded: FloatArray,
    of_common: FloatArray,
    forms: FloatArray,
    shared: FloatArray,
) -> None:
    """Set j Q_cc jᵀ (n, 3) of all rays, xx, xy, yy, and j W (n, 2, z).

    ``folded`` (f, F, F) and ``of_common`` (f, K, z) are those of ``gather_frames``. Rays of a frame are worked on
    together, four at a time.
    """
    flat, triangles, rows, products = (
        by_others.reshape(-1),
        folded.reshape(-1),
        of_common.reshape(-1),
        shared.reshape(-1),
    )
    width, own, z = by_others.shape[2], folded.shape[1], shared.shape[2]
    first, listed = sorted_by_frame(frame, folded.shape[0])
    for f in range(folded.shape[0]):
        k = first[f]
        while listed[k] >= 0:
            one = listed[k]
            two = listed[k + 1] if listed[k + 1] >= 0 else one
            three = listed[k + 2] if two != one and listed[k + 2] >= 0 else two
            last = listed[k + 3] if three != two and listed[k + 3] >= 0 else three
            forms_of_four(
                flat,
                width,
                triangles,
                f * own * own,
                own,
                rows,
                f * width * z,
                z,
                one,
                two,
                three,
                last,
                forms,
                products,
            )
            if last == three:
                break
            k += 4


@compile_inline
def forms_of_four(
    by_others: FloatArray,
    width: int,
    folded: FloatArray,
    start: int,
    own: int,
    of_common: FloatArray,
    begin: int,
    z: int,
    one: int,
    two: int,
    three: int,
    last: int,
    forms: FloatArray,
    shared: FloatArray,
) -> None:
    """Set the forms of four rays of one frame, whose parts of R and W begin at ``start`` and ``begin``."""
    zero = same(0.0)
    a, b, c, d = 2 * width * one, 2 * width * two, 2 * width * three, 2 * width * last
    e, f, g, h = a + width, b + width, c + width, d + width
    xx, xy, yy = (zero, zero, zero, zero), (zero, zero, zero, zero), (zero, zero, zero, zero)
    for m in range(0, own, 4):
        s, t, u, v = zero, zero, zero, zero  # x F of each ray
        o, p, q, r = zero, zero, zero, zero  # y F
        at = start + m * own + m
        for k in range(m, own):
            row = four(folded, at)
            s, o = s + each(by_others, a + k) * row, o + each(by_others, e + k) * row
            t, p = t + each(by_others, b + k) * row, p + each(by_others, f + k) * row
            u, q = u + each(by_others, c + k) * row, q + each(by_others, g + k) * row
            v, r = v + each(by_others, d + k) * row, r + each(by_others, h + k) * row
            at += own
        x = four(by_others, a + m), four(by_others, b + m), four(by_others, c + m), four(by_others, d + m)
        y = four(by_others, e + m), four(by_others, f + m), four(by_others, g + m), four(by_others, h + m)
        xx = xx[0] + s * x[0], xx[1] + t * x[1], xx[2] + u * x[2], xx[3] + v * x[3]
        yy = yy[0] + o * y[0], yy[1] + p * y[1], yy[2] + q * y[2], yy[3] + r * y[3]
        i, j = xy[0] + s * y[0] + o * x[0], xy[1] + t * y[1] + p * x[1]
        xy = i, j, xy[2] + u * y[2] + q * x[2], xy[3] + v * y[3] + r * x[3]
    for m in range(0, z, 4):
        s, t, u, v = zero, zero, zero, zero  # x W of each ray
        o, p, q, r = zero, zero, zero, zero  # y W
        for k in range(width):
            row = four(of_common, begin + k * z + m)
            s, o = s + each(by_others, a + k) * row, o + each(by_others, e + k) * row
            t, p = t + each(by_others, b + k) * row, p + each(by_others, f + k) * row
            u, q = u + each(by_others, c + k) * row, q + each(by_others, g + k) * row
            v, r = v + each(by_others, d + k) * row, r + each(by_others, h + k) * row
        xx = xx[0] + s * s, xx[1] + t * t, xx[2] + u * u, xx[3] + v * v
        yy = yy[0] + o * o, yy[1] + p * p, yy[2] + q * q, yy[3] + r * r
        xy = xy[0] + 2.0 * s * o, xy[1] + 2.0 * t * p, xy[2] + 2.0 * u * q, xy[3] + 2.0 * v * r
        put_both(shared, 2 * one * z + m, z, s, o)
        put_both(shared, 2 * two * z + m, z, t, p)
        put_both(shared, 2 * three * z + m, z, u, q)
        put_both(shared, 2 * last * z + m, z, v, r)
    forms[one, 0], forms[one, 1], forms[one, 2] = total(xx[0]), 0.5 * total(xy[0]), total(yy[0])
    forms[two, 0], forms[two, 1], forms[two, 2] = total(xx[1]), 0.5 * total(xy[1]), total(yy[1])
    forms[three, 0], forms[three, 1], forms[three, 2] = total(xx[2]), 0.5 * total(xy[2]), total(yy[2])
    forms[last, 0], forms[last, 1], forms[last, 2] = total(xx[3]), 0.5 * total(xy[3]), total(yy[3])


@compile_inline
def put_both(array: FloatArray, place: int, further: int, one: Four, other: Four) -> None:
    """Store fours in two rows of an array, one below the other."""
    put(array, place, one)
    put(array, place + further, other)


@compile_inline
def cofactors_of_point(
    factor: FloatArray,
    by_others: FloatArray,
    width: int,
    frame: IntArray,
    first: int,
    end: int,
    runs: Runs,
    local: IntArray,
    shared: FloatArray,
    z: int,
    E: FloatArray,
    H: FloatArray,
    base: int,
    size: int,
    moved: FloatArray,
    sums: FloatArray,
    Q: FloatArray,
) -> None:
    """Make Q_pp of N_pp⁻¹, (3, 3) in ``Q``, by the rays first … end − 1 of one point, and set their j H as ``moved``.

    ``factor``, a N_pp⁻¹ (n, 2, 4), the Jacobians, ``moved`` (n, 2, 4), ``shared`` (n, 2, z), and couplings and
    products, (size + z, 4) from ``base`` on, are flat. For what is common, products are the couplings. ``sums`` (12,)
    is working space.
    """
    one, two, three = same(0.0), same(0.0), same(0.0)
    for i in range(first, end):
        x, y, u, v = same(0.0), same(0.0), same(0.0), same(0.0)
        start = runs.pointers[frame[i]]
        for t in range(start, runs.pointers[frame[i] + 1]):
            at, row = 2 * i * width + runs.first[t], base + 4 * local[i - first, t - start]
            left = runs.length[t]
            while left >= 2:
                h, g = four(H, row), four(H, row + 4)
                x, y = x + each(by_others, at) * h, y + each(by_others, at + width) * h
                u, v = u + each(by_others, at + 1) * g, v + each(by_others, at + width + 1) * g
                at, row, left = at + 2, row + 8, left - 2
            if left == 1:
                h = four(H, row)
                x, y = x + each(by_others, at) * h, y + each(by_others, at + width) * h
        for k in range(z):
            at, h = 2 * i * z + k, four(E, base + 4 * (size + k))
            x, y = x + each(shared, at) * h, y + each(shared, at + z) * h
        x, y = x + u, y + v
        put(moved, 8 * i, x)
        put(moved, 8 * i + 4, y)
        one = one + each(factor, 8 * i) * x + each(factor, 8 * i + 4) * y
        two = two + each(factor, 8 * i + 1) * x + each(factor, 8 * i + 5) * y
        three = three + each(factor, 8 * i + 2) * x + each(factor, 8 * i + 6) * y
    put(sums, 0, one)
    put(sums, 4, two)
    put(sums, 8, three)
    for k in range(3):
        for m in range(k + 1):
            Q[k, m] += sums[4 * k + m]
            Q[m, k] = Q[k, m]


@compile_kernel
def cofactors_of_rays(
    by_point: FloatArray,
    pointers: IntArray,
    of_points: FloatArray,
    forms: FloatArray,
    moved: FloatArray,
    of_rays: FloatArray,
    shares: FloatArray,
) -> None:
    """Set the cofactors (n, 2, 2) of rays and their shares (n, 2).

    Their points have the cofactors ``of_points`` (p, 3, 3); ``forms`` (n, 3) are j Q_cc jᵀ and ``moved`` j H (n, 2, 4).
    """
    for point in range(pointers.size - 1):
        Q = of_points[point]
        q00, q10, q11, q20, q21, q22 = Q[0, 0], Q[1, 0], Q[1, 1], Q[2, 0], Q[2, 1], Q[2, 2]
        for i in range(pointers[point], pointers[point + 1]):
            a, b, c = by_point[i, 0, 0], by_point[i, 0, 1], by_point[i, 0, 2]
            d, e, f = by_point[i, 1, 0], by_point[i, 1, 1], by_point[i, 1, 2]
            x, y, z = moved[i, 0, 0], moved[i, 0, 1], moved[i, 0, 2]
            u, v, w = moved[i, 1, 0], moved[i, 1, 1], moved[i, 1, 2]
            p, q, r = q00 * a + q10 * b + q20 * c, q10 * a + q11 * b + q21 * c, q20 * a + q21 * b + q22 * c
            s, t, o = q00 * d + q10 * e + q20 * f, q10 * d + q11 * e + q21 * f, q20 * d + q21 * e + q22 * f
            xx, yy, xy = a * p + b * q + c * r, d * s + e * t + f * o, d * p + e * q + f * r
            across_x, across_y = a * x + b * y + c * z, d * u + e * v + f * w
            xy += forms[i, 1] - (a * u + b * v + c * w) - (d * x + e * y + f * z)
            shares[i, 0], shares[i, 1] = xx - across_x, yy - across_y
            of_rays[i, 0, 0], of_rays[i, 1, 1] = (xx - 2.0 * across_x + forms[i, 0], yy - 2.0 * across_y + forms[i, 2])
            of_rays[i, 0, 1] = of_rays[i, 1, 0] = xy


# ---- Kernels of the cofactors of points, from the selected inverse Q_cc of the reduced system.
#
# With the coupling E = Σ jᵀa N_pp⁻¹ of one point, H = Q_cc E, and Q_pp = N_pp⁻¹ + Eᵀ H, Q_cp = −H. What is
# common to all frames is taken out of Q_cc before (``common_columns``): it is coupled like all else, by j W,
# and multiplied by nothing.

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
    flat, factors, products, width = (by_others.reshape(-1), factor.reshape(-1), moved.reshape(-1), by_others.shape[2])
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
