"""Least-squares adjustment of a plane object, points beside the plane, and all images of it.

The plane is Z = 0 and the object: points in it have two free coordinates, points off it three; frames have position
and attitude. Shift (2), turn and scale in the plane stay free. Covariances of one datum are carried into another by
the S-transformation (W. Baarda), with the four movements as null space.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.reprojection import ahead, reproject
from mor.approximate.vectors import tangent_axes
from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import cross_matrix, rotate

FREE = 4
"""Shift (2), turn and scale in the plane."""
LEAST_DAMPING, ROUGH = 1e-9, 1e-6
"""Of the scaled normal matrix: always, for the free movements; and at least, once a step led upwards."""
STILL = 1e-10
"""Part of Σ (v/σ)² by which a step must promise to lower it; and σ below which residuals are rounding."""
UNDETERMINED = 1e-13
"""Eigenvalue of the scaled normal matrix, relative to the largest, below which something else is open as well."""


class PlaneState(NamedTuple):
    """What is adjusted: n points and m frames."""

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
    iterations: int = 100,
) -> AdjustedPlane:
    """Adjust ``state`` to the rays of m ``bundles``; ``seen`` (m, n) says which count. Levenberg–Marquardt.

    Towards ``held`` (3,), in the axes of the first frame, the normal of the plane that it sees does not move.
    """
    free = _unknowns(seen, state, in_plane)
    free[5] = held is None
    damping, growth = LEAST_DAMPING, 2.0
    residuals, design = _linearised(bundles, seen, state)
    for _ in range(iterations):
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
            damping = max(damping * max(0.1, 1.0 - (2.0 * gain - 1.0) ** 3), LEAST_DAMPING)
            state, residuals, design, growth = moved, new_residuals, new_design, 2.0
        else:
            damping, growth = max(damping, ROUGH) * growth, 2.0 * growth
        still = promised <= STILL * before or before < STILL**2 * len(residuals)
        if still or float(np.max(np.abs(step))) < 1e-12 or damping > 1e6:
            break
    return _judged(bundles, seen, state, residuals, design, free)


def _unknowns(seen: FloatArray | BoolArray, state: PlaneState, in_plane: BoolArray) -> BoolArray:
    there = np.any(seen, axis=0)
    points = np.stack([there, there, there & ~in_plane], axis=1)
    return np.concatenate([np.ones(6 * len(state.positions), dtype=bool), points.ravel()])


def _turns(state: PlaneState, held: FloatArray | None) -> FloatArray:
    """Axes (3, 3), as columns, about which the first frame may turn; the last is none where something is held."""
    if held is None:
        return np.eye(3)
    return np.column_stack([tangent_axes(np.cross(state.rotations[0, :, 2], held)), np.zeros(3)])


def _step(design: FloatArray, residuals: FloatArray, damping: float) -> FloatArray:
    normal = design.T @ design
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    damped = normal / np.outer(scale, scale) + damping * np.eye(len(scale))
    return np.asarray(-tolerant.solve(damped, design.T @ residuals / scale) / scale)


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
    values, vectors = tolerant.eigh(adjusted.normal[np.ix_(free, free)] * np.outer(scale, scale))
    if values[FREE] < UNDETERMINED * values[-1]:
        return np.full(adjusted.normal.shape, np.nan)
    null, chosen = movements(adjusted.state)[free], constraints[:, free]
    into_datum = np.eye(len(null)) - null @ tolerant.solve(chosen @ null, chosen)
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
