"""Shape of a plane object from two or more images, and points beside the plane, all adjusted together.

The start comes from pairs of images (:mod:`mor.approximate.planar.two_images`). Every pair leaves up to two shapes;
what the pairs of one image have in common is the normal of the plane as that image sees it, and with it a third image
decides. (The paper subtracts the cubics of two pairs as if they had one unknown. They do not: ϱ is the squared ratio of
the distances of S from the two images of its own pair.) Scale, position and turn in the plane stay free: see
:mod:`mor.approximate.planar.plane_object`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.intersection import nearest_point
from mor.approximate.planar.plane_adjustment import (
    AdjustedPlane,
    PlaneState,
    adjust_plane,
    covariance_in,
    inner_constraints,
)
from mor.approximate.planar.points_of_plane import carried_over
from mor.approximate.planar.two_images import (
    PlaneOrientation,
    PlaneOutcome,
    PlaneSolutions,
    along_normal,
    misfit_limit,
    planar_orientations,
    under_normal,
)
from mor.approximate.relative_orientation.nonlinearity import FAR, PROMISED
from mor.approximate.vectors import tangent_axes, unit
from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import cross_matrix

AS_GOOD = 25.0
"""Σ (v/σ)² by which another shape may be worse and still count as fitting equally well (5 σ)."""
MOVED = 5.0 / 3.0
"""Times its σ that a coordinate may change by for each σ of the normal: what is called five σ is three at least."""
SAME_NORMAL = 0.02
"""Angle in radians between the normals of two pairs up to which one of them is start enough."""
SAME = 1e-5
"""Differences of normals and attitudes, beyond their σ, up to which two shapes are one."""
SOLVED = (
    PlaneOutcome.UNIQUE,
    PlaneOutcome.AMBIGUOUS,
    PlaneOutcome.BASE_ALONG_NORMAL,
    PlaneOutcome.NOT_VISIBLE,
)
"""Outcomes of a pair that leave it to all images."""


class PlaneShape(NamedTuple):
    """Points in a plane and beside it, and the frames that see it; the plane is Z = 0, the frames at Z > 0."""

    outcome: PlaneOutcome
    points: FloatArray
    """(n, 2) in the plane, or the foot there; not a number where fewer than one image sees the point."""
    positions: FloatArray
    """(m, 3) projection centres."""
    rotations: FloatArray
    """(m, 3, 3) D of the images."""
    sigma_points: FloatArray
    """(n, 2) for the a-priori σ of the rays, with inner constraints over the points of the plane."""
    residuals: FloatArray
    """(m, n, 2) in units of σ; not a number where a point is not seen."""
    sigma0: float
    redundancy: int
    heights: FloatArray
    """(n,) above the plane, towards the frames; 0 in it."""
    in_plane: BoolArray
    """(n,)"""
    left_out: BoolArray
    """(n,) off the plane, and its rays do not meet in front of the images, or one image only sees it."""
    adjusted: AdjustedPlane | None
    """What :func:`mor.approximate.planar.plane_adjustment.covariance_in` carries into any datum."""
    sigma_normal: float
    """σ in radians of the normal of the plane as the first image sees it: the shape hangs on it."""
    alternatives: tuple[PlaneShape, ...] = ()
    """Other shapes that fit about as well, if the outcome is ambiguous."""


class _Rays(NamedTuple):
    bundles: Sequence[Bundle]
    seen: BoolArray
    """(m, n)"""
    in_plane: BoolArray
    """(n,)"""


def shape_of_plane(bundles: Sequence[Bundle], off: BoolArray | None = None) -> PlaneShape:
    """Shape from m ≥ 2 images with n rays each; a point that an image does not see has a ray of NaN there.

    The first image is in every pair and must share at least four points of the plane with each other one.
    ``off`` (n,) names points off the plane; without it they are found where most points lie in one. Degenerate data are
    named in the outcome (of the first pair where they are pairwise).
    """
    seen = np.stack([np.all(np.isfinite(bundle.rays), axis=1) for bundle in bundles])
    rays = _Rays(bundles, seen, _in_plane(bundles, seen) if off is None else ~off)
    pairs = []
    for k in range(1, len(bundles)):
        both = seen[0] & seen[k] & rays.in_plane
        pairs.append(planar_orientations(bundles[0].take(both), bundles[k].take(both)))
    based = [pair for pair in pairs if pair.outcome is not PlaneOutcome.NO_BASE]
    for pair in based:
        if pair.outcome not in SOLVED:
            return _failed(pair.outcome, rays)
    hypotheses = _hypotheses(rays, pairs)
    if not hypotheses:
        return _failed((based or pairs)[0].outcome, rays)
    shapes = [_adjusted(rays, _start(rays, chosen)) for chosen in hypotheses]
    return _decided(rays, pairs, shapes)


def _in_plane(bundles: Sequence[Bundle], seen: BoolArray) -> BoolArray:
    inside = np.ones(seen.shape[1], dtype=bool)
    for k in range(1, len(bundles)):
        both = np.flatnonzero(seen[0] & seen[k])
        if len(both) > 0:
            inside[both] &= carried_over(bundles[0].take(both), bundles[k].take(both))
    return inside


def _hypotheses(rays: _Rays, pairs: list[PlaneSolutions]) -> list[list[PlaneOrientation]]:
    """One orientation per pair, for each normal that the first image can see the plane under."""
    normals: list[FloatArray] = []
    for number, pair in enumerate(pairs, 1):
        double = [_double(rays, number, pair)] if pair.outcome is PlaneOutcome.BASE_ALONG_NORMAL else []
        for one in [*pair.solutions, *double]:
            if one.front > 0 and all(np.linalg.norm(one.normal - n) > SAME_NORMAL for n in normals):
                normals.append(one.normal)
    return [
        [_under(rays, number, pair, normal) for number, pair in enumerate(pairs, 1)] for normal in normals
    ]


def _double(rays: _Rays, number: int, pair: PlaneSolutions) -> PlaneOrientation:
    both = rays.seen[0] & rays.seen[number] & rays.in_plane
    matrix = np.eye(3) if pair.homography is None else pair.homography.matrix
    return along_normal(matrix, rays.bundles[0].rays[both], rays.bundles[number].rays[both])


def _under(rays: _Rays, number: int, pair: PlaneSolutions, normal: FloatArray) -> PlaneOrientation:
    """Image ``number`` under a normal; one at the first centre bears any."""
    if pair.outcome is PlaneOutcome.NO_BASE or pair.homography is None:
        return pair.solutions[0]._replace(normal=normal)
    for one in pair.solutions:
        if np.array_equal(one.normal, normal):
            return one
    both = rays.seen[0] & rays.seen[number] & rays.in_plane
    return under_normal(
        pair.homography.matrix, normal, rays.bundles[0].rays[both], rays.bundles[number].rays[both]
    )


def _start(rays: _Rays, chosen: list[PlaneOrientation]) -> PlaneState:
    """Plane system: the first image one unit above its origin."""
    normal = chosen[0].normal
    across = tangent_axes(normal)
    first = np.column_stack([across[:, 1], across[:, 0], -normal])
    above = np.array([0.0, 0.0, 1.0])
    rotations = np.stack([first] + [one.rotation @ first for one in chosen])
    positions = np.stack([above] + [first.T @ one.base + above for one in chosen])
    points = np.full((len(rays.in_plane), 3), np.nan)
    for bundle, there, position, rotation in zip(rays.bundles, rays.seen, positions, rotations, strict=True):
        missing = there & rays.in_plane & np.isnan(points[:, 0])
        turned = bundle.rays[missing] @ rotation
        points[missing] = position - turned * (position[2] / turned[:, 2])[:, None]
        points[missing, 2] = 0.0
    return PlaneState(points, positions, rotations)


def _adjusted(rays: _Rays, start: PlaneState) -> PlaneShape:
    """Adjust the plane, then the points off it with it; of those the worst are left out one by one until it fits."""
    used = rays.seen & rays.in_plane
    adjusted = adjust_plane(rays.bundles, used, start, rays.in_plane)
    off = ~rays.in_plane & (np.sum(rays.seen, axis=0) > 1)
    plane, limit = adjusted, misfit_limit(adjusted.redundancy)
    while np.any(off):
        started = _with_points(rays, plane.state, off)
        off &= np.all(np.isfinite(started.points), axis=1)
        adjusted = adjust_plane(rays.bundles, rays.seen & (rays.in_plane | off), started, rays.in_plane)
        behind = off & ~adjusted.front
        extra = adjusted.redundancy - plane.redundancy
        limit = misfit_limit(adjusted.redundancy)
        if not np.any(behind) and adjusted.objective - plane.objective <= misfit_limit(extra):
            break
        worst = np.where(off, np.nansum(adjusted.residuals**2, axis=(0, 2)), -1.0)
        off &= ~behind if np.any(behind) else np.arange(len(off)) != int(np.argmax(worst))
        adjusted = plane
    return _shape(rays, adjusted, off, limit)


def _with_points(rays: _Rays, state: PlaneState, off: BoolArray) -> PlaneState:
    points = state.points.copy()
    for index in np.flatnonzero(off):
        images = np.flatnonzero(rays.seen[:, index])
        own = np.stack([rays.bundles[int(k)].rays[index] for k in images])
        turned = unit(np.einsum("nij,ni->nj", state.rotations[images], own))
        points[index] = nearest_point(state.positions[images], turned)
    return state._replace(points=points)


def _shape(rays: _Rays, adjusted: AdjustedPlane, off: BoolArray, limit: float) -> PlaneShape:
    state = adjusted.state
    covariance = covariance_in(
        adjusted, inner_constraints(adjusted, rays.in_plane & np.any(rays.seen, axis=0))
    )
    known = np.any(rays.seen, axis=0) & (rays.in_plane | off)
    points = np.where(known[:, None], state.points, np.nan)
    sigma = np.sqrt(np.diag(covariance)[6 * len(state.positions) :].reshape(-1, 3)[:, :2])
    front = bool(np.all(adjusted.front[rays.in_plane]))
    outcome = PlaneOutcome.UNIQUE if front else PlaneOutcome.NOT_VISIBLE
    if front and adjusted.objective > limit:
        outcome = PlaneOutcome.NOT_PLANE
    return PlaneShape(
        outcome,
        points[:, :2],
        state.positions,
        state.rotations,
        np.where(known[:, None], sigma, np.nan),
        adjusted.residuals,
        float(np.sqrt(adjusted.objective / adjusted.redundancy)) if adjusted.redundancy > 0 else float("nan"),
        adjusted.redundancy,
        points[:, 2],
        rays.in_plane,
        ~rays.in_plane & ~off,
        adjusted,
        _sigma_normal(state, covariance),
    )


def _sigma_normal(state: PlaneState, covariance: FloatArray) -> float:
    across = cross_matrix(state.rotations[0, :, 2])
    spread = across @ covariance[3:6, 3:6] @ across.T
    return float(np.sqrt(np.max(tolerant.eigvalsh(spread)))) if np.all(np.isfinite(spread)) else float("inf")


def _decided(rays: _Rays, pairs: list[PlaneSolutions], shapes: list[PlaneShape]) -> PlaneShape:
    def rank(shape: PlaneShape) -> tuple[int, float]:
        return int(np.sum(shape.left_out)), float(np.nansum(shape.residuals**2))

    visible = [shape for shape in shapes if shape.outcome is PlaneOutcome.UNIQUE] or shapes
    best, *others = sorted(visible, key=rank)
    excess = AS_GOOD * max(1.0, np.nan_to_num(best.sigma0) ** 2)
    limit = rank(best)[0], rank(best)[1] + excess
    rivals: list[PlaneShape] = []
    for other in others:
        if rank(other) <= limit and not any(_same(other, one) for one in (best, *rivals)):
            rivals.append(other)
    outcome = best.outcome
    based: list[PlaneOutcome] = [pair.outcome for pair in pairs if pair.outcome is not PlaneOutcome.NO_BASE]
    if outcome is PlaneOutcome.UNIQUE:
        outcome = _visible_outcome(best, bool(rivals), _soft(rays, pairs, best), based)
    if (
        outcome is PlaneOutcome.BASE_ALONG_NORMAL
    ):  # the measurements cannot tell which: no σ holds for any of them
        rivals = [one._replace(outcome=outcome) for one in rivals]
    return best._replace(outcome=outcome, alternatives=tuple(rivals))


def _visible_outcome(best: PlaneShape, rivals: bool, soft: bool, pairs: list[PlaneOutcome]) -> PlaneOutcome:
    along = all(pair is PlaneOutcome.BASE_ALONG_NORMAL for pair in pairs)
    if along and (len(best.positions) == 2 or rivals or soft):
        return PlaneOutcome.BASE_ALONG_NORMAL
    if rivals:
        return PlaneOutcome.AMBIGUOUS
    return PlaneOutcome.WEAK if soft else PlaneOutcome.UNIQUE


def _soft(rays: _Rays, pairs: list[PlaneSolutions], shape: PlaneShape) -> bool:
    """Do the σ promise more than the measurements hold?

    Where the normal is turned by three and five σ along the axes of its error ellipse, and all else is adjusted anew,
    Σ (v/σ)² must have risen by what σ promise, about 9 and 25 (see the ``nonlinearity`` of relative orientation).
    Where the normal is turned by three no coordinate or flying height may have changed by five of its own σ or more.
    """
    adjusted = shape.adjusted
    if adjusted is None or not max(FAR) * shape.sigma_normal < 0.5 * np.pi:
        return True
    covariance = covariance_in(adjusted, inner_constraints(adjusted, rays.in_plane & rays.seen.any(axis=0)))
    normal = -adjusted.state.rotations[0, :, 2]
    off = ~rays.in_plane & ~shape.left_out
    values, axes = tolerant.eigh(cross_matrix(normal) @ covariance[3:6, 3:6] @ cross_matrix(normal).T)
    used = np.isfinite(adjusted.residuals[:, :, 0])
    sigma_heights = np.sqrt(np.diag(covariance)[2 : 6 * len(shape.positions) : 6])
    for k, far, sign in product((2, 1), FAR, (1.0, -1.0)):
        turned = unit(normal + sign * np.tan(far * np.sqrt(max(values[k], 0.0))) * axes[:, k])
        chosen = [_under(rays, number, pair, turned) for number, pair in enumerate(pairs, 1)]
        start = _with_points(rays, _start(rays, chosen), off)
        bent = adjust_plane(rays.bundles, used, start, rays.in_plane, held=axes[:, k])
        if bent.objective - adjusted.objective < PROMISED * far**2:
            return True
        if _moved(shape, bent.state, rays.in_plane, sigma_heights) > MOVED * far:
            return True
    return False


def _moved(shape: PlaneShape, bent: PlaneState, in_plane: BoolArray, sigma_heights: FloatArray) -> float:
    """Largest change of a coordinate in the plane or a flying height, in its σ, from the shape to one laid upon it."""
    known = in_plane & np.isfinite(shape.points).all(axis=1) & np.isfinite(bent.points).all(axis=1)
    before, after = (array[known, :2] @ [1.0, 1.0j] for array in (shape.points, bent.points))
    mean = before.mean()
    before, after = before - mean, after - after.mean()
    turn = np.vdot(after, before) / np.vdot(after, after).real
    laid = after * turn
    away = np.stack([(laid - before).real, (laid - before).imag], axis=1)
    points = np.abs(away) / np.maximum(shape.sigma_points[known], 1e-300)
    heights = np.abs(np.abs(turn) * bent.positions[:, 2] - shape.positions[:, 2])
    return float(max(np.max(points), np.max(heights / np.maximum(sigma_heights, 1e-300))))


def _same(first: PlaneShape, second: PlaneShape) -> bool:
    """One shape: the first image sees the plane under one normal, the others stand to it alike, to their σ."""
    away = np.abs(_invariants(first) - _invariants(second))
    sigma = min(first.sigma_normal, second.sigma_normal, 1.0)
    return bool(np.max(away) <= SAME + sigma)


def _invariants(shape: PlaneShape) -> FloatArray:
    first = shape.rotations[0]
    return np.concatenate([first[:, 2], (shape.rotations[1:] @ first.T).ravel()])


def _failed(outcome: PlaneOutcome, rays: _Rays) -> PlaneShape:
    images, count = rays.seen.shape
    return PlaneShape(
        outcome,
        np.full((count, 2), np.nan),
        np.full((images, 3), np.nan),
        np.full((images, 3, 3), np.nan),
        np.full((count, 2), np.nan),
        np.full((images, count, 2), np.nan),
        float("nan"),
        0,
        np.full(count, np.nan),
        rays.in_plane,
        np.zeros(count, dtype=bool),
        None,
        float("nan"),
    )
