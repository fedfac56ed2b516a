"""Kernels that eliminate points met by rays alone: their 3×3 systems, and what they leave in the reduced
system.

For one point, with the Jacobians a (by the point) and j (by the other unknowns) of its rays,

    N_pp = Σ aᵀa = L Lᵀ,    W = Σ jᵀa,    V = W L⁻ᵀ,    b_p = −Σ aᵀ residual,    u = L⁻¹ b_p.
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.compiled import compile_kernel
from mor.adjustment.compiled.cliques import Runs
from mor.geometry.arrays import FloatArray, IntArray

# Pivots of a 3×3 system scaled to unit diagonal carry hardly any round-off.
VANISHING = 1e-12


@compile_kernel
def clear(matrix: FloatArray) -> None:
    """Set a matrix to zero; the assignment to a slice would take seconds to compile."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            matrix[i, j] = 0.0


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

    Sets L (3, 3), the reciprocals of its diagonal, b_p = −Σ aᵀ residual as ``gradient``, and u = L⁻¹ b_p. A
    coordinate whose pivot vanishes is held: reciprocal and u are zero, the row and column of L too.
    """
    clear(L)
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
    L[0, 0], L[1, 0], L[1, 1], L[2, 0], L[2, 1], L[2, 2] = n00, n10, n11, n20, n21, n22
    gradient[0], gradient[1], gradient[2] = g, h, k
    u[0], u[1], u[2] = g, h, k
    for j in range(3):
        whole = L[j, j]
        pivot = whole * (1.0 + damping)
        for m in range(j):
            pivot -= L[j, m] * L[j, m]
        if pivot <= VANISHING * whole:
            inverse[j] = 0.0
            u[j] = 0.0
            for m in range(3):
                L[max(j, m), min(j, m)] = 0.0
            continue
        L[j, j] = np.sqrt(pivot)
        inverse[j] = 1.0 / L[j, j]
        for i in range(j + 1, 3):
            for m in range(j):
                L[i, j] -= L[i, m] * L[j, m]
            L[i, j] *= inverse[j]
        for m in range(j):
            u[j] -= L[j, m] * u[m]
        u[j] *= inverse[j]


@compile_kernel
def couple(
    by_point: FloatArray,
    by_others: FloatArray,
    frame: IntArray,
    first: int,
    end: int,
    runs: Runs,
    local: IntArray,
    L: FloatArray,
    inverse: FloatArray,
    V: FloatArray,
) -> None:
    """Set V = W L⁻ᵀ, transposed (3, m), for the rays first … end − 1, all of one point."""
    clear(V)
    one, two, three = V[0], V[1], V[2]
    for i in range(first, end):
        ax, ay, az = by_point[i, 0, 0], by_point[i, 0, 1], by_point[i, 0, 2]
        bx, by, bz = by_point[i, 1, 0], by_point[i, 1, 1], by_point[i, 1, 2]
        start = runs.pointers[frame[i]]
        for t in range(start, runs.pointers[frame[i] + 1]):
            at, column = local[i - first, t - start], runs.first[t]
            for k in range(runs.length[t]):
                x, y = by_others[i, 0, column + k], by_others[i, 1, column + k]
                one[at + k] += x * ax + y * bx
                two[at + k] += x * ay + y * by
                three[at + k] += x * az + y * bz
    p, q, r = inverse[0], inverse[1], inverse[2]
    a, b, c = L[1, 0], L[2, 0], L[2, 1]
    for m in range(one.size):
        x = one[m] * p
        y = (two[m] - a * x) * q
        one[m] = x
        two[m] = y
        three[m] = (three[m] - b * x - c * y) * r


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
