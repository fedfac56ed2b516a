"""Array types that every module shares."""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
SmallIntArray: TypeAlias = NDArray[np.int32]
"""Numbers of names: tables have many rows."""
AnyIntArray: TypeAlias = NDArray[np.signedinteger[Any]]
"""Numbers that are only looked up: of ten million rows they are kept as small as they go."""
SmallestIntArray: TypeAlias = NDArray[np.int8]
"""Numbers of components of a row."""
LARGEST = 1e50
"""Numbers that are read and computed with. (v/σ)² of the worst of them is 1e200, and leaves room for sums and products
of derivatives; nothing that is measured, in whatever unit, comes near."""


def ranges(starts: IntArray, lengths: IntArray) -> IntArray:
    """Concatenation of ``arange(starts[i], starts[i] + lengths[i])``."""
    before = np.cumsum(lengths) - lengths
    return (np.repeat(starts - before, lengths) + np.arange(int(lengths.sum()))).astype(np.int64)


def pieces(count: int, at_a_time: int) -> Iterator[slice]:
    """Slices of so many of ``count`` rows at a time."""
    for first in range(0, count, at_a_time):
        yield slice(first, first + at_a_time)


def across(combine: np.ufunc, rows: NDArray[Any]) -> NDArray[Any]:
    """(n,) what a ufunc makes of the columns of (n, m): for a small m its ``reduce`` takes ten times as long."""
    whole: NDArray[Any] = reduce(combine, rows.T)
    return whole
