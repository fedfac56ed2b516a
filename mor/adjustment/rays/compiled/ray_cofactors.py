"""Kernels of the cofactors of rays, from those of their points and the selected inverse Q_cc of the reduced system.

With E = W N_pp⁻¹ and H = Q_cc E of its point, a ray with the derivatives a by the point and j by all else has a
computed value of the cofactor

    a Q_pp aᵀ − 2 a Hᵀ jᵀ + j Q_cc jᵀ,

and an error of 1 in it moves the point by (Q Aᵀ)_p = Q_pp aᵀ − Hᵀ jᵀ: the *share* of it that goes into the point is
a Q_pp aᵀ − a Hᵀ jᵀ.
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.rays.compiled.cliques import Pattern, Runs, places_of_frame
from mor.adjustment.rays.compiled.points import clear
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_inline, compile_kernel

TILE = 4
"""Columns that are worked on together."""
ROOM_FOR_FORMS = 3 * TILE
_ONE, _TWO, _THREE = (np.uint64(k) for k in range(1, TILE))


@compile_kernel
def gather_frames(columns: IntArray, pattern: Pattern, values: FloatArray, of_frame: FloatArray) -> bool:
    """Set the part (K, K) of Q_cc for the columns (f, K) of each frame, folded into its lower triangle.

    What stands off the diagonal is doubled, so that quadratic forms come out right. Returns False where a
    pair is not stored.
    """
    width = columns.shape[1]
    starts, places = np.empty(width, dtype=np.int64), np.empty((width, width), dtype=np.int64)
    for f in range(columns.shape[0]):
        clear(of_frame[f])
        if not places_of_frame(columns[f], pattern, starts, places):
            return False
        for k in range(width):
            for m in range(width):
                place = places[k, m]
                if place >= 0:
                    factor = 2.0 if places[m, k] < 0 else 1.0
                    of_frame[f, max(k, m), min(k, m)] += factor * values[place]
    return True


@compile_inline
def cofactors_of_rays(
    by_point: FloatArray,
    by_others: FloatArray,
    width: int,
    frame: IntArray,
    first: int,
    end: int,
    runs: Runs,
    local: IntArray,
    of_frame: FloatArray,
    H: FloatArray,
    base: int,
    Q: FloatArray,
    forms: FloatArray,
    of_rays: FloatArray,
    shares: FloatArray,
) -> None:
    """Set the cofactors (2, 2) of the rays first … end − 1 of one point with Q_pp = Q, and their shares (2,).

    ``by_others`` and the products H, (m, 4) from the unknown ``base`` on, are flat; ``forms`` is working space.
    """
    for i in range(first, end):
        a, b, c = by_point[i, 0, 0], by_point[i, 0, 1], by_point[i, 0, 2]
        d, e, f = by_point[i, 1, 0], by_point[i, 1, 1], by_point[i, 1, 2]
        p = Q[0, 0] * a + Q[0, 1] * b + Q[0, 2] * c
        q = Q[1, 0] * a + Q[1, 1] * b + Q[1, 2] * c
        r = Q[2, 0] * a + Q[2, 1] * b + Q[2, 2] * c
        xx, xy = a * p + b * q + c * r, d * p + e * q + f * r
        yy = d * (Q[0, 0] * d + Q[0, 1] * e + Q[0, 2] * f) + e * (Q[1, 0] * d + Q[1, 1] * e + Q[1, 2] * f)
        yy += f * (Q[2, 0] * d + Q[2, 1] * e + Q[2, 2] * f)
        x0, x1, x2, y0, y1, y2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # Hᵀ jᵀ
        start = runs.pointers[frame[i]]
        for t in range(start, runs.pointers[frame[i] + 1]):
            at, one = 2 * i * width + runs.first[t], 4 * (base + local[i - first, t - start])
            for k in range(runs.length[t]):
                x, y = by_others[at + k], by_others[at + width + k]
                h0, h1, h2 = H[one + 4 * k], H[one + 4 * k + 1], H[one + 4 * k + 2]
                x0 += x * h0
                x1 += x * h1
                x2 += x * h2
                y0 += y * h0
                y1 += y * h1
                y2 += y * h2
        across_x, across_y = a * x0 + b * x1 + c * x2, d * y0 + e * y1 + f * y2
        shares[i, 0], shares[i, 1] = xx - across_x, yy - across_y
        quadratic_forms(of_frame, frame[i] * width * width, by_others, 2 * i * width, width, forms)
        others_x, others_y, others_xy = sum_of(forms, 0), sum_of(forms, TILE), sum_of(forms, 2 * TILE)
        xy += 0.5 * others_xy - a * y0 - b * y1 - c * y2 - d * x0 - e * x1 - f * x2
        of_rays[i, 0, 0] = xx - 2.0 * across_x + others_x
        of_rays[i, 0, 1] = of_rays[i, 1, 0] = xy
        of_rays[i, 1, 1] = yy - 2.0 * across_y + others_y


@compile_inline
def sum_of(forms: FloatArray, first: int) -> float:
    """Return the sum of a few numbers from ``first`` on."""
    return float(forms[first] + forms[first + 1] + forms[first + 2] + forms[first + 3])


@compile_inline
def quadratic_forms(
    of_frame: FloatArray, start: int, by_others: FloatArray, first: int, width: int, forms: FloatArray
) -> None:
    """Set forms that add up to x F xᵀ, y F yᵀ and x F yᵀ + y F xᵀ, four numbers each.

    x and y are rows of the Jacobian, one below the other, from ``first`` on; the lower triangle F begins at ``start``.
    Four by four columns are worked on at a time.
    """
    for k in range(ROOM_FOR_FORMS):
        forms[k] = 0.0
    whole = width - width % TILE
    for k in range(0, whole, TILE):
        row = np.uint64(first + k)
        under = row + np.uint64(width)
        x0, x1, x2, x3 = by_others[row], by_others[row + _ONE], by_others[row + _TWO], by_others[row + _THREE]
        y0, y1 = by_others[under], by_others[under + _ONE]
        y2, y3 = by_others[under + _TWO], by_others[under + _THREE]
        for m in range(0, k + TILE, TILE):
            at = np.uint64(start + k * width + m)
            f0, f1, f2, f3 = of_frame[at], of_frame[at + _ONE], of_frame[at + _TWO], of_frame[at + _THREE]
            s0, s1, s2, s3 = x0 * f0, x0 * f1, x0 * f2, x0 * f3
            t0, t1, t2, t3 = y0 * f0, y0 * f1, y0 * f2, y0 * f3
            at += np.uint64(width)
            f0, f1, f2, f3 = of_frame[at], of_frame[at + _ONE], of_frame[at + _TWO], of_frame[at + _THREE]
            s0, s1, s2, s3 = s0 + x1 * f0, s1 + x1 * f1, s2 + x1 * f2, s3 + x1 * f3
            t0, t1, t2, t3 = t0 + y1 * f0, t1 + y1 * f1, t2 + y1 * f2, t3 + y1 * f3
            at += np.uint64(width)
            f0, f1, f2, f3 = of_frame[at], of_frame[at + _ONE], of_frame[at + _TWO], of_frame[at + _THREE]
            s0, s1, s2, s3 = s0 + x2 * f0, s1 + x2 * f1, s2 + x2 * f2, s3 + x2 * f3
            t0, t1, t2, t3 = t0 + y2 * f0, t1 + y2 * f1, t2 + y2 * f2, t3 + y2 * f3
            at += np.uint64(width)
            f0, f1, f2, f3 = of_frame[at], of_frame[at + _ONE], of_frame[at + _TWO], of_frame[at + _THREE]
            s0, s1, s2, s3 = s0 + x3 * f0, s1 + x3 * f1, s2 + x3 * f2, s3 + x3 * f3
            t0, t1, t2, t3 = t0 + y3 * f0, t1 + y3 * f1, t2 + y3 * f2, t3 + y3 * f3
            column = np.uint64(first + m)
            below = column + np.uint64(width)
            a0, a1 = by_others[column], by_others[column + _ONE]
            a2, a3 = by_others[column + _TWO], by_others[column + _THREE]
            b0, b1 = by_others[below], by_others[below + _ONE]
            b2, b3 = by_others[below + _TWO], by_others[below + _THREE]
            forms[0] += s0 * a0
            forms[1] += s1 * a1
            forms[2] += s2 * a2
            forms[3] += s3 * a3
            forms[4] += t0 * b0
            forms[5] += t1 * b1
            forms[6] += t2 * b2
            forms[7] += t3 * b3
            forms[8] += s0 * b0 + t0 * a0
            forms[9] += s1 * b1 + t1 * a1
            forms[10] += s2 * b2 + t2 * a2
            forms[11] += s3 * b3 + t3 * a3
    for k in range(whole, width):
        x, y, s, t = by_others[first + k], by_others[first + width + k], 0.0, 0.0
        for m in range(k + 1):
            s += of_frame[start + k * width + m] * by_others[first + m]
            t += of_frame[start + k * width + m] * by_others[first + width + m]
        forms[0] += s * x
        forms[4] += t * y
        forms[8] += s * y + t * x
