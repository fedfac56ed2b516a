"""Kernels that bring rays into the order of their points."""

from __future__ import annotations

import numpy as np

from mor.arrays import IntArray, SmallIntArray
from mor.compilation import compile_kernel


@compile_kernel
def by_point_and_frame(point: IntArray, frame: IntArray, points: int) -> tuple[IntArray, IntArray]:
    """Return pointers (points+1,) and the order of the rays by point, then by frame; points < 0 are left out."""
    pointers = np.zeros(points + 1, dtype=np.int64)
    for i in range(point.size):
        if point[i] >= 0:
            pointers[point[i] + 1] += 1
    for p in range(points):
        pointers[p + 1] += pointers[p]
    order = np.empty(pointers[points], dtype=np.int64)
    used = np.zeros(points, dtype=np.int64)
    for i in range(point.size):
        p = point[i]
        if p < 0:
            continue
        at = pointers[p] + used[p]
        used[p] += 1
        while at > pointers[p] and frame[order[at - 1]] > frame[i]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = i
    return pointers, order


@compile_kernel
def local_numbers(
    frame: IntArray, first: IntArray, frames: int, local: SmallIntArray
) -> tuple[IntArray, IntArray]:
    """Number the frames of each chunk from 0, in order of first appearance.

    ``first`` (c+1,) are the chunks' first rays; sets ``local`` (n,). Returns pointers (c+1,) and the frames of each
    chunk.
    """
    pointers = np.zeros(first.size, dtype=np.int64)
    found = np.empty(max(16, 2 * frames), dtype=np.int64)
    number = np.full(frames, -1, dtype=np.int64)
    count = 0
    for c in range(first.size - 1):
        begin = count
        for i in range(first[c], first[c + 1]):
            f = frame[i]
            if number[f] < begin:
                if count == found.size:
                    larger = np.empty(2 * found.size, dtype=np.int64)
                    larger[:count] = found
                    found = larger
                number[f] = count
                found[count] = f
                count += 1
            local[i] = number[f] - begin
        pointers[c + 1] = count
    return pointers, found[:count].copy()
