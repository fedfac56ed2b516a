"""From measured image coordinates back to rays, through any camera model."""

from __future__ import annotations

import numpy as np

from mor.approximate.vectors import tangent_axes, unit
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry.cameras import CameraModel

_ITERATIONS = 12
_CHUNK = 5000
_REACHED, _MISSED = 1e-12, 1e-6
"""Parts of the camera constant: no further step is made, and the ray is not reached."""
_STANDS = 1e-9
"""Radians of a step after which no other one is needed, or none leads farther."""


def ideal_rays(
    model: CameraModel, interior: FloatArray, of: IntArray, constants: FloatArray, measured: FloatArray
) -> FloatArray:
    """Unit rays (n, 3), scene at Z* < 0, whose projections are the ``measured`` coordinates (n, 2).

    ``interior`` (m, k) are the interior orientations, and ``of`` (n,) tells which of them each ray has; ``constants``
    (n, j) are those of the model.

    Newton's method in the tangent plane of the ray, so that fisheye rays beyond 90° are reached too. Where it does not
    converge (a polynomial beyond its range), the ray of the undistorted central projection is kept.
    """
    rays = np.empty((len(measured), 3))
    # Some thousand rays at a time stay in the cache, and ten million do not fill the memory with derivatives.
    for first in range(0, len(measured), _CHUNK):
        chosen = slice(first, first + _CHUNK)
        rays[chosen] = _chunk_of_rays(model, interior[of[chosen]], constants[chosen], measured[chosen])
    return rays


def _chunk_of_rays(
    model: CameraModel, interior: FloatArray, constants: FloatArray, measured: FloatArray
) -> FloatArray:
    plain = np.concatenate([measured - interior[:, 1:3], -np.abs(interior[:, :1])], axis=1)
    start = unit(plain)
    ray = start
    with np.errstate(all="ignore"):
        for left in range(_ITERATIONS, -1, -1):
            projection = model.project(ray, interior, constants, measured)
            wrong = measured - projection.xy
            away = np.abs(wrong).max(axis=1) / interior[:, 0]
            if not left or np.nanmax(away, initial=0.0) < _REACHED:
                break
            across = tangent_axes(ray)
            step = _solved(projection.by_star @ across, wrong, 1e-12 * interior[:, 0] ** 2)
            step *= np.minimum(1.0, 0.3 / np.maximum(np.linalg.norm(step, axis=1), 1e-300))[:, None]
            ray = unit(ray + np.einsum("nij,nj->ni", across, step))
            if np.nanmax(np.abs(step), initial=0.0) < _STANDS:
                break
    missed: BoolArray = np.asarray(~(away < _MISSED))
    return np.where(missed[:, None], start, ray)


def _solved(jacobian: FloatArray, wrong: FloatArray, least: FloatArray) -> FloatArray:
    """Solutions (n, 2) of n pairs of equations, 0 where their determinant is at most ``least``."""
    (a, b), (c, d) = np.moveaxis(jacobian, 0, 2)
    determinant = a * d - b * c
    good = np.isfinite(determinant) & (np.abs(determinant) > least)
    divisor = np.where(good, determinant, 1.0)
    x, y = wrong.T
    solution = np.stack([d * x - b * y, a * y - c * x], axis=1) / divisor[:, None]
    return np.where(good[:, None], solution, 0.0)
