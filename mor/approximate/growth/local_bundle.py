"""Frames at the edge of what is known, adjusted together with the points they see.

Such a frame is tied on one side only. Posed one by one, each on points of the last, small errors in attitude grow from
row to row by a constant factor; adjusted together with its neighbours they do not. It is one step of a bundle
adjustment of some points of some frames: points eliminated, frames outside held, given positions with their σ. More
steps are not needed, for every frame takes part several times.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse

from mor.approximate.bundle import Bundle, direction_bundle
from mor.approximate.growth.forward_intersection import PosedFrames
from mor.approximate.growth.pose_frame import observed_centres
from mor.approximate.parts.frames import SLACKS, Frame, loosened
from mor.approximate.parts.part import Part
from mor.approximate.parts.sightings import Sightings
from mor.approximate.reprojection import reproject
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry import tolerant
from mor.geometry.rotations import cross_matrix, rotate
from mor.sparse.block_matrix import BlockMatrix, BlockStructure
from mor.sparse.cholesky import NotFiniteError, factorise
from mor.sparse.symbolic_factorisation import analyse

_SAMPLE = 40
"""Points of a frame that take part."""
_NEAR = 10.0
"""Misfit in units of σ up to which a ray has a say."""
_POSE = 6
"""Unknowns of a frame."""
_LOOSE = 1e-9
"""Part of the diagonal added to it, so that what nothing ties stays where it is."""


class _Rays(NamedTuple):
    """Rays of posed frames to the points that take part."""

    bundle: Bundle
    frame: IntArray
    column: IntArray
    """Number among the moving frames, −1 where a frame is held."""
    point: IntArray
    """Number among the points."""
    height: FloatArray
    held: BoolArray
    """(points,) true where the coordinates are given."""


def settle(
    part: Part, frames: Sequence[Frame], seen: Sightings, poses: PosedFrames, moving: Sequence[int]
) -> None:
    """Adjust the poses of the ``moving`` frames, in ``part`` and in ``poses``; the points only lead to them."""
    points = _points(part, frames, moving)
    if len(points) == 0:
        return
    column = np.full(seen.frames, -1, dtype=np.int64)
    column[list(moving)] = np.arange(len(moving))
    rays = _rays(part, seen, poses, points, column)
    try:
        change = _step(part, frames, poses, rays, part.points[points], moving)
    except NotFiniteError:
        return
    poses.centres[list(moving)] += change[:, :3]
    poses.turns[list(moving)] = rotate(poses.turns[list(moving)], change[:, 3:])
    for number in moving:
        part.poses[number] = (poses.centres[number].copy(), poses.turns[number].copy())


def _points(part: Part, frames: Sequence[Frame], moving: Sequence[int]) -> IntArray:
    """Of each frame the points that come first in an order without rule, so that frames have them in common."""
    chosen = np.zeros(len(part.points), dtype=bool)
    for number in moving:
        points = frames[number].points
        points = points[part.known(points)]
        if len(points) > _SAMPLE:
            points = points[np.argpartition(_shuffled(points), _SAMPLE)[:_SAMPLE]]
        chosen[points] = True
    return np.flatnonzero(chosen)


def _shuffled(points: IntArray) -> IntArray:
    """Places of points (n,) in an order that has nothing to do with their numbers (Fibonacci hashing)."""
    return (points * 2654435769) % 2**32


def _rays(part: Part, seen: Sightings, poses: PosedFrames, points: IntArray, column: IntArray) -> _Rays:
    rays = seen.of_points(points)
    point = np.repeat(np.arange(len(points)), seen.pointers[points + 1] - seen.pointers[points])
    posed = np.isfinite(poses.centres[seen.frame[rays], 0])
    rays, point = rays[posed], point[posed]
    sigma = loosened(seen.sigma[rays], max(part.slack, SLACKS[1]))
    frame = seen.frame[rays]
    bundle = direction_bundle(seen.rays[rays], sigma)
    return _Rays(bundle, frame, column[frame], point, seen.height[rays], part.fixed[points])


def _step(
    part: Part,
    frames: Sequence[Frame],
    poses: PosedFrames,
    rays: _Rays,
    X: FloatArray,
    moving: Sequence[int],
) -> FloatArray:
    """One step of Gauss–Newton, points eliminated: changes (m, 6) of X0 and δ of the moving frames."""
    residuals, by_pose, by_point = _linearised(poses, rays, X)
    of_points = _summed(by_point, by_point, rays.point, len(X))
    size = np.trace(of_points, axis1=1, axis2=2)
    tie = np.where(size > 0.0, np.where(rays.held, 1e12, _LOOSE) * size, 1.0)
    of_points += tie[:, None, None] * np.eye(3)
    inverse = tolerant.inv(of_points).astype(np.float64)
    point_side = _summed(by_point, residuals[:, :, None], rays.point, len(X))[:, :, 0]
    order = np.argsort(rays.column, kind="stable")[np.count_nonzero(rays.column < 0) :]
    row, column, shape = rays.column[order], rays.point[order], (len(moving), len(X))
    by_pose = by_pose[order]
    of_frames = _summed(by_pose, by_pose, row, len(moving))
    frame_side = _summed(by_pose, residuals[order][:, :, None], row, len(moving))[:, :, 0]
    _hold_by_positions(part, frames, poses, X, moving, of_frames, frame_side)
    own = np.einsum("nii->ni", of_frames)
    own += np.where(own > 0.0, _LOOSE * own, 1.0)
    mixed = by_pose.transpose(0, 2, 1) @ by_point[order]
    across = _blocks(mixed, row, column, shape)
    reach = _blocks(mixed @ inverse[column], row, column, shape)
    each = np.arange(len(moving))
    diagonal = _blocks(of_frames, each, each, (len(moving), len(moving)))
    reduced = _lower_triangle((diagonal - reach @ across.T).tobsr())
    return _solved(reduced, frame_side.ravel() - reach @ point_side.ravel()).reshape(-1, 6)


def _linearised(poses: PosedFrames, rays: _Rays, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (n, 2), derivatives (n, 2, 6) by the pose and (n, 2, 3) by the point; 0 for rays that pass by."""
    D = poses.turns[rays.frame]
    away = X[rays.point] - poses.centres[rays.frame]
    away[:, 2] += rays.height
    star = np.einsum("nij,nj->ni", D, away)
    computed = reproject(rays.bundle, star)
    near = np.linalg.norm(computed.residuals, axis=1) < _NEAR
    by_star = computed.by_star * near[:, None, None]
    by_point = by_star @ D
    by_pose = np.concatenate([-by_point, by_star @ cross_matrix(star)], axis=2)
    return computed.residuals * near[:, None], by_pose, by_point


def _summed(first: FloatArray, second: FloatArray, number: IntArray, count: int) -> FloatArray:
    """Sums (count, i, j) of firstᵀ second of the rays of each ``number`` (n,), which ascends."""
    products = first.transpose(0, 2, 1) @ second
    begins = np.flatnonzero(np.diff(number, prepend=-1))
    summed = np.zeros((count, *products.shape[1:]))
    summed[number[begins]] = np.add.reduceat(products, begins, axis=0)
    return summed


def _hold_by_positions(
    part: Part,
    frames: Sequence[Frame],
    poses: PosedFrames,
    X: FloatArray,
    moving: Sequence[int],
    of_frames: FloatArray,
    side: FloatArray,
) -> None:
    known, place, sigma = observed_centres(
        part, [frames[number] for number in moving], poses.turns[list(moving)], X
    )
    held = np.flatnonzero(known)
    weight = sigma[held] ** -2.0
    of_frames[held[:, None], np.arange(3), np.arange(3)] += weight
    side[held, :3] += weight * (poses.centres[list(moving)][held] - place[held])


def _blocks(
    blocks: FloatArray, row: IntArray, column: IntArray, shape: tuple[int, int]
) -> scipy.sparse.bsr_array:
    """Sparse matrix of blocks (n, i, j) at their block columns, sorted by block rows; those at one place are added."""
    _, height, width = blocks.shape
    pointers = np.searchsorted(row, np.arange(shape[0] + 1))
    size = (height * shape[0], width * shape[1])
    return scipy.sparse.bsr_array((blocks, column, pointers), shape=size, blocksize=(height, width))


def _lower_triangle(matrix: scipy.sparse.bsr_array) -> BlockMatrix:
    """A symmetric matrix of square blocks as the factorisation takes it, which has an entry in every diagonal block."""
    matrix.sort_indices()
    count = len(matrix.indptr) - 1
    row = np.repeat(np.arange(count), np.diff(matrix.indptr))
    kept = matrix.indices >= row
    column_pointers = np.concatenate([[0], np.cumsum(np.bincount(row[kept], minlength=count))])
    structure = BlockStructure(
        _POSE * np.arange(count + 1),
        column_pointers.astype(np.int64),
        matrix.indices[kept].astype(np.int64),
        _POSE**2 * np.arange(int(kept.sum()) + 1),
    )
    return BlockMatrix(structure, matrix.data[kept].transpose(0, 2, 1).ravel())


def _solved(matrix: BlockMatrix, side: FloatArray) -> FloatArray:
    """Solution of matrix · x = −side, scaled to a unit diagonal. Raises :class:`NotFiniteError`."""
    diagonal = matrix.diagonal()
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    factor = factorise(matrix.scaled(scale), analyse(matrix.structure))
    return -scale * factor.solve(scale * side)
