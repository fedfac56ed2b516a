"""Kernels that take out of the cofactors Q of the reduced system what the columns bring that all frames have in common.

These are the last ones, the interior orientation of a single camera. With Q_zz = C Cᵀ theirs,

    Q = R + W Wᵀ,        W = Q_·z C⁻ᵀ,

and R vanishes in their rows and columns: they become unknowns with unit cofactors, correlated with nothing. What is
left for products are the blocks of R of the frames' own unknowns. Those on its diagonal are stored halved: so R is
what is stored and its mirror image.
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.rays.compiled.cliques import Pattern, find_start, places_of_frame
from mor.adjustment.rays.compiled.points import clear
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_kernel
from mor.registers import four, same, total


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
