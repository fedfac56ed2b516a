"""Kernels that move values between matrix, front and parent, and the Cholesky step that sets pivots aside.

A front is three column-major arrays: ``pivots`` (k, k) and ``below`` (r, k) with its first k columns, and
``rest`` (r, r), of which only the lower triangle counts while factorising.
"""

from __future__ import annotations

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.compilation import compile_kernel


@compile_kernel
def assemble(
    values: FloatArray,
    start: IntArray,
    height: IntArray,
    width: IntArray,
    row: IntArray,
    column: IntArray,
    transposed: BoolArray,
    pivots: FloatArray,
    below: FloatArray,
) -> None:
    """Copy stored blocks of the matrix into the first columns of a front."""
    k = pivots.shape[0]
    for e in range(start.size):
        target = pivots if row[e] < k else below
        first = row[e] if row[e] < k else row[e] - k
        place = start[e]
        if transposed[e]:
            for i in range(height[e]):
                for j in range(width[e]):
                    target[first + j, column[e] + i] = values[place]
                    place += 1
        else:
            for i in range(height[e]):
                for j in range(width[e]):
                    target[first + i, column[e] + j] = values[place]
                    place += 1


@compile_kernel
def extract(
    values: FloatArray,
    start: IntArray,
    height: IntArray,
    width: IntArray,
    row: IntArray,
    column: IntArray,
    transposed: BoolArray,
    pivots: FloatArray,
    below: FloatArray,
) -> None:
    """Copy entries of the first columns of a front back to the stored blocks: ``assemble`` reversed."""
    k = pivots.shape[0]
    for e in range(start.size):
        source = pivots if row[e] < k else below
        first = row[e] if row[e] < k else row[e] - k
        place = start[e]
        if transposed[e]:
            for i in range(height[e]):
                for j in range(width[e]):
                    values[place] = source[first + j, column[e] + i]
                    place += 1
        else:
            for i in range(height[e]):
                for j in range(width[e]):
                    values[place] = source[first + i, column[e] + j]
                    place += 1


@compile_kernel
def runs_of_places(places: IntArray, split: int) -> IntArray:
    """Return the bounds of runs of consecutive places; none reaches across ``split``."""
    bounds = np.empty(places.size + 1, dtype=np.int64)
    count = 0
    for i in range(places.size):
        if i == 0 or i == split or places[i] != places[i - 1] + 1:
            bounds[count] = i
            count += 1
    bounds[count] = places.size
    return bounds[: count + 1]


@compile_kernel
def add_to_column(
    update: FloatArray, places: IntArray, bounds: IntArray, first: int, shift: int, target: FloatArray
) -> None:
    """Add the entries of a column from ``first`` on to the rows ``places`` − ``shift`` of another one."""
    for r in range(bounds.size - 1):
        low, high = max(bounds[r], first), bounds[r + 1]
        if low < high:
            to = places[bounds[r]] - bounds[r] - shift
            one, other = update[low:high], target[to + low : to + high]
            for i in range(one.size):
                other[i] += one[i]


@compile_kernel
def extend_add(
    update: FloatArray, places: IntArray, pivots: FloatArray, below: FloatArray, rest: FloatArray
) -> None:
    """Add the lower triangle of a child's update to the parent's rows ``places`` (ascending)."""
    k = pivots.shape[0]
    split = int(np.searchsorted(places, k))
    bounds = runs_of_places(places, split)
    upper = bounds[: np.searchsorted(bounds, split) + 1]
    lower = bounds[upper.size - 1 :]
    for j in range(split):
        add_to_column(update[:, j], places, upper, j, 0, pivots[:, places[j]])
        add_to_column(update[:, j], places, lower, split, k, below[:, places[j]])
    for j in range(split, places.size):
        add_to_column(update[:, j], places, lower, j, k, rest[:, places[j] - k])


@compile_kernel
def inherit(
    places: IntArray, pivots: FloatArray, below: FloatArray, rest: FloatArray, inherited: FloatArray
) -> None:
    """Copy the full symmetric (r, r) part at ``places`` (ascending) out of the parent's inverse."""
    k = pivots.shape[0]
    split = np.searchsorted(places, k)
    for j in range(split):
        column = places[j]
        for i in range(split):
            inherited[i, j] = pivots[places[i], column]
        for i in range(split, places.size):
            inherited[i, j] = below[places[i] - k, column]
            inherited[j, i] = below[places[i] - k, column]
    for j in range(split, places.size):
        column = places[j] - k
        for i in range(split, places.size):
            inherited[i, j] = rest[places[i] - k, column]


@compile_kernel
def factor_setting_aside(matrix: FloatArray, tolerance: float, vanished: BoolArray) -> None:
    """Replace the lower triangle of a matrix by its Cholesky factor, column by column.

    A pivot below ``tolerance`` is set aside: its unknown is fixed, which leaves the row and the column of a
    unit matrix in the factor, and ``vanished`` is set there. This never fails, not even if indefinite.
    """
    size = matrix.shape[0]
    for j in range(size):
        pivot = matrix[j, j]
        if pivot < tolerance:
            vanished[j] = True
            matrix[j, :j] = 0.0
            matrix[j + 1 :, j] = 0.0
            matrix[j, j] = 1.0
            continue
        matrix[j:, j] /= np.sqrt(pivot)
        for i in range(j + 1, size):
            matrix[i:, i] -= matrix[i, j] * matrix[i:, j]


@compile_kernel
def mirror(matrix: FloatArray) -> None:
    """Copy the lower triangle of a square matrix to its upper one."""
    for j in range(matrix.shape[0]):
        for i in range(j + 1, matrix.shape[0]):
            matrix[j, i] = matrix[i, j]
