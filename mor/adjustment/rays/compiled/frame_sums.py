"""Kernels that add up what the rays of one frame leave beside the products of their couplings.

Rays are gone through frame by frame, and tiles of a few rows and columns are added up in registers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.rays.compiled.cliques import Met, Pattern, Runs, find_start
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_inline, compile_kernel

ROWS, COLUMNS = 4, 8
"""Rows and columns that are added up together; Jacobians have whole numbers of them."""
_ONE, _TWO, _THREE, _FOUR, _FIVE, _SIX, _SEVEN = (np.uint64(k) for k in range(1, COLUMNS))


class FrameSums(NamedTuple):
    """Sums over the rays of each frame.

    Attributes:
        width: K.
        squares: (frames · K · K,) lower triangles of Σ ĵᵀj; ĵ is j with the point of the ray eliminated, or j itself.
        diagonal: (frames · K,) diagonal of Σ jᵀj.
        gradient: (frames · K,) −Σ jᵀ residual.
        right_hand_side: (frames · K,) the same of the residuals that the points leave.
    """

    width: int
    squares: FloatArray
    diagonal: FloatArray
    gradient: FloatArray
    right_hand_side: FloatArray


@compile_kernel
def add_rays(
    residual: FloatArray,
    moved: FloatArray,
    by_others: FloatArray,
    reduced: FloatArray,
    frame: IntArray,
    sums: FrameSums,
) -> None:
    """Add the rays, (n, 2), (n, 2), j (n, 2, K) and ĵ (n, 2, K), to the sums of their frames."""
    width, frames = sums.width, sums.gradient.size // sums.width
    first, listed = sorted_by_frame(frame, frames)
    flat, rows = by_others.reshape(-1), reduced.reshape(-1)
    plain, shifted = residual.reshape(-1), moved.reshape(-1)
    for f in range(frames):
        if listed[first[f]] < 0:
            continue
        for column in range(0, width, COLUMNS):
            add_products(flat, plain, shifted, listed, first[f], width, column, sums, f)
            for row in range(column, width, ROWS):
                start = f * width * width
                add_tile(flat, rows, listed, first[f], width, row, column, sums.squares, start)


@compile_kernel
def sorted_by_frame(frame: IntArray, frames: int) -> tuple[IntArray, IntArray]:
    """Return where the rays of each frame begin (frames,) in a list of them all, -1 behind those of each frame."""
    count, first = np.zeros(frames, dtype=np.int64), np.zeros(frames, dtype=np.int64)
    for i in range(frame.size):
        count[frame[i]] += 1
    for f in range(1, frames):
        first[f] = first[f - 1] + count[f - 1] + 1
    listed, place = np.full(frame.size + frames, -1, dtype=np.int64), first.copy()
    for i in range(frame.size):
        listed[place[frame[i]]] = i
        place[frame[i]] += 1
    return first, listed


@compile_kernel
def add_products(
    by_others: FloatArray,
    residual: FloatArray,
    moved: FloatArray,
    listed: IntArray,
    first: int,
    width: int,
    column: int,
    sums: FrameSums,
    f: int,
) -> None:
    """Add what else the listed rays of the frame ``f`` leave in ``COLUMNS`` columns."""
    g0, g1, g2, g3, g4, g5, g6, g7 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    h0, h1, h2, h3, h4, h5, h6, h7 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    d0, d1, d2, d3, d4, d5, d6, d7 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    further = np.uint64(width)
    k = np.uint64(first)
    while listed[k] >= 0:
        i = np.uint64(listed[k])
        a = _TWO * further * i + np.uint64(column)
        c, place = a + further, _TWO * i
        r, s, t, u = residual[place], residual[place + _ONE], moved[place], moved[place + _ONE]
        a0, a1, a2, a3 = by_others[a], by_others[a + _ONE], by_others[a + _TWO], by_others[a + _THREE]
        a4, a5, a6, a7 = (
            by_others[a + _FOUR],
            by_others[a + _FIVE],
            by_others[a + _SIX],
            by_others[a + _SEVEN],
        )
        b0, b1, b2, b3 = by_others[c], by_others[c + _ONE], by_others[c + _TWO], by_others[c + _THREE]
        b4, b5, b6, b7 = (
            by_others[c + _FOUR],
            by_others[c + _FIVE],
            by_others[c + _SIX],
            by_others[c + _SEVEN],
        )
        g0, g1 = g0 - (a0 * r + b0 * s), g1 - (a1 * r + b1 * s)
        g2, g3 = g2 - (a2 * r + b2 * s), g3 - (a3 * r + b3 * s)
        g4, g5 = g4 - (a4 * r + b4 * s), g5 - (a5 * r + b5 * s)
        g6, g7 = g6 - (a6 * r + b6 * s), g7 - (a7 * r + b7 * s)
        h0, h1 = h0 - (a0 * t + b0 * u), h1 - (a1 * t + b1 * u)
        h2, h3 = h2 - (a2 * t + b2 * u), h3 - (a3 * t + b3 * u)
        h4, h5 = h4 - (a4 * t + b4 * u), h5 - (a5 * t + b5 * u)
        h6, h7 = h6 - (a6 * t + b6 * u), h7 - (a7 * t + b7 * u)
        d0, d1 = d0 + a0 * a0 + b0 * b0, d1 + a1 * a1 + b1 * b1
        d2, d3 = d2 + a2 * a2 + b2 * b2, d3 + a3 * a3 + b3 * b3
        d4, d5 = d4 + a4 * a4 + b4 * b4, d5 + a5 * a5 + b5 * b5
        d6, d7 = d6 + a6 * a6 + b6 * b6, d7 + a7 * a7 + b7 * b7
        k += _ONE
    at = np.uint64(f * width + column)
    add_eight(sums.gradient, at, g0, g1, g2, g3, g4, g5, g6, g7)
    add_eight(sums.right_hand_side, at, h0, h1, h2, h3, h4, h5, h6, h7)
    add_eight(sums.diagonal, at, d0, d1, d2, d3, d4, d5, d6, d7)


@compile_kernel
def add_tile(
    by_others: FloatArray,
    reduced: FloatArray,
    listed: IntArray,
    first: int,
    width: int,
    row: int,
    column: int,
    squares: FloatArray,
    start: int,
) -> None:
    """Add Σ ĵᵀj of ``ROWS`` rows and ``COLUMNS`` columns, of listed rays, from ``first`` on; (K, K) begin at ``start``.

    Places are unsigned, so that numbers side by side are one operation; and where the list ends is not known before,
    or the compiler would work on several rays at a time, whose numbers lie far apart.
    """
    s00, s01, s02, s03, s04, s05, s06, s07 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    s10, s11, s12, s13, s14, s15, s16, s17 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    s20, s21, s22, s23, s24, s25, s26, s27 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    s30, s31, s32, s33, s34, s35, s36, s37 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    further = np.uint64(width)
    k = np.uint64(first)
    while listed[k] >= 0:
        i = np.uint64(listed[k])
        base = _TWO * further * i
        a, b = base + np.uint64(column), base + np.uint64(row)
        c, d = a + further, b + further
        x0, x1, x2, x3 = reduced[b], reduced[b + _ONE], reduced[b + _TWO], reduced[b + _THREE]
        y0, y1, y2, y3 = reduced[d], reduced[d + _ONE], reduced[d + _TWO], reduced[d + _THREE]
        a0, a1, a2, a3 = by_others[a], by_others[a + _ONE], by_others[a + _TWO], by_others[a + _THREE]
        a4, a5, a6, a7 = (
            by_others[a + _FOUR],
            by_others[a + _FIVE],
            by_others[a + _SIX],
            by_others[a + _SEVEN],
        )
        b0, b1, b2, b3 = by_others[c], by_others[c + _ONE], by_others[c + _TWO], by_others[c + _THREE]
        b4, b5, b6, b7 = (
            by_others[c + _FOUR],
            by_others[c + _FIVE],
            by_others[c + _SIX],
            by_others[c + _SEVEN],
        )
        s00, s01 = s00 + x0 * a0 + y0 * b0, s01 + x0 * a1 + y0 * b1
        s02, s03 = s02 + x0 * a2 + y0 * b2, s03 + x0 * a3 + y0 * b3
        s04, s05 = s04 + x0 * a4 + y0 * b4, s05 + x0 * a5 + y0 * b5
        s06, s07 = s06 + x0 * a6 + y0 * b6, s07 + x0 * a7 + y0 * b7
        s10, s11 = s10 + x1 * a0 + y1 * b0, s11 + x1 * a1 + y1 * b1
        s12, s13 = s12 + x1 * a2 + y1 * b2, s13 + x1 * a3 + y1 * b3
        s14, s15 = s14 + x1 * a4 + y1 * b4, s15 + x1 * a5 + y1 * b5
        s16, s17 = s16 + x1 * a6 + y1 * b6, s17 + x1 * a7 + y1 * b7
        s20, s21 = s20 + x2 * a0 + y2 * b0, s21 + x2 * a1 + y2 * b1
        s22, s23 = s22 + x2 * a2 + y2 * b2, s23 + x2 * a3 + y2 * b3
        s24, s25 = s24 + x2 * a4 + y2 * b4, s25 + x2 * a5 + y2 * b5
        s26, s27 = s26 + x2 * a6 + y2 * b6, s27 + x2 * a7 + y2 * b7
        s30, s31 = s30 + x3 * a0 + y3 * b0, s31 + x3 * a1 + y3 * b1
        s32, s33 = s32 + x3 * a2 + y3 * b2, s33 + x3 * a3 + y3 * b3
        s34, s35 = s34 + x3 * a4 + y3 * b4, s35 + x3 * a5 + y3 * b5
        s36, s37 = s36 + x3 * a6 + y3 * b6, s37 + x3 * a7 + y3 * b7
        k += _ONE
    at = np.uint64(start + row * width + column)
    add_eight(squares, at, s00, s01, s02, s03, s04, s05, s06, s07)
    at += further
    add_eight(squares, at, s10, s11, s12, s13, s14, s15, s16, s17)
    at += further
    add_eight(squares, at, s20, s21, s22, s23, s24, s25, s26, s27)
    at += further
    add_eight(squares, at, s30, s31, s32, s33, s34, s35, s36, s37)


@compile_inline
def add_eight(
    sums: FloatArray,
    at: np.uint64,
    s0: float,
    s1: float,
    s2: float,
    s3: float,
    s4: float,
    s5: float,
    s6: float,
    s7: float,
) -> None:
    """Add numbers to those side by side."""
    sums[at] += s0
    sums[at + _ONE] += s1
    sums[at + _TWO] += s2
    sums[at + _THREE] += s3
    sums[at + _FOUR] += s4
    sums[at + _FIVE] += s5
    sums[at + _SIX] += s6
    sums[at + _SEVEN] += s7


@compile_kernel
def carry_frames(
    columns: IntArray,
    runs: Runs,
    met: Met,
    pattern: Pattern,
    sums: FrameSums,
    values: FloatArray,
    right_hand_side: FloatArray,
    diagonal: FloatArray,
    gradient: FloatArray,
) -> bool:
    """Add the sums of frames with columns (f, K) to the reduced system; False where a pair of blocks is not stored."""
    frames, width = columns.shape
    squares = sums.squares.reshape((frames, width, width))
    for f in range(frames):
        for k in range(width):
            column = columns[f, k]
            if column >= 0:
                right_hand_side[column] += sums.right_hand_side[f * width + k]
                gradient[column] += sums.gradient[f * width + k]
                diagonal[column] += sums.diagonal[f * width + k]
        for t in range(runs.pointers[f], runs.pointers[f + 1]):
            for s in range(runs.pointers[f], runs.pointers[f + 1]):
                one, other = runs.block[t], runs.block[s]
                if one < other:
                    continue
                start = find_start(
                    pattern.indptr, pattern.indices, pattern.position, met.column[one], met.column[other]
                )
                if start < 0:
                    return False
                for k in range(runs.length[t]):
                    at = start + (runs.within[t] + k) * met.size[other] + runs.within[s]
                    for m in range(runs.length[s]):
                        row, column = runs.first[t] + k, runs.first[s] + m
                        values[at + m] += squares[f, max(row, column), min(row, column)]
    return True
