"""Kernel that notes the quality of rays: what ``redundancy`` does for all observations, for millions of rays."""

from __future__ import annotations

import numpy as np

from mor.adjustment.compiled import compile_kernel
from mor.geometry.arrays import BoolArray, FloatArray, IntArray


@compile_kernel
def fill(
    rows: IntArray,
    place: IntArray,
    weight: FloatArray,
    white: FloatArray,
    controlled: float,
    v: FloatArray,
    out: BoolArray,
    absorbed: FloatArray,
    joint: FloatArray,
    freedom: FloatArray,
) -> None:
    """Set the quality (group rows, 2) of the rays at ``place`` (k,) of a chunk, which are these rows of their group.

    ``white`` (n, 2, 2) are the cofactors of the whitened computed values, ``weight`` (n, 2) is 1/σ; the residuals v are
    there already. Eigenvalues of the joint test below ``controlled`` are left out.
    """
    for k in range(rows.size):
        row, i = rows[k], place[k]
        w, z = weight[i, 0], weight[i, 1]
        a = 1.0 - white[i, 0, 0] if w != 0.0 else 0.0
        c = 1.0 - white[i, 1, 1] if z != 0.0 else 0.0
        b = -white[i, 0, 1] if w != 0.0 and z != 0.0 else 0.0
        x, y = v[row, 0] * w if w != 0.0 else 0.0, v[row, 1] * z if z != 0.0 else 0.0
        mean, half = 0.5 * (a + c), 0.5 * (a - c)
        radius = np.hypot(half, b)
        turn = 0.5 * np.arctan2(b, half)
        cosine, sine = np.cos(turn), np.sin(turn)
        total, count = 0.0, 0.0
        if mean + radius > controlled:
            total += (cosine * x + sine * y) ** 2 / (mean + radius)
            count += 1.0
        if mean - radius > controlled:
            total += (cosine * y - sine * x) ** 2 / (mean - radius)
            count += 1.0
        for m in range(2):
            if weight[i, m] != 0.0:
                absorbed[row, m] = white[i, m, m]
                if not out[row, m]:
                    joint[row, m] = total
                    freedom[row, m] = count
