"""Selected inverse: those blocks of N⁻¹ that lie on the pattern of N, from its Cholesky factor.

K. Takahashi, J. Fagan, M.-S. Chin (1973) obtain them from the top of the elimination tree downwards. In the
fronts, with N⁻¹ = Z and Y = L21 L11⁻¹, and Z22 inherited from the parent:

    Z21 = −Z22 Y,        Z11 = (L11 L11ᵀ)⁻¹ − Yᵀ Z21.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg.blas import dgemm, dtrsm
from scipy.linalg.lapack import dpotri

from mor.linalg.block_matrix import BlockMatrix
from mor.linalg.cholesky import Factor, FrontOperations, alike, moves, threads_for
from mor.linalg.symbolic import Elimination
from mor.long_arrays import kept
from mor.types import FloatArray

Watcher = Callable[[float], None]
"""Told how many more operations are done."""


def selected_inverse(factor: Factor, watch: Watcher | None = None) -> BlockMatrix:
    """Return the blocks of N⁻¹ on the pattern of N; rows and columns of unknowns set aside are zero.

    Exact, not an approximation: every entry equals that of the full inverse (of N without the rows and
    columns of the unknowns set aside). ``watch`` is told some hundred times how far it is.
    """
    plan = factor.elimination
    tellings = _tellings(plan) if watch is not None else {}
    values = np.zeros(int(plan.structure.position[-1]))
    move = moves()
    waiting = np.bincount(plan.parent[plan.parent >= 0], minlength=plan.fronts)
    inverses: dict[int, tuple[FloatArray, FloatArray, FloatArray]] = {}
    for order, run in reversed(alike(plan.orders)):
        with threads_for(order):
            for f in reversed(run):
                parent = int(plan.parent[f])
                places = plan.row_in_parent[plan.row_pointers[f] : plan.row_pointers[f + 1]]
                rest = np.empty((places.size, places.size), order="F")
                if places.size:
                    move.inherit(places, *inverses[parent], rest)
                pivots, below = _inverse_of_front(move, factor, f, rest)
                move.extract(values, plan.entries, f, pivots, below)
                if watch is not None and f in tellings:
                    watch(tellings[f])
                if waiting[f]:
                    inverses[f] = kept(pivots.T).T, kept(below.T).T, kept(rest.T).T
                if parent >= 0:
                    waiting[parent] -= 1
                    if waiting[parent] == 0:
                        del inverses[parent]
    return BlockMatrix(plan.structure, values)


def operations(plan: Elimination) -> FloatArray:
    """(f,) floating point operations of the selected inverse in each front."""
    k, r = plan.pivots.astype(float), np.diff(plan.row_pointers).astype(float)
    count: FloatArray = 2.0 / 3.0 * k**3 + 3.0 * k**2 * r + 2.0 * k * r**2
    return count


def _tellings(plan: Elimination) -> dict[int, float]:
    done = np.cumsum(operations(plan)[::-1])
    if len(done) == 0:
        return {}
    steps = np.floor(done * (100 / done[-1]))
    ends = np.flatnonzero(np.diff(steps, prepend=0.0) > 0.0)
    return dict(zip((len(done) - 1 - ends).tolist(), np.diff(done[ends], prepend=0.0).tolist(), strict=True))


def _inverse_of_front(move: FrontOperations, factor: Factor, f: int, rest: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Z11 (k, k), both triangles, and Z21 (r, k) of a front whose Z22 is known."""
    plan = factor.elimination
    pivots, _ = dpotri(factor.pivots[f], lower=1)
    first, end = plan.pivot_pointers[f : f + 2]
    within = slice(*np.searchsorted(factor.set_aside_places, (first, end)))
    vanished = factor.set_aside_places[within] - first
    pivots[vanished, vanished] = 0.0
    move.mirror(pivots)
    below = np.empty((0, pivots.shape[0]), order="F")
    if rest.size:
        ratio = dtrsm(1.0, factor.pivots[f], factor.below[f], side=1, lower=1)
        below = dgemm(-1.0, rest, ratio)
        pivots = dgemm(-1.0, ratio, below, beta=1.0, c=pivots, trans_a=1, overwrite_c=1)
    return pivots, below
