"""Kernels of the cofactors of rays, from those of their points and the selected inverse Q_cc of the reduced system.

With E = W N_pp⁻¹ and H = Q_cc E of its point, a ray with the derivatives a by the point and j by all else has a
computed value of the cofactor

    a Q_pp aᵀ − 2 a Hᵀ jᵀ + j Q_cc jᵀ,        Q_pp = N_pp⁻¹ + Σ (a N_pp⁻¹)ᵀ j H,

and an error of 1 in it moves the point by (Q Aᵀ)_p = Q_pp aᵀ − Hᵀ jᵀ: the *share* of it that goes into the point is
a Q_pp aᵀ − a Hᵀ jᵀ.
"""

from __future__ import annotations

from mor.adjustment.rays.compiled.cliques import Runs
from mor.adjustment.rays.compiled.frame_sums import sorted_by_frame
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_inline, compile_kernel
from mor.registers import Four, each, four, put, same, total


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
            of_rays[i, 0, 0], of_rays[i, 1, 1] = (
                xx - 2.0 * across_x + forms[i, 0],
                yy - 2.0 * across_y + forms[i, 2],
            )
            of_rays[i, 0, 1] = of_rays[i, 1, 0] = xy
