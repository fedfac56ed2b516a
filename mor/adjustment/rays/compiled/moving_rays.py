"""Kernel of image points of a rolling shutter: what ``mor.observations.time.rolling_shutter`` has, ray by ray."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.rays.compiled.cameras import project
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_inline, compile_kernel

COLUMNS = (3, 3, 1, 3, 3, 3, 1)
"""Columns of the slots before the interior orientation."""
_ROUNDS, _STILL = 20, 1e-13
_SERIES = 0.05
"""Angle below which series have all digits."""


class MovingValues(NamedTuple):
    """Values of all blocks of the kinds of the slots, in their order; rotations (n, 9)."""

    point: FloatArray
    rotation: FloatArray
    height: FloatArray
    eccentricity: FloatArray
    velocity: FloatArray
    rate: FloatArray
    readout: FloatArray
    interior: FloatArray


@compile_kernel
def compute(
    model: int,
    values: MovingValues,
    blocks: IntArray,
    constants: FloatArray,
    r0: FloatArray,
    clock: FloatArray,
    found: FloatArray,
    jacobian: FloatArray,
) -> None:
    """Set image coordinates (n, 2) and Jacobians (n, 2, 20 + k) by all slots in their order.

    ``blocks`` (9, n) are block numbers, ``constants`` (n, 2) measured coordinates, ``clock`` (n, 3) their phases.
    """
    R, J, star = np.empty((3, 3)), np.empty((3, 3)), np.empty((2, 3))
    q, s, drift_star, lever = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    k = values.interior.shape[1]
    interior, by_interior = np.empty(k), np.zeros((2, k))
    for n in range(found.shape[0]):
        X0, D, e = (
            values.point[blocks[0, n]],
            values.rotation[blocks[1, n]],
            values.eccentricity[blocks[3, n]],
        )
        v, w, T = values.velocity[blocks[4, n]], values.rate[blocks[5, n]], values.readout[blocks[6, n], 0]
        X = values.point[blocks[8, n]]
        for j in range(k):
            interior[j] = values.interior[blocks[7, n], j]
        a, b, c = X[0] - X0[0], X[1] - X0[1], X[2] - X0[2] - values.height[blocks[2, n], 0]
        for j in range(3):
            lever[j] = D[3 * j] * a + D[3 * j + 1] * b + D[3 * j + 2] * c
        u, z = constants[n, 0], constants[n, 1]
        gx, gy, g0 = clock[n, 0], clock[n, 1], clock[n, 2]
        x, y = u, z
        phase = t = px = py = slip = dx = dy = fx = fy = 0.0
        for _ in range(_ROUNDS + 1):
            phase = gx * x + gy * y + g0
            t = T * phase
            turn(-w[0] * t, -w[1] * t, -w[2] * t, R)
            for j in range(3):
                q[j] = lever[j] - v[j] * t
            for j in range(3):
                s[j] = R[j, 0] * q[0] + R[j, 1] * q[1] + R[j, 2] * q[2]
            px, py = project(
                model, s[0] + e[0], s[1] + e[1], s[2] + e[2], interior, r0[n], u, z, star, by_interior
            )
            for j in range(3):
                drift_star[j] = -(R[j, 0] * v[0] + R[j, 1] * v[1] + R[j, 2] * v[2])
            drift_star[0] -= w[1] * s[2] - w[2] * s[1]
            drift_star[1] -= w[2] * s[0] - w[0] * s[2]
            drift_star[2] -= w[0] * s[1] - w[1] * s[0]
            dx = star[0, 0] * drift_star[0] + star[0, 1] * drift_star[1] + star[0, 2] * drift_star[2]
            dy = star[1, 0] * drift_star[0] + star[1, 1] * drift_star[1] + star[1, 2] * drift_star[2]
            slip = 1.0 - T * (gx * dx + gy * dy)
            tau = T * (gx * (px - x) + gy * (py - y)) / slip
            fx, fy = dx * tau, dy * tau
            if not max(abs(px + fx - x), abs(py + fy - y)) > _STILL * interior[0]:
                break
            x, y = px + fx, py + fy
        found[n, 0], found[n, 1] = px + fx, py + fy
        slopes(-w[0] * t, -w[1] * t, -w[2] * t, J)
        for m in range(2):
            fill_row(jacobian[n, m], star[m], R, J, D, lever, q, t, by_interior[m])
        jacobian[n, 0, 16], jacobian[n, 1, 16] = phase * dx, phase * dy
        for j in range(20 + k):
            tau = T * (gx * jacobian[n, 0, j] + gy * jacobian[n, 1, j]) / slip
            jacobian[n, 0, j] += dx * tau
            jacobian[n, 1, j] += dy * tau


@compile_inline
def turn(x: float, y: float, z: float, R: FloatArray) -> None:
    """Set exp([ψ]×)."""
    square = x * x + y * y + z * z
    angle = np.sqrt(square)
    if angle < 1e-4:
        sine, cosine = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        sine, cosine = np.sin(angle) / angle, (1.0 - np.cos(angle)) / square
    fill(x, y, z, sine, cosine, square, R)


@compile_inline
def slopes(x: float, y: float, z: float, J: FloatArray) -> None:
    """Set the right Jacobian of exp at ψ."""
    square = x * x + y * y + z * z
    angle = np.sqrt(square)
    if angle < _SERIES:
        cosine = 0.5 - square / 24.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0))
        third = (1.0 - square / 20.0 * (1.0 - square / 42.0)) / 6.0
    else:
        cosine, third = (1.0 - np.cos(angle)) / square, (angle - np.sin(angle)) / (square * angle)
    fill(x, y, z, -cosine, third, square, J)


@compile_inline
def fill(x: float, y: float, z: float, first: float, second: float, square: float, R: FloatArray) -> None:
    """Set 1 + first [ψ]× + second [ψ]×²."""
    R[0, 0], R[1, 1], R[2, 2] = (
        1.0 + second * (x * x - square),
        1.0 + second * (y * y - square),
        1.0 + second * (z * z - square),
    )
    R[0, 1], R[1, 0] = second * x * y - first * z, second * x * y + first * z
    R[0, 2], R[2, 0] = second * x * z + first * y, second * x * z - first * y
    R[1, 2], R[2, 1] = second * y * z - first * x, second * y * z + first * x


@compile_kernel
def fill_row(
    row: FloatArray,
    star: FloatArray,
    R: FloatArray,
    J: FloatArray,
    D: FloatArray,
    lever: FloatArray,
    q: FloatArray,
    t: float,
    by_interior: FloatArray,
) -> None:
    """Set the Jacobian of one component at a fixed time, but for the readout time."""
    a = star[0] * R[0, 0] + star[1] * R[1, 0] + star[2] * R[2, 0]
    b = star[0] * R[0, 1] + star[1] * R[1, 1] + star[2] * R[2, 1]
    c = star[0] * R[0, 2] + star[1] * R[1, 2] + star[2] * R[2, 2]
    k = by_interior.size
    for j in range(3):
        row[17 + k + j] = a * D[j] + b * D[3 + j] + c * D[6 + j]
        row[j] = -row[17 + k + j]
        row[7 + j] = star[j]
    row[3], row[4], row[5] = (
        b * lever[2] - c * lever[1],
        c * lever[0] - a * lever[2],
        a * lever[1] - b * lever[0],
    )
    row[6] = row[2]
    row[10], row[11], row[12] = -t * a, -t * b, -t * c
    f, g, h = b * q[2] - c * q[1], c * q[0] - a * q[2], a * q[1] - b * q[0]
    for j in range(3):
        row[13 + j] = t * (f * J[0, j] + g * J[1, j] + h * J[2, j])
    for j in range(k):
        row[17 + j] = by_interior[j]
