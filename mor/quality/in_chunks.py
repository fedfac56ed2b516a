"""Arrays of many observations worked out a piece at a time, so that what stands between takes no room."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from mor.arrays import BoolArray, FloatArray

Found = TypeVar("Found", FloatArray, BoolArray)

ROWS_AT_A_TIME = 250_000


def in_pieces(shape: tuple[int, ...], work: Callable[[slice], Found]) -> Found:
    """The array of a shape (n, …) whose rows the work finds, so many at a time; each depends on its own row alone."""
    if shape[0] <= ROWS_AT_A_TIME:
        return work(slice(None))
    first = work(slice(0, ROWS_AT_A_TIME))
    result = np.empty(shape, dtype=first.dtype)
    result[:ROWS_AT_A_TIME] = first
    for start in range(ROWS_AT_A_TIME, shape[0], ROWS_AT_A_TIME):
        rows = slice(start, start + ROWS_AT_A_TIME)
        result[rows] = work(rows)
    return result


def sum_of_known(shape: tuple[int, int], work: Callable[[slice], FloatArray]) -> float:
    """The sum of what the work finds, but for NaN.

    It is added up by halves, as numpy does it within an array: to the last digit ``nansum`` over the whole, where no
    half cuts a row in two, as of one or two components.
    """
    rows, width = shape

    def of_part(first: int, count: int) -> float:
        if count <= ROWS_AT_A_TIME:
            return float(np.sum(_or_zero(work(slice(first, first + count)))))
        half = (count * width // 2) // 8 * 8 // width or count // 2
        return of_part(first, half) + of_part(first + half, count - half)

    return of_part(0, rows)


def _or_zero(values: FloatArray) -> FloatArray:
    return np.where(np.isnan(values), 0.0, values)
