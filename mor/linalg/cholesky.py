"""Multifrontal Cholesky factorisation."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cache, partial
from itertools import groupby
from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

from mor import long_arrays
from mor.linalg import compilation
from mor.linalg.block_matrix import BlockMatrix
from mor.linalg.compilation import compile_kernel
from mor.linalg.symbolic import Elimination, Entries
from mor.types import BoolArray, FloatArray, IntArray

# ---- Number of threads of dense linear algebra.
#
# Threads wake up and spin for every call. On the small fronts of a sparse factorisation that costs far more
# than it gains (on a busy machine a thousandfold), so they are let loose on large fronts only, each by itself.

# Order of a dense matrix from which on several threads are worth waking. One thread factorises it in a tenth of a
# second; where another program has the second processor, two take ten times as long.
WORTH_THREADS = 2000


@cache
def _controller() -> ThreadpoolController:
    """Return the handle on the linear algebra libraries; looking for them takes milliseconds."""
    return ThreadpoolController()


def threads_for(order: int) -> AbstractContextManager[object]:
    """Return a context in which matrices of this order are worked on: one thread unless they are large."""
    if order >= WORTH_THREADS:
        return nullcontext()
    return one_thread()


def alike(orders: IntArray) -> list[tuple[int, range]]:
    """Runs of neighbouring fronts (f,), all of them large or none: the largest order of each run, and its places.

    A limit on threads takes as long as a small front.
    """
    runs, first = [], 0
    for _, run in groupby(orders.tolist(), key=lambda order: order >= WORTH_THREADS):
        own = list(run)
        runs.append((max(own), range(first, first + len(own))))
        first += len(own)
    return runs


def one_thread() -> AbstractContextManager[object]:
    """Return a context in which linear algebra has one thread: sums come out the same, wherever they are made."""
    limit: AbstractContextManager[object] = _controller().limit(limits=1, user_api="blas")
    return limit


# ---- Kernels that move values between matrix, front and parent, and the Cholesky step that sets pivots aside.
#
# A front is three column-major arrays: ``pivots`` (k, k) and ``below`` (r, k) with its first k columns, and
# ``rest`` (r, r), of which only the lower triangle counts while factorising.


@compile_kernel
def assemble(
    values: FloatArray,
    start: IntArray,
    height: IntArray,
    width: IntArray,
    row: IntArray,
    column: IntArray,
    transposed: BoolArray,
    pivots: FloatArray,
    below: FloatArray,
) -> None:
    """Copy stored blocks of the matrix into the first columns of a front."""
    k = pivots.shape[0]
    for e in range(start.size):
        target = pivots if row[e] < k else below
        first = row[e] if row[e] < k else row[e] - k
        place = start[e]
        if transposed[e]:
            for i in range(height[e]):
                for j in range(width[e]):
                    target[first + j, column[e] + i] = values[place]
                    place += 1
        else:
            for i in range(height[e]):
                for j in range(width[e]):
                    target[first + i, column[e] + j] = values[place]
                    place += 1


@compile_kernel
def extract(
    values: FloatArray,
    start: IntArray,
    height: IntArray,
    width: IntArray,
    row: IntArray,
    column: IntArray,
    transposed: BoolArray,
    pivots: FloatArray,
    below: FloatArray,
) -> None:
    """Copy entries of the first columns of a front back to the stored blocks: ``assemble`` reversed."""
    k = pivots.shape[0]
    for e in range(start.size):
        source = pivots if row[e] < k else below
        first = row[e] if row[e] < k else row[e] - k
        place = start[e]
        if transposed[e]:
            for i in range(height[e]):
                for j in range(width[e]):
                    values[place] = source[first + j, column[e] + i]
                    place += 1
        else:
            for i in range(height[e]):
                for j in range(width[e]):
                    values[place] = source[first + i, column[e] + j]
                    place += 1


@compile_kernel
def runs_of_places(places: IntArray, split: int) -> IntArray:
    """Return the bounds of runs of consecutive places; none reaches across ``split``."""
    bounds = np.empty(places.size + 1, dtype=np.int64)
    count = 0
    for i in range(places.size):
        if i == 0 or i == split or places[i] != places[i - 1] + 1:
            bounds[count] = i
            count += 1
    bounds[count] = places.size
    return bounds[: count + 1]


@compile_kernel
def add_to_column(
    update: FloatArray, places: IntArray, bounds: IntArray, first: int, shift: int, target: FloatArray
) -> None:
    """Add the entries of a column from ``first`` on to the rows ``places`` − ``shift`` of another one."""
    for r in range(bounds.size - 1):
        low, high = max(bounds[r], first), bounds[r + 1]
        if low < high:
            to = places[bounds[r]] - bounds[r] - shift
            one, other = update[low:high], target[to + low : to + high]
            for i in range(one.size):
                other[i] += one[i]


@compile_kernel
def extend_add(update: FloatArray, places: IntArray, pivots: FloatArray, below: FloatArray, rest: FloatArray) -> None:
    """Add the lower triangle of a child's update to the parent's rows ``places`` (ascending)."""
    k = pivots.shape[0]
    split = int(np.searchsorted(places, k))
    bounds = runs_of_places(places, split)
    upper = bounds[: np.searchsorted(bounds, split) + 1]
    lower = bounds[upper.size - 1 :]
    for j in range(split):
        add_to_column(update[:, j], places, upper, j, 0, pivots[:, places[j]])
        add_to_column(update[:, j], places, lower, split, k, below[:, places[j]])
    for j in range(split, places.size):
        add_to_column(update[:, j], places, lower, j, k, rest[:, places[j] - k])


@compile_kernel
def inherit(places: IntArray, pivots: FloatArray, below: FloatArray, rest: FloatArray, inherited: FloatArray) -> None:
    """Copy the full symmetric (r, r) part at ``places`` (ascending) out of the parent's inverse."""
    k = pivots.shape[0]
    split = np.searchsorted(places, k)
    for j in range(split):
        column = places[j]
        for i in range(split):
            inherited[i, j] = pivots[places[i], column]
        for i in range(split, places.size):
            inherited[i, j] = below[places[i] - k, column]
            inherited[j, i] = below[places[i] - k, column]
    for j in range(split, places.size):
        column = places[j] - k
        for i in range(split, places.size):
            inherited[i, j] = rest[places[i] - k, column]


@compile_kernel
def factor_setting_aside(matrix: FloatArray, tolerance: float, vanished: BoolArray) -> None:
    """Replace the lower triangle of a matrix by its Cholesky factor, column by column.

    A pivot below ``tolerance`` is set aside: its unknown is fixed, which leaves the row and the column of a
    unit matrix in the factor, and ``vanished`` is set there. This never fails, not even if indefinite.
    """
    size = matrix.shape[0]
    for j in range(size):
        pivot = matrix[j, j]
        if pivot < tolerance:
            vanished[j] = True
            matrix[j, :j] = 0.0
            matrix[j + 1 :, j] = 0.0
            matrix[j, j] = 1.0
            continue
        matrix[j:, j] /= np.sqrt(pivot)
        for i in range(j + 1, size):
            matrix[i:, i] -= matrix[i, j] * matrix[i:, j]


@compile_kernel
def mirror(matrix: FloatArray) -> None:
    """Copy the lower triangle of a square matrix to its upper one."""
    for j in range(matrix.shape[0]):
        for i in range(j + 1, matrix.shape[0]):
            matrix[j, i] = matrix[i, j]


# ---- Values moved between matrix, front and parent: compiled, or in plain numpy.
#
# A front is three column-major arrays: ``pivots`` (k, k) and ``below`` (r, k) with its first k columns, and
# ``rest`` (r, r), of which only the lower triangle counts while factorising.

_Move = Callable[..., None]


class FrontOperations(NamedTuple):
    """The ways values go, each as in :mod:`mor.linalg.cholesky`; asked for once, used for every front.

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


def moves() -> FrontOperations:
    """Compiled ones where kernels are wanted, plain ones elsewhere."""
    if not compilation.wanted():
        return FrontOperations(_assemble, _extract, _extend_add, _inherit, _mirror)
    of_blocks = _by_blocks(assemble), _by_blocks(extract)
    return FrontOperations(*of_blocks, extend_add, inherit, mirror)


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


def _extend_add(update: FloatArray, places: IntArray, pivots: FloatArray, below: FloatArray, rest: FloatArray) -> None:
    k = pivots.shape[0]
    split = int(np.searchsorted(places, k))
    inside, beyond = places[:split], places[split:] - k
    lower = np.tril(update)
    pivots[np.ix_(inside, inside)] += lower[:split, :split]
    below[np.ix_(beyond, inside)] += lower[split:, :split]
    rest[np.ix_(beyond, beyond)] += lower[split:, split:]


def _inherit(places: IntArray, pivots: FloatArray, below: FloatArray, rest: FloatArray, inherited: FloatArray) -> None:
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


# ---- Multifrontal Cholesky factorisation of a symmetric positive semidefinite block matrix.
#
# Front after front, children first: gather the entries of the matrix and the updates of the children, factorise
# the k × k pivot block (L11), solve for the r × k block below it (L21), and hand the update −L21 L21ᵀ on to the
# parent. Everything dense is LAPACK. A pivot that vanishes is set aside instead of failing: its unknown is
# fixed at zero, and what remains is the factorisation of the matrix without its row and column.

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
        return min((float(np.square(front.diagonal()).min()) for front in self.pivots if front.size), default=np.inf)

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
            self._forward(x)
            self._backward(x)
        solution = np.empty_like(x)
        solution[plan.permutation] = x
        return solution.reshape(right_hand_side.shape)

    def _forward(self, x: FloatArray) -> None:
        """Replace x (permuted) by the solution of L y = x."""
        plan = self.elimination
        vanished = np.zeros(x.shape[0], dtype=bool)
        vanished[self.set_aside_places] = True
        for f in range(plan.fronts):
            first, end = plan.pivot_pointers[f], plan.pivot_pointers[f + 1]
            x[first:end][vanished[first:end]] = 0.0
            if not x[first:end].any():  # a right-hand side of few unknowns reaches few fronts
                continue
            # A row-major slice is its own transpose in column-major order: yᵀ = xᵀ L11⁻ᵀ, in place.
            y = dtrsm(1.0, self.pivots[f], x[first:end].T, side=1, lower=1, trans_a=1, overwrite_b=1).T
            x[first:end] = y
            if self.below[f].size:
                x[plan.rows[plan.row_pointers[f] : plan.row_pointers[f + 1]]] -= self.below[f] @ y

    def _backward(self, x: FloatArray) -> None:
        """Replace x (permuted) by the solution of Lᵀ z = x."""
        plan = self.elimination
        for f in range(plan.fronts - 1, -1, -1):
            first, end = plan.pivot_pointers[f], plan.pivot_pointers[f + 1]
            y = x[first:end]
            if self.below[f].size:
                y = y - self.below[f].T @ x[plan.rows[plan.row_pointers[f] : plan.row_pointers[f + 1]]]
            x[first:end] = dtrsm(1.0, self.pivots[f], y.T, side=1, lower=1, trans_a=0, overwrite_b=1).T


def factorise(matrix: BlockMatrix, elimination: Elimination, tolerance: float = 1e-10) -> Factor:
    """Return the Cholesky factor of a symmetric positive semidefinite matrix scaled to unit diagonal.

    Args:
        matrix: the matrix; of its diagonal blocks only the lower triangles are read.
        elimination: the plan made for its pattern.
        tolerance: pivots below it, negative ones included, are set aside. A pivot is 1 − R², R the multiple
            correlation with what was eliminated before; its round-off is seldom above 1e-12.

    Raises:
        NotFiniteError: the matrix contains infinities or not-a-numbers.
    """
    _refuse_not_finite(matrix)
    return _eliminated(matrix, elimination, tolerance, elimination.fronts)


def _refuse_not_finite(matrix: BlockMatrix) -> None:
    if not np.isfinite(matrix.values.sum()):  # whatever is not finite shows in the sum, and it is five times as fast
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
                front = partial(_assembled_front, move, matrix.values, elimination, f, pivots[f], below[f], children)
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

    Thousands of arrays of their own, made again with every factorisation, leave the memory full of holes.
    """
    k, r = plan.pivots, np.diff(plan.row_pointers)
    return _parts(k, k), _parts(r, k)


def _parts(rows: IntArray, columns: IntArray) -> list[FloatArray]:
    ends = np.cumsum(rows * columns)
    whole = long_arrays.zeros(int(ends[-1]) if ends.size else 0)
    return [
        whole[end - m * n : end].reshape((m, n), order="F")
        for m, n, end in zip(rows.tolist(), columns.tolist(), ends.tolist(), strict=True)
    ]


def _keep(found: FloatArray, place: FloatArray) -> None:
    if not np.may_share_memory(found, place):
        place[...] = found


def _assembled_front(
    move: FrontOperations,
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
    rest = long_arrays.zeros(r * r).reshape((r, r), order="F")
    move.assemble(values, plan.entries, f, pivots, below)
    for update, places in updates:
        move.extend_add(update, places, pivots, below, rest)
    return pivots, below, rest


def _factor_in_place(matrix: FloatArray, tolerance: float) -> FloatArray | None:
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
    if size <= 64:  # vanishing pivots are looked for column by column
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
