"""Kernels that eliminate points met by rays alone: their 3×3 systems, and what they leave in the reduced
system.

For one point, with the Jacobians a (by the point) and j (by the other unknowns) of its rays,

    N_pp = Σ aᵀa = L Lᵀ,    W = Σ jᵀa,    V = W L⁻ᵀ,    b_p = −Σ aᵀ residual,    u = L⁻¹ b_p.
"""

from __future__ import annotations

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.compilation import compile_inline, compile_kernel

# Pivots of a 3×3 system scaled to unit diagonal carry hardly any round-off.
VANISHING = 1e-12


@compile_kernel
def clear(matrix: FloatArray) -> None:
    """Set a matrix to zero; the assignment to a slice would take seconds to compile."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            matrix[i, j] = 0.0


@compile_inline
def sums_of_point(
    by_point: FloatArray, residual: FloatArray, first: int, end: int
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Return the lower triangle of Σ aᵀa, row by row, and −Σ aᵀ residual of the rays first … end − 1."""
    n00, n10, n11, n20, n21, n22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    g, h, k = 0.0, 0.0, 0.0
    for i in range(first, end):
        for c in range(2):
            x, y, z, r = by_point[i, c, 0], by_point[i, c, 1], by_point[i, c, 2], residual[i, c]
            n00 += x * x
            n10 += x * y
            n11 += y * y
            n20 += x * z
            n21 += y * z
            n22 += z * z
            g -= x * r
            h -= y * r
            k -= z * r
    return n00, n10, n11, n20, n21, n22, g, h, k


@compile_kernel
def root_of_point(
    n00: float, n10: float, n11: float, n20: float, n21: float, n22: float, damping: float
) -> tuple[float, float, float, float, float, float]:
    """Return the reciprocals of the diagonal of L and what stands below it: L10, L20, L21.

    A coordinate whose pivot vanishes is held: its reciprocal is zero, and so are its row and column. (What is not a
    number is not held, but shows.)
    """
    p, q, r, a, b, c = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    pivot = n00 * (1.0 + damping)
    if not pivot <= VANISHING * n00:
        p = 1.0 / np.sqrt(pivot)
        a, b = n10 * p, n20 * p
    pivot = n11 * (1.0 + damping) - a * a
    if not pivot <= VANISHING * n11:
        q = 1.0 / np.sqrt(pivot)
        c = (n21 - a * b) * q
    else:
        a = 0.0
    pivot = n22 * (1.0 + damping) - b * b - c * c
    if not pivot <= VANISHING * n22:
        r = 1.0 / np.sqrt(pivot)
    else:
        b, c = 0.0, 0.0
    return p, q, r, a, b, c


@compile_kernel
def whiten_points(
    by_point: FloatArray,
    residual: FloatArray,
    pointers: IntArray,
    damping: float,
    white: FloatArray,
    moved: FloatArray,
    held: BoolArray,
    gradient: FloatArray,
) -> None:
    """Factorise N_pp of all points and carry its root into their rays.

    Sets a L⁻ᵀ as ``white`` (n, 2, 3), so that V = Σ jᵀ white; residual + white u as ``moved`` (n, 2): the residuals
    after the points have made up for what they can, so that −Σ jᵀ moved is what is left of the right-hand side; whether
    a coordinate is ``held`` (p, 3); and b_p = −Σ aᵀ residual as ``gradient`` (p, 3).
    """
    for point in range(pointers.size - 1):
        first, end = pointers[point], pointers[point + 1]
        n00, n10, n11, n20, n21, n22, g, h, k = sums_of_point(by_point, residual, first, end)
        p, q, r, a, b, c = root_of_point(n00, n10, n11, n20, n21, n22, damping)
        gradient[point, 0], gradient[point, 1], gradient[point, 2] = g, h, k
        held[point, 0], held[point, 1], held[point, 2] = p == 0.0, q == 0.0, r == 0.0
        u = g * p
        v = (h - a * u) * q
        w = (k - b * u - c * v) * r
        for i in range(first, end):
            for m in range(2):
                x = by_point[i, m, 0] * p
                y = (by_point[i, m, 1] - a * x) * q
                z = (by_point[i, m, 2] - b * x - c * y) * r
                white[i, m, 0], white[i, m, 1], white[i, m, 2] = x, y, z
                moved[i, m] = residual[i, m] + x * u + y * v + z * w


@compile_kernel
def invert_points(by_point: FloatArray, pointers: IntArray, factor: FloatArray, inverse: FloatArray) -> None:
    """Set N_pp⁻¹ of all points as ``inverse`` (p, 3, 3), and a N_pp⁻¹ of their rays as ``factor`` (n, 2, 4).

    The fourth number is zero.
    """
    nothing = np.zeros((by_point.shape[0], 2))
    for point in range(pointers.size - 1):
        first, end = pointers[point], pointers[point + 1]
        n00, n10, n11, n20, n21, n22, _, _, _ = sums_of_point(by_point, nothing, first, end)
        p, q, r, a, b, c = root_of_point(n00, n10, n11, n20, n21, n22, 0.0)
        k10, k21 = -a * p * q, -c * q * r  # L⁻¹ below its diagonal
        k20 = -(b * p + c * k10) * r
        n00, n10, n11 = p * p + k10 * k10 + k20 * k20, k10 * q + k20 * k21, q * q + k21 * k21
        n20, n21, n22 = k20 * r, k21 * r, r * r
        inverse[point, 0, 0], inverse[point, 0, 1], inverse[point, 0, 2] = n00, n10, n20
        inverse[point, 1, 0], inverse[point, 1, 1], inverse[point, 1, 2] = n10, n11, n21
        inverse[point, 2, 0], inverse[point, 2, 1], inverse[point, 2, 2] = n20, n21, n22
        for i in range(first, end):
            for m in range(2):
                x, y, z = by_point[i, m, 0], by_point[i, m, 1], by_point[i, m, 2]
                factor[i, m, 0] = x * n00 + y * n10 + z * n20
                factor[i, m, 1] = x * n10 + y * n11 + z * n21
                factor[i, m, 2] = x * n20 + y * n21 + z * n22
                factor[i, m, 3] = 0.0


@compile_kernel
def factor_point(
    by_point: FloatArray,
    residual: FloatArray,
    first: int,
    end: int,
    damping: float,
    L: FloatArray,
    inverse: FloatArray,
    u: FloatArray,
    gradient: FloatArray,
) -> None:
    """Factorise N_pp of the rays first … end − 1 of one point, (n, 2, 3) and (n, 2).

    Sets what stands below the diagonal of L (3, 3), the reciprocals of its diagonal, b_p = −Σ aᵀ residual as
    ``gradient``, and u = L⁻¹ b_p, both zero where a coordinate is held.
    """
    n00, n10, n11, n20, n21, n22, g, h, k = sums_of_point(by_point, residual, first, end)
    p, q, r, a, b, c = root_of_point(n00, n10, n11, n20, n21, n22, damping)
    inverse[0], inverse[1], inverse[2] = p, q, r
    L[1, 0], L[2, 0], L[2, 1] = a, b, c
    gradient[0], gradient[1], gradient[2] = g, h, k
    u[0] = g * p
    u[1] = (h - a * u[0]) * q
    u[2] = (k - b * u[0] - c * u[1]) * r


@compile_kernel
def solve_points(
    residual: FloatArray, by_point: FloatArray, pointers: IntArray, damping: float, point_steps: FloatArray
) -> None:
    """Set the steps (p, 3) of the points, all else known."""
    L, inverse, u, gradient = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    for p in range(pointers.size - 1):
        factor_point(by_point, residual, pointers[p], pointers[p + 1], damping, L, inverse, u, gradient)
        for j in range(2, -1, -1):
            for k in range(j + 1, 3):
                u[j] -= L[k, j] * u[k]
            u[j] *= inverse[j]
            point_steps[p, j] = u[j]


@compile_kernel
def follow_directions(
    by_point: FloatArray,
    by_others: FloatArray,
    frame: IntArray,
    columns: IntArray,
    pointers: IntArray,
    directions: FloatArray,
    of_points: FloatArray,
) -> None:
    """Set how the points follow (p, 3, k) directions (n, k) of the others: −N_pp⁻¹ Wᵀ g."""
    count, width = directions.shape[1], columns.shape[1]
    L, inverse, u, gradient = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    nothing = np.zeros((by_point.shape[0], 2))
    of_frame = np.zeros((columns.shape[0], width, count))
    for f in range(columns.shape[0]):
        for k in range(width):
            if columns[f, k] >= 0:
                for d in range(count):
                    of_frame[f, k, d] = directions[columns[f, k], d]
    moved, right = np.empty((2, count)), np.empty((3, count))
    for p in range(pointers.size - 1):
        clear(right)
        for i in range(pointers[p], pointers[p + 1]):
            clear(moved)
            for k in range(width):
                x, y = by_others[i, 0, k], by_others[i, 1, k]
                for d in range(count):
                    moved[0, d] += x * of_frame[frame[i], k, d]
                    moved[1, d] += y * of_frame[frame[i], k, d]
            for j in range(3):
                x, y = by_point[i, 0, j], by_point[i, 1, j]
                for d in range(count):
                    right[j, d] -= x * moved[0, d] + y * moved[1, d]
        factor_point(by_point, nothing, pointers[p], pointers[p + 1], 0.0, L, inverse, u, gradient)
        for d in range(count):
            a = right[0, d] * inverse[0]
            b = (right[1, d] - L[1, 0] * a) * inverse[1]
            c = (right[2, d] - L[2, 0] * a - L[2, 1] * b) * inverse[2] * inverse[2]
            b = (b - L[2, 1] * c) * inverse[1]
            of_points[p, 0, d] = (a - L[1, 0] * b - L[2, 0] * c) * inverse[0]
            of_points[p, 1, d], of_points[p, 2, d] = b, c
