"""Images of a plane object: its shape, adjustment and precision."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from mor.model import rotations
from mor.model.rotations import cross_matrix, rotate
from mor.start.bundle import AS_GOOD, Bundle, ahead, reproject, samples, tangent_axes, unit
from mor.start.intersection import nearest_point
from mor.start.killian import (
    Homography,
    PlaneOrientation,
    PlaneOutcome,
    PlaneSolutions,
    along_normal,
    convex_hull,
    fit_homography,
    homographies_of_four,
    misfit_limit,
    misfits,
    planar_orientations,
    significance_of_points,
    under_normal,
)
from mor.start.relative_orientation import FAR, PROMISED
from mor.types import BoolArray, FloatArray, IntArray

# ---- Which of many points lie in one plane: those that one collineation carries from the first image to each other.
#
# Killian: the evaluations of two images, compared with each other, tell a point in the plane from one off it.

LEVEL = 0.001
"""Probability that a point of the plane is taken for one off it: the level of data snooping."""
AGREES = float(chdtri(2, LEVEL))
"""Σ (v/σ)² up to which a point is carried over: two conditions, at the level of data snooping.

A point of the plane told from it loses nothing: it gets a height of none within its σ. One off it and taken for one of
it bends the shape, and is told without a height, with the σ of a point of the plane: hence no 5 σ.
"""
LEAST = 5
"""Points that must agree: any four do."""


def carried_over(a: Bundle, b: Bundle) -> BoolArray:
    """(n,) true for the points of the plane that most of the n homologous rays of two images lie in.

    All of them where each fits to the others and all together, or where fewer than five, or less than half, would be
    left: what is wrong then shows in the misfit.
    """
    everything = np.ones(len(a), dtype=bool)
    whole = fit_homography(a, b)
    fits = _variance(whole) == 1.0 and np.all(significance_of_points(a, b, whole, everything) < AGREES)
    if len(a) <= LEAST or fits:
        return everything
    kept = _best_half(a, b, next(samples(len(a), 4, 200, 200, np.random.default_rng(len(a)))))
    # Adjustments of the half that fits best, and of all that agree.
    for _ in range(5):
        homography = fit_homography(a.take(kept), b.take(kept))
        now = significance_of_points(a, b, homography, kept) < AGREES * _variance(homography)
        if np.sum(now) < max(LEAST, 0.5 * len(a)):
            return everything
        if np.array_equal(now, kept):
            break
        kept = now
    return kept


def _variance(homography: Homography) -> float:
    """Variance of unit weight where σ are too small beyond doubt, else one."""
    redundancy = homography.redundancy
    too_small = redundancy > 0 and homography.objective > float(chdtri(redundancy, LEVEL))
    return homography.objective / redundancy if too_small else 1.0


def _best_half(a: Bundle, b: Bundle, samples: IntArray) -> BoolArray:
    """The half of the points that fits best: least trimmed squares (P. J. Rousseeuw 1984) over ``samples`` (m, 4).

    Grown from there a collineation is not bent by points off the plane that hide each other.
    """
    half = max(LEAST, int(np.ceil(0.5 * len(a))))
    found = misfits(a, b, homographies_of_four(a.directions[samples], b.directions[samples]))
    best = found[np.argmin(np.sum(np.sort(found, axis=1)[:, :half], axis=1))]
    for _ in range(3):
        kept = np.zeros(len(a), dtype=bool)
        kept[np.argsort(best)[:half]] = True
        best = significance_of_points(a, b, fit_homography(a.take(kept), b.take(kept)), kept)
    return kept


# ---- Least-squares adjustment of a plane object, points beside the plane, and all images of it.
#
# The plane is Z = 0 and the object: points in it have two free coordinates, points off it three; frames have position
# and attitude. Shift (2), turn and scale in the plane stay free. Covariances of one datum are carried into another by
# the S-transformation (W. Baarda), with the four movements as null space.

FREE = 4
"""Shift (2), turn and scale in the plane."""


class PlaneState(NamedTuple):
    """Unknowns of the adjustment: n points and m frames."""

    points: FloatArray
    """(n, 3); Z = 0 in the plane; not a number where nothing is known."""
    positions: FloatArray
    """(m, 3)"""
    rotations: FloatArray
    """(m, 3, 3)"""


class AdjustedPlane(NamedTuple):
    """The least-squares solution."""

    state: PlaneState
    residuals: FloatArray
    """(m, n, 2) in units of σ; not a number where a point is not seen."""
    objective: float
    """Σ (v/σ)²."""
    redundancy: int
    front: BoolArray
    """(n,) true where a point lies in front of all images that see it."""
    normal: FloatArray
    """(u, u) normal matrix: six columns for each frame (X0, δ), then three for each point."""
    free: BoolArray
    """(u,) the columns that are unknowns."""


def adjust_plane(
    bundles: Sequence[Bundle],
    seen: FloatArray | BoolArray,
    state: PlaneState,
    in_plane: BoolArray,
    held: FloatArray | None = None,
) -> AdjustedPlane:
    """Adjust ``state`` to the rays of m ``bundles``; ``seen`` (m, n) says which count. Levenberg–Marquardt.

    Towards ``held`` (3,), in the axes of the first frame, the normal of the plane that it sees does not move.
    """
    there = np.any(seen, axis=0)
    points = np.stack([there, there, there & ~in_plane], axis=1)
    free = np.concatenate([np.ones(6 * len(state.positions), dtype=bool), points.ravel()])
    free[5] = held is None
    # Of the scaled normal matrix: always, for the free movements, and more once a step led upwards.
    least_damping = 1e-9
    damping, growth = least_damping, 2.0
    residuals, design = _linearised(bundles, seen, state)
    for _ in range(100):
        step = np.zeros(len(free))
        axes = _turns(state, held)
        turned = np.concatenate([design[:, :3], design[:, 3:6] @ axes, design[:, 6:]], axis=1)
        step[free] = _step(turned[:, free], residuals, damping)
        step[3:6] = axes @ step[3:6]
        moved = _moved(state, step)
        new_residuals, new_design = _linearised(bundles, seen, moved)
        before, after = float(residuals @ residuals), float(new_residuals @ new_residuals)
        promised = before - float(np.sum((residuals + design @ step) ** 2))
        if after <= before:
            gain = (before - after) / promised if promised > 0.0 else 1.0
            damping = max(damping * max(0.1, 1.0 - (2.0 * gain - 1.0) ** 3), least_damping)
            state, residuals, design, growth = moved, new_residuals, new_design, 2.0
        else:
            damping, growth = max(damping, 1e-6) * growth, 2.0 * growth
        # A step that promises less is none; σ below the same number are rounding.
        still = promised <= 1e-10 * before or before < 1e-20 * len(residuals)
        if still or float(np.max(np.abs(step))) < 1e-12 or damping > 1e6:
            break
    return _judged(bundles, seen, state, residuals, design, free)


def _turns(state: PlaneState, held: FloatArray | None) -> FloatArray:
    """Axes (3, 3), as columns, about which the first frame may turn; the last is none where something is held."""
    if held is None:
        return np.eye(3)
    return np.column_stack([tangent_axes(np.cross(state.rotations[0, :, 2], held)), np.zeros(3)])


def _step(design: FloatArray, residuals: FloatArray, damping: float) -> FloatArray:
    normal = design.T @ design
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    damped = normal / np.outer(scale, scale) + damping * np.eye(len(scale))
    return np.asarray(-rotations.solve(damped, design.T @ residuals / scale) / scale)


def _linearised(
    bundles: Sequence[Bundle], seen: FloatArray | BoolArray, state: PlaneState
) -> tuple[FloatArray, FloatArray]:
    """Residuals and dense design over 6 columns per frame, 3 per point."""
    frames, count = len(bundles), len(state.points)
    blocks, residuals = [], []
    for k, bundle in enumerate(bundles):
        index = np.flatnonzero(seen[k])
        star = (state.points[index] - state.positions[k]) @ state.rotations[k].T
        computed = reproject(bundle.take(index), star)
        rows = np.zeros((len(index), 2, 6 * frames + 3 * count))
        by_point = computed.by_star @ state.rotations[k]
        rows[:, :, 6 * k : 6 * k + 3] = -by_point
        rows[:, :, 6 * k + 3 : 6 * k + 6] = computed.by_star @ cross_matrix(star)
        for axis in range(3):
            rows[np.arange(len(index)), :, 6 * frames + 3 * index + axis] = by_point[:, :, axis]
        blocks.append(rows.reshape(-1, rows.shape[2]))
        residuals.append(computed.residuals.ravel())
    return np.concatenate(residuals), np.concatenate(blocks)


def _moved(state: PlaneState, step: FloatArray) -> PlaneState:
    frames = step[: 6 * len(state.positions)].reshape(-1, 6)
    points = state.points + step[frames.size :].reshape(-1, 3)
    return PlaneState(points, state.positions + frames[:, :3], rotate(state.rotations, frames[:, 3:]))


def _judged(
    bundles: Sequence[Bundle],
    seen: FloatArray | BoolArray,
    state: PlaneState,
    residuals: FloatArray,
    design: FloatArray,
    free: BoolArray,
) -> AdjustedPlane:
    spread = np.full((len(bundles), len(state.points), 2), np.nan)
    spread[np.asarray(seen, dtype=bool)] = residuals.reshape(-1, 2)
    front = np.ones(len(state.points), dtype=bool)
    for k, bundle in enumerate(bundles):
        index = np.flatnonzero(seen[k])
        star = (state.points[index] - state.positions[k]) @ state.rotations[k].T
        front[index] &= ahead(bundle.take(index), star)
    redundancy = len(residuals) - int(np.sum(free)) + FREE
    objective = float(residuals @ residuals)
    return AdjustedPlane(state, spread, objective, redundancy, front, design.T @ design, free)


def movements(state: PlaneState) -> FloatArray:
    """Null space (u, 4) of the adjustment: what shifts in X and Y, a turn about Z and a change of scale do to it."""
    up = np.array([0.0, 0.0, 1.0])
    frames, count = len(state.positions), len(state.points)
    points = np.nan_to_num(state.points)
    of_frames, of_points = np.zeros((frames, 6, FREE)), np.zeros((count, 3, FREE))
    of_frames[:, :2, :2], of_points[:, :2, :2] = np.eye(2), np.eye(2)
    of_frames[:, :3, 2], of_points[:, :, 2] = np.cross(up, state.positions), np.cross(up, points)
    of_frames[:, 3:, 2] = state.rotations @ up
    of_frames[:, :3, 3], of_points[:, :, 3] = state.positions, points
    return np.concatenate([of_frames.reshape(-1, FREE), of_points.reshape(-1, FREE)])


def covariance_in(adjusted: AdjustedPlane, constraints: FloatArray) -> FloatArray:
    """Covariance (u, u) for the a-priori σ of the rays in the datum ``constraints`` (4, u): C dx = 0.

    Zero for what is no unknown; not a number where more than the four movements is open.
    """
    free = adjusted.free
    scale = 1.0 / np.sqrt(np.maximum(np.diag(adjusted.normal)[free], 1e-300))
    values, vectors = rotations.eigh(adjusted.normal[np.ix_(free, free)] * np.outer(scale, scale))
    # Eigenvalue of the scaled normal matrix, relative to the largest, below which something else is open as well.
    if values[FREE] < 1e-13 * values[-1]:
        return np.full(adjusted.normal.shape, np.nan)
    null, chosen = movements(adjusted.state)[free], constraints[:, free]
    into_datum = np.eye(len(null)) - null @ rotations.solve(chosen @ null, chosen)
    roots = into_datum @ (scale[:, None] * vectors[:, FREE:]) / np.sqrt(values[FREE:])
    covariance = np.zeros(adjusted.normal.shape)
    covariance[np.ix_(free, free)] = roots @ roots.T
    return covariance


def inner_constraints(adjusted: AdjustedPlane, in_plane: BoolArray) -> FloatArray:
    """Constraints (4, u) of the datum of least trace over the points ``in_plane``."""
    chosen = movements(adjusted.state)
    frames = 6 * len(adjusted.state.positions)
    chosen[:frames] = 0.0
    chosen[frames:][~np.repeat(in_plane, 3)] = 0.0
    chosen[~adjusted.free] = 0.0
    return np.asarray(chosen.T)


# ---- Shape of a plane object from two or more images, and points beside the plane, all adjusted together.
#
# The start comes from pairs of images (:mod:`mor.start.killian`). Every pair leaves up to two shapes; what
# the pairs of one image have in common is the normal of the plane as that image sees it, and with it a third
# image decides. (The paper subtracts the cubics of two pairs as if they had one unknown. They do not: ϱ is
# the squared ratio of the distances of S from the two images of its own pair.) Scale, position and turn in
# the plane stay free: see :mod:`mor.start.plane_object`.


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
    """What :func:`mor.start.plane_object.covariance_in` carries into any datum."""
    sigma_normal: float
    """σ in radians of the normal of the plane as the first image sees it: the shape hangs on it."""
    alternatives: tuple[PlaneShape, ...] = ()
    """Other shapes that fit about as well, if the outcome is ambiguous."""


class _PlaneRays(NamedTuple):
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
    rays = _PlaneRays(bundles, seen, _in_plane(bundles, seen) if off is None else ~off)
    pairs = []
    for k in range(1, len(bundles)):
        both = seen[0] & seen[k] & rays.in_plane
        pairs.append(planar_orientations(bundles[0].take(both), bundles[k].take(both)))
    based = [pair for pair in pairs if pair.outcome is not PlaneOutcome.NO_BASE]
    for pair in based:
        if not pair.outcome.usable and pair.outcome is not PlaneOutcome.NOT_VISIBLE:
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


def _hypotheses(rays: _PlaneRays, pairs: list[PlaneSolutions]) -> list[list[PlaneOrientation]]:
    """One orientation per pair, for each normal that the first image can see the plane under."""
    normals: list[FloatArray] = []
    for number, pair in enumerate(pairs, 1):
        double = [_double(rays, number, pair)] if pair.outcome is PlaneOutcome.BASE_ALONG_NORMAL else []
        for one in [*pair.solutions, *double]:
            # Angle in radians between the normals of two pairs up to which one of them is start enough.
            if one.front > 0 and all(np.linalg.norm(one.normal - n) > 0.02 for n in normals):
                normals.append(one.normal)
    return [[_under(rays, number, pair, normal) for number, pair in enumerate(pairs, 1)] for normal in normals]


def _double(rays: _PlaneRays, number: int, pair: PlaneSolutions) -> PlaneOrientation:
    both = rays.seen[0] & rays.seen[number] & rays.in_plane
    matrix = np.eye(3) if pair.homography is None else pair.homography.matrix
    return along_normal(matrix, rays.bundles[0].rays[both], rays.bundles[number].rays[both])


def _under(rays: _PlaneRays, number: int, pair: PlaneSolutions, normal: FloatArray) -> PlaneOrientation:
    """Image ``number`` under a normal; one at the first centre bears any."""
    if pair.outcome is PlaneOutcome.NO_BASE or pair.homography is None:
        return pair.solutions[0]._replace(normal=normal)
    for one in pair.solutions:
        if np.array_equal(one.normal, normal):
            return one
    both = rays.seen[0] & rays.seen[number] & rays.in_plane
    return under_normal(pair.homography.matrix, normal, rays.bundles[0].rays[both], rays.bundles[number].rays[both])


def _start(rays: _PlaneRays, chosen: list[PlaneOrientation]) -> PlaneState:
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


def _adjusted(rays: _PlaneRays, start: PlaneState) -> PlaneShape:
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


def _with_points(rays: _PlaneRays, state: PlaneState, off: BoolArray) -> PlaneState:
    points = state.points.copy()
    for index in np.flatnonzero(off):
        images = np.flatnonzero(rays.seen[:, index])
        own = np.stack([rays.bundles[int(k)].rays[index] for k in images])
        turned = unit(np.einsum("nij,ni->nj", state.rotations[images], own))
        points[index] = nearest_point(state.positions[images], turned)
    return state._replace(points=points)


def _shape(rays: _PlaneRays, adjusted: AdjustedPlane, off: BoolArray, limit: float) -> PlaneShape:
    state = adjusted.state
    covariance = covariance_in(adjusted, inner_constraints(adjusted, rays.in_plane & np.any(rays.seen, axis=0)))
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
    return float(np.sqrt(np.max(rotations.eigvalsh(spread)))) if np.all(np.isfinite(spread)) else float("inf")


def _decided(rays: _PlaneRays, pairs: list[PlaneSolutions], shapes: list[PlaneShape]) -> PlaneShape:
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
    if outcome is PlaneOutcome.BASE_ALONG_NORMAL:  # the measurements cannot tell which: no σ holds for any of them
        rivals = [one._replace(outcome=outcome) for one in rivals]
    return best._replace(outcome=outcome, alternatives=tuple(rivals))


def _visible_outcome(best: PlaneShape, rivals: bool, soft: bool, pairs: list[PlaneOutcome]) -> PlaneOutcome:
    along = all(pair is PlaneOutcome.BASE_ALONG_NORMAL for pair in pairs)
    if along and (len(best.positions) == 2 or rivals or soft):
        return PlaneOutcome.BASE_ALONG_NORMAL
    if rivals:
        return PlaneOutcome.AMBIGUOUS
    return PlaneOutcome.WEAK if soft else PlaneOutcome.UNIQUE


def _soft(rays: _PlaneRays, pairs: list[PlaneSolutions], shape: PlaneShape) -> bool:
    """Return whether the σ promise more than the measurements hold.

    Where the normal is turned by three and five σ along the axes of its error ellipse, and all else is adjusted again,
    Σ (v/σ)² must have risen by what σ promise, about 9 and 25 (see the ``sigma_hold`` of relative orientations).
    Where the normal is turned by three no coordinate or flying height may have changed by five of its own σ or more.
    """
    adjusted = shape.adjusted
    if adjusted is None or not max(FAR) * shape.sigma_normal < 0.5 * np.pi:
        return True
    covariance = covariance_in(adjusted, inner_constraints(adjusted, rays.in_plane & rays.seen.any(axis=0)))
    normal = -adjusted.state.rotations[0, :, 2]
    off = ~rays.in_plane & ~shape.left_out
    values, axes = rotations.eigh(cross_matrix(normal) @ covariance[3:6, 3:6] @ cross_matrix(normal).T)
    used = np.isfinite(adjusted.residuals[:, :, 0])
    sigma_heights = np.sqrt(np.diag(covariance)[2 : 6 * len(shape.positions) : 6])
    for k, far, sign in product((2, 1), FAR, (1.0, -1.0)):
        turned = unit(normal + sign * np.tan(far * np.sqrt(max(values[k], 0.0))) * axes[:, k])
        chosen = [_under(rays, number, pair, turned) for number, pair in enumerate(pairs, 1)]
        start = _with_points(rays, _start(rays, chosen), off)
        bent = adjust_plane(rays.bundles, used, start, rays.in_plane, held=axes[:, k])
        if bent.objective - adjusted.objective < PROMISED * far**2:
            return True
        # Times its σ that a coordinate may change by for each σ of the normal: what is called five σ is three at least.
        if _plane_shape_moved(shape, bent.state, rays.in_plane, sigma_heights) > (5.0 / 3.0) * far:
            return True
    return False


def _plane_shape_moved(shape: PlaneShape, bent: PlaneState, in_plane: BoolArray, sigma_heights: FloatArray) -> float:
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
    # Differences of normals and attitudes, beyond their σ, up to which two shapes are one.
    return bool(np.max(away) <= 1e-5 + sigma)


def _invariants(shape: PlaneShape) -> FloatArray:
    first = shape.rotations[0]
    return np.concatenate([first[:, 2], (shape.rotations[1:] @ first.T).ravel()])


def _failed(outcome: PlaneOutcome, rays: _PlaneRays) -> PlaneShape:
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


# ---- What one does with the shape of a plane object: scale, level or wall, further points, sides and angles (Killian).


class PlacedPlane(NamedTuple):
    """Points of the plane and the frames in an object system."""

    points: FloatArray
    """(n, 3)"""
    positions: FloatArray
    """(m, 3)"""
    rotations: FloatArray
    """(m, 3, 3)"""
    turn: FloatArray
    """(3, 3) from the axes of the shape to those of the object system."""
    scale: float
    """Length in the object system over that of the shape."""


class SidesAndAngles(NamedTuple):
    """A polygon by its sides and angles."""

    sides: FloatArray
    """(k,) from each corner to the next."""
    angles: FloatArray
    """(k,) interior angle at each corner in radians, 0 to 2π for a polygon without crossing sides."""


def scale_from_length(shape: PlaneShape, first: int, second: int, length: float) -> float:
    """Factor from the unit of the shape to that of ``length``, measured between two of its points, also off the plane.

    Raises ``ValueError`` if the length is not positive or the points coincide.
    """
    space = in_space(shape)
    distance = float(np.linalg.norm(space[second] - space[first]))
    if not length > 0.0 or not distance > 0.0:
        raise ValueError("the scale needs two different points and a positive length")
    return length / distance


def in_space(shape: PlaneShape) -> FloatArray:
    """Points (n, 3) of a shape, the plane Z = 0."""
    return np.column_stack([shape.points, shape.heights])


def on_level_plane(shape: PlaneShape, origin: int, towards: int, scale: float) -> PlacedPlane:
    """Plane as the level plane Z = 0, its normal upwards to the cameras: Z of a position is its flight
    height.

    ``origin`` becomes (0, 0, 0), the X axis runs to the point ``towards``.
    """
    turn = np.eye(3)
    turn[:2, :2] = _axes(shape, origin, towards)
    return _placed(shape, origin, turn, scale)


def on_wall(shape: PlaneShape, origin: int, towards: int, scale: float) -> PlacedPlane:
    """Plane as a wall Y = 0 seen by cameras at Y < 0: X to the right along the wall, Y into it, Z up.

    The line from ``origin`` to the point ``towards`` is level and leads to the right.
    """
    turn = np.zeros((3, 3))
    along = _axes(shape, origin, towards)
    turn[0, :2], turn[2, :2] = along
    turn[1, 2] = -1.0
    return _placed(shape, origin, turn, scale)


def _axes(shape: PlaneShape, origin: int, towards: int) -> FloatArray:
    along = shape.points[towards] - shape.points[origin]
    x, y = along / np.linalg.norm(along)
    return np.array([[x, y], [-y, x]])


def _placed(shape: PlaneShape, origin: int, turn: FloatArray, scale: float) -> PlacedPlane:
    zero = np.append(shape.points[origin], 0.0)
    return PlacedPlane(
        scale * (in_space(shape) - zero) @ turn.T,
        scale * (shape.positions - zero) @ turn.T,
        np.asarray(shape.rotations @ turn.T),
        turn,
        scale,
    )


def sides_and_angles(corners: FloatArray) -> SidesAndAngles:
    """Sides and interior angles of a polygon (k, 2), corners in order round it either way."""
    following, previous = np.roll(corners, -1, axis=0) - corners, np.roll(corners, 1, axis=0) - corners
    turning = np.arctan2(
        following[:, 0] * previous[:, 1] - following[:, 1] * previous[:, 0], np.sum(following * previous, axis=1)
    )
    x, y = corners.T
    counter_clockwise = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) > 0.0
    angles = np.mod(turning if counter_clockwise else -turning, 2.0 * np.pi)
    return SidesAndAngles(np.linalg.norm(following, axis=1), angles)


# ---- Standard deviations and correlations of a plane object in its object system: points, images, sides, angles,
# heights.
#
# The datum is that of the object system: two points carry origin, direction and length. What is told is a
# function of the adjusted points and frames; its covariance follows from theirs by the S-transformation and
# the law of propagation, for the a-priori σ of the image coordinates.


class Length(NamedTuple):
    """Definition of origin, direction and scale of the object system."""

    first: int
    second: int
    length: float
    sigma: float
    """Zero where the length is exact."""


class Derived(NamedTuple):
    """Numbers that follow from the adjusted points and frames, with their precision."""

    values: FloatArray
    """(k,)"""
    covariance: FloatArray
    """(k, k)"""


def placed_covariance(shape: PlaneShape, placed: PlacedPlane, tie: Length) -> FloatArray:
    """Covariance (u, u) in the object system: X0 and δ of every frame, then X Y Z of every point.

    Not a number on the dangerous locus, where standard deviations of first order mean nothing.
    """
    adjusted = shape.adjusted
    if adjusted is None or shape.outcome is PlaneOutcome.BASE_ALONG_NORMAL:
        unknowns = 6 * len(shape.positions) + 3 * len(shape.points)
        return np.full((unknowns, unknowns), np.nan)
    covariance = covariance_in(adjusted, _tie_constraints(shape, tie))
    frames = 6 * len(shape.positions)
    carried = np.eye(len(covariance))
    for start in [*range(0, frames, 6), *range(frames, len(covariance), 3)]:
        carried[start : start + 3, start : start + 3] = placed.scale * placed.turn
    stretched = np.zeros(len(covariance))
    stretched[:frames] = np.pad(placed.positions, ((0, 0), (0, 3))).ravel()
    stretched[frames:] = np.nan_to_num(placed.points).ravel()
    relative = tie.sigma / tie.length
    result = carried @ covariance @ carried.T + relative**2 * np.outer(stretched, stretched)
    sigma = np.sqrt(np.maximum(np.diag(result), 0.0))
    # σ over the largest one below which it is zero: of what carries the object system.
    exact = sigma < 1e-7 * np.max(sigma)
    result[exact] = result[:, exact] = 0.0
    return np.asarray(result)


def _tie_constraints(shape: PlaneShape, tie: Length) -> FloatArray:
    """The first point stays, the second may neither turn round it nor come nearer."""
    frames = 6 * len(shape.positions)
    space = in_space(shape)
    along = space[tie.second] - space[tie.first]
    a, b = frames + 3 * tie.first, frames + 3 * tie.second
    constraints = np.zeros((4, frames + 3 * len(space)))
    constraints[0, a] = constraints[1, a + 1] = 1.0
    constraints[2, b : b + 2] = [-along[1], along[0]]
    constraints[3, b : b + 3], constraints[3, a : a + 3] = along, -along
    return constraints


def corners(shape: PlaneShape) -> IntArray:
    """Points that are the corners, in order round it: four as they come if no sides cross, else the hull."""
    inside = np.flatnonzero(shape.in_plane & np.isfinite(shape.points[:, 0]))
    flat = shape.points[inside]
    if len(inside) == 4 and not (_crossing(flat[[0, 1, 2, 3]]) or _crossing(flat[[1, 2, 3, 0]])):
        return inside
    return np.asarray(inside[convex_hull(flat)])


def _crossing(four: FloatArray) -> bool:
    def side(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
        return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))

    one, two, three, last = four
    return side(one, two, three) * side(one, two, last) < 0 and side(three, last, one) * side(three, last, two) < 0


def derived(
    shape: PlaneShape, placed: PlacedPlane, covariance: FloatArray, round_it: IntArray, constants: FloatArray
) -> Derived:
    """Sides, angles (radians), heights of points off the plane, flying heights, and these over the camera constants.

    Corners as in ``round_it`` (k,), from each to the next; (k + k + points off + m + m) numbers.
    """
    flat = placed.scale * shape.points[round_it]
    polygon = sides_and_angles(flat)
    off = np.flatnonzero(~shape.in_plane & ~shape.left_out)
    flying = placed.scale * shape.positions[:, 2]
    values = [polygon.sides, polygon.angles, placed.scale * shape.heights[off], flying, flying / constants]
    frames, up = 6 * len(shape.positions), placed.turn[:, 2]
    rows = np.zeros((2 * len(flat) + len(off) + 2 * len(flying), len(covariance)))
    by_points = _polygon_by_points(flat, placed.turn)
    for number, index in enumerate(round_it):
        column = frames + 3 * int(index)
        rows[: 2 * len(flat), column : column + 3] = by_points[:, number]
    for number, index in enumerate(off):
        column = frames + 3 * int(index)
        rows[2 * len(flat) + number, column : column + 3] = up
    for image, constant in enumerate(constants):
        row = 2 * len(flat) + len(off) + image
        rows[row, 6 * image : 6 * image + 3] = up
        rows[row + len(flying), 6 * image : 6 * image + 3] = up / constant
    return Derived(np.concatenate(values), np.asarray(rows @ covariance @ rows.T))


def _polygon_by_points(flat: FloatArray, turn: FloatArray) -> FloatArray:
    """Derivatives (2k, k, 3) of sides and interior angles by the corners, in the axes of the object system."""
    count = len(flat)
    rows = np.zeros((2 * count, count, 2))
    x, y = flat.T
    sense = np.sign(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    for i in range(count):
        before, after = (i - 1) % count, (i + 1) % count
        along = flat[after] - flat[i]
        direction = along / np.linalg.norm(along)
        rows[i, after], rows[i, i] = direction, -direction
        for other, sign in ((before, sense), (after, -sense)):
            to = flat[other] - flat[i]
            turned = sign * np.array([-to[1], to[0]]) / float(to @ to)
            rows[count + i, other] += turned
            rows[count + i, i] -= turned
    return np.asarray(rows @ turn[:, :2].T)
