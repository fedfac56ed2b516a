"""Kernels that linearise image rays and eliminate their points, or find their steps, piece by piece.

A piece is so small that its Jacobians, and the couplings they become, stay in the cache.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.rays.compiled.cliques import NONE, Pattern
from mor.adjustment.rays.compiled.frame_sums import add_rays
from mor.adjustment.rays.compiled.pieces import end_of_piece, largest_piece
from mor.adjustment.rays.compiled.point_products import Gathering, store_points
from mor.adjustment.rays.compiled.points import solve_points, whiten_points
from mor.adjustment.rays.compiled.sights.image_rays import (
    FrameChange,
    FrameValues,
    Layout,
    Measured,
    Paths,
    follow,
    linearise,
)
from mor.adjustment.rays.compiled.sights.moving_rays import follow_moving, linearise_moving
from mor.adjustment.rays.compiled.sights.path_rays import follow_along, linearise_along
from mor.arrays import BoolArray, FloatArray, IntArray, SmallIntArray
from mor.compilation import compile_kernel

RAYS_OF_A_PIECE = 1024


class ImageRays(NamedTuple):
    """Image rays of whole points, not yet linearised.

    Attributes:
        values, layout: see there.
        frames: (f,) numbers of their frames in ``values``.
        local: (n,) frame of each ray, as its place in ``frames``.
        pointers: (p+1,) rays of each point.
        points: (p, 3) coordinates.
        measured: see there.
    """

    values: FrameValues
    layout: Layout
    frames: IntArray
    local: SmallIntArray
    pointers: IntArray
    points: FloatArray
    measured: Measured

    @property
    def paths(self) -> Paths | None:
        """Paths of the frames, ``None`` where no pose is one between knots."""
        return self.values.paths if len(self.values.paths.knots) else None


@compile_kernel
def gather_image_rays(
    gathering: Gathering,
    rays: ImageRays,
    paths: Paths | None,
    damping: float,
    pattern: Pattern,
    matrix: FloatArray,
    held: BoolArray,
    gradient: FloatArray,
) -> tuple[bool, float]:
    """Gather the points; return whether all pairs of blocks are stored, and the sum of the squared residuals.

    ``paths`` are those of the rays; where they are ``None`` nothing is compiled for them, which takes its time.
    """
    values, layout, frames, local, pointers, points, (observed, weight, measured, clock) = rays
    count, width = points.shape[0], gathering.columns.shape[1]
    room = largest_piece(pointers, RAYS_OF_A_PIECE)
    residuals, by_points = np.empty((room, 2)), np.empty((room, 2, 3))
    shifted, whites = np.empty((room, 2)), np.empty((room, 2, 3))
    by_others, without = np.empty((room, 2, width)), np.zeros((room, 2, width))
    in_chunk, overall = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64)
    squares, first = 0.0, NONE
    while first < count:
        last = end_of_piece(pointers, first, RAYS_OF_A_PIECE)
        begin, end = pointers[first], pointers[last]
        n = end - begin
        for i in range(n):
            in_chunk[i] = local[begin + i]
            overall[i] = frames[in_chunk[i]]
        own = pointers[first : last + 1] - begin
        piece = Measured(observed[begin:end], weight[begin:end], measured[begin:end], clock[begin:end])
        residual, by_point, by_other = residuals[:n], by_points[:n], by_others[:n]
        linearise(values, layout, overall[:n], own, points[first:last], piece, residual, by_point, by_other)
        linearise_moving(
            values, layout, overall[:n], own, points[first:last], piece, residual, by_point, by_other
        )
        if paths is not None:
            linearise_along(
                values, layout, overall[:n], own, points[first:last], piece, residual, by_point, by_other
            )
        for i in range(n):
            squares += residual[i, 0] * residual[i, 0] + residual[i, 1] * residual[i, 1]
        white, moved = whites[:n], shifted[:n]
        gradients, holds = gradient[first:last], held[first:last]
        whiten_points(by_point, residual, own, damping, white, moved, holds, gradients)
        reduced = without[:n] if gathering.nested else by_other
        if not store_points(gathering, white, by_other, reduced, in_chunk[:n], own, pattern, matrix):
            return False, squares
        add_rays(residual, moved, by_other, reduced, in_chunk[:n], gathering.sums)
        first = last
    return True, squares


@compile_kernel
def solve_image_points(
    rays: ImageRays, paths: Paths | None, change: FrameChange, damping: float, steps: FloatArray
) -> None:
    """Set the steps (p, 3) of the points after a small change of the frames."""
    values, _, frames, local, pointers, points, (observed, weight, measured, clock) = rays
    room = largest_piece(pointers, RAYS_OF_A_PIECE)
    residuals, by_points, overall = (
        np.empty((room, 2)),
        np.empty((room, 2, 3)),
        np.empty(room, dtype=np.int64),
    )
    first = NONE
    while first < points.shape[0]:
        last = end_of_piece(pointers, first, RAYS_OF_A_PIECE)
        begin, end = pointers[first], pointers[last]
        n = end - begin
        for i in range(n):
            overall[i] = frames[local[begin + i]]
        own = pointers[first : last + 1] - begin
        piece = Measured(observed[begin:end], weight[begin:end], measured[begin:end], clock[begin:end])
        residual, by_point = residuals[:n], by_points[:n]
        follow(values, change, overall[:n], own, points[first:last], piece, residual, by_point)
        follow_moving(values, change, overall[:n], own, points[first:last], piece, residual, by_point)
        if paths is not None:
            follow_along(values, change, overall[:n], own, points[first:last], piece, residual, by_point)
        solve_points(residual, by_point, own, damping, steps[first:last])
        first = last
