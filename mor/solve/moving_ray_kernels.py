"""Compiled kernels: rays of rolling shutters, line scanners and trajectories."""

from __future__ import annotations

from math import cos, nan, sin, sqrt
from typing import NamedTuple

import numpy as np

from mor.linalg.compilation import compile_inline, compile_kernel
from mor.solve.ray_kernels import (
    ALONG,
    CROSSING,
    MOVING,
    FrameChange,
    FrameValues,
    Layout,
    Paths,
    ProjectedPoint,
    RayMeasurements,
    Vector,
    by_object,
    clear_columns,
    clear_row,
    fill_by_interior,
    into_tangent,
    pose_columns,
    rotated,
    rotation,
    set_row,
    sight,
)
from mor.types import FloatArray, IntArray

# ---- Small rotations for kernels: rotation vectors ψ act by vector products, also where they turn by much.
#
# exp([ψ]×) q = q + sin|ψ|/|ψ| ψ×q + (1 − cos|ψ|)/|ψ|² ψ×(ψ×q)

_SERIES = 0.0025
"""Square of the angle below which the series have all digits."""


class SmallRotation(NamedTuple):
    """A small rotation vector ψ, and the factors of ψ× and ψ×ψ× in exp([ψ]×), and of the last in its right Jacobian."""

    psi: Vector
    sine: float
    cosine: float
    third: float


@compile_kernel
def cross(a: Vector, b: Vector) -> Vector:
    """Return a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compile_kernel
def small_turn(x: float, y: float, z: float) -> SmallRotation:
    """Return the rotation by a vector."""
    square = x * x + y * y + z * z
    if square < _SERIES:
        sine = 1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0))
        cosine = 0.5 - square / 24.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0))
        third = (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0))) / 6.0
    else:
        angle = sqrt(square)
        sine, cosine = sin(angle) / angle, (1.0 - cos(angle)) / square
        third = (1.0 - sine) / square
    return SmallRotation((x, y, z), sine, cosine, third)


@compile_kernel
def polynomial(q: Vector, once: Vector, first: float, second: float, twice: Vector) -> Vector:
    """Return q + first · once + second · twice."""
    return (
        q[0] + first * once[0] + second * twice[0],
        q[1] + first * once[1] + second * twice[1],
        q[2] + first * once[2] + second * twice[2],
    )


@compile_kernel
def turned(turn: SmallRotation, q: Vector) -> Vector:
    """Return exp([ψ]×) q."""
    once = cross(turn.psi, q)
    return polynomial(q, once, turn.sine, turn.cosine, cross(turn.psi, once))


@compile_kernel
def turned_back(turn: SmallRotation, row: Vector) -> Vector:
    """Return the row times exp([ψ]×)."""
    once = cross(row, turn.psi)
    return polynomial(row, once, turn.sine, turn.cosine, cross(once, turn.psi))


@compile_kernel
def by_psi(turn: SmallRotation, q: Vector) -> Vector:
    """Return J(−ψ) q with the right Jacobian J."""
    once = cross(turn.psi, q)
    return polynomial(q, once, turn.cosine, turn.third, cross(turn.psi, once))


@compile_kernel
def row_by_psi(turn: SmallRotation, row: Vector) -> Vector:
    """Return the row times J(−ψ)."""
    once = cross(row, turn.psi)
    return polynomial(row, once, turn.cosine, turn.third, cross(once, turn.psi))


# ---- Kernels that linearise image rays of rolling shutters, ray by ray what ``mor.model.images`` has.
#
# A point is seen where it and the shutter meet. Its image moves there by d = (∂x/∂t, ∂y/∂t); a change δ of the image
# point at a fixed time moves the row in which they meet, and becomes
#
#     M δ,        M = 1 + d gᵀ T / (1 − T g·d)
#
# with the slope g of the phase in the image. So M stands before all derivatives.

_ROUNDS, _STILL = 20, 1e-12
"""Rounds at most, and the part of the camera constant by which the row may still move.

What is left of that is taken along to first order; the derivatives are those at the row before, and differ by less than
it, for the point moves in the image by a small part of its height while it is read out."""


class ShutterCrossing(NamedTuple):
    """A point where it and the shutter meet.

    Attributes:
        phase: part of the readout that has passed, less 1/2.
        time: since the middle row.
        turn: by which the image has turned since.
        shifted: D (X − X0) − v t.
        star: the same, turned, and the eccentricity added.
        sight: image coordinates at this time, and derivatives.
        x, y: image coordinates where the two meet.
        across: M, row by row.
        drift: M d.
    """

    phase: float
    time: float
    turn: SmallRotation
    shifted: Vector
    star: Vector
    sight: ProjectedPoint
    x: float
    y: float
    across: tuple[float, float, float, float]
    drift: tuple[float, float]


@compile_kernel
def meet(values: FrameValues, f: int, lever: Vector, i: FloatArray, u: float, v: float) -> ShutterCrossing:
    """Return where a point at ``lever`` = D (X − X0) meets the shutter, looked for from (u, v), as measured."""
    T, model, e, r0 = values.readout[f], values.model[f] % MOVING, values.eccentricity[f], values.r0[f]
    gx, gy, g0 = values.clock[f, 0], values.clock[f, 1], values.clock[f, 2]
    velocity = values.velocity[f, 0], values.velocity[f, 1], values.velocity[f, 2]
    rate = values.rate[f, 0], values.rate[f, 1], values.rate[f, 2]
    x, y, rounds = u, v, 0
    while True:
        phase = gx * x + gy * y + g0
        t = T * phase
        turn = small_turn(-rate[0] * t, -rate[1] * t, -rate[2] * t)
        shifted = lever[0] - velocity[0] * t, lever[1] - velocity[1] * t, lever[2] - velocity[2] * t
        q, along = turned(turn, shifted), turned(turn, velocity)
        about = cross(rate, q)
        star = q[0] + e[0], q[1] + e[1], q[2] + e[2]
        seen = sight(model, star[0], star[1], star[2], i, r0, u, v)
        a, b, c = -along[0] - about[0], -along[1] - about[1], -along[2] - about[2]
        one, other = seen.by_star
        dx, dy = one[0] * a + one[1] * b + one[2] * c, other[0] * a + other[1] * b + other[2] * c
        later = T / (1.0 - T * (gx * dx + gy * dy))
        tau = later * (gx * (seen.x - x) + gy * (seen.y - y))
        found_x, found_y = seen.x + dx * tau, seen.y + dy * tau
        rounds += 1
        if rounds > _ROUNDS or not max(abs(found_x - x), abs(found_y - y)) > _STILL * i[0]:
            break
        x, y = found_x, found_y
    across = 1.0 + dx * gx * later, dx * gy * later, dy * gx * later, 1.0 + dy * gy * later
    drift = across[0] * dx + across[1] * dy, across[2] * dx + across[3] * dy
    return ShutterCrossing(phase, t, turn, shifted, star, seen, found_x, found_y, across, drift)


@compile_kernel
def linearise_moving(
    values: FrameValues,
    layout: Layout,
    frame: IntArray,
    pointers: IntArray,
    points: FloatArray,
    rays: RayMeasurements,
    residual: FloatArray,
    by_point: FloatArray,
    by_others: FloatArray,
) -> None:
    """Set residuals and Jacobians of the rays of rolling shutters, as ``linearise`` does those of frames."""
    interiors, tangent, pose = values.interior, values.tangent, pose_columns(layout)
    width, flat = by_others.shape[2], by_others.reshape(-1)
    observed, weight, measured = rays[:3]
    by_interior, i = np.zeros((2, interiors.shape[1])), np.empty(interiors.shape[1])
    for p in range(pointers.size - 1):
        for n in range(pointers[p], pointers[p + 1]):
            f = frame[n]
            if values.model[f] < MOVING or values.model[f] >= ALONG:
                continue
            for k in range(i.size):
                i[k] = interiors[f, k]
            D, lever = rotation(values.D, f), lever_of(values, f, points, p)
            u, v = measured[n, 0], measured[n, 1]
            met = meet(values, f, lever, i, u, v)
            X, Y, Z = met.star
            model, r0, by_ideal = values.model[f] % MOVING, values.r0[f], met.sight.by_ideal
            fill_by_interior(model, X, Y, Z, i, r0, u, v, by_ideal, by_interior)
            one, other = met.sight.by_star
            for m in range(2):
                w = weight[n, m]
                if w == 0.0:
                    residual[n, m] = 0.0
                    clear_row(by_point, by_others, n, m)
                    continue
                residual[n, m] = ((met.x if m == 0 else met.y) - observed[n, m]) * w
                g, h = w * met.across[2 * m], w * met.across[2 * m + 1]
                by_star = g * one[0] + h * other[0], g * one[1] + h * other[1], g * one[2] + h * other[2]
                by_shifted, row = turned_back(met.turn, by_star), np.uint64((2 * n + m) * width)
                clear_columns(flat, row, 0, layout.of_motion)
                set_row(by_point, n, m, flat, row, pose, D, lever, by_shifted)
                if pose[0] >= 0 and tangent.shape[0] > 0:
                    into_tangent(flat, row + np.uint64(pose[0]), tangent, f)
                set_motion(by_others[n, m], layout, met, by_shifted, by_star, w * met.drift[m] * met.phase)
                for k in range(layout.components.size):
                    j = layout.components[k]
                    by_others[n, m, layout.interior + k] = g * by_interior[0, j] + h * by_interior[1, j]
                clear_columns(flat, row, layout.interior + layout.components.size, width)


@compile_inline
def lever_of(values: FrameValues, f: int, points: FloatArray, p: int) -> Vector:
    """Return D (X − X0)."""
    X = points[p, 0] - values.centre[f, 0]
    Y = points[p, 1] - values.centre[f, 1]
    Z = points[p, 2] - values.centre[f, 2]
    return rotated(rotation(values.D, f), X, Y, Z)


@compile_kernel
def set_motion(
    row: FloatArray, layout: Layout, met: ShutterCrossing, by_shifted: Vector, by_star: Vector, by_readout: float
) -> None:
    """Set the derivatives of one component by eccentricity, velocity, rate and readout time."""
    time, turn = met.time, met.turn
    if layout.eccentricity >= 0:
        for k in range(3):
            row[layout.eccentricity + k] = by_star[k]
    if layout.velocity >= 0:
        for k in range(3):
            row[layout.velocity + k] = -time * by_shifted[k]
    if layout.rate >= 0:
        by_turn = cross(by_shifted, met.shifted)
        once = cross(by_turn, turn.psi)
        by_turn = polynomial(by_turn, once, -turn.cosine, turn.third, cross(once, turn.psi))
        for k in range(3):
            row[layout.rate + k] = time * by_turn[k]
    if layout.readout >= 0:
        row[layout.readout] = by_readout


@compile_kernel
def moving_residuals(
    values: FrameValues,
    frame: IntArray,
    pointers: IntArray,
    points: FloatArray,
    rays: RayMeasurements,
    residual: FloatArray,
) -> None:
    """Set residuals (n, 2) of the rays of rolling shutters divided by σ, and nothing else."""
    observed, weight, measured = rays[:3]
    i = np.empty(values.interior.shape[1])
    for p in range(pointers.size - 1):
        for n in range(pointers[p], pointers[p + 1]):
            f = frame[n]
            if values.model[f] < MOVING or values.model[f] >= ALONG:
                continue
            for k in range(i.size):
                i[k] = values.interior[f, k]
            u, v = measured[n, 0], measured[n, 1]
            met = meet(values, f, lever_of(values, f, points, p), i, u, v)
            w, z = weight[n, 0], weight[n, 1]
            residual[n, 0] = (met.x - observed[n, 0]) * w if w != 0.0 else 0.0
            residual[n, 1] = (met.y - observed[n, 1]) * z if z != 0.0 else 0.0


@compile_kernel
def follow_moving(
    values: FrameValues,
    change: FrameChange,
    frame: IntArray,
    pointers: IntArray,
    points: FloatArray,
    rays: RayMeasurements,
    residual: FloatArray,
    by_point: FloatArray,
) -> None:
    """Set residuals after a small change of the frames, and Jacobians by the point, of the rays of rolling shutters."""
    D, interiors = values.D, values.interior
    observed, weight, measured = rays[:3]
    by_interior, i = np.zeros((2, interiors.shape[1])), np.empty(interiors.shape[1])
    for p in range(pointers.size - 1):
        for n in range(pointers[p], pointers[p + 1]):
            f = frame[n]
            if values.model[f] < MOVING or values.model[f] >= ALONG:
                continue
            for k in range(i.size):
                i[k] = interiors[f, k]
            lever = lever_of(values, f, points, p)
            u, v = measured[n, 0], measured[n, 1]
            met = meet(values, f, lever, i, u, v)
            X, Y, Z = met.star
            model, r0, by_ideal = values.model[f] % MOVING, values.r0[f], met.sight.by_ideal
            fill_by_interior(model, X, Y, Z, i, r0, u, v, by_ideal, by_interior)
            a, b, c = star_change(values, change, f, lever, met)
            one, other = met.sight.by_star
            dx = one[0] * a + one[1] * b + one[2] * c
            dy = other[0] * a + other[1] * b + other[2] * c
            for k in range(i.size):
                dx += by_interior[0, k] * change.interior[f, k]
                dy += by_interior[1, k] * change.interior[f, k]
            later = met.phase * change.readout[f]
            for m in range(2):
                w = weight[n, m]
                g, h = w * met.across[2 * m], w * met.across[2 * m + 1]
                if w == 0.0:
                    residual[n, m] = by_point[n, m, 0] = by_point[n, m, 1] = by_point[n, m, 2] = 0.0
                    continue
                found = met.x if m == 0 else met.y
                residual[n, m] = (found - observed[n, m] + met.drift[m] * later) * w + g * dx + h * dy
                by_star = g * one[0] + h * other[0], g * one[1] + h * other[1], g * one[2] + h * other[2]
                a, b, c = by_object(rotation(D, f), turned_back(met.turn, by_star))
                by_point[n, m, 0], by_point[n, m, 1], by_point[n, m, 2] = a, b, c


@compile_kernel
def star_change(values: FrameValues, change: FrameChange, f: int, lever: Vector, met: ShutterCrossing) -> Vector:
    """Return by how much the point moves in the image system at a fixed time, where its frame changes."""
    time, turn = met.time, met.turn
    X, Y, Z = rotated(rotation(values.D, f), change.centre[f, 0], change.centre[f, 1], change.centre[f, 2])
    velocity, rate = change.velocity[f], change.rate[f]
    about = cross(lever, (change.turn[f, 0], change.turn[f, 1], change.turn[f, 2]))
    spin = rate[0], rate[1], rate[2]
    once = cross(turn.psi, spin)
    spin = polynomial(spin, once, -turn.cosine, turn.third, cross(turn.psi, once))
    faster = cross(met.shifted, spin)
    a, b, c = turned(
        turn,
        (
            about[0] - X + time * (faster[0] - velocity[0]),
            about[1] - Y + time * (faster[1] - velocity[1]),
            about[2] - Z + time * (faster[2] - velocity[2]),
        ),
    )
    return a + change.eccentricity[f, 0], b + change.eccentricity[f, 1], c + change.eccentricity[f, 2]


# ---- How points are seen from trajectories, one at a time: at once, where they meet a shutter, where they cross a
# line.
#
# In the axes of knot 0 a point is at D_0 (X − X_0) − Σ w_k p_k with p_k = D_0 (X_k − X_0), the sum over the
# other knots; exp(−[θ]×) with θ = Σ w_k θ_k turns it into those of time t. A line scanner sees it when it
# crosses the line: a change (dx, dy) at a fixed time becomes dx − ẋ/ẏ dy, and −dy/ẏ in time. A rolling
# shutter sees it where it meets it, as in ``moving_rays``.

_ROUNDS_OF_PASSING, _STILL_PASSING = 20, 1e-12
"""Rounds at most, and the part of the camera constant by which a meeting may still move, or of the time in which the
camera scans its own camera constant, by which a crossing may: what is left of that is taken along to first order, and
the derivatives differ by less than it."""


class Passing(NamedTuple):
    """A point as it is seen from a trajectory.

    Attributes:
        turn: −θ.
        lever: D(t) (X − X0(t)).
        star: the same, with the eccentricity added.
        sight: image coordinates at this time, and derivatives.
        x, y: coordinates as they are computed: y of line scanners is that of the row of the crossing.
        across: what stands before the derivatives at a fixed time, row by row.
        by_readout: derivatives of x and y by the readout time.
    """

    turn: SmallRotation
    lever: Vector
    star: Vector
    sight: ProjectedPoint
    x: float
    y: float
    across: tuple[float, float, float, float]
    by_readout: tuple[float, float]


class Look(NamedTuple):
    """A point as it is seen at one time; (dx, dy) is its velocity in the image."""

    turn: SmallRotation
    lever: Vector
    star: Vector
    sight: ProjectedPoint
    dx: float
    dy: float


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
def look(
    values: FrameValues, f: int, base: Vector, i: FloatArray, u: float, v: float, time: float, w: FloatArray
) -> Look:
    """Return how a point at ``base`` = D_0 (X − X_0) is seen at ``time`` since knot 0, and set the weights w (4,)."""
    e, r0, model = values.eccentricity[f], values.r0[f], values.model[f]
    moved, theta, velocity, rate = between(values.paths, f, time, w)
    turn = small_turn(-theta[0], -theta[1], -theta[2])
    q = turned(turn, (base[0] - moved[0], base[1] - moved[1], base[2] - moved[2]))
    star = q[0] + e[0], q[1] + e[1], q[2] + e[2]
    seen = sight(model % MOVING, star[0], star[1], star[2], i, r0, u, v)
    if model < ALONG + MOVING:
        return Look(turn, q, star, seen, 0.0, 0.0)
    about, along = cross(q, by_psi(turn, rate)), turned(turn, velocity)
    a, b, c = about[0] - along[0], about[1] - along[1], about[2] - along[2]
    one, other = seen.by_star
    dx, dy = one[0] * a + one[1] * b + one[2] * c, other[0] * a + other[1] * b + other[2] * c
    return Look(turn, q, star, seen, dx, dy)


@compile_kernel
def passing(
    values: FrameValues, f: int, base: Vector, i: FloatArray, u: float, v: float, clock: FloatArray, w: FloatArray
) -> Passing:
    """Return how a point at ``base`` = D_0 (X − X_0) is seen, and set the weights w (4,) of the knots.

    (u, v) are the measured coordinates, v of a line scanner that of its line; ``clock`` (3,): time since knot 0, of a
    line scanner when the observed row was scanned, that row, and seconds by rows.
    """
    if values.model[f] >= CROSSING:
        return crossing(values, f, base, i, u, v, clock, w)
    if values.model[f] >= ALONG + MOVING:
        return meeting(values, f, base, i, u, v, clock[0], w)
    turn, q, star, seen, _, _ = look(values, f, base, i, u, v, clock[0], w)
    return Passing(turn, q, star, seen, seen.x, seen.y, (1.0, 0.0, 0.0, 1.0), (0.0, 0.0))


@compile_kernel
def meeting(
    values: FrameValues, f: int, base: Vector, i: FloatArray, u: float, v: float, middle: float, w: FloatArray
) -> Passing:
    """Return where a point meets a rolling shutter, looked for from (u, v); its middle row is at ``middle``."""
    T, gx, gy, g0 = values.readout[f], values.clock[f, 0], values.clock[f, 1], values.clock[f, 2]
    x, y, rounds = u, v, 0
    while True:
        phase = gx * x + gy * y + g0
        turn, q, star, seen, dx, dy = look(values, f, base, i, u, v, middle + T * phase, w)
        later = T / (1.0 - T * (gx * dx + gy * dy))
        tau = later * (gx * (seen.x - x) + gy * (seen.y - y))
        found_x, found_y = seen.x + dx * tau, seen.y + dy * tau
        rounds += 1
        if rounds > _ROUNDS_OF_PASSING or not max(abs(found_x - x), abs(found_y - y)) > _STILL_PASSING * i[0]:
            break
        x, y = found_x, found_y
    across = 1.0 + dx * gx * later, dx * gy * later, dy * gx * later, 1.0 + dy * gy * later
    by_readout = phase * (across[0] * dx + across[1] * dy), phase * (across[2] * dx + across[3] * dy)
    return Passing(turn, q, star, seen, found_x, found_y, across, by_readout)


@compile_kernel
def crossing(
    values: FrameValues, f: int, base: Vector, i: FloatArray, u: float, v: float, clock: FloatArray, w: FloatArray
) -> Passing:
    """Return where a point crosses the line y = v of a scanner, as rows; see ``passing``."""
    time, still, rounds = clock[0], _STILL_PASSING * abs(clock[2] * i[0]), 0
    while True:
        turn, q, star, seen, dx, dy = look(values, f, base, i, u, v, time, w)
        per_dy = 1.0 / dy if dy != 0.0 else nan  # a camera that stands still scans nothing
        step = (v - seen.y) * per_dy
        rounds += 1
        if rounds > _ROUNDS_OF_PASSING or not abs(step) > still:
            break
        time += step
    per_rate = 1.0 / clock[2]
    row = clock[1] + (time + step - clock[0]) * per_rate
    across = 1.0, -dx * per_dy, 0.0, -per_dy * per_rate
    return Passing(turn, q, star, seen, seen.x + dx * step, row, across, (0.0, 0.0))


# ---- Kernels that linearise image rays along trajectories, as ``mor.model.observation_types.time`` has images and
# line scanners.
#
# How a point is seen says ``passing``. A row β by the small rotation of the pose becomes
#
#     w_k β J(θ) J(θ_k)⁻¹        and        β exp(−[θ]×) − β J(θ) Σ w_k J(θ_k)⁻ᵀ
#
# by those of knot k, and of knot 0.

KNOTS = 4
"""Knots that a pose depends on, at most."""


@compile_kernel
def linearise_along(
    values: FrameValues,
    layout: Layout,
    frame: IntArray,
    pointers: IntArray,
    points: FloatArray,
    rays: RayMeasurements,
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
                a, b, c = by_object(rotation(D, f), turned_back(seen.turn, by_star))
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


@compile_kernel
def set_knots(
    row: FloatArray,
    layout: Layout,
    values: FrameValues,
    f: int,
    w: FloatArray,
    by_point: Vector,
    turn: SmallRotation,
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
    rays: RayMeasurements,
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
    rays: RayMeasurements,
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
                a, b, c = by_object(rotation(D, f), turned_back(seen.turn, by_star))
                by_point[n, m, 0], by_point[n, m, 1], by_point[n, m, 2] = a, b, c


@compile_kernel
def star_along(values: FrameValues, change: FrameChange, f: int, w: FloatArray, seen: Passing) -> Vector:
    """Return by how much the point moves in the image system at a fixed time, where the knots change."""
    paths, turn = values.paths, seen.turn
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
    back = turned(turn, rotated(rotation(values.D, f), X, Y, Z))
    e = change.eccentricity[f]
    return about[0] - back[0] + e[0], about[1] - back[1] + e[1], about[2] - back[2] + e[2]
