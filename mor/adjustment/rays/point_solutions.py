"""From the reduced system to the eliminated points and back, one pass over the rays each.

With the rows of the rays split into A_p (their points) and A_r (all else), N_pp = A_pᵀA_p is block diagonal:

    reduced right-hand side   b_r − A_rᵀ A_p N_pp⁻¹ b_p
    points                    x_p = N_pp⁻¹ (b_p − A_pᵀ A_r x_r)
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.plan import Plan
from mor.adjustment.rays.chunks import RayChunk, point_steps, ray_chunks
from mor.adjustment.rays.lanes import in_lanes
from mor.adjustment.rays.linearised import Rays
from mor.adjustment.rays.plan import RayPlan
from mor.adjustment.rays.point_elimination import follow_directions
from mor.adjustment.rays.point_reference import inverse_roots
from mor.arrays import FloatArray
from mor.parameters.index import Values


def full_directions(plan: Plan, values: Values, reduced: FloatArray, damping: float = 0.0) -> FloatArray:
    """Directions (u, k) whose reduced part is given (n, k), the points following so that AᵀA g vanishes for them."""
    full = np.zeros((plan.problem.index.count, reduced.shape[1]))
    full[plan.kept] = reduced
    if reduced.shape[1] == 0:
        return full

    def of_lane(rays: RayPlan) -> None:
        for chunk in ray_chunks(plan.problem, rays, plan.reduced, values):
            full[rays.columns[chunk.points]] = follow_directions(chunk.rays, reduced, damping)

    in_lanes(plan.rays, 0, of_lane)
    return full


def full_step(plan: Plan, values: Values, reduced: FloatArray, damping: float = 0.0) -> FloatArray:
    """Step (u,) of all unknowns from that of the reduced ones (n,)."""
    full = np.zeros(plan.problem.index.count)
    full[plan.kept] = reduced
    steps = np.empty((len(plan.rays.columns), 3))

    def of_lane(rays: RayPlan) -> None:
        for points, found in point_steps(plan.problem, rays, values, full, damping):
            steps[points] = found

    in_lanes(plan.rays, 0, of_lane)
    full[plan.rays.columns] = steps
    return full


def reduce_right_hand_side(
    plan: Plan, values: Values, rhs: FloatArray, damping: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Reduced right-hand sides (n, k) of rhs (u, k), and N_pp⁻¹ b_p of the points (p, 3, k).

    Where points have nothing on their right-hand side, their rays are not looked at.
    """
    reduced = rhs[plan.kept].copy()
    of_points = rhs[plan.rays.columns]
    answer = np.zeros(of_points.shape)
    touched = np.asarray(of_points.any(axis=(1, 2)))
    wanted = tuple(chunk for chunk in plan.rays.chunks if touched[chunk.points].any())
    for chunk in ray_chunks(plan.problem, plan.rays._replace(chunks=wanted), plan.reduced, values):
        if not touched[chunk.points].any():
            continue
        rays = chunk.rays
        roots = inverse_roots(point_normals(rays), damping)[0]
        alone = roots.transpose(0, 2, 1) @ (roots @ of_points[chunk.points])
        answer[chunk.points] = alone
        moved = np.einsum("nmi,nik->nmk", rays.by_point, alone[point_of_ray(rays)])
        add_to_others(rays, -moved, reduced)
    return reduced, answer


def add_to_others(rays: Rays, image: FloatArray, into: FloatArray) -> None:
    """Add A_rᵀ of an image (n, 2, k) of the rays to the reduced unknowns (r, k), in place, frame by frame."""
    order = np.argsort(rays.frame, kind="stable")
    ends = np.cumsum(np.bincount(rays.frame, minlength=len(rays.columns)))
    by_others, width = rays.by_others[order], rays.by_others.shape[2]
    sorted_image = image[order]
    first = 0
    for columns, end in zip(rays.columns, ends, strict=True):
        free = columns >= 0
        if end > first and free.any():
            J, v = (
                by_others[first:end].reshape(-1, width),
                sorted_image[first:end].reshape(-1, image.shape[2]),
            )
            into[columns[free]] += (J.T @ v)[free]
        first = end


def point_normals(rays: Rays) -> FloatArray:
    """N_pp (p, 3, 3) of the points of a chunk."""
    products = np.einsum("nmi,nmj->nij", rays.by_point, rays.by_point)
    normals: FloatArray = np.add.reduceat(products, rays.point_pointers[:-1], axis=0)
    return normals


def point_of_ray(rays: Rays) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """(n,) point of each ray within its chunk."""
    return np.repeat(np.arange(rays.points), np.diff(rays.point_pointers))


__all__ = [
    "RayChunk",
    "add_to_others",
    "full_directions",
    "full_step",
    "reduce_right_hand_side",
]
