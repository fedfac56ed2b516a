"""What an error of 1 in an observation does to its points: what EP, the influence on position, is made of.

An error ∇ in observation i moves all unknowns by x = Q Aᵀ P e_i ∇ in the datum of the adjustment. What it *carries*
into its points is, with a' the derivatives of the observation by the coordinates that count,

    a' x/∇ = a' (Q Aᵀ P)_i    for all terrestrial observations: every free coordinate counts; angles are multiplied by
                              the length of the sight,
    a' x/∇ / |∂x/∂X|          for image coordinates: their object point counts, the projection centre does not. It is
                              the movement of the point across the ray.

The cofactors Q of the factorisation are those of a minimal datum without the weak directions. As A G = 0 for the null
vectors G, all that is missing in Q Aᵀ is a sum of few directions:

    S Q Sᵀ Aᵀ = Q Aᵀ + own (A through)ᵀ,    own = (weak, −G H),  through = (weak, Q B)    with S = I − G H Bᵀ.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor import compilation
from mor.adjustment.datum.s_transformation import STransformation
from mor.adjustment.normals import image_of_rays
from mor.adjustment.plan import Plan
from mor.adjustment.rays.chunks import RayChunk
from mor.adjustment.rays.plan import RayPlan
from mor.adjustment.rays.point_solutions import point_of_ray
from mor.adjustment.state import Adjustment
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.observations import FOLLOWER_TYPES, IMAGE_TYPES, MOVING_TYPES
from mor.quality.reliability import ray_kernels as compiled_rays

OF_IMAGES = frozenset(
    kind.key for kinds in (IMAGE_TYPES, FOLLOWER_TYPES, MOVING_TYPES) for kind in kinds.values()
)
"""Keys of the observation types that are image coordinates of a point, their last block."""


class Directions(NamedTuple):
    """What weak directions and the datum add to Q Aᵀ, (u, k) each: own (A through)ᵀ."""

    own: FloatArray
    through: FloatArray

    def added(self, own: FloatArray, jacobian: FloatArray, columns: IntArray) -> FloatArray:
        """a' own (A through)ᵀ (n, m) for rows with a' and A (n, m, K) and their columns (n, K), −1 where fixed."""
        free = (columns >= 0)[:, :, None]
        parts = (np.where(free, array[columns], 0.0) for array in self)
        moved, image = (form @ part for form, part in zip((own, jacobian), parts, strict=True))
        added: FloatArray = np.sum(moved * image, axis=2)
        return added


def directions(adjustment: Adjustment, datum: STransformation) -> Directions:
    """What is missing in the cofactors of the factorisation, for the datum of the adjustment."""
    weak = adjustment.inverse.weak
    return Directions(
        np.concatenate([weak, -datum.null @ datum.binding], axis=1),
        np.concatenate([weak, datum.through], axis=1),
    )


def counted_columns(adjustment: Adjustment, number: int, rows: IntArray, columns: IntArray) -> BoolArray:
    """(n, K) those of the columns of the rows of a group whose movement counts."""
    group, index = adjustment.problem.groups[number], adjustment.problem.index
    if group.type.key not in OF_IMAGES:
        is_point = np.array([kind == "point" for kind in index.unknown_kind])
        return np.asarray((columns >= 0) & is_point[index.kind_of[np.maximum(columns, 0)]])
    target = index.columns["point"][group.blocks[-1][rows]]
    counted: BoolArray = (columns[:, :, None] == target[:, None, :]).any(axis=2) & (columns >= 0)
    return counted


def add_directions(plan: Plan, lane: RayPlan, chunk: RayChunk, extra: Directions, shares: FloatArray) -> None:
    """Add to the shares (n, 2) of the rays of a chunk what the minimal datum lacks, in place."""
    if extra.own.shape[1] == 0:
        return
    rays, columns = chunk.rays, lane.columns[chunk.points]
    own, through = (np.ascontiguousarray(array[columns]) for array in extra)
    reduced = extra.through[plan.kept]
    if compilation.wanted():
        of_frames = np.where((rays.columns >= 0)[:, :, None], reduced[rays.columns], 0.0)
        of_frames = np.ascontiguousarray(np.swapaxes(of_frames, 1, 2))
        arrays = rays.by_point, rays.by_others, rays.frame, rays.point_pointers
        compiled_rays.add_directions(*arrays, own, of_frames, through, shares)
        return
    image = image_of_rays(rays, reduced, through)
    shares += np.sum((rays.by_point @ own[point_of_ray(rays)]) * image, axis=2)


def lengths_of_rays(chunk: RayChunk) -> FloatArray:
    """(n, 2) 1/|∂x/∂X|, which makes of shares of rays what an error of 1 carries into their points."""
    slope = np.sqrt(np.einsum("ncj,ncj->nc", chunk.rays.by_point, chunk.rays.by_point))
    return _quotient(chunk.weight, slope)


def lengths_of_rows(
    adjustment: Adjustment, number: int, rows: IntArray, jacobian: FloatArray, columns: IntArray
) -> FloatArray:
    """The same (n, m) for rows of a group with Jacobians (n, m, K); 0 for image coordinates of points that are held."""
    group, index = adjustment.problem.groups[number], adjustment.problem.index
    if group.type.key not in OF_IMAGES:
        return length_of_sight(adjustment, number, rows)
    target = index.columns["point"][group.blocks[-1][rows]]
    if not np.array_equal(columns[:, -3:], target):  # held throughout, and left out of the columns
        return np.zeros(jacobian.shape[:2])
    slope = np.linalg.norm(jacobian[:, :, -3:], axis=2)
    return _quotient(np.ones_like(slope), slope)


def _quotient(above: FloatArray, below: FloatArray) -> FloatArray:
    """The quotient, 0 where there is nothing below."""
    quotient: FloatArray = np.divide(above, below, out=np.zeros_like(below), where=below > 0.0)
    return quotient


def length_of_sight(adjustment: Adjustment, number: int, rows: IntArray) -> FloatArray:
    """(n, m) length of the sight for angular components of the rows, 1 for all others."""
    group = adjustment.problem.groups[number]
    positions = [
        adjustment.values["point"][blocks[rows]]
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True)
        if slot.kind == "point" and slot.part == "position"
    ]
    angular = group.type.wraps
    if len(positions) < 2 or not angular.any():
        return np.ones((len(rows), group.observed.shape[1]))
    along = positions[-1] - positions[0]
    horizontal, slope = np.hypot(along[:, 0], along[:, 1]), np.linalg.norm(along, axis=1)
    columns = [
        (horizontal if component in group.type.turns else slope) if turns else np.ones(len(slope))
        for component, turns in enumerate(angular)
    ]
    return np.stack(columns, axis=1)
