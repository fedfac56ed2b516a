"""Multifrontal Cholesky factorisation of a symmetric positive semidefinite block matrix.

Front after front, children first: gather the entries of the matrix and the updates of the children, factorise
the k × k pivot block (L11), solve for the r × k block below it (L21), and hand the update −L21 L21ᵀ on to the
parent. Everything dense is LAPACK. A pivot that vanishes is set aside instead of failing: its unknown is
fixed at zero, and what remains is the factorisation of the matrix without its row and column.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg.blas import dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf

from mor.arrays import FloatArray, IntArray
from mor.sparse.blas_threads import alike, one_thread, threads_for
from mor.sparse.block_matrix import BlockMatrix
from mor.sparse.compiled.fronts import factor_setting_aside
from mor.sparse.fronts import Moves, moves
from mor.sparse.symbolic_factorisation import Elimination

# A pivot of a matrix with unit diagonal is 1 − R², R the multiple correlation with what was eliminated
# before. It is a difference of numbers of order one; its round-off is some 1e-16 times the growth, seldom
# above 1e-12.
TOLERANCE = 1e-10
# Below this order vanishing pivots are looked for column by column; above it the matrix is halved first.
_HALVE_ABOVE = 64
_NONE = np.empty(0, dtype=np.int64)
_Front = tuple[FloatArray, FloatArray, FloatArray]


class NotFiniteError(ValueError):
    """A matrix contains infinities or not-a-numbers."""


@dataclass(frozen=True)
class Factor:
    """Cholesky factor, front by front.

    Attributes:
        elimination: the plan it follows.
        pivots: for each front L11 (k, k), column-major, lower triangle; what stands above is undefined.
        below: for each front L21 (r, k), column-major.
        set_aside: scalar unknowns whose pivot vanished, ascending.
        set_aside_places: their places in the order of elimination, ascending.
    """

    elimination: Elimination
    pivots: tuple[FloatArray, ...]
    below: tuple[FloatArray, ...]
    set_aside: IntArray
    set_aside_places: IntArray

    @property
    def smallest_pivot(self) -> float:
        """Smallest pivot, squared as in N = L D Lᵀ; 0 if unknowns are set aside."""
        if len(self.set_aside):
            return 0.0
        return min(
            (float(np.square(front.diagonal()).min()) for front in self.pivots if front.size), default=np.inf
        )

    def solve(self, right_hand_side: FloatArray) -> FloatArray:
        """Return x of N x = b for b (n,) or (n, k); unknowns set aside are held at zero.

        Equations of unknowns set aside are not looked at: a consistent right-hand side fulfils them by
        itself.
        """
        plan = self.elimination
        columns = right_hand_side[:, None] if right_hand_side.ndim == 1 else right_hand_side
        if columns.shape[1] == 0:  # a network whose datum is settled has no direction to be anchored
            return np.zeros(columns.shape)
        x = np.ascontiguousarray(columns[plan.permutation], dtype=np.float64)
        with one_thread():
            self._forward(x, plan.fronts)
            self._backward(x, plan.fronts)
        solution = np.empty_like(x)
        solution[plan.permutation] = x
        return solution.reshape(right_hand_side.shape)

    def reduce(self, right_hand_side: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Of a factor without its last front: y of L y = b (n, k), and what is left of b for the last front (p, k)."""
        plan = self.elimination
        x = np.ascontiguousarray(right_hand_side[plan.permutation], dtype=np.float64)
        with one_thread():
            self._forward(x, plan.fronts - 1)
        return x, x[plan.pivot_pointers[-2] :].copy()

    def follow(self, y: FloatArray, last: FloatArray) -> FloatArray:
        """Of a factor without its last front: x (n, k) of Lᵀ x = y, the unknowns of the last front given (p, k)."""
        plan = self.elimination
        x = y.copy()
        x[plan.pivot_pointers[-2] :] = last
        with one_thread():
            self._backward(x, plan.fronts - 1)
        solution = np.empty_like(x)
        solution[plan.permutation] = x
        return solution

    def _forward(self, x: FloatArray, fronts: int) -> None:
        """Replace x (permuted) by the solution of L y = x, in the first fronts."""
        plan = self.elimination
        vanished = np.zeros(x.shape[0], dtype=bool)
        vanished[self.set_aside_places] = True
        for f in range(fronts):
            first, end = plan.pivot_pointers[f], plan.pivot_pointers[f + 1]
            x[first:end][vanished[first:end]] = 0.0
            if not x[first:end].any():  # a right-hand side of few unknowns reaches few fronts
                continue
            # A row-major slice is its own transpose in column-major order: yᵀ = xᵀ L11⁻ᵀ, in place.
            y = dtrsm(1.0, self.pivots[f], x[first:end].T, side=1, lower=1, trans_a=1, overwrite_b=1).T
            x[first:end] = y
            if self.below[f].size:
                x[plan.rows[plan.row_pointers[f] : plan.row_pointers[f + 1]]] -= self.below[f] @ y

    def _backward(self, x: FloatArray, fronts: int) -> None:
        """Replace x (permuted) by the solution of Lᵀ z = x, in the first fronts."""
        plan = self.elimination
        for f in range(fronts - 1, -1, -1):
            first, end = plan.pivot_pointers[f], plan.pivot_pointers[f + 1]
            y = x[first:end]
            if self.below[f].size:
                y = y - self.below[f].T @ x[plan.rows[plan.row_pointers[f] : plan.row_pointers[f + 1]]]
            x[first:end] = dtrsm(1.0, self.pivots[f], y.T, side=1, lower=1, trans_a=0, overwrite_b=1).T


@dataclass(frozen=True)
class Completed(Factor):
    """A factor without its last front, and the inverse of that front where others have a say in it, too.

    What it solves is part of a larger system: right-hand sides have nothing outside of this part.
    """

    last: FloatArray
    """(p, p) that inverse, both triangles."""

    def solve(self, right_hand_side: FloatArray) -> FloatArray:
        """As that of a whole factor."""
        y, left = self.reduce(right_hand_side.reshape(len(right_hand_side), -1))
        return self.follow(y, self.last @ left).reshape(right_hand_side.shape)


def completed(factor: Factor, last: FloatArray) -> Completed:
    """A factor without its last front with the inverse (p, p) of that front."""
    return Completed(
        factor.elimination, factor.pivots, factor.below, factor.set_aside, factor.set_aside_places, last
    )


def factorise(matrix: BlockMatrix, elimination: Elimination, tolerance: float = TOLERANCE) -> Factor:
    """Return the Cholesky factor of a symmetric positive semidefinite matrix scaled to unit diagonal.

    Args:
        matrix: the matrix; of its diagonal blocks only the lower triangles are read.
        elimination: the plan made for its pattern.
        tolerance: pivots below it, negative ones included, are set aside.

    Raises:
        NotFiniteError: the matrix contains infinities or not-a-numbers.
    """
    _refuse_not_finite(matrix)
    return _eliminated(matrix, elimination, tolerance, elimination.fronts)


def _refuse_not_finite(matrix: BlockMatrix) -> None:
    if not np.isfinite(
        matrix.values.sum()
    ):  # whatever is not finite shows in the sum, and it is five times as fast
        raise NotFiniteError("the normal matrix contains values that are not finite")


def _eliminated(matrix: BlockMatrix, elimination: Elimination, tolerance: float, fronts: int) -> Factor:
    """The factor of the first ``fronts`` fronts; those after them are assembled only."""
    updates: dict[int, list[tuple[FloatArray, IntArray]]] = {}
    pivots, below = _room_for(elimination)
    move = moves()
    set_aside = [np.empty(0, dtype=np.int64)]
    for order, run in alike(elimination.orders):
        with threads_for(order):
            for f in run:
                children = updates.pop(f, [])
                front = partial(
                    _assembled_front, move, matrix.values, elimination, f, pivots[f], below[f], children
                )
                if f >= fronts:
                    front()
                    continue
                rest, vanished = _factor_front(front, tolerance)
                if vanished.size:
                    set_aside.append(vanished + elimination.pivot_pointers[f])
                if rest.size:
                    rows = slice(elimination.row_pointers[f], elimination.row_pointers[f + 1])
                    of_parent = updates.setdefault(int(elimination.parent[f]), [])
                    of_parent.append((rest, elimination.row_in_parent[rows]))
    at = np.concatenate(set_aside)
    return Factor(elimination, tuple(pivots), tuple(below), np.sort(elimination.permutation[at]), at)


def _factor_front(assembled: Callable[[], _Front], tolerance: float) -> tuple[FloatArray, IntArray]:
    """Replace pivots and what is below them by L11 and L21; return what is left for the parent, and vanished pivots."""
    pivots, below, rest = assembled()
    factor, vanished = _factor_in_place(pivots, tolerance), _NONE
    if factor is None:  # the assembled pivots are gone, and are needed once more
        pivots[...], below[...] = 0.0, 0.0
        pivots, below, rest = assembled()
        factor, vanished = _factor_dense(pivots, tolerance)
    _keep(factor, pivots)
    _keep(_below(factor, vanished, below, rest), below)
    return rest, vanished


def _room_for(plan: Elimination) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return zeros for L11 and L21 of each front, as parts of two arrays.

    Thousands of arrays of their own, made anew with every factorisation, leave the memory full of holes.
    """
    k, r = plan.pivots, np.diff(plan.row_pointers)
    return _parts(k, k), _parts(r, k)


def _parts(rows: IntArray, columns: IntArray) -> list[FloatArray]:
    ends = np.cumsum(rows * columns)
    whole = np.zeros(int(ends[-1]) if ends.size else 0)
    return [
        whole[end - m * n : end].reshape((m, n), order="F")
        for m, n, end in zip(rows.tolist(), columns.tolist(), ends.tolist(), strict=True)
    ]


def _keep(found: FloatArray, place: FloatArray) -> None:
    """Copy what was found to its place, unless LAPACK has worked there."""
    if not np.may_share_memory(found, place):
        place[...] = found


def _assembled_front(
    move: Moves,
    values: FloatArray,
    plan: Elimination,
    f: int,
    pivots: FloatArray,
    below: FloatArray,
    updates: list[tuple[FloatArray, IntArray]],
) -> _Front:
    """Return the arrays (pivots, below, rest) of a front with the matrix and the children's updates in it.

    ``pivots`` (k, k) and ``below`` (r, k) are zeros to be used.
    """
    r = below.shape[0]
    rest = np.zeros((r, r), order="F")
    move.assemble(values, plan.entries, f, pivots, below)
    for update, places in updates:
        move.extend_add(update, places, pivots, below, rest)
    return pivots, below, rest


def _factor_in_place(matrix: FloatArray, tolerance: float) -> FloatArray | None:
    """Return the Cholesky factor in the place of the matrix; nothing if a pivot vanishes, the matrix being lost."""
    factor, failed = dpotrf(matrix, lower=1, clean=0, overwrite_a=1)
    return None if failed or np.square(factor.diagonal()).min(initial=1.0) < tolerance else factor


def _below(factor: FloatArray, vanished: IntArray, below: FloatArray, rest: FloatArray) -> FloatArray:
    """Return L21; subtract L21 L21ᵀ from the lower half of ``rest`` in place."""
    if not below.size:
        return below
    lower: FloatArray = dtrsm(1.0, factor, below, side=1, lower=1, trans_a=1, overwrite_b=1)
    lower[:, vanished] = 0.0
    dsyrk(-1.0, lower, beta=1.0, c=rest, lower=1, overwrite_c=1)
    return lower


def _factor_dense(matrix: FloatArray, tolerance: float) -> tuple[FloatArray, IntArray]:
    """Return the Cholesky factor (lower triangle, column-major) of a dense matrix and the pivots set aside.

    LAPACK does it in one go unless a pivot vanishes. Then the matrix is halved, so that all but the few
    columns around the vanishing pivots still go through LAPACK.
    """
    factor = _factor_in_place(matrix.copy(order="F"), tolerance)
    if factor is not None:
        return factor, _NONE
    factor = matrix.copy(order="F")
    size = matrix.shape[0]
    if size <= _HALVE_ABOVE:
        vanished = np.zeros(size, dtype=bool)
        factor_setting_aside(factor, tolerance, vanished)
        return factor, np.flatnonzero(vanished)
    half = size // 2
    rest = factor[half:, half:].copy(order="F")
    upper, before = _factor_dense(factor[:half, :half], tolerance)
    lower = _below(upper, before, factor[half:, :half].copy(order="F"), rest)
    remainder, after = _factor_dense(rest, tolerance)
    lower[after] = 0.0
    factor[:half, :half], factor[half:, :half], factor[half:, half:] = upper, lower, remainder
    return factor, np.concatenate((before, after + half))
