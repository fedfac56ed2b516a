"""Kernels of the store in which groups of points wait until they reach the blocks of the reduced system
together.

It is the way to the memory that costs, not the arithmetic. The blocks of the reduced system are therefore
visited in strips of columns that stay in the cache, and every strip by all groups in the store.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.rays.compiled.cliques import Clique, Met, Runs, merge
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_inline, compile_kernel
from mor.registers import fetch

STRIP = 60_000
"""Numbers in a strip of columns of the reduced system, 0.5 MB: it stays in the cache while the store goes by."""
SMALL_STORE, LARGE_STORE = 200_000, 1_000_000
"""Numbers in a store: 1.6 MB, which stays in the cache itself, to 8 MB. See ``size_of_store``."""

AHEAD, NUMBERS_AHEAD = 4, 40
"""How many blocks ahead of the one that is worked on are fetched, and how much of each: 6 × 6, beginning anywhere."""


class Store(NamedTuple):
    """Groups of points with the same unknowns.

    Attributes:
        couplings: group after group, those of its points with its m unknowns, (3, m) or (m, 4).
        first_coupling: (groups+1,) where those of a group start.
        points: (groups,) number of points.
        blocks: group after group, ascending block numbers of its unknowns.
        begin: the first local unknown of each of these blocks, and behind them the number of unknowns.
        first_block: (groups+1,) where the blocks of a group start; ``begin`` has one entry more for each group.
    """

    couplings: FloatArray
    first_coupling: IntArray
    points: IntArray
    blocks: IntArray
    begin: IntArray
    first_block: IntArray


@compile_kernel
def size_of_store(met: Met, largest: int) -> int:
    """Return the numbers of a store for these blocks: a quarter of those of their system, within limits.

    Every emptying goes through the whole system. Where that is larger than the cache, and points are seen by images at
    random, it should be a seldom one.
    """
    unknowns = met.size.sum()
    return int(max(SMALL_STORE, min(unknowns * unknowns // 8, largest)))


@compile_kernel
def store_for(numbers: int) -> Store:
    """Return an empty store for so many couplings."""
    points = numbers // 3 + 2
    return Store(
        np.empty(numbers),
        np.zeros(points + 1, dtype=np.int64),
        np.zeros(points, dtype=np.int64),
        np.empty(points, dtype=np.int64),
        np.empty(2 * points, dtype=np.int64),
        np.zeros(points + 1, dtype=np.int64),
    )


@compile_inline
def is_full(store: Store, groups: int, numbers: int) -> bool:
    """Return whether there may be no room for another group with a point whose coupling takes so many numbers."""
    return groups + 1 >= store.points.size or store.first_coupling[groups] + numbers > store.couplings.size


@compile_kernel
def open_group(
    store: Store, groups: int, frame: IntArray, first_ray: int, end: int, runs: Runs, met: Met, clique: Clique
) -> int:
    """Append a group without points, for those with the frames of these rays; return the number of its unknowns."""
    count = merge(frame, first_ray, end, runs, met, clique)
    first = store.first_block[groups]
    for slot in range(count):
        store.blocks[first + slot] = clique.blocks[slot]
    for slot in range(count + 1):
        store.begin[groups + first + slot] = clique.begin[slot]
    store.first_block[groups + 1] = first + count
    store.first_coupling[groups + 1] = store.first_coupling[groups]
    store.points[groups] = 0
    return int(clique.begin[count])


@compile_inline
def append_point(store: Store, groups: int, numbers: int) -> int:
    """Append a point to the last of so many groups; return where its coupling of so many numbers starts."""
    first = store.first_coupling[groups]
    store.first_coupling[groups] = first + numbers
    store.points[groups - 1] += 1
    return int(first)


@compile_kernel
def end_of_strip(first: int, size: IntArray, most: int) -> int:
    """Return the end of the strip of met blocks, of these sizes, that begins with ``first``, with so many numbers."""
    below = size[first:].sum()
    last, numbers = first, 0
    while last < size.size and (last == first or numbers + size[last] * below <= most):
        numbers += size[last] * below
        below -= size[last]
        last += 1
    return last


@compile_inline
def end_in_strip(blocks: IntArray, first: int, end: int, last: int) -> int:
    """Return the end of the ascending blocks ``blocks[first:end]`` that lie before the end ``last`` of a strip."""
    while first < end and blocks[first] < last:
        first += 1
    return first


@compile_kernel
def room_for_pairs(store: Store, groups: int) -> IntArray:
    """Return room for the pairs of blocks (n, 3) of the largest group."""
    most = 0
    for g in range(groups):
        most = max(most, store.first_block[g + 1] - store.first_block[g])
    return np.empty((most * (most + 1) // 2, 3), dtype=np.int64)


@compile_inline
def fetch_block(values: FloatArray, start: int) -> None:
    """Have a block brought into the cache that will be worked on soon."""
    for line in range(0, NUMBERS_AHEAD, 8):
        fetch(values, start + line)
