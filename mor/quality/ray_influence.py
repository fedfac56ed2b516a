"""What the estimated gross error of every ray does to its point: EP, as one number for each image coordinate.

With a the derivatives of a whitened image coordinate by its point, j those by all else, the part of an error that goes
into the point is

    share = a (Q Aᵀ)_p = a Q_pp aᵀ + a Q_po jᵀ = ½ (J Q Jᵀ + a Q_pp aᵀ − j Q_oo jᵀ),        J = (a, j),

so that the pass that gives the redundancy numbers gives it as well: Q_oo is that of one frame and its camera, and is
stored. Divided by |∂x/∂X| it is a length at the object, as angles are multiplied with the length of their sight: the
movement of the point in the direction in which it changes the image coordinate most.
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.block_matrix import BlockMatrix
from mor.adjustment.lanes import in_lanes
from mor.adjustment.normals import image_of_rays
from mor.adjustment.point_elimination import cofactors as ray_cofactors
from mor.adjustment.point_solutions import point_of_ray
from mor.adjustment.ray_chunks import RayChunk, ray_chunks
from mor.adjustment.ray_plan import RayPlan
from mor.adjustment.rays import Rays
from mor.adjustment.rows import block_cofactors
from mor.geometry.arrays import FloatArray
from mor.observations import FOLLOWER_TYPES, IMAGE_TYPES
from mor.quality.assess import Quality

OF_IMAGES = frozenset(kind.key for kind in (*IMAGE_TYPES.values(), *FOLLOWER_TYPES.values()))
"""Keys of the observation types that are image coordinates of a point, their last block."""


def fill_influence_of_rays(quality: Quality, cofactors: BlockMatrix, result: tuple[FloatArray, ...]) -> None:
    """Set EP (n, m) of the image coordinates of eliminated points, in internal units of length, in place.

    ``cofactors`` is the selected inverse of the adjustment. Other types of rays are left as they are.
    """
    plan, values = quality.adjustment.plan, quality.adjustment.inverse.values

    def of_lane(lane: RayPlan) -> None:
        for chunk in ray_chunks(quality.adjustment.problem, lane, plan.reduced, values):
            _fill_chunk(quality, lane, chunk, cofactors, result)

    in_lanes(plan.rays, 0, of_lane)


def _fill_chunk(
    quality: Quality, lane: RayPlan, chunk: RayChunk, cofactors: BlockMatrix, result: tuple[FloatArray, ...]
) -> None:
    share = _share_of_points(quality, lane, chunk, cofactors)
    slope = np.linalg.norm(chunk.rays.by_point, axis=2)
    seen = (chunk.weight > 0.0) & (slope > 0.0)
    length = np.where(seen, chunk.weight / np.where(seen, slope, 1.0), np.nan)
    for number in np.unique(chunk.group):
        if quality.adjustment.problem.groups[number].type.key not in OF_IMAGES:
            continue
        here = chunk.group == number
        rows = chunk.row[here]
        error = quality.reliability[number].at(rows).error
        result[number][rows] = share[here] * length[here] * error


def _share_of_points(quality: Quality, lane: RayPlan, chunk: RayChunk, cofactors: BlockMatrix) -> FloatArray:
    """(n, 2) part of an error in each coordinate of a ray that goes into its point, in the datum of the adjustment."""
    plan, inverse, datum = quality.adjustment.plan, quality.adjustment.inverse, quality.datum
    rays, columns = chunk.rays, lane.columns[chunk.points]
    of_points, white = ray_cofactors(rays, cofactors)
    point = point_of_ray(rays)
    own = np.sum((rays.by_point @ of_points[point]) * rays.by_point, axis=2)
    whole = np.diagonal(white, axis1=1, axis2=2)
    share: FloatArray = 0.5 * (
        whole + own - _by_frames(rays, block_cofactors(plan.target, cofactors.values, rays.columns))
    )
    for by_point, through, sign in (
        (inverse.weak, inverse.weak, 1.0),
        (datum.null @ datum.binding, datum.through, -1.0),
    ):
        if by_point.shape[1]:
            moved = rays.by_point @ by_point[columns][point]
            image = image_of_rays(rays, through[plan.kept], through[columns])
            share = share + sign * np.sum(moved * image, axis=2)
    return share


def _by_frames(rays: Rays, of_frame: FloatArray) -> FloatArray:
    """(n, 2) j Q_oo jᵀ, from Q_oo (f, K, K) of every frame: the rays of a frame together, its free columns only."""
    result = np.zeros((rays.rays, 2))
    order = np.argsort(rays.frame, kind="stable")
    ends = np.cumsum(np.bincount(rays.frame, minlength=len(of_frame)))
    for frame, (first, end) in enumerate(zip(np.concatenate([[0], ends[:-1]]), ends, strict=True)):
        here, free = order[first:end], np.flatnonzero(rays.columns[frame] >= 0)
        if len(here) and len(free):
            j = rays.by_others[here][:, :, free]
            result[here] = np.sum((j @ of_frame[frame][np.ix_(free, free)]) * j, axis=2)
    return result
