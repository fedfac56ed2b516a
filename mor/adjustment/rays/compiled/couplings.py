"""Kernels that couple points to the other unknowns of their rays.

With the Jacobians j of the rays by the others, and any right factor c (n, 2, 3), the coupling of a point is Σ jᵀc,
kept transposed (3, m), where m counts the merged unknowns of its rays; or as fours (m, 4), the last number zero.
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.rays.compiled.cliques import Runs
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_inline
from mor.registers import each, four, put, same

_ONE, _TWO = (np.uint64(k) for k in range(1, 3))


@compile_inline
def couple(
    factor: FloatArray,
    by_others: FloatArray,
    width: int,
    frame: IntArray,
    first: int,
    end: int,
    runs: Runs,
    local: IntArray,
    couplings: FloatArray,
    base: int,
    size: int,
) -> None:
    """Set the coupling (3, size) of one point, from ``base`` on, by its rays first … end − 1; ``by_others`` is flat."""
    for entry in range(3 * size):
        couplings[np.uint64(base) + np.uint64(entry)] = 0.0
    for i in range(first, end):
        a, b, c = factor[i, 0, 0], factor[i, 0, 1], factor[i, 0, 2]
        d, e, f = factor[i, 1, 0], factor[i, 1, 1], factor[i, 1, 2]
        start = runs.pointers[frame[i]]
        for t in range(start, runs.pointers[frame[i] + 1]):
            at = np.uint64(base + local[i - first, t - start])
            x = np.uint64(2 * i * width + runs.first[t])
            left = runs.length[t]
            while left >= 2:
                couple_two(by_others, x, width, a, b, c, d, e, f, couplings, at, size)
                at, x, left = at + _TWO, x + _TWO, left - 2
            if left == 1:
                x0, y0 = by_others[x], by_others[x + np.uint64(width)]
                couplings[at] += x0 * a + y0 * d
                couplings[at + np.uint64(size)] += x0 * b + y0 * e
                couplings[at + np.uint64(2 * size)] += x0 * c + y0 * f


@compile_inline
def couple_two(
    by_others: FloatArray,
    x: np.uint64,
    width: int,
    a: float,
    b: float,
    c: float,
    d: float,
    e: float,
    f: float,
    couplings: FloatArray,
    at: np.uint64,
    size: int,
) -> None:
    """Couple two unknowns, whose Jacobian is (x, x + 1) and as much a row below, by the factor (a, b, c; d, e, f).

    All that is fetched is fetched before anything is stored: the compiler takes the arrays for one that overlaps. Four
    unknowns at a time are no faster.
    """
    y = x + np.uint64(width)
    x0, x1 = by_others[x], by_others[x + _ONE]
    y0, y1 = by_others[y], by_others[y + _ONE]
    couplings[at] += x0 * a + y0 * d
    couplings[at + _ONE] += x1 * a + y1 * d
    below = at + np.uint64(size)
    couplings[below] += x0 * b + y0 * e
    couplings[below + _ONE] += x1 * b + y1 * e
    below += np.uint64(size)
    couplings[below] += x0 * c + y0 * f
    couplings[below + _ONE] += x1 * c + y1 * f


@compile_inline
def reduce_rays(
    factor: FloatArray,
    by_others: FloatArray,
    width: int,
    frame: IntArray,
    first: int,
    end: int,
    runs: Runs,
    local: IntArray,
    couplings: FloatArray,
    base: int,
    size: int,
    reduced: FloatArray,
) -> None:
    """Set j − c Vᵀ of the rays of one point, at their own columns, from its coupling; the Jacobians are flat."""
    for i in range(first, end):
        a, b, c = factor[i, 0, 0], factor[i, 0, 1], factor[i, 0, 2]
        d, e, f = factor[i, 1, 0], factor[i, 1, 1], factor[i, 1, 2]
        start = runs.pointers[frame[i]]
        for t in range(start, runs.pointers[frame[i] + 1]):
            at = np.uint64(base + local[i - first, t - start])
            x = np.uint64(2 * i * width + runs.first[t])
            left = runs.length[t]
            while left >= 2:
                reduce_two(by_others, x, width, a, b, c, d, e, f, couplings, at, size, reduced)
                at, x, left = at + _TWO, x + _TWO, left - 2
            if left == 1:
                y = x + np.uint64(width)
                p, q, r = couplings[at], couplings[at + np.uint64(size)], couplings[at + np.uint64(2 * size)]
                reduced[x] = by_others[x] - (a * p + b * q + c * r)
                reduced[y] = by_others[y] - (d * p + e * q + f * r)


@compile_inline
def reduce_two(
    by_others: FloatArray,
    x: np.uint64,
    width: int,
    a: float,
    b: float,
    c: float,
    d: float,
    e: float,
    f: float,
    couplings: FloatArray,
    at: np.uint64,
    size: int,
    reduced: FloatArray,
) -> None:
    """The same for two unknowns; arguments as those of ``couple_two``."""
    y, further = x + np.uint64(width), np.uint64(size)
    x0, x1 = by_others[x], by_others[x + _ONE]
    y0, y1 = by_others[y], by_others[y + _ONE]
    p0, p1 = couplings[at], couplings[at + _ONE]
    below = at + further
    q0, q1 = couplings[below], couplings[below + _ONE]
    below += further
    r0, r1 = couplings[below], couplings[below + _ONE]
    reduced[x] = x0 - (a * p0 + b * q0 + c * r0)
    reduced[x + _ONE] = x1 - (a * p1 + b * q1 + c * r1)
    reduced[y] = y0 - (d * p0 + e * q0 + f * r0)
    reduced[y + _ONE] = y1 - (d * p1 + e * q1 + f * r1)


@compile_inline
def couple_fours(
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
    couplings: FloatArray,
    base: int,
    size: int,
) -> None:
    """Set the coupling (size + z, 4) of one point, from ``base`` on: with its unknowns, and with what is common.

    The factor (n, 2, 4), the Jacobians of both, ``shared`` (n, 2, z), and all else are flat.
    """
    for at in range(base, base + 4 * (size + z), 4):
        put(couplings, at, same(0.0))
    for i in range(first, end):
        a, b = four(factor, 8 * i), four(factor, 8 * i + 4)
        start = runs.pointers[frame[i]]
        for t in range(start, runs.pointers[frame[i] + 1]):
            at, x = base + 4 * local[i - first, t - start], 2 * i * width + runs.first[t]
            for k in range(x, x + runs.length[t]):
                moved = each(by_others, k) * a + each(by_others, k + width) * b
                put(couplings, at, four(couplings, at) + moved)
                at += 4
        at = base + 4 * size
        for k in range(2 * i * z, 2 * i * z + z):
            put(couplings, at, four(couplings, at) + each(shared, k) * a + each(shared, k + z) * b)
            at += 4
