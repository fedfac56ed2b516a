"""Kernels that linearise image rays along trajectories, as ``mor.observations.time`` has images and line scanners.

In the axes of knot 0 a point is at D_0 (X − X_0) − Σ w_k p_k with p_k = D_0 (X_k − X_0), the sum over the other knots;
exp(−[θ]×) with θ = Σ w_k θ_k turns it into those of time t. A line scanner sees it when it crosses the line: a change
(dx, dy) at a fixed time becomes dx − ẋ/ẏ dy, and −dy/ẏ in time. A row β by the small rotation of the pose becomes

    w_k β J(θ) J(θ_k)⁻¹        and        β exp(−[θ]×) − β J(θ) Σ w_k J(θ_k)⁻ᵀ

by those of knot k, and of knot 0.
"""

from __future__ import annotations

from math import nan
from typing import NamedTuple

import numpy as np

from mor.adjustment.rays.compiled.cameras import ALONG, CROSSING, Sight, fill_by_interior, sight
from mor.adjustment.rays.compiled.image_rays import (
    FrameChange,
    FrameValues,
    Layout,
    Measured,
    Paths,
    clear_row,
)
from mor.adjustment.rays.compiled.moving_rays import (
    Turn,
    Vector,
    cross,
    lever_of,
    polynomial,
    small_turn,
    turned,
    turned_back,
)
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_inline, compile_kernel

KNOTS = 4
"""Knots that a pose depends on, at most."""
_ROUNDS, _STILL = 10, 1e-12
"""Rounds at most, and the part of the time in which the camera scans its own camera constant by which a crossing may
still move: what is left of that is taken along to first order, and the derivatives differ by less than it."""


class Passing(NamedTuple):
    """A point as it is seen from a trajectory.

    Attributes:
        turn: −θ.
        lever: D(t) (X − X0(t)).
        star: the same, with the eccentricity added.
        sight: image coordinates at this time, and derivatives.
        x, y: coordinates as they are computed: y of line scanners is that of the row of the crossing.
        across: what stands before the derivatives at a fixed time, row by row.
    """

    turn: Turn
    lever: Vector
    star: Vector
    sight: Sight
    x: float
    y: float
    across: tuple[float, float, float, float]


@compile_kernel
def between(paths: Paths, f: int, time: float, w: FloatArray) -> tuple[Vector, Vector, Vector, Vector]:
    """Set the weights w (4,) of the knots; return Σ w_k p_k and θ at ``time`` since knot 0, and their derivatives."""
    a, b, c, g, h, o = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    da, db, dc, dg, dh, do = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    weights, reach, turns = paths.weights[f], paths.reach[f], paths.turns[f]
    w[0] = 1.0
    for k in range(1, paths.knots[f]):
        first, second, third = weights[k, 1], weights[k, 2], weights[k, 3]
        one = weights[k, 0] + time * (first + time * (second + time * third))
        slope = first + time * (2.0 * second + 3.0 * time * third)
        p, q, r = reach[k - 1, 0], reach[k - 1, 1], reach[k - 1, 2]
        a, b, c = a + one * p, b + one * q, c + one * r
        da, db, dc = da + slope * p, db + slope * q, dc + slope * r
        p, q, r = turns[k - 1, 0], turns[k - 1, 1], turns[k - 1, 2]
        g, h, o = g + one * p, h + one * q, o + one * r
        dg, dh, do = dg + slope * p, dh + slope * q, do + slope * r
        w[k] = one
        w[0] -= one
    return (a, b, c), (g, h, o), (da, db, dc), (dg, dh, do)


@compile_kernel
def by_psi(turn: Turn, q: Vector) -> Vector:
    """Return J(−ψ) q with the right Jacobian J."""
    once = cross(turn.psi, q)
    return polynomial(q, once, turn.cosine, turn.third, cross(turn.psi, once))


@compile_kernel
def row_by_psi(turn: Turn, row: Vector) -> Vector:
    """Return the row times J(−ψ)."""
    once = cross(row, turn.psi)
    return polynomial(row, once, turn.cosine, turn.third, cross(once, turn.psi))


@compile_kernel
def passing(
    values: FrameValues,
    f: int,
    base: Vector,
    i: FloatArray,
    u: float,
    v: float,
    clock: FloatArray,
    w: FloatArray,
) -> Passing:
    """Return how a point at ``base`` = D_0 (X − X_0) is seen, and set the weights w (4,) of the knots.

    (u, v) are the measured coordinates, v of a line scanner that of its line; ``clock`` (3,): time since knot 0, of a
    line scanner when the observed row was scanned, that row, and seconds by rows.
    """
    crosses = values.model[f] >= CROSSING
    model = values.model[f] - (CROSSING if crosses else ALONG)
    e, r0 = values.eccentricity[f], values.r0[f]
    time, still, rounds = clock[0], _STILL * abs(clock[2] * i[0]), 0
    while True:
        moved, theta, velocity, rate = between(values.paths, f, time, w)
        turn = small_turn(-theta[0], -theta[1], -theta[2])
        q = turned(turn, (base[0] - moved[0], base[1] - moved[1], base[2] - moved[2]))
        star = q[0] + e[0], q[1] + e[1], q[2] + e[2]
        seen = sight(model, star[0], star[1], star[2], i, r0, u, v)
        if not crosses:
            return Passing(turn, q, star, seen, seen.x, seen.y, (1.0, 0.0, 0.0, 1.0))
        about, along = cross(q, by_psi(turn, rate)), turned(turn, velocity)
        a, b, c = about[0] - along[0], about[1] - along[1], about[2] - along[2]
        one, other = seen.by_star
        dx, dy = one[0] * a + one[1] * b + one[2] * c, other[0] * a + other[1] * b + other[2] * c
        per_dy = 1.0 / dy if dy != 0.0 else nan  # a camera that stands still scans nothing
        step = (v - seen.y) * per_dy
        rounds += 1
        if rounds > _ROUNDS or not abs(step) > still:
            break
        time += step
    per_rate = 1.0 / clock[2]
    row = clock[1] + (time + step - clock[0]) * per_rate
    return Passing(turn, q, star, seen, seen.x + dx * step, row, (1.0, -dx * per_dy, 0.0, -per_dy * per_rate))


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
            model = values.model[f] - (CROSSING if values.model[f] >= CROSSING else ALONG)
            by_ideal = seen.sight.by_ideal
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
            model = values.model[f] - (CROSSING if values.model[f] >= CROSSING else ALONG)
            by_ideal = seen.sight.by_ideal
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
                residual[n, m] = (found - observed[n, m]) * s + g * dx + h * dy
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
