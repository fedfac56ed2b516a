"""Values moved between matrix, front and parent: compiled, or in plain numpy.

A front is three column-major arrays: ``pivots`` (k, k) and ``below`` (r, k) with its first k columns, and
``rest`` (r, r), of which only the lower triangle counts while factorising.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mor import compilation
from mor.arrays import FloatArray, IntArray
from mor.sparse.compiled import fronts as kernels
from mor.sparse.symbolic_factorisation import Entries

_Move = Callable[..., None]


class Moves(NamedTuple):
    """The ways values go, each as in :mod:`mor.sparse.compiled.fronts`; asked for once, used for every front.

    Blocks of the matrix are those of front f among the ``Entries`` of the plan.
    """

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
    of_blocks = _by_blocks(kernels.assemble), _by_blocks(kernels.extract)
    return Moves(*of_blocks, kernels.extend_add, kernels.inherit, kernels.mirror)


def _by_blocks(kernel: _Move) -> _Move:
    def move(values: FloatArray, entries: Entries, f: int, *front: FloatArray) -> None:
        kernel(values, *entries.of_front(f), *front)

    return move


def _assemble(values: FloatArray, entries: Entries, f: int, pivots: FloatArray, below: FloatArray) -> None:
    found = entries.scalars_of_front(f, pivots.shape[0], below.shape[0])
    pivots.reshape(-1, order="F")[found.in_pivots] = values[found.to_pivots]
    below.reshape(-1, order="F")[found.in_below] = values[found.to_below]


def _extract(values: FloatArray, entries: Entries, f: int, pivots: FloatArray, below: FloatArray) -> None:
    found = entries.scalars_of_front(f, pivots.shape[0], below.shape[0])
    values[found.to_pivots] = pivots.reshape(-1, order="F")[found.in_pivots]
    values[found.to_below] = below.reshape(-1, order="F")[found.in_below]


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
