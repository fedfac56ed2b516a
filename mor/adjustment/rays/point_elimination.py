"""Elimination of the points that only rays meet: they are by far the most, and none of them enters the big
system.

Such a point has a 3×3 system of its own. Eliminating it leaves a *reduced* system of all other unknowns, in
which the blocks of its rays form a clique (D. C. Brown, 1958; Schur complement). The rays come in chunks of
whole points, are used and forgotten; the pass is repeated for the steps of the points and for the cofactors.

Every function has a plain numpy form in ``point_reference`` and a compiled one in ``compiled``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mor import compilation
from mor.adjustment.rays import point_reference
from mor.adjustment.rays.compiled import (
    common_columns,
    frame_sums,
    image_passes,
    point_cofactors,
    point_products,
    points,
)
from mor.adjustment.rays.compiled.cliques import Pattern
from mor.adjustment.rays.compiled.image_passes import ImageRays
from mor.adjustment.rays.compiled.point_products import System
from mor.adjustment.rays.linearised import Rays
from mor.adjustment.rays.reduced_system import ReducedSystem
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.sparse.block_matrix import BlockMatrix, BlockStructure

_FOURS = 4
"""Columns that are worked on together where cofactors are worked out."""


class Eliminated(NamedTuple):
    """What is noted of the points of a chunk while they are eliminated."""

    held: BoolArray
    """(p, 3) whether a coordinate is left undetermined by the rays of its point, even if all else is known.

    It is held: it neither moves nor weakens anything.
    """
    gradient: FloatArray
    """(p, 3) −Σ aᵀ residual."""


def accumulate(rays: Rays, reduced: ReducedSystem, damping: float = 0.0) -> Eliminated:
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
        return Eliminated(*point_reference.accumulate(rays, reduced, damping))
    residual, by_point, by_others, frame, columns, pointers = _arrays(_wide(rays, frame_sums.COLUMNS))
    pattern, system = _pattern(reduced.matrix.structure), _system(reduced)
    gathering = point_products.begin_gathering(columns, pattern)
    noted = _nothing_noted(rays.points)
    white, moved = np.empty(by_point.shape), np.empty(residual.shape)
    points.whiten_points(by_point, residual, pointers, damping, white, moved, *noted)
    reduced_rows = np.zeros(by_others.shape) if gathering.nested else by_others
    arrays = white, by_others, reduced_rows, frame, pointers
    stored = point_products.store_points(gathering, *arrays, pattern, system.values)
    frame_sums.add_rays(residual, moved, by_others, reduced_rows, frame, gathering.sums)
    _refuse_unless(stored and point_products.finish_gathering(gathering, pattern, system))
    return noted


def accumulate_images(
    columns: IntArray, rays: ImageRays, reduced: ReducedSystem, damping: float = 0.0
) -> tuple[Eliminated, float]:
    """Linearise image rays of frames with these columns (f, K) and do the same; compiled only.

    Returns:
        What ``accumulate`` does, and the sum of the squared residuals.

    Raises:
        ValueError: as ``accumulate``.
    """
    _refuse_columns_beyond(columns, reduced.matrix.structure.unknowns)
    wide = np.ascontiguousarray(_wide_columns(columns, frame_sums.COLUMNS), dtype=np.int64)
    pattern, system = _pattern(reduced.matrix.structure), _system(reduced)
    gathering = point_products.begin_gathering(wide, pattern)
    noted = _nothing_noted(len(rays.points))
    stored, squares = image_passes.gather_image_rays(
        gathering, rays, rays.paths, damping, pattern, system.values, *noted
    )
    _refuse_unless(stored and point_products.finish_gathering(gathering, pattern, system))
    return noted, squares


def follow_directions(rays: Rays, directions: FloatArray, damping: float = 0.0) -> FloatArray:
    """Return how the points of a chunk follow (p, 3, k) directions (n, k) of the reduced unknowns: −N_pp⁻¹ Wᵀ g."""
    if damping or not compilation.wanted():
        return point_reference.follow_directions(rays, directions, damping)
    _refuse_columns_beyond(rays.columns, len(directions))
    of_points = np.empty((rays.points, 3, directions.shape[1]))
    points.follow_directions(*_arrays(rays)[1:], np.ascontiguousarray(directions), of_points)
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
        return point_reference.back_substitute(rays, reduced_step, damping)
    moved = np.where(rays.columns >= 0, reduced_step[rays.columns], 0.0)[rays.frame]
    residual = rays.residual + np.einsum("nck,nk->nc", rays.by_others, moved)
    by_point = np.ascontiguousarray(rays.by_point, dtype=np.float64)
    steps = np.empty((rays.points, 3))
    points.solve_points(residual, by_point, rays.point_pointers, damping, steps)
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
    """The selected inverse Q of a reduced system, and what kernels take of it: R and W of ``common_columns``."""

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
    common_columns.split_cofactors(common, _pattern(inverse.structure), inverse.values, by_common, rest)
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
        return Cofactors(*point_reference.cofactors(rays, selected.inverse))
    result = Cofactors(np.empty((rays.points, 3, 3)), np.empty((rays.rays, 2, 2)), np.empty((rays.rays, 2)))
    stored = point_cofactors.cofactors(
        *_arrays(_wide(rays, _FOURS))[1:],
        selected.own,
        _pattern(structure),
        selected.rest,
        selected.by_common,
        *result,
    )
    _refuse_unless(stored)
    return result


def _pattern(structure: BlockStructure) -> Pattern:
    """Return the arrays of a pattern as the kernels take them."""
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


def _system(reduced: ReducedSystem) -> System:
    """Return the arrays of a reduced system as the kernels take them."""
    return System(reduced.matrix.values, reduced.right_hand_side, reduced.diagonal, reduced.gradient)


def _nothing_noted(points: int) -> Eliminated:
    return Eliminated(np.empty((points, 3), dtype=np.bool_), np.empty((points, 3)))


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
    """Raise where a ray has a column that the reduced system does not have."""
    if columns.max(initial=-1) >= unknowns:
        raise ValueError(f"the rays have columns beyond the {unknowns} unknowns of the reduced system")


def _refuse_unless(stored: bool) -> None:
    """Raise where a kernel met a pair of blocks that is not stored."""
    if not stored:
        raise ValueError("the pattern lacks a pair of blocks that meet in a point of the chunk")
