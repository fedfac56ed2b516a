"""Point elimination in plain numpy: what the compiled kernels do, readable, and what small projects are adjusted with.

Some points at a time are eliminated together. With N_pp = L Lᵀ, every ray of a point couples it with its frame by
V_i = j_iᵀ a_i L⁻ᵀ. Written into one dense matrix V, unknowns of all their frames × 3 coordinates of each point, they
leave −V Vᵀ to the reduced system: one product of dense matrices, which costs less than to look up where each pair of
rays goes, as long as the matrix stays small.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mor import compilation
from mor.adjustment.rays.compiled.points import VANISHING
from mor.adjustment.rays.linearised import Rays
from mor.adjustment.rays.reduced_system import ReducedSystem
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.sparse.block_matrix import BlockMatrix, BlockStructure
from mor.sparse.dense_part import DensePart, dense_part

# Entries of the dense matrices, above which fewer points are taken at a time: beyond it most of them are zero.
_ENTRIES_AT_A_TIME = 1_000_000


@dataclass(frozen=True)
class _Part:
    """Rays of some points, and the part of the reduced system that they meet, as a dense matrix.

    Attributes:
        rays: rays of whole points.
        dense: the unknowns of their frames in the reduced system.
        local: (f, K) number of each column of the frames in the dense matrix; one beyond it where fixed.
    """

    rays: Rays
    dense: DensePart
    local: IntArray

    @cached_property
    def point(self) -> IntArray:
        """(n,) point of each ray."""
        return np.repeat(np.arange(self.rays.points, dtype=np.int64), np.diff(self.rays.point_pointers))

    @cached_property
    def of_rays(self) -> IntArray:
        """(n, K) columns in the dense matrix, ray by ray."""
        return self.local[self.rays.frame]

    @property
    def order(self) -> int:
        """Order of the dense matrix, one row for all that is fixed included."""
        return self.dense.unknowns.size + 1

    def spread(self, of_rays: FloatArray) -> FloatArray:
        """(order, p, 3) sums of what rays (n, K, 3) have in common with their points."""
        width = 3 * self.rays.points
        places = self.of_rays[:, :, None] * width + (3 * self.point[:, None] + np.arange(3))[:, None, :]
        flat: FloatArray = np.asarray(
            np.bincount(places.ravel(), weights=of_rays.ravel(), minlength=self.order * width),
            dtype=np.float64,
        )
        return flat.reshape(self.order, -1, 3)

    def summed(self, of_rays: FloatArray) -> FloatArray:
        """(order,) sums of numbers (n, K) over the rays."""
        total = np.bincount(self.of_rays.ravel(), weights=of_rays.ravel(), minlength=self.order)
        return np.asarray(total, dtype=np.float64)

    def own_products(self) -> FloatArray:
        """(order, order) Σ jᵀj, without the points."""
        rays = self.rays
        order = np.argsort(rays.frame, kind="stable")
        frames, first = np.unique(rays.frame[order], return_index=True)
        others = rays.by_others[order]
        of_frames = np.add.reduceat(others.transpose(0, 2, 1) @ others, first, axis=0)
        local = self.local[frames]
        places = local[:, :, None] * self.order + local[:, None, :]
        flat = np.bincount(places.ravel(), weights=of_frames.ravel(), minlength=self.order**2)
        return np.asarray(flat, dtype=np.float64).reshape(self.order, -1)


def accumulate(rays: Rays, system: ReducedSystem, damping: float) -> tuple[BoolArray, FloatArray]:
    """Add what the points leave to the reduced system in place; return (p, 3) coordinates held, and −Σ aᵀ residual."""
    held, gradient = [np.empty((0, 3), dtype=np.bool_)], [np.empty((0, 3))]
    for part in _parts(rays, system.matrix.structure):
        mine = part.rays
        roots, vanished = _inverse_roots(mine, damping)
        of_points = _gradient_of_points(mine, mine.residual)
        V = _coupling(mine) @ roots[part.point].transpose(0, 2, 1)
        u = np.einsum("pij,pj->pi", roots, of_points)
        flat = part.spread(V).reshape(part.order, -1)
        part.dense.add_to(system.matrix.values, (part.own_products() - flat @ flat.T)[:-1, :-1])
        own = -np.einsum("nck,nc->nk", mine.by_others, mine.residual)
        left = own - np.einsum("nkj,nj->nk", V, u[part.point])
        unknowns = part.dense.unknowns
        system.gradient[unknowns] += part.summed(own)[:-1]
        system.right_hand_side[unknowns] += part.summed(left)[:-1]
        system.diagonal[unknowns] += part.summed(np.square(mine.by_others).sum(axis=1))[:-1]
        held.append(vanished)
        gradient.append(of_points)
    return np.concatenate(held), np.concatenate(gradient)


def back_substitute(rays: Rays, reduced_step: FloatArray, damping: float) -> FloatArray:
    """Return the steps (p, 3) of the points after the step (n,) of the others."""
    roots, _ = _inverse_roots(rays, damping)
    moved = rays.residual[:, :, None] + _moved(rays, reduced_step[:, None])
    return _followed(rays, roots, moved)[:, :, 0]


def follow_directions(rays: Rays, directions: FloatArray, damping: float = 0.0) -> FloatArray:
    """Return how the points follow (p, 3, k) directions (n, k) of the others."""
    roots, _ = _inverse_roots(rays, damping)
    return _followed(rays, roots, _moved(rays, directions))


def _moved(rays: Rays, directions: FloatArray) -> FloatArray:
    """What directions (n, k) of the others change in the observations (n, 2, k)."""
    moved = np.where((rays.columns >= 0)[:, :, None], directions[rays.columns], 0.0)
    return rays.by_others @ moved[rays.frame]


def _followed(rays: Rays, roots: FloatArray, moved: FloatArray) -> FloatArray:
    """−N_pp⁻¹ Σ aᵀ of what has moved (n, 2, k), (p, 3, k)."""
    gradient = _sum_by_point(rays, rays.by_point.transpose(0, 2, 1) @ moved)
    return -(roots.transpose(0, 2, 1) @ (roots @ gradient))


def cofactors(rays: Rays, inverse: BlockMatrix) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return Q_pp (p, 3, 3), cofactors (n, 2, 2) of the whitened computed values, and shares (n, 2) of the points."""
    of_points, of_rays, shares = [np.empty((0, 3, 3))], [np.empty((0, 2, 2))], [np.empty((0, 2))]
    for part in _parts(rays, inverse.structure):
        mine, point = part.rays, part.point
        roots, _ = _inverse_roots(mine, 0.0)
        inverse_of_points = roots.transpose(0, 2, 1) @ roots
        E = _coupling(mine) @ inverse_of_points[point]
        Q = np.zeros((part.order, part.order))
        Q[:-1, :-1] = part.dense.of(inverse.values)
        spread = (Q @ part.spread(E).reshape(part.order, -1)).reshape(part.order, -1, 3)
        H = spread[part.of_rays, point[:, None]]
        Q_pp = inverse_of_points + _sum_by_point(mine, E.transpose(0, 2, 1) @ H)
        across = mine.by_point.transpose(0, 2, 1)
        own = mine.by_point @ Q_pp[point] @ across
        mixed = mine.by_others @ H @ across
        of_frames = Q[part.local[:, :, None], part.local[:, None, :]]
        others = mine.by_others @ of_frames[mine.frame] @ mine.by_others.transpose(0, 2, 1)
        of_points.append(Q_pp)
        of_rays.append(own - mixed - mixed.transpose(0, 2, 1) + others)
        shares.append(np.diagonal(own - mixed, axis1=1, axis2=2))
    return np.concatenate(of_points), np.concatenate(of_rays), np.concatenate(shares)


class _Places(NamedTuple):
    """Where the rays of some points go: the same in every pass."""

    points: slice
    rays: slice
    frames: IntArray
    """Their frames, which they name by their place in this list."""
    frame: IntArray
    dense: DensePart
    local: IntArray

    def of(self, rays: Rays) -> _Part:
        """The rays of the points, with the columns of their frames only."""
        pointers = rays.point_pointers[self.points.start : self.points.stop + 1]
        some = Rays(
            rays.residual[self.rays],
            rays.by_point[self.rays],
            rays.by_others[self.rays],
            rays.columns[self.frames],
            pointers - pointers[0],
            self.frame,
        )
        return _Part(some, self.dense, self.local)


def _parts(rays: Rays, structure: BlockStructure) -> Iterator[_Part]:
    """Yield the rays of as many points at a time as make no large dense matrix.

    Where they go is kept from one pass to the next in a small project, whose passes are many.
    """
    if not compilation.is_small():
        yield from (places.of(rays) for places in _places(rays, structure))
        return
    key = rays.columns.tobytes(), rays.point_pointers.tobytes(), rays.frame.tobytes()
    if key not in structure.known:
        structure.known[key] = list(_places(rays, structure))
    yield from (places.of(rays) for places in structure.known[key])


def _places(rays: Rays, structure: BlockStructure) -> Iterator[_Places]:
    waiting = [(0, rays.points)] if rays.points else []
    while waiting:
        first, last = waiting.pop()
        part = slice(int(rays.point_pointers[first]), int(rays.point_pointers[last]))
        frames, frame = np.unique(rays.frame[part], return_inverse=True)
        columns = rays.columns[frames]
        dense = dense_part(structure, np.unique(structure.block_of[columns[columns >= 0]]))
        size = dense.unknowns.size
        if last - first > 1 and size * (size + 3 * (last - first)) > _ENTRIES_AT_A_TIME:
            middle = (first + last) // 2
            waiting += [(middle, last), (first, middle)]
            continue
        found = _Places(slice(first, last), part, frames, frame, dense, dense.numbers_of(columns))
        _refuse_pairs_not_stored(found.of(rays).rays, structure, dense)
        yield found


def _refuse_pairs_not_stored(rays: Rays, structure: BlockStructure, dense: DensePart) -> None:
    """Raise where two blocks meet in a point that the pattern does not store."""
    block = np.searchsorted(dense.blocks, structure.block_of[np.maximum(rays.columns, 0)])
    point = np.repeat(np.arange(rays.points), np.diff(rays.point_pointers))
    free = (rays.columns >= 0)[rays.frame]
    meets = np.zeros((dense.blocks.size, rays.points), dtype=np.float32)
    meets[block[rays.frame][free], np.broadcast_to(point[:, None], free.shape)[free]] = 1.0
    if ((meets @ meets.T > 0.0) & ~dense.stored).any():
        raise ValueError("the pattern lacks a pair of blocks that meet in a point of the chunk")


def _inverse_roots(rays: Rays, damping: float) -> tuple[FloatArray, BoolArray]:
    return inverse_roots(_sum_by_point(rays, rays.by_point.transpose(0, 2, 1) @ rays.by_point), damping)


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
    coupling = rays.by_others.transpose(0, 2, 1) @ rays.by_point
    return np.where(rays.columns_of_rays[:, :, None] >= 0, coupling, 0.0)


def _gradient_of_points(rays: Rays, residual: FloatArray) -> FloatArray:
    """Return b_p = −Σ aᵀ residual (p, 3)."""
    return _sum_by_point(rays, -np.einsum("ncj,nc->nj", rays.by_point, residual))


def _sum_by_point(rays: Rays, of_rays: FloatArray) -> FloatArray:
    """Return sums (p, ...) of what rays (n, ...) have, over the rays of each point."""
    some = np.flatnonzero(np.diff(rays.point_pointers))
    total = np.zeros((rays.points, *of_rays.shape[1:]))
    if some.size:
        total[some] = np.add.reduceat(of_rays, rays.point_pointers[some], axis=0)
    return total
