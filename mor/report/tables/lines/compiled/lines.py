"""Lines of a table: texts that are looked up, and numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mor.arrays import BoolArray, IntArray, SmallIntArray
from mor.compilation import compile_kernel
from mor.report.tables.lines.compiled.numbers import write_double, write_single

_ONE = np.uint64(1)
_COMMA, _END = np.uint8(ord(",")), np.uint8(ord("\n"))


@compile_kernel
def write_lines(
    text: NDArray[np.uint8],
    names: tuple[NDArray[np.uint8], ...],
    ends: tuple[IntArray, ...],
    places: SmallIntArray,
    before: int,
    doubles: NDArray[np.uint64],
    singles: NDArray[np.uint32],
    is_single: BoolArray,
) -> int:
    """Write lines of a table, columns separated by commas; returns how many bytes they take.

    Args:
        text: (bytes,) is written, with room for all lines and for what numbers overwrite beyond themselves.
        names: of each column of texts the different ones (bytes,), each with one byte behind it.
        ends: of each the places (texts + 1,) of these bytes: before the first text, and behind each.
        places: (t, n) which of them is in a line.
        before: how many columns of texts stand before the numbers, the others behind.
        doubles: (d, n) bits of the columns of numbers that are doubles, in their order; singles: (s, n) of the others.
        is_single: (d + s,) which columns of numbers are these.
    """
    at = np.uint64(0)
    for row in range(places.shape[1]):
        for column in range(before):
            at = _write_text(text, at, names[column], ends[column], places[column, row])
        double = single = 0
        for numbers in is_single:
            if numbers:
                at = write_single(text, at, np.uint64(singles[single, row]))
                single += 1
            else:
                at = write_double(text, at, doubles[double, row])
                double += 1
            text[at] = _COMMA
            at += _ONE
        for column in range(before, len(places)):
            at = _write_text(text, at, names[column], ends[column], places[column, row])
        text[at - _ONE] = _END
    return int(at)


@compile_kernel
def _write_text(
    text: NDArray[np.uint8], at: np.uint64, names: NDArray[np.uint8], ends: IntArray, place: int
) -> np.uint64:
    """Write a text and a comma."""
    for k in range(ends[place] + 1, ends[place + 1]):
        text[at] = names[k]
        at += _ONE
    text[at] = _COMMA
    return at + _ONE
