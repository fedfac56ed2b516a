"""Kernels that carry the coupling of a single point into blocks of the reduced system.

A block column is worked on in strips of six columns, then three, then single ones; what belongs to the columns stays in
registers. Without those of six, normal equations of an aerial block take 4 to 7 per cent longer, without those of three
2 to 3. Places are unsigned numbers: signed ones would be tested, entry by entry, for counting from the end.

In all of them ``couplings`` holds the transposed coupling (3, m) of the point from ``first`` on. The unknowns of its
blocks, ``slots`` in number, are ``begin[k]:begin[k+1]``; ``count`` blocks of the column of block ``slot``, that many
columns wide, are visited: those of ``others``, which start at ``starts`` in the values.
"""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_inline

_ONE, _TWO, _THREE, _FOUR, _FIVE = (np.uint64(k) for k in range(1, 6))


@compile_inline
def subtract_six(
    values: FloatArray,
    others: IntArray,
    starts: IntArray,
    count: int,
    width: int,
    couplings: FloatArray,
    first: int,
    begin: IntArray,
    slot: int,
    slots: int,
    strip: int,
) -> None:
    """Subtract V Vᵀ from six columns of the blocks, from column ``strip`` on."""
    size = begin[slots]
    one, two, three = np.uint64(first), np.uint64(first + size), np.uint64(first + 2 * size)
    k = np.uint64(begin[slot] + strip)
    a0 = couplings[one + k]
    a1 = couplings[one + k + _ONE]
    a2 = couplings[one + k + _TWO]
    a3 = couplings[one + k + _THREE]
    a4 = couplings[one + k + _FOUR]
    a5 = couplings[one + k + _FIVE]
    b0 = couplings[two + k]
    b1 = couplings[two + k + _ONE]
    b2 = couplings[two + k + _TWO]
    b3 = couplings[two + k + _THREE]
    b4 = couplings[two + k + _FOUR]
    b5 = couplings[two + k + _FIVE]
    c0 = couplings[three + k]
    c1 = couplings[three + k + _ONE]
    c2 = couplings[three + k + _TWO]
    c3 = couplings[three + k + _THREE]
    c4 = couplings[three + k + _FOUR]
    c5 = couplings[three + k + _FIVE]
    further = np.uint64(width)
    for visit in range(count):
        other, p = others[visit], np.uint64(starts[visit] + strip)
        for row in range(begin[other], begin[other + 1]):
            i = np.uint64(row)
            x, y, z = couplings[one + i], couplings[two + i], couplings[three + i]
            values[p] -= x * a0 + y * b0 + z * c0
            values[p + _ONE] -= x * a1 + y * b1 + z * c1
            values[p + _TWO] -= x * a2 + y * b2 + z * c2
            values[p + _THREE] -= x * a3 + y * b3 + z * c3
            values[p + _FOUR] -= x * a4 + y * b4 + z * c4
            values[p + _FIVE] -= x * a5 + y * b5 + z * c5
            p += further


@compile_inline
def subtract_three(
    values: FloatArray,
    others: IntArray,
    starts: IntArray,
    count: int,
    width: int,
    couplings: FloatArray,
    first: int,
    begin: IntArray,
    slot: int,
    slots: int,
    strip: int,
) -> None:
    """The same for three columns."""
    size = begin[slots]
    one, two, three = np.uint64(first), np.uint64(first + size), np.uint64(first + 2 * size)
    k = np.uint64(begin[slot] + strip)
    a0 = couplings[one + k]
    a1 = couplings[one + k + _ONE]
    a2 = couplings[one + k + _TWO]
    b0 = couplings[two + k]
    b1 = couplings[two + k + _ONE]
    b2 = couplings[two + k + _TWO]
    c0 = couplings[three + k]
    c1 = couplings[three + k + _ONE]
    c2 = couplings[three + k + _TWO]
    further = np.uint64(width)
    for visit in range(count):
        other, p = others[visit], np.uint64(starts[visit] + strip)
        for row in range(begin[other], begin[other + 1]):
            i = np.uint64(row)
            x, y, z = couplings[one + i], couplings[two + i], couplings[three + i]
            values[p] -= x * a0 + y * b0 + z * c0
            values[p + _ONE] -= x * a1 + y * b1 + z * c1
            values[p + _TWO] -= x * a2 + y * b2 + z * c2
            p += further


@compile_inline
def subtract_one(
    values: FloatArray,
    others: IntArray,
    starts: IntArray,
    count: int,
    width: int,
    couplings: FloatArray,
    first: int,
    begin: IntArray,
    slot: int,
    slots: int,
    strip: int,
) -> None:
    """The same for a single column."""
    size = begin[slots]
    one, two, three = np.uint64(first), np.uint64(first + size), np.uint64(first + 2 * size)
    k = np.uint64(begin[slot] + strip)
    a0 = couplings[one + k]
    b0 = couplings[two + k]
    c0 = couplings[three + k]
    further = np.uint64(width)
    for visit in range(count):
        other, p = others[visit], np.uint64(starts[visit] + strip)
        for row in range(begin[other], begin[other + 1]):
            i = np.uint64(row)
            x, y, z = couplings[one + i], couplings[two + i], couplings[three + i]
            values[p] -= x * a0 + y * b0 + z * c0
            p += further


@compile_inline
def subtract_column_of_point(
    values: FloatArray,
    others: IntArray,
    starts: IntArray,
    count: int,
    width: int,
    couplings: FloatArray,
    first: int,
    begin: IntArray,
    slot: int,
    slots: int,
) -> None:
    """Subtract V Vᵀ from the blocks of a column."""
    strip = 0
    while width - strip >= 6:
        subtract_six(values, others, starts, count, width, couplings, first, begin, slot, slots, strip)
        strip += 6
    while width - strip >= 3:
        subtract_three(values, others, starts, count, width, couplings, first, begin, slot, slots, strip)
        strip += 3
    while strip < width:
        subtract_one(values, others, starts, count, width, couplings, first, begin, slot, slots, strip)
        strip += 1
