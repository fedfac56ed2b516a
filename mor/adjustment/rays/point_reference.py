"""Point elimination in plain numpy: what the compiled kernels do, readable, and fit for use without a
compiler.

The unknowns are not merged here. Every pair (i, m) of rays of a point contributes −V_i V_mᵀ with V_i = j_iᵀ
a_i L⁻ᵀ, N_pp = L Lᵀ, and all pairs of a handful of points are treated at once.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mor.adjustment.rays.compiled.points import VANISHING
from mor.adjustment.rays.linearised import Rays
from mor.adjustment.rays.reduced_system import ReducedSystem
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.sparse.block_matrix import BlockMatrix, BlockStructure, find_blocks

# Entries of the reduced matrix that are touched at a time: bounds the memory, not the result.
_ENTRIES_AT_A_TIME = 2_000_000


def accumulate(rays: Rays, system: ReducedSystem, damping: float) -> tuple[BoolArray, FloatArray]:
    """Add what the points leave to the reduced system in place; return (p, 3) coordinates held, and −Σ aᵀ residual."""
    held, gradient = [np.empty((0, 3), dtype=np.bool_)], [np.empty((0, 3))]
    for part in _parts(rays):
        roots, vanished = _inverse_roots(part, damping)
        point = _point_of_ray(part)
        V = _coupling(part) @ roots[point].transpose(0, 2, 1)
        u = np.einsum("pij,pj->pi", roots, _gradient_of_points(part, part.residual))
        one, other = _pairs(part)
        products = -V[one] @ V[other].transpose(0, 2, 1)
        itself = np.flatnonzero(one == other)
        products[itself] += part.by_others.transpose(0, 2, 1) @ part.by_others
        columns = part.columns_of_rays
        places, mirrored = _places(system.matrix.structure, columns[one], columns[other])
        wanted = (places >= 0) & ~mirrored
        np.add.at(system.matrix.values, places[wanted], products[wanted])
        free = columns >= 0
        own = -np.einsum("nck,nc->nk", part.by_others, part.residual)
        np.add.at(system.gradient, columns[free], own[free])
        left = own - np.einsum("nkj,nj->nk", V, u[point])
        np.add.at(system.right_hand_side, columns[free], left[free])
        np.add.at(system.diagonal, columns[free], np.square(part.by_others).sum(axis=1)[free])
        held.append(vanished)
        gradient.append(_gradient_of_points(part, part.residual))
    return np.concatenate(held), np.concatenate(gradient)


def back_substitute(rays: Rays, reduced_step: FloatArray, damping: float) -> FloatArray:
    """Return the steps (p, 3) of the points after the step (n,) of the others."""
    columns = rays.columns_of_rays
    step_of_column = np.where(columns >= 0, reduced_step[columns], 0.0)
    moved = rays.residual + np.einsum("nck,nk->nc", rays.by_others, step_of_column)
    roots, _ = _inverse_roots(rays, damping)
    u = np.einsum("pij,pj->pi", roots, _gradient_of_points(rays, moved))
    steps: FloatArray = np.einsum("pij,pi->pj", roots, u)
    return steps


def cofactors(rays: Rays, inverse: BlockMatrix) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return Q_pp (p, 3, 3), cofactors (n, 2, 2) of the whitened computed values, and shares (n, 2) of the points."""
    of_points, of_rays, shares = [np.empty((0, 3, 3))], [np.empty((0, 2, 2))], [np.empty((0, 2))]
    for part in _parts(rays):
        roots, _ = _inverse_roots(part, 0.0)
        point = _point_of_ray(part)
        inverse_of_points = roots.transpose(0, 2, 1) @ roots
        E = _coupling(part) @ inverse_of_points[point]
        one, other = _pairs(part)
        columns = part.columns_of_rays
        places, _ = _places(inverse.structure, columns[one], columns[other])
        Q = np.where(places >= 0, inverse.values[places], 0.0)
        H = np.zeros_like(E)
        np.add.at(H, one, Q @ E[other])
        Q_pp = inverse_of_points
        np.add.at(Q_pp, point, E.transpose(0, 2, 1) @ H)
        across = part.by_point.transpose(0, 2, 1)
        own = part.by_point @ Q_pp[point] @ across
        mixed = part.by_others @ H @ across
        others = part.by_others @ Q[one == other] @ part.by_others.transpose(0, 2, 1)
        of_points.append(Q_pp)
        of_rays.append(own - mixed - mixed.transpose(0, 2, 1) + others)
        shares.append(np.diagonal(own - mixed, axis1=1, axis2=2))
    return np.concatenate(of_points), np.concatenate(of_rays), np.concatenate(shares)


def _parts(rays: Rays) -> Iterator[Rays]:
    """Yield handfuls of whole points, few enough for the memory."""
    pointers = rays.point_pointers
    entries = np.concatenate(([0], np.cumsum(np.diff(pointers) ** 2 * rays.columns.shape[1] ** 2)))
    first = 0
    while first < rays.points:
        last = int(np.searchsorted(entries, entries[first] + _ENTRIES_AT_A_TIME, side="right")) - 1
        last = max(last, first + 1)
        part = slice(pointers[first], pointers[last])
        yield Rays(
            rays.residual[part],
            rays.by_point[part],
            rays.by_others[part],
            rays.columns,
            pointers[first : last + 1] - pointers[first],
            rays.frame[part],
        )
        first = last


def _point_of_ray(rays: Rays) -> IntArray:
    """Return the (n,) point of each ray."""
    return np.repeat(np.arange(rays.points, dtype=np.int64), np.diff(rays.point_pointers))


def _inverse_roots(rays: Rays, damping: float) -> tuple[FloatArray, BoolArray]:
    """Return L⁻¹ (p, 3, 3) of N_pp = L Lᵀ, zero in rows and columns of coordinates held, and those (p, 3)."""
    N = np.zeros((rays.points, 3, 3))
    np.add.at(N, _point_of_ray(rays), rays.by_point.transpose(0, 2, 1) @ rays.by_point)
    L, held = np.zeros_like(N), np.zeros((rays.points, 3), dtype=np.bool_)
    inverse = np.zeros((rays.points, 3))
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
    gradient = np.zeros((rays.points, 3))
    np.add.at(gradient, _point_of_ray(rays), -np.einsum("ncj,nc->nj", rays.by_point, residual))
    return gradient


def _pairs(rays: Rays) -> tuple[IntArray, IntArray]:
    """Return all ordered pairs of rays of the same point."""
    degree = np.diff(rays.point_pointers)
    partners = np.repeat(degree, degree)
    one = np.repeat(np.arange(rays.rays, dtype=np.int64), partners)
    start = np.repeat(rays.point_pointers[:-1], degree)
    within = np.arange(one.size) - np.repeat(np.cumsum(partners) - partners, partners)
    return one, start[one] + within


def _places(structure: BlockStructure, rows: IntArray, columns: IntArray) -> tuple[IntArray, BoolArray]:
    """Return where the entries (rows[i, k], columns[i, m]) stand in the flat values, and which are mirrored.

    Returns (pairs, K, K) places, -1 where one of the two is fixed, and whether the entry stands above the
    diagonal blocks, so that its place is that of its mirror image.
    """
    r, c = np.broadcast_arrays(rows[:, :, None], columns[:, None, :])
    free = (r >= 0) & (c >= 0)
    places = np.full(r.shape, -1, dtype=np.int64)
    mirrored = np.zeros(r.shape, dtype=np.bool_)
    above = structure.block_of[r[free]] < structure.block_of[c[free]]
    low, high = np.where(above, c[free], r[free]), np.where(above, r[free], c[free])
    low_block, high_block = structure.block_of[low], structure.block_of[high]
    starts = find_blocks(structure, low_block, high_block)
    if (starts < 0).any():
        raise ValueError("the pattern lacks a pair of blocks that meet in a point of the chunk")
    width = structure.sizes[high_block]
    within = (low - structure.offsets[low_block]) * width + high - structure.offsets[high_block]
    places[free] = starts + within
    mirrored[free] = above
    return places, mirrored
