"""Kernels that note the quality of rays: what ``redundancy`` does for all observations, for millions of rays."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray, IntArray, SmallestIntArray, SmallIntArray
from mor.compilation import compile_kernel


@compile_kernel
def fill(
    rows: SmallIntArray,
    place: IntArray,
    weight: FloatArray,
    white: FloatArray,
    shares: FloatArray,
    by_point: FloatArray,
    controlled: float,
    v: FloatArray,
    absorbed: FloatArray,
    carried: FloatArray,
    joint: FloatArray,
    freedom: SmallestIntArray,
) -> None:
    """Set the quality of the rays at ``place`` (k,) of a chunk, which are these rows (n, 2) and (n,) of their group.

    ``white`` (n, 2, 2) are the cofactors of the whitened computed values, ``shares`` (n, 2) what of an error of 1 goes
    into their points, ``by_point`` (n, 2, 3) the whitened derivatives by these, ``weight`` (n, 2) is 1/σ; the residuals
    v are there already. Eigenvalues of the joint test below ``controlled`` are left out. ``joint`` and ``freedom`` have
    one column for the row, or one for each component.
    """
    for k in range(rows.size):
        row, i = rows[k], place[k]
        w, z = weight[i, 0], weight[i, 1]
        a = 1.0 - white[i, 0, 0] if w != 0.0 else 0.0
        c = 1.0 - white[i, 1, 1] if z != 0.0 else 0.0
        b = -white[i, 0, 1] if w != 0.0 and z != 0.0 else 0.0
        x, y = v[row, 0] * w if w != 0.0 else 0.0, v[row, 1] * z if z != 0.0 else 0.0
        mean, half = 0.5 * (a + c), 0.5 * (a - c)
        radius = np.sqrt(half * half + b * b)
        large, small = mean + radius, mean - radius
        total, count = 0.0, 0
        if small > controlled:
            total = (c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b)
            count = 2
        elif large > controlled:  # along the axis of the larger eigenvalue alone
            along = (a - small) * x * x + 2.0 * b * x * y + (c - small) * y * y
            total = along / ((large - small) * large)
            count = 1
        joint[row], freedom[row] = total, count
        for m in range(2):
            if weight[i, m] != 0.0:
                absorbed[row, m] = white[i, m, m]
                a, b, c = by_point[i, m, 0], by_point[i, m, 1], by_point[i, m, 2]
                slope = np.sqrt(a * a + b * b + c * c)
                carried[row, m] = shares[i, m] * weight[i, m] / slope if slope > 0.0 else 0.0


@compile_kernel
def note_residuals(
    rows: SmallIntArray, place: IntArray, weight: FloatArray, residual: FloatArray, v: FloatArray
) -> None:
    """Set the residuals v (n, 2) in these rows (k,) from the whitened ones at ``place``; NaN where nothing is seen."""
    for k in range(rows.size):
        row, i = rows[k], place[k]
        for m in range(2):
            v[row, m] = residual[i, m] / weight[i, m] if weight[i, m] > 0.0 else np.nan


@compile_kernel
def add_directions(
    by_point: FloatArray,
    by_others: FloatArray,
    frame: IntArray,
    pointers: IntArray,
    own: FloatArray,
    through_frames: FloatArray,
    through: FloatArray,
    shares: FloatArray,
) -> None:
    """Add a own (A through)ᵀ to the shares (n, 2) of rays: what a minimal datum and weak directions keep from them.

    Directions ``own`` and ``through`` are given on the points (p, 3, d), through on the frames (f, d, K) too.
    """
    width, count = by_others.shape[2], own.shape[2]
    for p in range(pointers.size - 1):
        for i in range(pointers[p], pointers[p + 1]):
            x, y, of_frame = by_others[i, 0], by_others[i, 1], through_frames[frame[i]]
            a, b, c = by_point[i, 0, 0], by_point[i, 0, 1], by_point[i, 0, 2]
            d, e, f = by_point[i, 1, 0], by_point[i, 1, 1], by_point[i, 1, 2]
            of_x, of_y = 0.0, 0.0
            for m in range(count):
                row, s, t = of_frame[m], 0.0, 0.0
                for k in range(width):
                    s += x[k] * row[k]
                    t += y[k] * row[k]
                one, two, three = through[p, 0, m], through[p, 1, m], through[p, 2, m]
                s += a * one + b * two + c * three
                t += d * one + e * two + f * three
                one, two, three = own[p, 0, m], own[p, 1, m], own[p, 2, m]
                of_x += s * (a * one + b * two + c * three)
                of_y += t * (d * one + e * two + f * three)
            shares[i, 0] += of_x
            shares[i, 1] += of_y
