"""Eliminate tie points from the normal equations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from mor.linalg import compilation
from mor.linalg.block_matrix import BlockMatrix, BlockStructure, DensePart, dense_part, find_blocks
from mor.model.contract import Computed
from mor.model.parameters import Values
from mor.solve import clique_kernels, cofactor_kernels, moving_ray_kernels, product_kernels, ray_kernels
from mor.solve.clique_kernels import VANISHING, Pattern
from mor.solve.problem import Problem, rotation_tangents
from mor.solve.product_kernels import ImageRays, ReducedSystemArrays
from mor.solve.ray_kernels import ALONG, MOVING, FrameChange, FrameValues, RayMeasurements
from mor.solve.rays import Chunk, GroupFrames, RayPlan, frame_change, frame_values
from mor.types import BoolArray, FloatArray, IntArray, SmallIntArray, ranges

# ---- Rays: two whitened observations each, from a frame to a point, linearised.


@dataclass(frozen=True)
class Rays:
    """A chunk of rays, sorted by point; a chunk holds whole points.

    Attributes:
        residual: (n, 2) computed − observed, divided by σ.
        by_point: (n, 2, 3) Jacobian by the coordinates of the point, divided by σ.
        by_others: (n, 2, K) Jacobian by all other unknowns, divided by σ.
        columns: (f, K) number of each of these unknowns in the reduced system, -1 where it is fixed, for every
            frame. No number twice in a row.
        point_pointers: (p+1,) the rays of point i are ``point_pointers[i]:point_pointers[i+1]``.
        frame_of_ray: (n,) frame of each ray; where it is left out, every ray has a frame of its own, f = n.

    Raises:
        ValueError: the shapes do not agree, or the points do not cover the rays.
    """

    residual: FloatArray
    by_point: FloatArray
    by_others: FloatArray
    columns: IntArray
    point_pointers: IntArray
    frame_of_ray: IntArray | None = None

    def __post_init__(self) -> None:
        n, width = self.frame.size, self.columns.shape[1]
        shapes = (self.residual.shape, self.by_point.shape, self.by_others.shape)
        if shapes != ((n, 2), (n, 2, 3), (n, 2, width)):
            raise ValueError(f"shapes of the rays do not agree: {n} rows of {width} columns, but {shapes}")
        pointers = self.point_pointers
        if pointers[0] != 0 or pointers[-1] != n or (np.diff(pointers) < 0).any():
            raise ValueError(f"the point pointers do not ascend from 0 to the number of rays, {n}")
        if n and (self.frame.min() < 0 or self.frame.max() >= len(self.columns)):
            raise ValueError(f"rays name frames beyond the {len(self.columns)} that have columns")

    @cached_property
    def frame(self) -> IntArray:
        """(n,) frame of each ray."""
        return np.arange(len(self.columns)) if self.frame_of_ray is None else self.frame_of_ray

    @property
    def columns_of_rays(self) -> IntArray:
        """(n, K) columns, ray by ray."""
        return self.columns if self.frame_of_ray is None else self.columns[self.frame_of_ray]

    @property
    def rays(self) -> int:
        """Number of rays n."""
        return int(self.residual.shape[0])

    @property
    def points(self) -> int:
        """Number of points p."""
        return self.point_pointers.size - 1


# ---- The reduced system: what is left of the normal equations when the points that only rays meet are eliminated.


class ReducedSystem(NamedTuple):
    """Normal equations of the unknowns that remain; ``accumulate`` adds to its arrays in place.

    Attributes:
        matrix: S = Σ jᵀj − Σ W N_pp⁻¹ Wᵀ; diagonal blocks hold both triangles.
        right_hand_side: (n,) −Σ jᵀ residual − Σ W N_pp⁻¹ b_p.
        diagonal: (n,) diagonal of Σ jᵀj alone, before the points are eliminated: the measure of what
            vanishes, and of damping.
        gradient: (n,) −Σ jᵀ residual alone, before the points are eliminated.
    """

    matrix: BlockMatrix
    right_hand_side: FloatArray
    diagonal: FloatArray
    gradient: FloatArray


def empty_reduced_system(structure: BlockStructure) -> ReducedSystem:
    """Return a reduced system of zeros."""
    matrix = BlockMatrix(structure, np.zeros(int(structure.position[-1])))
    return ReducedSystem(matrix, *(np.zeros(structure.unknowns) for _ in range(3)))


# ---- Point elimination in plain numpy: what the compiled kernels do, readable, and what small projects are
# adjusted with.
#
# With N_pp = L Lᵀ, every ray of a point couples it with its frame by V_i = j_iᵀ a_i L⁻ᵀ, and the points leave
# −Σ V_i V_jᵀ to the reduced system. Where the rays of a chunk meet few unknowns, all V_i are written into one dense
# matrix V, unknowns of all their frames × 3 coordinates of each point: V Vᵀ is one product. Else all pairs of rays of a
# point are multiplied, and those of the same two frames are added up before it is looked up where they go.

_MOST_ENTRIES = 20_000_000
"""Entries of the largest dense matrix."""
_PAIRS_SORTED, _PAIRS_AT_A_TIME = 500_000, 16_384
"""Pairs of rays that are put in order, and that are multiplied together: large arrays are slow to get."""


@dataclass(frozen=True)
class _DenseRays:
    """Rays of some points, and the part of the reduced system that they meet, as a dense matrix.

    Attributes:
        rays: rays of whole points.
        part: the unknowns of their frames in the reduced system.
        local: (f, K) number of each column of the frames in the dense matrix; one beyond it where fixed.
    """

    rays: Rays
    part: DensePart
    local: IntArray

    @cached_property
    def point(self) -> IntArray:
        """(n,) point of each ray."""
        return _point_of_rays(self.rays)

    @cached_property
    def of_rays(self) -> IntArray:
        """(n, K) columns in the dense matrix, ray by ray."""
        return self.local[self.rays.frame]

    @property
    def order(self) -> int:
        """Order of the dense matrix, one row for all that is fixed included."""
        return self.part.unknowns.size + 1

    def spread(self, of_rays: FloatArray) -> FloatArray:
        """(order, p, 3) sums of what rays (n, K, 3) have in common with their points."""
        width = 3 * self.rays.points
        places = self.of_rays[:, :, None] * width + (3 * self.point[:, None] + np.arange(3))[:, None, :]
        flat: FloatArray = np.asarray(
            np.bincount(places.ravel(), weights=of_rays.ravel(), minlength=self.order * width), dtype=np.float64
        )
        return flat.reshape(self.order, -1, 3)

    def own_products(self) -> FloatArray:
        """(order, order) Σ jᵀj, without the points."""
        rays = self.rays
        order = np.argsort(rays.frame, kind="stable")
        frames, first = np.unique(rays.frame[order], return_index=True)
        others = rays.by_others[order]
        of_frames = np.add.reduceat(_transposed(others) @ others, first, axis=0)
        local = self.local[frames]
        places = local[:, :, None] * self.order + local[:, None, :]
        flat = np.bincount(places.ravel(), weights=of_frames.ravel(), minlength=self.order**2)
        return np.asarray(flat, dtype=np.float64).reshape(self.order, -1)


def accumulate_by_numpy(rays: Rays, system: ReducedSystem, damping: float) -> tuple[BoolArray, FloatArray]:
    """Add what the points leave to the reduced system in place; return (p, 3) coordinates held, and −Σ aᵀ residual."""
    roots, vanished = _inverse_roots(rays, damping)
    of_points = _sum_by_point(rays, -np.einsum("ncj,nc->nj", rays.by_point, rays.residual))
    point, structure = _point_of_rays(rays), system.matrix.structure
    V = _coupling(rays) @ _transposed(roots)[point]
    u = np.einsum("pij,pj->pi", roots, of_points)
    dense = _as_dense(rays, structure)
    if dense is not None:
        flat = dense.spread(V).reshape(dense.order, -1)
        dense.part.add_to(system.matrix.values, (dense.own_products() - flat @ flat.T)[:-1, :-1])
    else:
        _add_by_pairs(rays, V, system.matrix)
    own = -np.einsum("nck,nc->nk", rays.by_others, rays.residual)
    left = own - np.einsum("nkj,nj->nk", V, u[point])
    place = (rays.columns_of_rays + 1).ravel()
    for total, of_rays in (
        (system.gradient, own),
        (system.right_hand_side, left),
        (system.diagonal, np.square(rays.by_others).sum(axis=1)),
    ):
        total += np.bincount(place, weights=of_rays.ravel(), minlength=structure.unknowns + 1)[1:]
    return vanished, of_points


def _transposed(matrices: FloatArray) -> FloatArray:
    return np.ascontiguousarray(matrices.transpose(0, 2, 1))  # products of views take several times as long


def _point_of_rays(rays: Rays) -> IntArray:
    return np.repeat(np.arange(rays.points, dtype=np.int64), np.diff(rays.point_pointers))


def back_substitute_by_numpy(rays: Rays, reduced_step: FloatArray, damping: float) -> FloatArray:
    """Return the steps (p, 3) of the points after the step (n,) of the others."""
    roots, _ = _inverse_roots(rays, damping)
    moved = rays.residual[:, :, None] + _moved(rays, reduced_step[:, None])
    return _followed(rays, roots, moved)[:, :, 0]


def follow_directions_by_numpy(rays: Rays, directions: FloatArray, damping: float = 0.0) -> FloatArray:
    """Return how the points follow (p, 3, k) directions (n, k) of the others."""
    roots, _ = _inverse_roots(rays, damping)
    return _followed(rays, roots, _moved(rays, directions))


def _moved(rays: Rays, directions: FloatArray) -> FloatArray:
    """Return the change (n, 2, k) of the observations for directions (n, k) of the other unknowns."""
    moved = np.where((rays.columns >= 0)[:, :, None], directions[rays.columns], 0.0)
    return rays.by_others @ moved[rays.frame]


def _followed(rays: Rays, roots: FloatArray, moved: FloatArray) -> FloatArray:
    """−N_pp⁻¹ Σ aᵀ of what has moved (n, 2, k), (p, 3, k)."""
    gradient = _sum_by_point(rays, rays.by_point.transpose(0, 2, 1) @ moved)
    return -(roots.transpose(0, 2, 1) @ (roots @ gradient))


def cofactors_by_numpy(rays: Rays, inverse: BlockMatrix) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return Q_pp (p, 3, 3), cofactors (n, 2, 2) of the whitened computed values, and shares (n, 2) of the points."""
    point = _point_of_rays(rays)
    roots, _ = _inverse_roots(rays, 0.0)
    inverse_of_points = roots.transpose(0, 2, 1) @ roots
    E = _coupling(rays) @ inverse_of_points[point]
    dense = _as_dense(rays, inverse.structure)
    H, of_frames = _by_pairs(rays, E, inverse) if dense is None else _by_dense(dense, E, inverse)
    Q_pp = inverse_of_points + _sum_by_point(rays, E.transpose(0, 2, 1) @ H)
    across = rays.by_point.transpose(0, 2, 1)
    own = rays.by_point @ Q_pp[point] @ across
    mixed = rays.by_others @ H @ across
    others = rays.by_others @ of_frames[rays.frame] @ rays.by_others.transpose(0, 2, 1)
    cofactors_of_rays = own - mixed - mixed.transpose(0, 2, 1) + others
    return Q_pp, cofactors_of_rays, np.diagonal(own - mixed, axis1=1, axis2=2).copy()


def _by_dense(dense: _DenseRays, E: FloatArray, inverse: BlockMatrix) -> tuple[FloatArray, FloatArray]:
    """Σ Q_ij E_j (n, K, 3) over the rays of a point, and Q (f, K, K) of the frames."""
    Q = np.zeros((dense.order, dense.order))
    Q[:-1, :-1] = dense.part.of(inverse.values)
    spread = (Q @ dense.spread(E).reshape(dense.order, -1)).reshape(dense.order, -1, 3)
    return spread[dense.of_rays, dense.point[:, None]], Q[dense.local[:, :, None], dense.local[:, None, :]]


def _as_dense(rays: Rays, structure: BlockStructure) -> _DenseRays | None:
    """Return the rays with their part of the system as a dense matrix, or ``None`` if pairs of rays cost less.

    A small project keeps their places from one pass to the next.
    """
    small = compilation.is_small()
    key = (rays.columns.tobytes(), rays.point_pointers.tobytes(), rays.frame.tobytes()) if small else None
    if key in structure.known:
        return _DenseRays(rays, *structure.known[key])
    used = rays.columns[np.unique(rays.frame)]
    blocks = np.unique(structure.block_of[used[used >= 0]])
    size, width = int(structure.sizes[blocks].sum()), rays.columns.shape[1]
    counts = np.diff(rays.point_pointers)
    entries, pairs = size * (size + 3 * rays.points), int(counts @ (counts + 1)) // 2
    # ns to add an entry of a pair, an entry of a dense matrix, and the share of one point in it (measured, one core).
    of_pair, of_entry, of_point = 5.0, 10.0, 0.3
    by_pairs = of_pair * pairs * width**2 < size**2 * (of_entry + of_point * rays.points)
    if entries > _MOST_ENTRIES or (entries > 1_000_000 and by_pairs):  # a small one takes 16 MB with its copy
        return None
    part = dense_part(structure, blocks)
    found = _DenseRays(rays, part, part.numbers_of(rays.columns))
    _refuse_pairs_not_stored(rays, structure, part)
    if key is not None:
        structure.known[key] = found.part, found.local
    return found


def _refuse_pairs_not_stored(rays: Rays, structure: BlockStructure, dense: DensePart) -> None:
    block = np.searchsorted(dense.blocks, structure.block_of[np.maximum(rays.columns, 0)])
    free = (rays.columns >= 0)[rays.frame]
    meets = np.zeros((dense.blocks.size, rays.points), dtype=np.float32)
    meets[block[rays.frame][free], np.broadcast_to(_point_of_rays(rays)[:, None], free.shape)[free]] = 1.0
    _refuse_unless(not ((meets @ meets.T > 0.0) & ~dense.stored).any())


class _Products(NamedTuple):
    """Products of runs of columns, in one block each, of m pairs of frames: those whose columns are free."""

    some: IntArray
    """(k,) pairs of frames."""
    rows: slice
    columns: slice
    places: IntArray
    """(k, r, c) in the flat values."""
    turned: IntArray
    """(k, r, c) of the transposed products, within a block of the diagonal."""
    order: IntArray
    """(k,) 1 where the block of the rows is behind the one of the columns, 0 where they are the same, else −1."""


def _products(rays: Rays, structure: BlockStructure, one: IntArray, other: IntArray) -> Iterator[_Products]:
    """Yield where products of the columns of frames (m,) go, for each pair of runs of columns in one block."""
    block = np.where(rays.columns >= 0, structure.block_of[rays.columns], -1)
    within = rays.columns - structure.offsets[block]
    cuts = np.flatnonzero((block[:, 1:] != block[:, :-1]).any(axis=0)) + 1
    runs = [slice(*ends) for ends in pairwise([0, *cuts.tolist(), block.shape[1]])]
    for rows, columns in product(runs, runs):
        row_block, column_block = block[one, rows.start], block[other, columns.start]
        some = np.flatnonzero((row_block >= 0) & (column_block >= 0))
        if not len(some):
            continue
        row_block, column_block = row_block[some], column_block[some]
        start = find_blocks(structure, row_block, column_block)
        _refuse_unless(bool((start >= 0).all()))
        row, column = within[one[some], rows][:, :, None], within[other[some], columns][:, None, :]
        straight = start[:, None, None] + row * structure.sizes[column_block][:, None, None] + column
        turned = start[:, None, None] + column * structure.sizes[row_block][:, None, None] + row
        places = np.where((row_block >= column_block)[:, None, None], straight, turned)
        yield _Products(some, rows, columns, places, turned, np.sign(row_block - column_block))


class _Pairs(NamedTuple):
    """Pairs of rays i, j of a point, and the frames of i and j."""

    one: IntArray
    """(m,)"""
    other: IntArray
    """(m,)"""
    number: IntArray
    """(m,) number of the two frames among these k."""
    frame: IntArray
    """(k,)"""
    partner: IntArray
    """(k,)"""


def _pairs(rays: Rays, both: bool) -> Iterator[_Pairs]:
    """Yield all pairs of rays of a point, or those with j < i only; pairs of the same two frames come together."""
    pointers, point = rays.point_pointers, _point_of_rays(rays)
    first = pointers[point]
    counts = np.diff(pointers)[point] if both else np.arange(rays.rays) - first
    before = np.concatenate(([0], np.cumsum(counts)))
    begin = 0
    while begin < rays.rays:
        end = max(int(np.searchsorted(before, before[begin] + _PAIRS_SORTED, side="right")) - 1, begin + 1)
        some = counts[begin:end]
        one, other = np.repeat(np.arange(begin, end), some), ranges(first[begin:end], some)
        keys = rays.frame[one] * len(rays.columns) + rays.frame[other]
        order = np.argsort(keys, kind="stable")
        for k in range(0, len(order), _PAIRS_AT_A_TIME):
            part = order[k : k + _PAIRS_AT_A_TIME]
            frames, number = np.unique(keys[part], return_inverse=True)
            yield _Pairs(one[part], other[part], number, frames // len(rays.columns), frames % len(rays.columns))
        begin = end


def _sums(number: IntArray, count: int, terms: FloatArray) -> FloatArray:
    """(count, …) sums of terms (m, …) of the same number (m,): many times faster than by a ufunc."""
    from scipy.sparse import csc_array  # small networks, which load faster without, have no pairs

    one = csc_array((np.ones(len(number)), number, np.arange(len(number) + 1)), shape=(count, len(number)))
    return np.asarray(one @ terms.reshape(len(number), -1)).reshape(count, *terms.shape[1:])


def _add_by_pairs(rays: Rays, V: FloatArray, matrix: BlockMatrix) -> None:
    """Add Σ jᵀj − Σ V_i V_jᵀ to the matrix in place."""
    across = _transposed(V)
    others = rays.by_others
    count = len(rays.columns)
    sums = _sums(rays.frame, count, _transposed(others) @ others - V @ across)
    for found in _products(rays, matrix.structure, np.arange(count), np.arange(count)):
        lower = found.order >= 0
        _add(matrix, found.places[lower], sums[found.some[lower], found.rows, found.columns])
    for pairs in _pairs(rays, both=False):
        products = np.take(V, pairs.one, axis=0) @ np.take(across, pairs.other, axis=0)
        sums = -_sums(pairs.number, len(pairs.frame), products)
        for found in _products(rays, matrix.structure, pairs.frame, pairs.partner):
            same = found.order == 0
            _add(matrix, found.places, sums[found.some, found.rows, found.columns])
            _add(matrix, found.turned[same], sums[found.some[same], found.rows, found.columns])


def _add(matrix: BlockMatrix, places: IntArray, terms: FloatArray) -> None:
    np.add.at(matrix.values, places.ravel(), terms.ravel())  # flat, in a sixth of the time


def _by_pairs(rays: Rays, E: FloatArray, inverse: BlockMatrix) -> tuple[FloatArray, FloatArray]:
    """Σ Q_ij E_j (n, K, 3) over the rays of a point, and Q (f, K, K) of the frames."""

    def of_frames(one: IntArray, other: IntArray) -> FloatArray:
        Q = np.zeros((len(one), *(rays.columns.shape[1],) * 2))
        for found in _products(rays, inverse.structure, one, other):
            Q[found.some, found.rows, found.columns] = inverse.values[found.places]
        return Q

    H = np.zeros(E.shape)
    for pairs in _pairs(rays, both=True):
        Q = np.take(of_frames(pairs.frame, pairs.partner), pairs.number, axis=0)
        first, last = int(pairs.one.min()), int(pairs.one.max())
        H[first : last + 1] += _sums(pairs.one - first, last - first + 1, Q @ np.take(E, pairs.other, axis=0))
    every = np.arange(len(rays.columns))
    return H, of_frames(every, every)


def _inverse_roots(rays: Rays, damping: float) -> tuple[FloatArray, BoolArray]:
    return inverse_roots(_sum_by_point(rays, _transposed(rays.by_point) @ rays.by_point), damping)


def inverse_roots(N: FloatArray, damping: float = 0.0) -> tuple[FloatArray, BoolArray]:
    """Return L⁻¹ (p, 3, 3) of N_pp = L Lᵀ, zero in rows and columns of coordinates held, and those (p, 3).

    Held are coordinates whose pivot vanishes, as the compiled passes hold them.
    """
    L, held = np.zeros_like(N), np.zeros((len(N), 3), dtype=np.bool_)
    inverse = np.zeros((len(N), 3))
    for j in range(3):
        whole = N[:, j, j]
        pivot = whole * (1.0 + damping) - np.square(L[:, j, :j]).sum(axis=1)
        held[:, j] = pivot <= VANISHING * whole
        L[held[:, j], j] = 0.0
        L[:, j, j] = np.sqrt(np.where(held[:, j], 1.0, pivot))
        inverse[:, j] = np.where(held[:, j], 0.0, 1.0 / L[:, j, j])
        below = N[:, j + 1 :, j] - np.einsum("pik,pk->pi", L[:, j + 1 :, :j], L[:, j, :j])
        L[:, j + 1 :, j] = below * inverse[:, j, None]
    roots = np.zeros_like(N)
    for j in range(3):
        roots[:, j, j] = inverse[:, j]
        for i in range(j + 1, 3):
            roots[:, i, j] = -inverse[:, i] * np.einsum("pk,pk->p", L[:, i, j:i], roots[:, j:i, j])
    return roots, held


def _coupling(rays: Rays) -> FloatArray:
    """Return jᵀa (n, K, 3); rows of fixed unknowns are zero."""
    coupling = _transposed(rays.by_others) @ rays.by_point
    return np.where(rays.columns_of_rays[:, :, None] >= 0, coupling, 0.0)


def _sum_by_point(rays: Rays, of_rays: FloatArray) -> FloatArray:
    some = np.flatnonzero(np.diff(rays.point_pointers))
    total = np.zeros((rays.points, *of_rays.shape[1:]))
    if some.size:
        total[some] = np.add.reduceat(of_rays, rays.point_pointers[some], axis=0)
    return total


# ---- Elimination of the points that only rays meet: they are by far the most, and none of them enters the big
# system.
#
# Such a point has a 3×3 system of its own. Eliminating it leaves a *reduced* system of all other unknowns, in
# which the blocks of its rays form a clique (D. C. Brown, 1958; Schur complement). The rays come in chunks of
# whole points, are used and forgotten; the pass is repeated for the steps of the points and for the cofactors.
#
# Every function has a plain numpy form in ``point_reference`` and a compiled one in ``compiled``.

_FOURS = 4
"""Columns that are worked on together where cofactors are worked out."""


class PointFactors(NamedTuple):
    """Factors of the points of a chunk, kept for the back-substitution."""

    held: BoolArray
    """(p, 3) whether a coordinate is left undetermined by the rays of its point, even if all else is known.

    It is held: it neither moves nor weakens anything.
    """
    gradient: FloatArray
    """(p, 3) −Σ aᵀ residual."""


def accumulate(rays: Rays, reduced: ReducedSystem, damping: float = 0.0) -> PointFactors:
    """Eliminate the points of a chunk of rays and add what they leave to the reduced system, in place.

    Args:
        rays: residuals and Jacobians, whole points.
        reduced: the system to add to. Its pattern must hold all pairs of blocks that the rays of a
            point meet.
        damping: the diagonal of N_pp is multiplied by 1 + damping (Levenberg-Marquardt); the others'
            diagonal is the caller's.

    Raises:
        ValueError: the pattern lacks a pair of blocks that meet in a point, or a column is beyond it.
    """
    _refuse_columns_beyond(rays.columns, reduced.matrix.structure.unknowns)
    if not compilation.wanted():
        return PointFactors(*accumulate_by_numpy(rays, reduced, damping))
    residual, by_point, by_others, frame, columns, pointers = _arrays(_wide(rays, clique_kernels.COLUMNS))
    pattern, system = _pattern(reduced.matrix.structure), _system(reduced)
    gathering = product_kernels.begin_gathering(columns, pattern)
    noted = _nothing_noted(rays.points)
    white, moved = np.empty(by_point.shape), np.empty(residual.shape)
    clique_kernels.whiten_points(by_point, residual, pointers, damping, white, moved, *noted)
    reduced_rows = np.zeros(by_others.shape) if gathering.nested else by_others
    arrays = white, by_others, reduced_rows, frame, pointers
    stored = product_kernels.store_points(gathering, *arrays, pattern, system.values)
    clique_kernels.add_rays(residual, moved, by_others, reduced_rows, frame, gathering.sums)
    _refuse_unless(stored and product_kernels.finish_gathering(gathering, pattern, system))
    return noted


def accumulate_images(
    columns: IntArray, rays: ImageRays, reduced: ReducedSystem, damping: float = 0.0
) -> tuple[PointFactors, float]:
    """Linearise image rays of frames with these columns (f, K) and do the same; compiled only.

    Returns:
        What ``accumulate`` does, and the sum of the squared residuals.

    Raises:
        ValueError: as ``accumulate``.
    """
    _refuse_columns_beyond(columns, reduced.matrix.structure.unknowns)
    wide = np.ascontiguousarray(_wide_columns(columns, clique_kernels.COLUMNS), dtype=np.int64)
    pattern, system = _pattern(reduced.matrix.structure), _system(reduced)
    gathering = product_kernels.begin_gathering(wide, pattern)
    noted = _nothing_noted(len(rays.points))
    stored, squares = product_kernels.gather_image_rays(
        gathering, rays, rays.paths, damping, pattern, system.values, *noted
    )
    _refuse_unless(stored and product_kernels.finish_gathering(gathering, pattern, system))
    return noted, squares


def follow_directions(rays: Rays, directions: FloatArray, damping: float = 0.0) -> FloatArray:
    """Return how the points of a chunk follow (p, 3, k) directions (n, k) of the reduced unknowns: −N_pp⁻¹ Wᵀ g."""
    if damping or not compilation.wanted():
        return follow_directions_by_numpy(rays, directions, damping)
    _refuse_columns_beyond(rays.columns, len(directions))
    of_points = np.empty((rays.points, 3, directions.shape[1]))
    clique_kernels.follow_directions(*_arrays(rays)[1:], np.ascontiguousarray(directions), of_points)
    return of_points


def back_substitute(rays: Rays, reduced_step: FloatArray, damping: float = 0.0) -> FloatArray:
    """Return the steps (p, 3) of the points of a chunk.

    Args:
        rays: the same residuals and Jacobians as for ``accumulate``.
        reduced_step: (n,) solution of the reduced system.
        damping: as for ``accumulate``.
    """
    _refuse_columns_beyond(rays.columns, reduced_step.size)
    if not compilation.wanted():
        return back_substitute_by_numpy(rays, reduced_step, damping)
    moved = np.where(rays.columns >= 0, reduced_step[rays.columns], 0.0)[rays.frame]
    residual = rays.residual + np.einsum("nck,nk->nc", rays.by_others, moved)
    by_point = np.ascontiguousarray(rays.by_point, dtype=np.float64)
    steps = np.empty((rays.points, 3))
    clique_kernels.solve_points(residual, by_point, rays.point_pointers, damping, steps)
    return steps


class Cofactors(NamedTuple):
    """Cofactors of a chunk of rays, exact."""

    of_points: FloatArray
    """(p, 3, 3) Q_pp."""
    of_rays: FloatArray
    """(n, 2, 2) parts of J Q Jᵀ, of the whitened computed values. One minus their diagonals are redundancy numbers."""
    shares: FloatArray
    """(n, 2) parts a (Q Jᵀ)_p of their diagonals that go into the points."""


class Split(NamedTuple):
    """The selected inverse Q of a reduced system, and what kernels take of it: R and W of ``cofactor_kernels``."""

    inverse: BlockMatrix
    own: int
    """Columns of the frames before those that all have in common."""
    rest: FloatArray
    """Values of R, where those of Q are."""
    by_common: FloatArray
    """(n, z) W."""


def split(columns: IntArray, inverse: BlockMatrix) -> Split:
    """Split a selected inverse for rays whose frames have no other columns than these (f, K)."""
    if not compilation.wanted():
        return Split(inverse, columns.shape[1], np.zeros(0), np.zeros((0, 0)))
    columns = _wide_columns(columns, _FOURS)
    varied = np.flatnonzero((columns != columns[:1]).any(axis=0))
    own = int(varied.max(initial=-1)) + 1
    common = np.full(columns.shape[1] - own + (own - columns.shape[1]) % _FOURS, -1)
    common[: columns.shape[1] - own] = columns[0, own:] if len(columns) else -1
    rest, by_common = np.empty(inverse.values.shape), np.zeros((inverse.structure.unknowns, len(common)))
    cofactor_kernels.split_cofactors(common, _pattern(inverse.structure), inverse.values, by_common, rest)
    return Split(inverse, own, rest, by_common)


def cofactors(rays: Rays, selected: Split) -> Cofactors:
    """Return the cofactors of the points and of the computed values of a chunk of rays, exactly.

    Args:
        rays: Jacobians; the residuals are not looked at.
        selected: selected inverse of the reduced system, split for the frames of these rays and others.

    Raises:
        ValueError: the pattern lacks a pair of blocks that meet in a point, or a column is beyond it.
    """
    structure = selected.inverse.structure
    _refuse_columns_beyond(rays.columns, structure.unknowns)
    if not compilation.wanted():
        return Cofactors(*cofactors_by_numpy(rays, selected.inverse))
    result = Cofactors(np.empty((rays.points, 3, 3)), np.empty((rays.rays, 2, 2)), np.empty((rays.rays, 2)))
    stored = cofactor_kernels.cofactors(
        *_arrays(_wide(rays, _FOURS))[1:], selected.own, _pattern(structure), selected.rest, selected.by_common, *result
    )
    _refuse_unless(stored)
    return result


def _pattern(structure: BlockStructure) -> Pattern:
    block_of, offsets = structure.block_of, structure.offsets
    return Pattern(block_of, offsets, structure.indptr, structure.indices, structure.position)


def _arrays(rays: Rays) -> tuple[FloatArray, FloatArray, FloatArray, IntArray, IntArray, IntArray]:
    """Return the arrays of the rays as the kernels take them, which look neither at layout nor at bounds."""
    return (
        np.ascontiguousarray(rays.residual, dtype=np.float64),
        np.ascontiguousarray(rays.by_point, dtype=np.float64),
        np.ascontiguousarray(rays.by_others, dtype=np.float64),
        np.ascontiguousarray(rays.frame, dtype=np.int64),
        np.ascontiguousarray(rays.columns, dtype=np.int64),
        np.ascontiguousarray(rays.point_pointers, dtype=np.int64),
    )


def _system(reduced: ReducedSystem) -> ReducedSystemArrays:
    return ReducedSystemArrays(reduced.matrix.values, reduced.right_hand_side, reduced.diagonal, reduced.gradient)


def _nothing_noted(points: int) -> PointFactors:
    return PointFactors(np.empty((points, 3), dtype=np.bool_), np.empty((points, 3)))


def _wide(rays: Rays, together: int) -> Rays:
    """The rays with as many columns as are worked on together, or a multiple; those that are added are fixed."""
    columns = _wide_columns(rays.columns, together)
    missing = columns.shape[1] - rays.columns.shape[1]
    if missing == 0:
        return rays
    none = np.zeros((rays.rays, 2, missing))
    return replace(rays, by_others=np.concatenate([rays.by_others, none], axis=2), columns=columns)


def _wide_columns(columns: IntArray, together: int) -> IntArray:
    missing = -columns.shape[1] % together
    return np.hstack([columns, np.full((len(columns), missing), -1)]) if missing else columns


def _refuse_columns_beyond(columns: IntArray, unknowns: int) -> None:
    if columns.max(initial=-1) >= unknowns:
        raise ValueError(f"the rays have columns beyond the {unknowns} unknowns of the reduced system")


def _refuse_unless(stored: bool) -> None:
    if not stored:
        raise ValueError("the pattern lacks a pair of blocks that meet in a point of the chunk")


# ---- The rays of the eliminated points, linearised chunk by chunk and forgotten.
#
# Image coordinates of the usual cameras are linearised by a compiled kernel; every other type of ray, and all of them
# where there is no compiler, by its own equation in numpy.


class RayChunk(NamedTuple):
    """A chunk, linearised."""

    points: slice
    """Its eliminated points."""
    group: IntArray
    row: SmallIntArray
    weight: FloatArray
    """(n, 2) 1/σ, 0 where not observed."""
    rays: Rays


_Work = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class _LinearisationPoint:
    """Values at which the rays are linearised."""

    problem: Problem
    plan: RayPlan
    values: Values

    @cached_property
    def tangent(self) -> FloatArray | None:
        return rotation_tangents(self.problem.index, self.values)

    @cached_property
    def frames(self) -> FrameValues:
        """Arrays of the frames, as the kernels expect them."""
        return frame_values(self.plan.frames, self.problem.groups, self.values, self.tangent)


def ray_chunks(problem: Problem, plan: RayPlan, reduced: IntArray, values: Values) -> Iterator[RayChunk]:
    """All chunks, linearised at the values; ``reduced`` (u,) numbers the unknowns of the reduced system.

    The arrays of a chunk are overwritten by the next one: fresh memory costs a tenth of the whole pass.
    """
    place = _LinearisationPoint(problem, plan, values)
    columns, work = _reduced_columns(plan, reduced), _workspace(plan)
    for chunk in plan.chunks:
        yield _ray_chunk(place, chunk, columns[chunk.frames], work)


class EliminatedChunk(NamedTuple):
    """One chunk whose points are eliminated."""

    points: slice
    gradient: FloatArray
    """(p, 3) −Σ aᵀ residual of the points."""
    squares: float
    """Sum of the squared residuals."""


def eliminate_chunks(
    problem: Problem, plan: RayPlan, reduced: IntArray, values: Values, system: ReducedSystem, damping: float
) -> Iterator[EliminatedChunk]:
    """Linearise all chunks and eliminate their points; what they leave is added to the system, in place."""
    place = _LinearisationPoint(problem, plan, values)
    columns = _reduced_columns(plan, reduced)
    work: _Work | None = None
    for chunk in plan.chunks:
        of_frames = columns[chunk.frames]
        if _all_compiled(place, chunk):
            noted, squares = accumulate_images(of_frames, _image_rays(place, chunk), system, damping)
        else:
            work = work or _workspace(plan)
            linearised = _ray_chunk(place, chunk, of_frames, work).rays
            noted = accumulate(linearised, system, damping)
            squares = float(np.vdot(linearised.residual, linearised.residual))
        yield EliminatedChunk(chunk.points, noted.gradient, squares)


def point_steps(
    problem: Problem, plan: RayPlan, values: Values, step: FloatArray, damping: float
) -> Iterator[tuple[slice, FloatArray]]:
    """The steps (p, 3) with which the points of each chunk follow a step (u,) of all other unknowns."""
    place = _LinearisationPoint(problem, plan, values)
    change: FrameChange | None = None
    work: _Work | None = None
    for chunk in plan.chunks:
        if _all_compiled(place, chunk):
            steps = np.empty((chunk.points.stop - chunk.points.start, 3))
            rays = _image_rays(place, chunk)
            change = change or frame_change(
                plan.frames, problem.groups, problem.index, step, place.tangent, place.frames.interior.shape[1]
            )
            product_kernels.solve_image_points(rays, rays.paths, change, damping, steps)
        else:
            work = work or _workspace(plan)
            linearised = _ray_chunk(place, chunk, plan.frames.columns[chunk.frames], work).rays
            steps = back_substitute(linearised, step, damping)
        yield chunk.points, steps


def ray_residuals(problem: Problem, plan: RayPlan, values: Values) -> Iterator[tuple[Chunk, FloatArray]]:
    """Residuals (n, 2) of the rays of every chunk, computed − observed, divided by σ; 0 where not observed."""
    place = _LinearisationPoint(problem, plan, values)
    for chunk in plan.chunks:
        residual = np.empty((chunk.rays.stop - chunk.rays.start, 2))
        frame = chunk.frames[plan.frame[chunk.rays]]
        measured = _measured(plan, chunk)
        if _fits(place, chunk):
            points = values["point"][plan.points[chunk.points]]
            arrays = place.frames, frame, _pointers(plan, chunk), points, measured, residual
            ray_kernels.residuals(*arrays)
            if _any_moving(place, chunk):
                moving_ray_kernels.moving_residuals(*arrays)
            if _any_along(place, chunk):
                moving_ray_kernels.residuals_along(*arrays)
        for _, here, computed in _left_to_numpy(place, chunk, frame, derivatives=False):
            residual[here] = (computed.values - measured.observed[here]) * measured.weight[here]
        yield chunk, np.where(measured.weight > 0.0, residual, 0.0)


def ray_objective(problem: Problem, plan: RayPlan, values: Values) -> float:
    """Σ (v/σ)² of the rays; infinite where an equation cannot be evaluated."""
    total = sum(float(np.vdot(residual, residual)) for _, residual in ray_residuals(problem, plan, values))
    return total if np.isfinite(total) else np.inf


def _reduced_columns(plan: RayPlan, reduced: IntArray) -> IntArray:
    columns = plan.frames.columns
    return np.where(columns >= 0, reduced[columns], -1) if columns.size else columns


def _workspace(plan: RayPlan) -> _Work:
    """Room for the residuals and Jacobians of the largest of the chunks."""
    n = max((chunk.rays.stop - chunk.rays.start for chunk in plan.chunks), default=0)
    return np.empty((n, 2)), np.empty((n, 2, 3)), np.empty((n, 2, plan.frames.columns.shape[1]))


def _ray_chunk(place: _LinearisationPoint, chunk: Chunk, columns: IntArray, work: _Work) -> RayChunk:
    plan = place.plan
    local = plan.frame[chunk.rays].astype(np.int64)
    frame = chunk.frames[local]
    n, width = len(local), columns.shape[1]
    residual, by_point, by_others = (array[:n] for array in work)
    measured, pointers = _measured(plan, chunk), _pointers(plan, chunk)
    if _fits(place, chunk):
        points = np.take(place.values["point"], plan.points[chunk.points], axis=0)  # a third of the time of an index
        arrays = place.frames, plan.frames.layout, frame, pointers, points, measured
        ray_kernels.linearise(*arrays, residual, by_point, by_others)
        if _any_moving(place, chunk):
            moving_ray_kernels.linearise_moving(*arrays, residual, by_point, by_others)
        if _any_along(place, chunk):
            moving_ray_kernels.linearise_along(*arrays, residual, by_point, by_others)
    for group, here, computed in _left_to_numpy(place, chunk, frame):
        weight = measured.weight[here]
        by_others[here] = _by_frame(place, group, frame[here], computed, width) * weight[:, :, None]
        by_point[here] = computed.jacobians[-1] * weight[:, :, None]
        residual[here] = (computed.values - measured.observed[here]) * weight
        seen = weight > 0.0
        if not seen.all():
            for array in (residual, by_point, by_others):
                array[here] = np.where(seen.reshape(*seen.shape, *(1,) * (array.ndim - 2)), array[here], 0.0)
    rays = Rays(residual, by_point, by_others, columns, pointers, local)
    group_of_ray = plan.group_of_frame[frame]
    return RayChunk(chunk.points, group_of_ray, plan.row[chunk.rays], measured.weight, rays)


def _image_rays(place: _LinearisationPoint, chunk: Chunk) -> ImageRays:
    plan = place.plan
    points = np.take(place.values["point"], plan.points[chunk.points], axis=0)  # a third of the time of an index
    local, pointers, layout = plan.frame[chunk.rays], _pointers(plan, chunk), plan.frames.layout
    return ImageRays(place.frames, layout, chunk.frames, local, pointers, points, _measured(plan, chunk))


def _fits(place: _LinearisationPoint, chunk: Chunk) -> bool:
    return compilation.wanted() and bool((place.frames.model[chunk.frames] >= 0).any())


def _all_compiled(place: _LinearisationPoint, chunk: Chunk) -> bool:
    return compilation.wanted() and bool((place.frames.model[chunk.frames] >= 0).all())


def _any_moving(place: _LinearisationPoint, chunk: Chunk) -> bool:
    model = place.frames.model[chunk.frames]
    return bool(((model >= MOVING) & (model < ALONG)).any())


def _any_along(place: _LinearisationPoint, chunk: Chunk) -> bool:
    return bool((place.frames.model[chunk.frames] >= ALONG).any())


def _left_to_numpy(
    place: _LinearisationPoint, chunk: Chunk, frame: IntArray, derivatives: bool = True
) -> Iterator[tuple[GroupFrames, IntArray, Computed]]:
    """Yield groups, the rays (k,) of a chunk that are of them, and what their equations make of these."""
    plain = {g.group: g for g in place.plan.frames.groups if g.model < 0 or not compilation.wanted()}
    if not plain:
        return
    group_of_ray, rows = place.plan.group_of_frame[frame], place.plan.row[chunk.rays]
    here = {number: np.flatnonzero(group_of_ray == number) for number in plain}
    numbers = [number for number, own in here.items() if len(own)]
    found = place.problem.equations.of_several(numbers, place.values, [rows[here[n]] for n in numbers], derivatives)
    for number, computed in zip(numbers, found, strict=True):
        yield plain[number], here[number], computed


def _by_frame(
    place: _LinearisationPoint, group: GroupFrames, frame: IntArray, computed: Computed, width: int
) -> FloatArray:
    """Jacobian (n, 2, K) by the unknowns of the frames."""
    result = np.zeros((len(frame), 2, width))
    slots = place.problem.groups[group.group].type.slots
    for pick in group.picks:
        jacobian = computed.jacobians[pick.slot]
        if slots[pick.slot].kind == "rotation" and place.tangent is not None:
            jacobian = jacobian @ place.tangent[group.blocks[pick.slot][frame - group.first]]
        result[:, :, pick.columns] = jacobian[:, :, pick.components]
    return result


def _measured(plan: RayPlan, chunk: Chunk) -> RayMeasurements:
    return plan.measurements.of(chunk.rays)


def _pointers(plan: RayPlan, chunk: Chunk) -> IntArray:
    pointers: IntArray = plan.pointers[chunk.points.start : chunk.points.stop + 1] - chunk.rays.start
    return pointers
