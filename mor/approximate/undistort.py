"""From measured image coordinates back to rays, through any camera model."""

from __future__ import annotations

import numpy as np

from mor.geometry.arrays import BoolArray, FloatArray
from mor.geometry.cameras import CameraModel

_ITERATIONS = 12


def ideal_rays(
    model: CameraModel, interior: FloatArray, constants: FloatArray, measured: FloatArray
) -> FloatArray:
    """Unit rays (n, 3), scene at Z* < 0, whose projections are the ``measured`` coordinates (n, 2).

    Newton's method in the tangent plane of the ray, so that fisheye rays beyond 90° are reached too. Where it does not
    converge (a polynomial beyond its range), the ray of the undistorted central projection is kept.
    """
    plain = np.concatenate([measured - interior[:, 1:3], -np.abs(interior[:, :1])], axis=1)
    start = plain / np.linalg.norm(plain, axis=1, keepdims=True)
    ray = start.copy()
    with np.errstate(all="ignore"):
        for _ in range(_ITERATIONS):
            projection = model.project(ray, interior, constants, measured)
            across = np.stack(_tangents(ray), axis=2)
            jacobian = projection.by_star @ across
            determinant = np.linalg.det(jacobian)
            good = np.isfinite(determinant) & (np.abs(determinant) > 1e-12 * interior[:, 0] ** 2)
            jacobian[~good] = np.eye(2)
            wrong = np.where(good[:, None], measured - projection.xy, 0.0)
            step = np.einsum("nij,nj->ni", np.linalg.inv(jacobian), wrong)
            step *= np.minimum(1.0, 0.3 / np.maximum(np.linalg.norm(step, axis=1), 1e-300))[:, None]
            ray = ray + np.einsum("nij,nj->ni", across, step)
            ray /= np.linalg.norm(ray, axis=1, keepdims=True)
            if np.nanmax(np.abs(step), initial=0.0) < 1e-9:
                break
        reached = model.project(ray, interior, constants, measured).xy
    missed: BoolArray = np.asarray(~(np.abs(reached - measured).max(axis=1) < 1e-6 * interior[:, 0]))
    result: FloatArray = np.where(missed[:, None], start, ray)
    return result


def _tangents(ray: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors (n, 3) perpendicular to each ray."""
    helper = np.zeros_like(ray)
    helper[np.arange(len(ray)), np.argmin(np.abs(ray), axis=1)] = 1.0
    first = np.cross(ray, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(ray, first)
