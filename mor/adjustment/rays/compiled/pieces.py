"""Kernels that cut points into pieces of so many rays that what is worked out of them stays in the cache."""

from __future__ import annotations

from mor.arrays import IntArray
from mor.compilation import compile_kernel


@compile_kernel
def end_of_piece(pointers: IntArray, first: int, rays: int) -> int:
    """Return the end of the points of the piece of so many rays that begins with the point ``first``, one at least."""
    last = first + 1
    while last < pointers.size - 1 and pointers[last + 1] - pointers[first] <= rays:
        last += 1
    return last


@compile_kernel
def largest_piece(pointers: IntArray, rays: int) -> int:
    """Return the largest number of rays of a piece."""
    largest = 0
    for p in range(pointers.size - 1):
        largest = max(largest, pointers[p + 1] - pointers[p])
    return int(max(largest, min(rays, pointers[-1] - pointers[0])))
