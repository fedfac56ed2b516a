"""Kernels that linearise image rays of rolling shutters, ray by ray what ``mor.observations.time.rolling_shutter`` has.

A point is seen where it and the shutter meet. Its image moves there by d = (∂x/∂t, ∂y/∂t); a change δ of the image
point at a fixed time moves the row in which they meet, and becomes

    M δ,        M = 1 + d gᵀ T / (1 − T g·d)

with the slope g of the phase in the image. So M stands before all derivatives.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.rays.compiled.sights.cameras import ALONG, MOVING, Sight, fill_by_interior, sight
from mor.adjustment.rays.compiled.sights.image_rays import (
    FrameChange,
    FrameValues,
    Layout,
    Measured,
    clear_row,
    set_row,
)
from mor.adjustment.rays.compiled.sights.small_turns import (
    Turn,
    Vector,
    cross,
    polynomial,
    small_turn,
    turned,
    turned_back,
)
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_inline, compile_kernel

_ROUNDS, _STILL = 20, 1e-12
"""Rounds at most, and the part of the camera constant by which the row may still move.

What is left of that is taken along to first order; the derivatives are those at the row before, and differ by less than
it, for the point moves in the image by a small part of its height while it is read out."""


class Meeting(NamedTuple):
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
    turn: Turn
    shifted: Vector
    star: Vector
    sight: Sight
    x: float
    y: float
    across: tuple[float, float, float, float]
    drift: tuple[float, float]


@compile_kernel
def meet(values: FrameValues, f: int, lever: Vector, i: FloatArray, u: float, v: float) -> Meeting:
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
    return Meeting(phase, t, turn, shifted, star, seen, found_x, found_y, across, drift)


@compile_kernel
def linearise_moving(
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
    """Set residuals and Jacobians of the rays of rolling shutters, as ``linearise`` does those of frames."""
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
            one, other = met.sight.by_star
            a, b, c = lever
            for m in range(2):
                w = weight[n, m]
                if w == 0.0:
                    residual[n, m] = 0.0
                    clear_row(by_point, by_others, n, m)
                    continue
                residual[n, m] = ((met.x if m == 0 else met.y) - observed[n, m]) * w
                g, h = w * met.across[2 * m], w * met.across[2 * m + 1]
                by_star = g * one[0] + h * other[0], g * one[1] + h * other[1], g * one[2] + h * other[2]
                s, t, d = turned_back(met.turn, by_star)
                for k in range(layout.of_motion):
                    by_others[n, m, k] = 0.0
                set_row(by_point, by_others, n, m, layout, D, values.tangent, f, a, b, c, s, t, d)
                set_motion(by_others[n, m], layout, met, (s, t, d), by_star, w * met.drift[m] * met.phase)
                for k in range(layout.components.size):
                    j = layout.components[k]
                    by_others[n, m, layout.interior + k] = g * by_interior[0, j] + h * by_interior[1, j]
                for k in range(layout.interior + layout.components.size, by_others.shape[2]):
                    by_others[n, m, k] = 0.0


@compile_inline
def lever_of(values: FrameValues, f: int, points: FloatArray, p: int) -> Vector:
    """Return D (X − X0)."""
    X = points[p, 0] - values.centre[f, 0]
    Y = points[p, 1] - values.centre[f, 1]
    Z = points[p, 2] - values.centre[f, 2]
    D = values.D[f]
    return (
        D[0] * X + D[1] * Y + D[2] * Z,
        D[3] * X + D[4] * Y + D[5] * Z,
        D[6] * X + D[7] * Y + D[8] * Z,
    )


@compile_kernel
def set_motion(
    row: FloatArray, layout: Layout, met: Meeting, by_shifted: Vector, by_star: Vector, by_readout: float
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
    rays: Measured,
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
    rays: Measured,
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
                s, t, d = turned_back(met.turn, by_star)
                for k in range(3):
                    by_point[n, m, k] = s * D[f, k] + t * D[f, 3 + k] + d * D[f, 6 + k]


@compile_kernel
def star_change(values: FrameValues, change: FrameChange, f: int, lever: Vector, met: Meeting) -> Vector:
    """Return by how much the point moves in the image system at a fixed time, where its frame changes."""
    D, time, turn = values.D[f], met.time, met.turn
    X, Y, Z = change.centre[f, 0], change.centre[f, 1], change.centre[f, 2]
    velocity, rate = change.velocity[f], change.rate[f]
    about = cross(lever, (change.turn[f, 0], change.turn[f, 1], change.turn[f, 2]))
    spin = rate[0], rate[1], rate[2]
    once = cross(turn.psi, spin)
    spin = polynomial(spin, once, -turn.cosine, turn.third, cross(turn.psi, once))
    faster = cross(met.shifted, spin)
    a, b, c = turned(
        turn,
        (
            about[0] - D[0] * X - D[1] * Y - D[2] * Z + time * (faster[0] - velocity[0]),
            about[1] - D[3] * X - D[4] * Y - D[5] * Z + time * (faster[1] - velocity[1]),
            about[2] - D[6] * X - D[7] * Y - D[8] * Z + time * (faster[2] - velocity[2]),
        ),
    )
    return a + change.eccentricity[f, 0], b + change.eccentricity[f, 1], c + change.eccentricity[f, 2]
