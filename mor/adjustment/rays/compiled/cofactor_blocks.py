"""Kernels that multiply the coupling of a single point with one block of R, and with its mirror image.

A block is worked on in strips of six columns, then two, then single ones; what belongs to the columns stays in
registers. It begins at ``start`` in the values, row by row, ``width`` numbers in a row. The couplings E and the
products H are (m, 4), flat, the fourth number zero, so that a number of a block is fetched once, and meets the three
of the point side by side. Those of the rows are ``first:end``, those of the first column of the strip begin at ``at``.
Rows and columns may be the same ones.
"""

from __future__ import annotations

from mor.arrays import FloatArray
from mor.compilation import compile_inline
from mor.registers import each, four, put, same


@compile_inline
def multiply_block(
    values: FloatArray,
    start: int,
    width: int,
    E: FloatArray,
    H: FloatArray,
    first: int,
    end: int,
    column: int,
) -> None:
    """Add to the products what a block, and its mirror image, make of E; those of its columns begin at ``column``."""
    strip = 0
    while width - strip >= 6:
        multiply_six(values, start + strip, width, E, H, first, end, column + 4 * strip)
        strip += 6
    while width - strip >= 2:
        multiply_two(values, start + strip, width, E, H, first, end, column + 4 * strip)
        strip += 2
    if strip < width:
        multiply_one(values, start + strip, width, E, H, first, end, column + 4 * strip)


@compile_inline
def multiply_six(
    values: FloatArray, start: int, width: int, E: FloatArray, H: FloatArray, first: int, end: int, at: int
) -> None:
    """The same for six columns."""
    a, b, c = four(E, at), four(E, at + 4), four(E, at + 8)
    d, e, f = four(E, at + 12), four(E, at + 16), four(E, at + 20)
    u, v, w, x, y, z = same(0.0), same(0.0), same(0.0), same(0.0), same(0.0), same(0.0)
    p = start
    for row in range(first, end, 4):
        own = four(E, row)
        k, m, n = each(values, p), each(values, p + 1), each(values, p + 2)
        q, r, s = each(values, p + 3), each(values, p + 4), each(values, p + 5)
        u, v, w = u + k * own, v + m * own, w + n * own
        x, y, z = x + q * own, y + r * own, z + s * own
        put(H, row, (four(H, row) + k * a + m * b + n * c) + (q * d + r * e + s * f))
        p += width
    put(H, at, four(H, at) + u)
    put(H, at + 4, four(H, at + 4) + v)
    put(H, at + 8, four(H, at + 8) + w)
    put(H, at + 12, four(H, at + 12) + x)
    put(H, at + 16, four(H, at + 16) + y)
    put(H, at + 20, four(H, at + 20) + z)


@compile_inline
def multiply_two(
    values: FloatArray, start: int, width: int, E: FloatArray, H: FloatArray, first: int, end: int, at: int
) -> None:
    """The same for two columns."""
    a, b, u, v = four(E, at), four(E, at + 4), same(0.0), same(0.0)
    p = start
    for row in range(first, end, 4):
        own, k, m = four(E, row), each(values, p), each(values, p + 1)
        u, v = u + k * own, v + m * own
        put(H, row, four(H, row) + k * a + m * b)
        p += width
    put(H, at, four(H, at) + u)
    put(H, at + 4, four(H, at + 4) + v)


@compile_inline
def multiply_one(
    values: FloatArray, start: int, width: int, E: FloatArray, H: FloatArray, first: int, end: int, at: int
) -> None:
    """The same for a single column."""
    a, u = four(E, at), same(0.0)
    p = start
    for row in range(first, end, 4):
        own, k = four(E, row), each(values, p)
        u = u + k * own
        put(H, row, four(H, row) + k * a)
        p += width
    put(H, at, four(H, at) + u)
