"""Shape of a plane object from two or more images, by least squares over all points and images.

The plane is the object: points (u, v, 0), frames with position and attitude. The start comes from pairs of
images (:mod:`mor.approximate.planar.two_images`). Every pair leaves up to two shapes; what the pairs of one image have
in common is the normal of the plane as that image sees it, and with it a third image decides. (The paper
subtracts the cubics of two pairs as if they had one unknown. They do not: ϱ is the squared ratio of the
distances of S from the two images of its own pair.) Scale, position and turn in the plane stay free: see
:mod:`mor.approximate.planar.plane_object`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.planar.two_images import (
    PlaneOrientation,
    PlaneOutcome,
    misfit_limit,
    planar_orientations,
)
from mor.approximate.reprojection import ahead, reproject
from mor.approximate.vectors import tangent_axes
from mor.arrays import BoolArray, FloatArray
from mor.geometry.rotations import cross_matrix, rotate

FREE = 4
"""Shift (2), turn and scale in the plane."""
AS_GOOD = 25.0
"""Σ (v/σ)² by which another shape may be worse and still count as fitting equally well (5 σ)."""
SAME_NORMAL = 0.2
"""Angle in radians between the normals of two pairs up to which they may be one."""


@dataclass(frozen=True)
class PlaneShape:
    """Points in a plane and the frames that see it; the plane is Z = 0, the frames at Z > 0."""

    outcome: PlaneOutcome
    points: FloatArray
    """(n, 2); not a number where fewer than one image sees the point."""
    positions: FloatArray
    """(m, 3) projection centres."""
    rotations: FloatArray
    """(m, 3, 3) D of the images."""
    sigma_points: FloatArray
    """(n, 2) for the a-priori σ of the rays, with inner constraints over all points."""
    residuals: FloatArray
    """(m, n, 2) in units of σ; not a number where a point is not seen."""
    sigma0: float
    redundancy: int
    alternatives: tuple[PlaneShape, ...] = ()
    """Other shapes that fit about as well, if the outcome is ambiguous."""


class _State(NamedTuple):
    points: FloatArray
    positions: FloatArray
    rotations: FloatArray


def shape_of_plane(bundles: Sequence[Bundle]) -> PlaneShape:
    """Shape from m ≥ 2 images with n rays each; a point that an image does not see has a ray of NaN there.

    The first image is in every pair and must share at least four points with each other one. Degenerate
    data are named in the outcome (of the first pair where they are pairwise).
    """
    seen = [np.all(np.isfinite(bundle.rays), axis=1) for bundle in bundles]
    pairs = []
    for bundle, there in zip(bundles[1:], seen[1:], strict=True):
        both = seen[0] & there
        pairs.append(planar_orientations(bundles[0].take(both), bundle.take(both)))
    for pair in pairs:
        if not any(orientation.front for orientation in pair.solutions):
            return _failed(pair.outcome, bundles)
    shapes = [
        _adjusted(bundles, seen, _start(bundles, seen, chosen))
        for chosen in _hypotheses([pair.solutions for pair in pairs])
    ]
    return _decided(shapes, [pair.outcome for pair in pairs])


def _hypotheses(pairs: list[list[PlaneOrientation]]) -> list[list[PlaneOrientation]]:
    """One orientation per pair, for each normal that the first image can see the plane under."""
    normals = [one.normal for pair in pairs for one in pair if one.front > 0]
    hypotheses: list[list[PlaneOrientation]] = []
    spreads: list[float] = []
    for normal in normals:
        chosen = [max(pair, key=lambda one: float(one.normal @ normal)) for pair in pairs]
        if not any(all(a is b for a, b in zip(chosen, old, strict=True)) for old in hypotheses):
            hypotheses.append(chosen)
            spreads.append(max(float(np.linalg.norm(one.normal - normal)) for one in chosen))
    kept = [h for h, spread in zip(hypotheses, spreads, strict=True) if spread < SAME_NORMAL]
    return kept or [hypotheses[int(np.argmin(spreads))]]


def _start(bundles: Sequence[Bundle], seen: list[BoolArray], chosen: list[PlaneOrientation]) -> _State:
    """Plane system: the first image one unit above its origin."""
    normal = chosen[0].normal
    across = tangent_axes(normal)
    first = np.column_stack([across[:, 1], across[:, 0], -normal])
    above = np.array([0.0, 0.0, 1.0])
    rotations = [first] + [one.rotation @ first for one in chosen]
    positions = [above] + [first.T @ one.base + above for one in chosen]
    points = np.full((len(bundles[0]), 2), np.nan)
    for bundle, there, position, rotation in zip(bundles, seen, positions, rotations, strict=True):
        missing = there & np.isnan(points[:, 0])
        rays = bundle.rays[missing] @ rotation
        points[missing] = (position - rays * (position[2] / rays[:, 2])[:, None])[:, :2]
    return _State(points, np.stack(positions), np.stack(rotations))


def _linearised(
    bundles: Sequence[Bundle], seen: list[BoolArray], state: _State
) -> tuple[FloatArray, FloatArray]:
    """Residuals and dense design over 6 unknowns per image, 2 per point."""
    images, count = len(bundles), len(state.points)
    blocks, residuals = [], []
    space = np.column_stack([np.nan_to_num(state.points), np.zeros(count)])
    for k, (bundle, there) in enumerate(zip(bundles, seen, strict=True)):
        index = np.flatnonzero(there)
        star = (space[index] - state.positions[k]) @ state.rotations[k].T
        computed = reproject(bundle.take(index), star)
        rows = np.zeros((len(index), 2, 6 * images + 2 * count))
        by_point = computed.by_star @ state.rotations[k]
        rows[:, :, 6 * k : 6 * k + 3] = -by_point
        rows[:, :, 6 * k + 3 : 6 * k + 6] = computed.by_star @ cross_matrix(star)
        for axis in range(2):
            rows[np.arange(len(index)), :, 6 * images + 2 * index + axis] = by_point[:, :, axis]
        blocks.append(rows.reshape(-1, rows.shape[2]))
        residuals.append(computed.residuals.ravel())
    return np.concatenate(residuals), np.concatenate(blocks)


def _moved(state: _State, step: FloatArray) -> _State:
    images = len(state.positions)
    frames = step[: 6 * images].reshape(images, 6)
    points = state.points + step[6 * images :].reshape(-1, 2)
    return _State(points, state.positions + frames[:, :3], rotate(state.rotations, frames[:, 3:]))


def _adjusted(
    bundles: Sequence[Bundle], seen: list[BoolArray], state: _State, iterations: int = 50
) -> PlaneShape:
    damping = 1e-9
    residuals, design = _linearised(bundles, seen, state)
    for _ in range(iterations):
        normal = design.T @ design
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        damped = normal / np.outer(scale, scale) + damping * np.eye(len(scale))
        step = -np.linalg.solve(damped, design.T @ residuals / scale) / scale
        moved = _moved(state, step)
        new_residuals, new_design = _linearised(bundles, seen, moved)
        if new_residuals @ new_residuals <= residuals @ residuals:
            state, residuals, design = moved, new_residuals, new_design
            damping = max(damping / 10.0, 1e-9)
        else:
            damping *= 10.0
        if float(np.max(np.abs(step))) < 1e-12 or damping > 1e6:
            break
    return _result(bundles, seen, state, residuals, design)


def _result(
    bundles: Sequence[Bundle], seen: list[BoolArray], state: _State, residuals: FloatArray, design: FloatArray
) -> PlaneShape:
    unseen = ~np.any(seen, axis=0)
    redundancy = len(residuals) - (6 * len(bundles) + 2 * int(np.sum(~unseen)) - FREE)
    spread = np.full((len(bundles), len(state.points), 2), np.nan)
    offset = 0
    front = True
    space = np.column_stack([np.nan_to_num(state.points), np.zeros(len(state.points))])
    for k, (bundle, there) in enumerate(zip(bundles, seen, strict=True)):
        count = int(np.sum(there))
        spread[k, there] = residuals[offset : offset + 2 * count].reshape(-1, 2)
        offset += 2 * count
        star = (space[there] - state.positions[k]) @ state.rotations[k].T
        front = front and bool(np.all(ahead(bundle.take(there), star)))
    sigma_points = _sigma_points(design, 6 * len(bundles))
    sigma0 = float(np.sqrt(residuals @ residuals / redundancy)) if redundancy > 0 else float("nan")
    return PlaneShape(
        PlaneOutcome.UNIQUE if front else PlaneOutcome.NOT_VISIBLE,
        state.points,
        state.positions,
        state.rotations,
        sigma_points,
        spread,
        sigma0,
        redundancy,
    )


def _sigma_points(design: FloatArray, frames: int) -> FloatArray:
    """Standard deviations (n, 2) of the points in their own datum, by the S-transformation; NaN where unseen."""
    active = np.any(design != 0.0, axis=0)
    values, vectors = np.linalg.eigh(design[:, active].T @ design[:, active])
    null, inner = vectors[:, :FREE], vectors[:, :FREE].copy()
    inner[: int(np.sum(active[:frames]))] = 0.0
    into_datum = np.eye(len(values)) - null @ np.linalg.solve(inner.T @ null, inner.T)
    roots = into_datum @ vectors[:, FREE:] / np.sqrt(np.maximum(values[FREE:], 1e-300))
    sigma = np.full(len(active), np.nan)
    sigma[active] = np.linalg.norm(roots, axis=1)
    return np.asarray(sigma[frames:].reshape(-1, 2))


def _decided(shapes: list[PlaneShape], pairs: list[PlaneOutcome]) -> PlaneShape:
    def objective(shape: PlaneShape) -> float:
        return float(np.nansum(shape.residuals**2))

    visible = [shape for shape in shapes if shape.outcome is PlaneOutcome.UNIQUE] or shapes
    best, *others = sorted(visible, key=objective)
    excess = AS_GOOD * max(1.0, np.nan_to_num(best.sigma0) ** 2)
    rivals = [
        other for other in others if objective(other) <= objective(best) + excess and _other(best, other)
    ]
    outcome = best.outcome
    if best.outcome is PlaneOutcome.NOT_VISIBLE:
        pass
    elif objective(best) > misfit_limit(best.redundancy):
        outcome = PlaneOutcome.NOT_PLANE
    elif len(pairs) == 1 and pairs[0] is PlaneOutcome.BASE_ALONG_NORMAL:
        outcome = pairs[0]
    elif rivals:
        outcome = PlaneOutcome.AMBIGUOUS
    return replace(best, outcome=outcome, alternatives=tuple(rivals))


def _other(first: PlaneShape, second: PlaneShape) -> bool:
    return bool(np.max(np.abs(first.rotations - second.rotations)) > 1e-6)


def _failed(outcome: PlaneOutcome, bundles: Sequence[Bundle]) -> PlaneShape:
    images, count = len(bundles), len(bundles[0])
    return PlaneShape(
        outcome,
        np.full((count, 2), np.nan),
        np.full((images, 3), np.nan),
        np.full((images, 3, 3), np.nan),
        np.full((count, 2), np.nan),
        np.full((images, count, 2), np.nan),
        float("nan"),
        0,
    )
