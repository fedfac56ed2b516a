"""Values moved between matrix, front and parent: compiled, or in plain numpy.

A front is three column-major arrays: ``pivots`` (k, k) and ``below`` (r, k) with its first k columns, and
``rest`` (r, r), of which only the lower triangle counts while factorising. Stored blocks are told by where they
start in the flat values, their height and width, the row and column of the front they go to, and whether they
enter it transposed.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mor import compilation
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.sparse.compiled import fronts as kernels

Blocks = tuple[IntArray, IntArray, IntArray, IntArray, IntArray, BoolArray]
"""Start, height, width, row, column, transposed of the stored blocks of a front."""


def assemble(values: FloatArray, blocks: Blocks, pivots: FloatArray, below: FloatArray) -> None:
    """Copy stored blocks of the matrix into the first columns of a front."""
    if compilation.wanted():
        kernels.assemble(values, *blocks, pivots, below)
        return
    for stored, place in _places(values, blocks, pivots, below):
        place[...] = stored


def extract(values: FloatArray, blocks: Blocks, pivots: FloatArray, below: FloatArray) -> None:
    """Copy entries of the first columns of a front back to the stored blocks: ``assemble`` reversed."""
    if compilation.wanted():
        kernels.extract(values, *blocks, pivots, below)
        return
    for stored, place in _places(values, blocks, pivots, below):
        stored[...] = place


def _places(
    values: FloatArray, blocks: Blocks, pivots: FloatArray, below: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Each stored block and its place in the front, both as views of the same shape."""
    k = pivots.shape[0]
    for start, h, w, row, column, transposed in zip(*(part.tolist() for part in blocks), strict=True):
        stored = values[start : start + h * w].reshape(h, w)
        stored = stored.T if transposed else stored
        array, first = (pivots, row) if row < k else (below, row - k)
        yield stored, array[first : first + stored.shape[0], column : column + stored.shape[1]]


def extend_add(
    update: FloatArray, places: IntArray, pivots: FloatArray, below: FloatArray, rest: FloatArray
) -> None:
    """Add the lower triangle of a child's update to the parent's rows ``places`` (ascending)."""
    if compilation.wanted():
        kernels.extend_add(update, places, pivots, below, rest)
        return
    k = pivots.shape[0]
    split = int(np.searchsorted(places, k))
    inside, beyond = places[:split], places[split:] - k
    lower = np.tril(update)
    pivots[np.ix_(inside, inside)] += lower[:split, :split]
    below[np.ix_(beyond, inside)] += lower[split:, :split]
    rest[np.ix_(beyond, beyond)] += lower[split:, split:]


def inherit(
    places: IntArray, pivots: FloatArray, below: FloatArray, rest: FloatArray, inherited: FloatArray
) -> None:
    """Copy the full symmetric (r, r) part at ``places`` (ascending) out of the parent's inverse."""
    if compilation.wanted():
        kernels.inherit(places, pivots, below, rest, inherited)
        return
    k = pivots.shape[0]
    split = int(np.searchsorted(places, k))
    inside, beyond = places[:split], places[split:] - k
    inherited[:split, :split] = pivots[np.ix_(inside, inside)]
    inherited[split:, :split] = below[np.ix_(beyond, inside)]
    inherited[:split, split:] = inherited[split:, :split].T
    inherited[split:, split:] = rest[np.ix_(beyond, beyond)]


def mirror(matrix: FloatArray) -> None:
    """Copy the lower triangle of a square matrix to its upper one."""
    if compilation.wanted():
        kernels.mirror(matrix)
        return
    upper = np.triu_indices(matrix.shape[0], 1)
    matrix[upper] = matrix.T[upper]
