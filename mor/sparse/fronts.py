"""Values moved between matrix, front and parent: compiled, or in plain numpy.

A front is three column-major arrays: ``pivots`` (k, k) and ``below`` (r, k) with its first k columns, and
``rest`` (r, r), of which only the lower triangle counts while factorising.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from mor import compilation
from mor.arrays import FloatArray, IntArray
from mor.sparse.compiled import fronts as kernels

_Move = Callable[..., None]


class Moves(NamedTuple):
    """The ways values go, each as in :mod:`mor.sparse.compiled.fronts`; asked for once, used for every front."""

    assemble: _Move
    """Copy stored blocks of the matrix into the first columns of a front."""
    extract: _Move
    """Copy entries of the first columns of a front back to the stored blocks."""
    extend_add: _Move
    """Add the lower triangle of a child's update to the parent's rows."""
    inherit: _Move
    """Copy a part of the parent's inverse."""
    mirror: _Move
    """Copy the lower triangle of a square matrix to its upper one."""


def moves() -> Moves:
    """Compiled ones where kernels are wanted, plain ones elsewhere."""
    if not compilation.wanted():
        return Moves(_assemble, _extract, _extend_add, _inherit, _mirror)
    of = (kernels.assemble, kernels.extract, kernels.extend_add, kernels.inherit, kernels.mirror)
    return Moves(*(kernel.compiled for kernel in of))


def _assemble(values: FloatArray, *front: Any) -> None:
    for stored, place in _places(values, *front):
        place[...] = stored


def _extract(values: FloatArray, *front: Any) -> None:
    for stored, place in _places(values, *front):
        stored[...] = place


def _places(values: FloatArray, *front: Any) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Each stored block and its place in the front, both as views of the same shape."""
    *blocks, pivots, below = front
    k = pivots.shape[0]
    for start, h, w, row, column, transposed in zip(*(part.tolist() for part in blocks), strict=True):
        stored = values[start : start + h * w].reshape(h, w)
        stored = stored.T if transposed else stored
        array, first = (pivots, row) if row < k else (below, row - k)
        yield stored, array[first : first + stored.shape[0], column : column + stored.shape[1]]


def _extend_add(
    update: FloatArray, places: IntArray, pivots: FloatArray, below: FloatArray, rest: FloatArray
) -> None:
    k = pivots.shape[0]
    split = int(np.searchsorted(places, k))
    inside, beyond = places[:split], places[split:] - k
    lower = np.tril(update)
    pivots[np.ix_(inside, inside)] += lower[:split, :split]
    below[np.ix_(beyond, inside)] += lower[split:, :split]
    rest[np.ix_(beyond, beyond)] += lower[split:, split:]


def _inherit(
    places: IntArray, pivots: FloatArray, below: FloatArray, rest: FloatArray, inherited: FloatArray
) -> None:
    k = pivots.shape[0]
    split = int(np.searchsorted(places, k))
    inside, beyond = places[:split], places[split:] - k
    inherited[:split, :split] = pivots[np.ix_(inside, inside)]
    inherited[split:, :split] = below[np.ix_(beyond, inside)]
    inherited[:split, split:] = inherited[split:, :split].T
    inherited[split:, split:] = rest[np.ix_(beyond, beyond)]


def _mirror(matrix: FloatArray) -> None:
    upper = np.triu_indices(matrix.shape[0], 1)
    matrix[upper] = matrix.T[upper]
