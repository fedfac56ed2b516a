"""Kernels that eliminate points met by rays alone: their 3×3 systems, and what they leave in the reduced
system.

For one point, with the Jacobians a (by the point) and j (by the other unknowns) of its rays,

    N_pp = Σ aᵀa = L Lᵀ,    W = Σ jᵀa,    V = W L⁻ᵀ,    b_p = −Σ aᵀ residual,    u = L⁻¹ b_p.
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.compiled import compile_kernel
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
    damping: float,
    L: FloatArray,
    inverse: FloatArray,
    u: FloatArray,
) -> None:
    """Factorise N_pp of the rays of one point, (r, 2, 3) and (r, 2).

    Sets L (3, 3), the reciprocals of its diagonal and u = L⁻¹ b_p with b_p = −Σ aᵀ residual. A coordinate
    whose
    pivot vanishes is held: reciprocal and u are zero, the row and column of L too.
    """
    clear(L)
    for j in range(3):
        u[j] = 0.0
    for i in range(by_point.shape[0]):
        for c in range(2):
            for j in range(3):
                u[j] -= by_point[i, c, j] * residual[i, c]
                for k in range(j + 1):
                    L[j, k] += by_point[i, c, j] * by_point[i, c, k]
    for j in range(3):
        whole = L[j, j]
        pivot = whole * (1.0 + damping)
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        if pivot <= VANISHING * whole:
            inverse[j] = 0.0
            u[j] = 0.0
            for k in range(3):
                L[max(j, k), min(j, k)] = 0.0
            continue
        L[j, j] = np.sqrt(pivot)
        inverse[j] = 1.0 / L[j, j]
        for i in range(j + 1, 3):
            for k in range(j):
                L[i, j] -= L[i, k] * L[j, k]
            L[i, j] *= inverse[j]
        for k in range(j):
            u[j] -= L[j, k] * u[k]
        u[j] *= inverse[j]


@compile_kernel
def couple(
    by_point: FloatArray,
    by_others: FloatArray,
    local: IntArray,
    L: FloatArray,
    inverse: FloatArray,
    V: FloatArray,
) -> None:
    """Set V = W L⁻ᵀ, transposed (3, m), for the rays of one point with local numbers (r, K) of their columns."""
    clear(V)
    for i in range(by_point.shape[0]):
        for k in range(local.shape[1]):
            at = local[i, k]
            if at < 0:
                continue
            x, y = by_others[i, 0, k], by_others[i, 1, k]
            V[0, at] += x * by_point[i, 0, 0] + y * by_point[i, 1, 0]
            V[1, at] += x * by_point[i, 0, 1] + y * by_point[i, 1, 1]
            V[2, at] += x * by_point[i, 0, 2] + y * by_point[i, 1, 2]
    for m in range(V.shape[1]):
        first = V[0, m] * inverse[0]
        second = (V[1, m] - L[1, 0] * first) * inverse[1]
        V[0, m] = first
        V[1, m] = second
        V[2, m] = (V[2, m] - L[2, 0] * first - L[2, 1] * second) * inverse[2]


@compile_kernel
def back_substitute(
    residual: FloatArray,
    by_point: FloatArray,
    by_others: FloatArray,
    columns: IntArray,
    pointers: IntArray,
    damping: float,
    step: FloatArray,
    point_steps: FloatArray,
) -> None:
    """Set the steps (p, 3) of the points, whose residuals are those after the step of the others."""
    L, inverse, u = np.empty((3, 3)), np.empty(3), np.empty(3)
    widest = np.diff(pointers).max() if pointers.size > 1 else 0
    moved = np.empty((widest, 2))
    for p in range(pointers.size - 1):
        first, end = pointers[p], pointers[p + 1]
        for i in range(first, end):
            x, y = residual[i, 0], residual[i, 1]
            for k in range(columns.shape[1]):
                if columns[i, k] >= 0:
                    x += by_others[i, 0, k] * step[columns[i, k]]
                    y += by_others[i, 1, k] * step[columns[i, k]]
            moved[i - first, 0], moved[i - first, 1] = x, y
        factor_point(by_point[first:end], moved[: end - first], damping, L, inverse, u)
        for j in range(2, -1, -1):
            for k in range(j + 1, 3):
                u[j] -= L[k, j] * u[k]
            u[j] *= inverse[j]
            point_steps[p, j] = u[j]
