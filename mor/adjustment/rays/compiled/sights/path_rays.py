"""Kernels that linearise image rays along trajectories, as ``mor.observations.time`` has images and line scanners.

How a point is seen says ``passing``. A row β by the small rotation of the pose becomes

    w_k β J(θ) J(θ_k)⁻¹        and        β exp(−[θ]×) − β J(θ) Σ w_k J(θ_k)⁻ᵀ

by those of knot k, and of knot 0.
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.rays.compiled.sights.cameras import ALONG, MOVING, fill_by_interior
from mor.adjustment.rays.compiled.sights.image_rays import (
    FrameChange,
    FrameValues,
    Layout,
    Measured,
    clear_row,
)
from mor.adjustment.rays.compiled.sights.moving_rays import lever_of
from mor.adjustment.rays.compiled.sights.passing import Passing, passing
from mor.adjustment.rays.compiled.sights.small_turns import (
    Turn,
    Vector,
    by_psi,
    cross,
    row_by_psi,
    turned,
    turned_back,
)
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_inline, compile_kernel

KNOTS = 4
"""Knots that a pose depends on, at most."""


@compile_kernel
def linearise_along(
    values: FrameValues,
    layout: Layout,
    frame: IntArray,
    pointers: IntArray,
    points: FloatArray,
    rays: Measured,
    residual: FloatArray,
    by_point: FloatArray,
    by_others: FloatArray,
) -> None:
    """Set residuals and Jacobians of the rays along trajectories, as ``linearise`` does those of frames."""
    D, interiors = values.D, values.interior
    observed, weight, measured, clock = rays
    by_interior, i, w = np.zeros((2, interiors.shape[1])), np.empty(interiors.shape[1]), np.empty(KNOTS)
    for p in range(pointers.size - 1):
        for n in range(pointers[p], pointers[p + 1]):
            f = frame[n]
            if values.model[f] < ALONG:
                continue
            for k in range(i.size):
                i[k] = interiors[f, k]
            u, v = measured[n, 0], measured[n, 1]
            seen = passing(values, f, lever_of(values, f, points, p), i, u, v, clock[n], w)
            X, Y, Z = seen.star
            model, by_ideal = values.model[f] % MOVING, seen.sight.by_ideal
            fill_by_interior(model, X, Y, Z, i, values.r0[f], u, v, by_ideal, by_interior)
            one, other = seen.sight.by_star
            for m in range(2):
                s = weight[n, m]
                if s == 0.0:
                    residual[n, m] = 0.0
                    clear_row(by_point, by_others, n, m)
                    continue
                residual[n, m] = ((seen.x if m == 0 else seen.y) - observed[n, m]) * s
                g, h = s * seen.across[2 * m], s * seen.across[2 * m + 1]
                by_star = g * one[0] + h * other[0], g * one[1] + h * other[1], g * one[2] + h * other[2]
                row = by_others[n, m]
                for k in range(layout.of_motion):
                    row[k] = 0.0
                a, b, c = by_object(D, f, turned_back(seen.turn, by_star))
                by_point[n, m, 0], by_point[n, m, 1], by_point[n, m, 2] = a, b, c
                set_knots(row, layout, values, f, w, (a, b, c), seen.turn, cross(by_star, seen.lever))
                if layout.readout >= 0:
                    row[layout.readout] = s * seen.by_readout[m]
                if layout.height >= 0:
                    row[layout.height] = -c
                if layout.eccentricity >= 0:
                    for k in range(3):
                        row[layout.eccentricity + k] = by_star[k]
                for k in range(layout.components.size):
                    j = layout.components[k]
                    row[layout.interior + k] = g * by_interior[0, j] + h * by_interior[1, j]
                for k in range(layout.interior + layout.components.size, row.size):
                    row[k] = 0.0


@compile_inline
def by_object(D: FloatArray, f: int, row: Vector) -> Vector:
    """Return the row times D_0."""
    s, t, d = row
    return (
        s * D[f, 0] + t * D[f, 3] + d * D[f, 6],
        s * D[f, 1] + t * D[f, 4] + d * D[f, 7],
        s * D[f, 2] + t * D[f, 5] + d * D[f, 8],
    )


@compile_kernel
def set_knots(
    row: FloatArray,
    layout: Layout,
    values: FrameValues,
    f: int,
    w: FloatArray,
    by_point: Vector,
    turn: Turn,
    by_turn: Vector,
) -> None:
    """Set the derivatives of one component by the knots, from those by the point and by the rotation of the pose."""
    paths, along = values.paths, row_by_psi(turn, by_turn)
    r, s, t = turned_back(turn, by_turn)
    for k in range(paths.knots[f]):
        start = layout.position if k == 0 else layout.knots[k - 1, 1]
        if start >= 0:
            for j in range(3):
                row[start + j] = -w[k] * by_point[j]
        if k == 0:
            continue
        M = paths.inverse[f, k - 1]
        a, b, c = w[k] * along[0], w[k] * along[1], w[k] * along[2]
        r -= M[0, 0] * a + M[0, 1] * b + M[0, 2] * c
        s -= M[1, 0] * a + M[1, 1] * b + M[1, 2] * c
        t -= M[2, 0] * a + M[2, 1] * b + M[2, 2] * c
        start = layout.knots[k - 1, 0]
        if start >= 0:
            found = row_times((a, b, c), M)
            if paths.tangent.shape[0] > 0:
                found = row_times(found, paths.tangent[f, k - 1])
            row[start], row[start + 1], row[start + 2] = found
    if layout.rotation >= 0:
        found = r, s, t
        if values.tangent.shape[0] > 0:
            found = row_times(found, values.tangent[f])
        row[layout.rotation], row[layout.rotation + 1], row[layout.rotation + 2] = found


@compile_inline
def row_times(row: Vector, M: FloatArray) -> Vector:
    """Return the row times a matrix (3, 3)."""
    a, b, c = row
    return (
        a * M[0, 0] + b * M[1, 0] + c * M[2, 0],
        a * M[0, 1] + b * M[1, 1] + c * M[2, 1],
        a * M[0, 2] + b * M[1, 2] + c * M[2, 2],
    )


@compile_kernel
def residuals_along(
    values: FrameValues,
    frame: IntArray,
    pointers: IntArray,
    points: FloatArray,
    rays: Measured,
    residual: FloatArray,
) -> None:
    """Set residuals (n, 2) of the rays along trajectories divided by σ, and nothing else."""
    observed, weight, measured, clock = rays
    i, w = np.empty(values.interior.shape[1]), np.empty(KNOTS)
    for p in range(pointers.size - 1):
        for n in range(pointers[p], pointers[p + 1]):
            f = frame[n]
            if values.model[f] < ALONG:
                continue
            for k in range(i.size):
                i[k] = values.interior[f, k]
            base = lever_of(values, f, points, p)
            seen = passing(values, f, base, i, measured[n, 0], measured[n, 1], clock[n], w)
            s, t = weight[n, 0], weight[n, 1]
            residual[n, 0] = (seen.x - observed[n, 0]) * s if s != 0.0 else 0.0
            residual[n, 1] = (seen.y - observed[n, 1]) * t if t != 0.0 else 0.0


@compile_kernel
def follow_along(
    values: FrameValues,
    change: FrameChange,
    frame: IntArray,
    pointers: IntArray,
    points: FloatArray,
    rays: Measured,
    residual: FloatArray,
    by_point: FloatArray,
) -> None:
    """Set residuals after a small change of the knots, and Jacobians by the point, of the rays along trajectories."""
    D, interiors = values.D, values.interior
    observed, weight, measured, clock = rays
    by_interior, i, w = np.zeros((2, interiors.shape[1])), np.empty(interiors.shape[1]), np.empty(KNOTS)
    for p in range(pointers.size - 1):
        for n in range(pointers[p], pointers[p + 1]):
            f = frame[n]
            if values.model[f] < ALONG:
                continue
            for k in range(i.size):
                i[k] = interiors[f, k]
            u, v = measured[n, 0], measured[n, 1]
            seen = passing(values, f, lever_of(values, f, points, p), i, u, v, clock[n], w)
            X, Y, Z = seen.star
            model, by_ideal = values.model[f] % MOVING, seen.sight.by_ideal
            fill_by_interior(model, X, Y, Z, i, values.r0[f], u, v, by_ideal, by_interior)
            a, b, c = star_along(values, change, f, w, seen)
            one, other = seen.sight.by_star
            dx = one[0] * a + one[1] * b + one[2] * c
            dy = other[0] * a + other[1] * b + other[2] * c
            for k in range(i.size):
                dx += by_interior[0, k] * change.interior[f, k]
                dy += by_interior[1, k] * change.interior[f, k]
            for m in range(2):
                s = weight[n, m]
                if s == 0.0:
                    residual[n, m] = by_point[n, m, 0] = by_point[n, m, 1] = by_point[n, m, 2] = 0.0
                    continue
                g, h = s * seen.across[2 * m], s * seen.across[2 * m + 1]
                found = seen.x if m == 0 else seen.y
                later = seen.by_readout[m] * change.readout[f]
                residual[n, m] = (found - observed[n, m] + later) * s + g * dx + h * dy
                by_star = g * one[0] + h * other[0], g * one[1] + h * other[1], g * one[2] + h * other[2]
                a, b, c = by_object(D, f, turned_back(seen.turn, by_star))
                by_point[n, m, 0], by_point[n, m, 1], by_point[n, m, 2] = a, b, c


@compile_kernel
def star_along(values: FrameValues, change: FrameChange, f: int, w: FloatArray, seen: Passing) -> Vector:
    """Return by how much the point moves in the image system at a fixed time, where the knots change."""
    paths, turn, D = values.paths, seen.turn, values.D[f]
    X, Y, Z = w[0] * change.centre[f, 0], w[0] * change.centre[f, 1], w[0] * change.centre[f, 2]
    p, q, r = change.turn[f, 0], change.turn[f, 1], change.turn[f, 2]
    a, b, c = 0.0, 0.0, 0.0  # Σ w_k (J(θ_k)⁻¹ δ_k − J(θ_k)⁻ᵀ δ_0)
    for k in range(1, paths.knots[f]):
        one, M = w[k], paths.inverse[f, k - 1]
        shift, spin = change.knots[f, k - 1, 0], change.knots[f, k - 1, 1]
        X, Y, Z = X + one * shift[0], Y + one * shift[1], Z + one * shift[2]
        g, h, o = spin[0], spin[1], spin[2]
        a += one * (M[0, 0] * g + M[0, 1] * h + M[0, 2] * o - M[0, 0] * p - M[1, 0] * q - M[2, 0] * r)
        b += one * (M[1, 0] * g + M[1, 1] * h + M[1, 2] * o - M[0, 1] * p - M[1, 1] * q - M[2, 1] * r)
        c += one * (M[2, 0] * g + M[2, 1] * h + M[2, 2] * o - M[0, 2] * p - M[1, 2] * q - M[2, 2] * r)
    delta, first = by_psi(turn, (a, b, c)), turned(turn, (p, q, r))
    about = cross(seen.lever, (delta[0] + first[0], delta[1] + first[1], delta[2] + first[2]))
    back = turned(
        turn,
        (
            D[0] * X + D[1] * Y + D[2] * Z,
            D[3] * X + D[4] * Y + D[5] * Z,
            D[6] * X + D[7] * Y + D[8] * Z,
        ),
    )
    e = change.eccentricity[f]
    return about[0] - back[0] + e[0], about[1] - back[1] + e[1], about[2] - back[2] + e[2]
