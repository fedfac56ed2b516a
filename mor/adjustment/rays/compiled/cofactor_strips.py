"""Kernels that multiply the coupling of a single point with blocks of the selected inverse: the way back of ``strips``.

The arguments are those of ``strips``, but the couplings E and the products H are (m, 4), the fourth number zero, and
begin at the unknown ``first``: a number of a block is fetched once, and meets the three of the point side by side.
Three columns at a time are as fast as six, and there is less to compile.
"""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_inline

_ONE, _TWO, _THREE = (np.uint64(k) for k in range(1, 4))


@compile_inline
def multiply_three(
    values: FloatArray,
    others: IntArray,
    starts: IntArray,
    count: int,
    width: int,
    E: FloatArray,
    H: FloatArray,
    first: int,
    begin: IntArray,
    slot: int,
    slots: int,
    strip: int,
) -> None:
    """Add to the products H what three columns of the blocks, from ``strip`` on, and their mirror image make of E."""
    base, further = np.uint64(4 * first), np.uint64(width)
    k = base + np.uint64(4 * (begin[slot] + strip))
    at = k
    a0, a1, a2, a3 = E[at], E[at + _ONE], E[at + _TWO], E[at + _THREE]
    at = k + np.uint64(4)
    b0, b1, b2, b3 = E[at], E[at + _ONE], E[at + _TWO], E[at + _THREE]
    at = k + np.uint64(8)
    c0, c1, c2, c3 = E[at], E[at + _ONE], E[at + _TWO], E[at + _THREE]
    a4, a5, a6, a7 = 0.0, 0.0, 0.0, 0.0
    b4, b5, b6, b7 = 0.0, 0.0, 0.0, 0.0
    c4, c5, c6, c7 = 0.0, 0.0, 0.0, 0.0
    for visit in range(count):
        other, p = others[visit], np.uint64(starts[visit] + strip)
        mirrored = 0.0 if other == slot else 1.0
        for row in range(begin[other], begin[other + 1]):
            i = base + np.uint64(4 * row)
            s0, s1 = mirrored * E[i], mirrored * E[i + _ONE]
            s2, s3 = mirrored * E[i + _TWO], mirrored * E[i + _THREE]
            q0 = values[p]
            q1 = values[p + _ONE]
            q2 = values[p + _TWO]
            H[i] += q0 * a0 + q1 * b0 + q2 * c0
            H[i + _ONE] += q0 * a1 + q1 * b1 + q2 * c1
            H[i + _TWO] += q0 * a2 + q1 * b2 + q2 * c2
            H[i + _THREE] += q0 * a3 + q1 * b3 + q2 * c3
            a4 += q0 * s0
            a5 += q0 * s1
            a6 += q0 * s2
            a7 += q0 * s3
            b4 += q1 * s0
            b5 += q1 * s1
            b6 += q1 * s2
            b7 += q1 * s3
            c4 += q2 * s0
            c5 += q2 * s1
            c6 += q2 * s2
            c7 += q2 * s3
            p += further
    at = k
    H[at] += a4
    H[at + _ONE] += a5
    H[at + _TWO] += a6
    H[at + _THREE] += a7
    at = k + np.uint64(4)
    H[at] += b4
    H[at + _ONE] += b5
    H[at + _TWO] += b6
    H[at + _THREE] += b7
    at = k + np.uint64(8)
    H[at] += c4
    H[at + _ONE] += c5
    H[at + _TWO] += c6
    H[at + _THREE] += c7


@compile_inline
def multiply_one(
    values: FloatArray,
    others: IntArray,
    starts: IntArray,
    count: int,
    width: int,
    E: FloatArray,
    H: FloatArray,
    first: int,
    begin: IntArray,
    slot: int,
    slots: int,
    strip: int,
) -> None:
    """The same for a single column."""
    base, further = np.uint64(4 * first), np.uint64(width)
    k = base + np.uint64(4 * (begin[slot] + strip))
    at = k
    a0, a1, a2, a3 = E[at], E[at + _ONE], E[at + _TWO], E[at + _THREE]
    a4, a5, a6, a7 = 0.0, 0.0, 0.0, 0.0
    for visit in range(count):
        other, p = others[visit], np.uint64(starts[visit] + strip)
        mirrored = 0.0 if other == slot else 1.0
        for row in range(begin[other], begin[other + 1]):
            i = base + np.uint64(4 * row)
            s0, s1 = mirrored * E[i], mirrored * E[i + _ONE]
            s2, s3 = mirrored * E[i + _TWO], mirrored * E[i + _THREE]
            q0 = values[p]
            H[i] += q0 * a0
            H[i + _ONE] += q0 * a1
            H[i + _TWO] += q0 * a2
            H[i + _THREE] += q0 * a3
            a4 += q0 * s0
            a5 += q0 * s1
            a6 += q0 * s2
            a7 += q0 * s3
            p += further
    at = k
    H[at] += a4
    H[at + _ONE] += a5
    H[at + _TWO] += a6
    H[at + _THREE] += a7


@compile_inline
def multiply_column_of_point(
    values: FloatArray,
    others: IntArray,
    starts: IntArray,
    count: int,
    width: int,
    E: FloatArray,
    H: FloatArray,
    first: int,
    begin: IntArray,
    slot: int,
    slots: int,
) -> None:
    """Add to the products H what the blocks of a column and their mirror images make of E.

    Diagonal blocks hold both triangles, and have no mirror image.
    """
    strip = 0
    while width - strip >= 3:
        multiply_three(values, others, starts, count, width, E, H, first, begin, slot, slots, strip)
        strip += 3
    while strip < width:
        multiply_one(values, others, starts, count, width, E, H, first, begin, slot, slots, strip)
        strip += 1
