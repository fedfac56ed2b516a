"""One pose by least squares: the same steps as :func:`mor.approximate.resection.refinement.adjust_pose_plainly`."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray
from mor.compilation import compile_kernel


@compile_kernel
def adjust_pose(
    rays: FloatArray,
    normals: FloatArray,
    axes: FloatArray,
    sigma: FloatArray,
    points: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    place: FloatArray,
    weight: FloatArray,
    iterations: int,
) -> tuple[FloatArray, FloatArray]:
    """Position (3,) and rotation (3, 3) of a bundle; ``weight`` (3,) is 1/σ of the observed position ``place``."""
    damping = 0.0
    normal, side = np.zeros((6, 6)), np.zeros(6)
    moved_normal, moved_side = np.zeros((6, 6)), np.zeros(6)
    before = _system(rays, normals, axes, sigma, points, position, rotation, place, weight, normal, side)
    for _ in range(iterations):
        step = _solution(normal, side, damping)
        new_position = position - step[:3]
        new_rotation = _rotated(rotation, step[3:])
        after = _system(
            rays,
            normals,
            axes,
            sigma,
            points,
            new_position,
            new_rotation,
            place,
            weight,
            moved_normal,
            moved_side,
        )
        range_ = np.max(np.abs(points - position))
        small = max(np.max(np.abs(step[:3])) / range_, np.max(np.abs(step[3:]))) < 1e-10
        if after <= before:
            position, rotation = new_position, new_rotation
            normal[:], side[:] = moved_normal, moved_side
            damping = damping / 10.0 if damping > 1e-10 else 0.0
        else:
            damping = max(10.0 * damping, 1e-6)
        if small or damping > 1e8 or (before - after >= 0.0 and before - after <= 1e-13 * before):
            break
        before = min(before, after)
    return position, rotation


@compile_kernel
def _system(
    rays: FloatArray,
    normals: FloatArray,
    axes: FloatArray,
    sigma: FloatArray,
    points: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    place: FloatArray,
    weight: FloatArray,
    normal: FloatArray,
    side: FloatArray,
) -> float:
    """Normal equations of the residuals by X0 and δ, into ``normal`` and ``side``; returns Σ (v/σ)²."""
    normal[:] = 0.0
    side[:] = 0.0
    row, star = np.zeros(6), np.zeros(3)
    total = 0.0
    for i in range(3):
        off = (position[i] - place[i]) * weight[i]
        total += off * off
        normal[i, i] += weight[i] * weight[i]
        side[i] += weight[i] * off
    for n in range(len(rays)):
        for i in range(3):
            star[i] = 0.0
            for j in range(3):
                star[i] += rotation[i, j] * (points[n, j] - position[j])
        depth = normals[n, 0] * star[0] + normals[n, 1] * star[1] + normals[n, 2] * star[2]
        if abs(depth) < 1e-12:
            depth = 1e-12
        reach = normals[n, 0] * rays[n, 0] + normals[n, 1] * rays[n, 1] + normals[n, 2] * rays[n, 2]
        factor = reach / depth
        for k in range(2):
            along, residual = 0.0, 0.0
            for i in range(3):
                along += axes[n, i, k] * star[i]
                residual += axes[n, i, k] * (star[i] * factor - rays[n, i])
            residual /= sigma[n]
            total += residual * residual
            along *= factor / depth
            x = (factor * axes[n, 0, k] - along * normals[n, 0]) / sigma[n]
            y = (factor * axes[n, 1, k] - along * normals[n, 1]) / sigma[n]
            z = (factor * axes[n, 2, k] - along * normals[n, 2]) / sigma[n]
            for j in range(3):
                row[j] = -(x * rotation[0, j] + y * rotation[1, j] + z * rotation[2, j])
            row[3] = y * star[2] - z * star[1]
            row[4] = z * star[0] - x * star[2]
            row[5] = x * star[1] - y * star[0]
            for i in range(6):
                side[i] += row[i] * residual
                for j in range(i + 1):
                    normal[i, j] += row[i] * row[j]
    for i in range(6):
        for j in range(i):
            normal[j, i] = normal[i, j]
    return total


@compile_kernel
def _solution(normal: FloatArray, side: FloatArray, damping: float) -> FloatArray:
    """Solution (6,) of the scaled, damped equations: Cholesky, or least squares where they are singular."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = np.empty((6, 6))
    for i in range(6):
        for j in range(6):
            scaled[i, j] = normal[i, j] / (scale[i] * scale[j])
        scaled[i, i] += damping
    factor = np.zeros((6, 6))
    x = side / scale
    for j in range(6):
        pivot = scaled[j, j]
        for k in range(j):
            pivot -= factor[j, k] ** 2
        if not pivot > 1e-12:
            if not (np.isfinite(scaled).all() and np.isfinite(x).all()):
                return np.full(6, np.nan)
            solution: FloatArray = np.linalg.lstsq(scaled, x, 1e-15)[0] / scale
            return solution
        factor[j, j] = np.sqrt(pivot)
        for i in range(j + 1, 6):
            product = scaled[i, j]
            for k in range(j):
                product -= factor[i, k] * factor[j, k]
            factor[i, j] = product / factor[j, j]
    y = x.copy()
    for i in range(6):
        for k in range(i):
            y[i] -= factor[i, k] * y[k]
        y[i] /= factor[i, i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            y[i] -= factor[k, i] * y[k]
        y[i] /= factor[i, i]
    return y / scale


@compile_kernel
def _rotated(rotation: FloatArray, step: FloatArray) -> FloatArray:
    """Exp([s]×) D, orthonormalised by one Newton step of the polar decomposition; D ← exp(−[δ]×) D with δ = −s."""
    angle = np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
    sine = np.sin(angle) / angle if angle > 1e-8 else 1.0
    cosine = 2.0 * (np.sin(0.5 * angle) / angle) ** 2 if angle > 1e-8 else 0.5
    cross = np.zeros((3, 3))
    cross[0, 1], cross[0, 2], cross[1, 2] = -step[2], step[1], -step[0]
    cross[1, 0], cross[2, 0], cross[2, 1] = step[2], -step[1], step[0]
    turn = np.eye(3) + sine * cross + cosine * _product(cross, cross)
    updated = _product(turn, rotation)
    excess = _product(updated, updated.T) - np.eye(3)
    result: FloatArray = updated - 0.5 * _product(excess, updated)
    return result


@compile_kernel
def _product(first: FloatArray, second: FloatArray) -> FloatArray:
    """Product of two (3, 3) matrices, without a call of BLAS."""
    product = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                product[i, j] += first[i, k] * second[k, j]
    return product
