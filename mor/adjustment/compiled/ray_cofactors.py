"""Kernels of the cofactors of rays, from those of their points and the selected inverse Q_cc of the reduced system.

With E = W N_pp⁻¹ and H = Q_cc E of its point, a ray with the derivatives a by the point and j by all else has a
computed value of the cofactor

    a Q_pp aᵀ − 2 a Hᵀ jᵀ + j Q_cc jᵀ,

and an error of 1 in it moves the point by (Q Aᵀ)_p = Q_pp aᵀ − Hᵀ jᵀ: the *share* of it that goes into the point is
a Q_pp aᵀ − a Hᵀ jᵀ.
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.compiled import compile_kernel
from mor.adjustment.compiled.cliques import Pattern, Runs, places_of_frame
from mor.adjustment.compiled.points import clear
from mor.geometry.arrays import FloatArray, IntArray


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


@compile_kernel
def cofactors_of_rays(
    by_point: FloatArray,
    by_others: FloatArray,
    frame: IntArray,
    first: int,
    end: int,
    runs: Runs,
    local: IntArray,
    of_frame: FloatArray,
    H: FloatArray,
    Q: FloatArray,
    of_rays: FloatArray,
    shares: FloatArray,
) -> None:
    """Set the cofactors (2, 2) of the rays first … end − 1 of one point with Q_pp = Q, and their shares (2,)."""
    width = by_others.shape[2]
    for i in range(first, end):
        x, y, F = by_others[i, 0], by_others[i, 1], of_frame[frame[i]]
        a, b, c = by_point[i, 0, 0], by_point[i, 0, 1], by_point[i, 0, 2]
        d, e, f = by_point[i, 1, 0], by_point[i, 1, 1], by_point[i, 1, 2]
        p = Q[0, 0] * a + Q[0, 1] * b + Q[0, 2] * c
        q = Q[1, 0] * a + Q[1, 1] * b + Q[1, 2] * c
        r = Q[2, 0] * a + Q[2, 1] * b + Q[2, 2] * c
        xx, xy = a * p + b * q + c * r, d * p + e * q + f * r
        yy = d * (Q[0, 0] * d + Q[0, 1] * e + Q[0, 2] * f) + e * (Q[1, 0] * d + Q[1, 1] * e + Q[1, 2] * f)
        yy += f * (Q[2, 0] * d + Q[2, 1] * e + Q[2, 2] * f)
        across_x, across_y = 0.0, 0.0
        start = runs.pointers[frame[i]]
        for t in range(start, runs.pointers[frame[i] + 1]):
            at, column = local[i - first, t - start], runs.first[t]
            for k in range(runs.length[t]):
                one, two, three = H[0, at + k], H[1, at + k], H[2, at + k]
                u, v = a * one + b * two + c * three, d * one + e * two + f * three
                across_x += x[column + k] * u
                across_y += y[column + k] * v
                xy -= x[column + k] * v + y[column + k] * u
        shares[i, 0], shares[i, 1] = xx - across_x, yy - across_y
        xx -= 2.0 * across_x
        yy -= 2.0 * across_y
        for k in range(width):
            row, of_x, of_y = F[k], 0.0, 0.0
            for m in range(k + 1):
                of_x += row[m] * x[m]
                of_y += row[m] * y[m]
            xx += x[k] * of_x
            yy += y[k] * of_y
            xy += 0.5 * (y[k] * of_x + x[k] * of_y)
        of_rays[i, 0, 0] = xx
        of_rays[i, 0, 1] = of_rays[i, 1, 0] = xy
        of_rays[i, 1, 1] = yy
