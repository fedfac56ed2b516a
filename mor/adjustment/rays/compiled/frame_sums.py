"""Kernels that add up what the rays of one frame leave beside the products of their couplings.

The rays of a frame are chained, and four by four columns are added up at a time, in registers, along the chain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.rays.compiled.cliques import Met, Pattern, Runs, find_start
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_kernel

TILE = 4
"""Columns that are added up together; Jacobians have at least so many."""
_ONE, _TWO, _THREE = (np.uint64(k) for k in range(1, TILE))


class FrameSums(NamedTuple):
    """Sums over the rays of each frame.

    Attributes:
        squares: (frames · K · K,) lower triangles of Σ jᵀj.
        gradient: (frames, K) −Σ jᵀ residual.
        right_hand_side: (frames, K) the same of the residuals that the points leave.
    """

    squares: FloatArray
    gradient: FloatArray
    right_hand_side: FloatArray


@compile_kernel
def add_rays(
    residual: FloatArray, moved: FloatArray, by_others: FloatArray, frame: IntArray, sums: FrameSums
) -> None:
    """Add the rays, (n, 2), (n, 2) and (n, 2, K), to the sums of their frames."""
    squares, gradient, right_hand_side = sums
    frames, width = gradient.shape
    first, following = chains(frame, frames)
    flat = by_others.reshape(-1)
    for i in range(frame.size):
        f, row = frame[i], by_others[i]
        r, s, t, u = residual[i, 0], residual[i, 1], moved[i, 0], moved[i, 1]
        for k in range(width):
            gradient[f, k] -= row[0, k] * r + row[1, k] * s
            right_hand_side[f, k] -= row[0, k] * t + row[1, k] * u
    for f in range(frames):
        if first[f] < 0:
            continue
        done = 0
        while done < width:
            k = min(done, width - TILE)
            across = 0
            while across < k + TILE:
                m = min(across, width - TILE)
                tile = products(flat, following, first[f], width, k, m)
                for row_of_tile in range(done - k, TILE):
                    start = (f * width + k + row_of_tile) * width + m
                    for column in range(across - m, TILE):
                        squares[start + column] += tile[TILE * row_of_tile + column]
                across += TILE
            done += TILE


@compile_kernel
def chains(frame: IntArray, frames: int) -> tuple[IntArray, IntArray]:
    """Return the first ray of each frame, and for each ray the next one of its frame; -1 where there is none."""
    first = np.full(frames, -1, dtype=np.int64)
    following = np.empty(frame.size, dtype=np.int64)
    for i in range(frame.size - 1, -1, -1):
        following[i] = first[frame[i]]
        first[frame[i]] = i
    return first, following


@compile_kernel
def products(
    by_others: FloatArray, following: IntArray, first: int, width: int, row: int, column: int
) -> tuple[float, ...]:
    """Return Σ jᵀj of four rows and columns, row by row, along a chain of rays.

    Places are unsigned, so that four numbers side by side are one operation.
    """
    s00, s01, s02, s03 = 0.0, 0.0, 0.0, 0.0
    s10, s11, s12, s13 = 0.0, 0.0, 0.0, 0.0
    s20, s21, s22, s23 = 0.0, 0.0, 0.0, 0.0
    s30, s31, s32, s33 = 0.0, 0.0, 0.0, 0.0
    further = np.uint64(width)
    i = first
    while i >= 0:
        base = np.uint64(2 * width * i)
        a, b = base + np.uint64(column), base + np.uint64(row)
        c, d = a + further, b + further
        x0, x1, x2, x3 = by_others[b], by_others[b + _ONE], by_others[b + _TWO], by_others[b + _THREE]
        a0, a1, a2, a3 = by_others[a], by_others[a + _ONE], by_others[a + _TWO], by_others[a + _THREE]
        y0, y1, y2, y3 = by_others[d], by_others[d + _ONE], by_others[d + _TWO], by_others[d + _THREE]
        b0, b1, b2, b3 = by_others[c], by_others[c + _ONE], by_others[c + _TWO], by_others[c + _THREE]
        s00 += x0 * a0 + y0 * b0
        s01 += x0 * a1 + y0 * b1
        s02 += x0 * a2 + y0 * b2
        s03 += x0 * a3 + y0 * b3
        s10 += x1 * a0 + y1 * b0
        s11 += x1 * a1 + y1 * b1
        s12 += x1 * a2 + y1 * b2
        s13 += x1 * a3 + y1 * b3
        s20 += x2 * a0 + y2 * b0
        s21 += x2 * a1 + y2 * b1
        s22 += x2 * a2 + y2 * b2
        s23 += x2 * a3 + y2 * b3
        s30 += x3 * a0 + y3 * b0
        s31 += x3 * a1 + y3 * b1
        s32 += x3 * a2 + y3 * b2
        s33 += x3 * a3 + y3 * b3
        i = following[np.uint64(i)]
    return s00, s01, s02, s03, s10, s11, s12, s13, s20, s21, s22, s23, s30, s31, s32, s33


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
                right_hand_side[column] += sums.right_hand_side[f, k]
                gradient[column] += sums.gradient[f, k]
                diagonal[column] += squares[f, k, k]
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
