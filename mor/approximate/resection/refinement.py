"""Refinement of a resection: Gauss–Newton with small rotations about the axes of the frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor import compilation
from mor.approximate.bundle import Bundle
from mor.approximate.growth.compiled import poses as kernels
from mor.approximate.reprojection import reproject
from mor.arrays import FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import cross_matrix, rotate


class Pose(NamedTuple):
    """Position and attitude of a frame."""

    position: FloatArray
    """(3,)"""
    rotation: FloatArray
    """(3, 3) D."""


def star_of(points: FloatArray, pose: Pose) -> FloatArray:
    """Points (n, 3) in the axes of a frame."""
    return np.asarray((points - pose.position) @ pose.rotation.T)


def pose_design(bundle: Bundle, points: FloatArray, pose: Pose) -> tuple[FloatArray, FloatArray]:
    """Residuals (2n,) in units of σ and their derivatives (2n, 6) by X0 and δ, D ← exp(−[δ]×) D."""
    star = star_of(points, pose)
    computed = reproject(bundle, star)
    by_position = -computed.by_star @ pose.rotation
    by_rotation = computed.by_star @ cross_matrix(star)
    return computed.residuals.ravel(), np.concatenate([by_position, by_rotation], axis=2).reshape(-1, 6)


class Observed(NamedTuple):
    """A position known beforehand: GNSS, a station, control."""

    place: FloatArray
    """(3,)"""
    sigma: FloatArray
    """(3,) standard deviations > 0."""


def adjust_pose(
    bundle: Bundle, points: FloatArray, pose: Pose, iterations: int = 40, observed: Observed | None = None
) -> Pose:
    """Least-squares pose from n ≥ 3 points (n, 3), starting at ``pose``; steps are damped only where they must be.

    A position ``observed`` beforehand counts with its σ.
    """
    if not compilation.wanted():
        return adjust_pose_plainly(bundle, points, pose, iterations, observed)
    place, weight = (np.zeros(3), np.zeros(3)) if observed is None else (observed.place, 1.0 / observed.sigma)
    position, rotation = kernels.adjust_pose(
        _contiguous(bundle.rays),
        _contiguous(bundle.normals),
        _contiguous(bundle.axes),
        _contiguous(bundle.sigma),
        _contiguous(points),
        _contiguous(pose.position),
        _contiguous(pose.rotation),
        _contiguous(place),
        _contiguous(weight),
        iterations,
    )
    return Pose(position, rotation)


def _contiguous(array: FloatArray) -> FloatArray:
    """The kernel is compiled for one layout of its arguments, not for each that may occur."""
    return np.ascontiguousarray(array, dtype=np.float64)


def adjust_pose_plainly(
    bundle: Bundle, points: FloatArray, pose: Pose, iterations: int = 40, observed: Observed | None = None
) -> Pose:
    """The same without a compiler: the readable form."""
    damping = 0.0
    residuals, design = _design(bundle, points, pose, observed)
    for _ in range(iterations):
        normal = design.T @ design
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        damped = normal / np.outer(scale, scale) + damping * np.eye(6)
        step = -tolerant.lstsq(damped, design.T @ residuals / scale, rcond=1e-15) / scale
        moved = Pose(pose.position + step[:3], rotate(pose.rotation, step[3:]))
        new_residuals, new_design = _design(bundle, points, moved, observed)
        before, after = float(residuals @ residuals), float(new_residuals @ new_residuals)
        range_ = float(np.max(np.abs(points - pose.position)))
        small = max(float(np.max(np.abs(step[:3]))) / range_, float(np.max(np.abs(step[3:])))) < 1e-10
        if after <= before:
            pose, residuals, design = moved, new_residuals, new_design
            damping = damping / 10.0 if damping > 1e-10 else 0.0
        else:
            damping = max(10.0 * damping, 1e-6)
        if small or damping > 1e8 or 0.0 <= before - after <= 1e-13 * before:
            break
    return pose


def _design(
    bundle: Bundle, points: FloatArray, pose: Pose, observed: Observed | None
) -> tuple[FloatArray, FloatArray]:
    residuals, design = pose_design(bundle, points, pose)
    if observed is None:
        return residuals, design
    rows = np.zeros((3, 6))
    rows[:, :3] = np.diag(1.0 / observed.sigma)
    return (
        np.concatenate([residuals, (pose.position - observed.place) / observed.sigma]),
        np.concatenate([design, rows]),
    )
