"""How points are seen from trajectories, one at a time: at once, where they meet a shutter, where they cross a line.

In the axes of knot 0 a point is at D_0 (X − X_0) − Σ w_k p_k with p_k = D_0 (X_k − X_0), the sum over the other knots;
exp(−[θ]×) with θ = Σ w_k θ_k turns it into those of time t. A line scanner sees it when it crosses the line: a change
(dx, dy) at a fixed time becomes dx − ẋ/ẏ dy, and −dy/ẏ in time. A rolling shutter sees it where it meets it, as in
``moving_rays``.
"""

from __future__ import annotations

from math import nan
from typing import NamedTuple

from mor.adjustment.rays.compiled.sights.cameras import ALONG, CROSSING, MOVING, Sight, sight
from mor.adjustment.rays.compiled.sights.image_rays import FrameValues, Paths
from mor.adjustment.rays.compiled.sights.small_turns import Turn, Vector, by_psi, cross, small_turn, turned
from mor.arrays import FloatArray
from mor.compilation import compile_kernel

_ROUNDS, _STILL = 20, 1e-12
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

    turn: Turn
    lever: Vector
    star: Vector
    sight: Sight
    x: float
    y: float
    across: tuple[float, float, float, float]
    by_readout: tuple[float, float]


class Look(NamedTuple):
    """A point as it is seen at one time; (dx, dy) is its velocity in the image."""

    turn: Turn
    lever: Vector
    star: Vector
    sight: Sight
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
    values: FrameValues,
    f: int,
    base: Vector,
    i: FloatArray,
    u: float,
    v: float,
    time: float,
    w: FloatArray,
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
    if values.model[f] >= CROSSING:
        return crossing(values, f, base, i, u, v, clock, w)
    if values.model[f] >= ALONG + MOVING:
        return meeting(values, f, base, i, u, v, clock[0], w)
    turn, q, star, seen, _, _ = look(values, f, base, i, u, v, clock[0], w)
    return Passing(turn, q, star, seen, seen.x, seen.y, (1.0, 0.0, 0.0, 1.0), (0.0, 0.0))


@compile_kernel
def meeting(
    values: FrameValues,
    f: int,
    base: Vector,
    i: FloatArray,
    u: float,
    v: float,
    middle: float,
    w: FloatArray,
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
        if rounds > _ROUNDS or not max(abs(found_x - x), abs(found_y - y)) > _STILL * i[0]:
            break
        x, y = found_x, found_y
    across = 1.0 + dx * gx * later, dx * gy * later, dy * gx * later, 1.0 + dy * gy * later
    by_readout = phase * (across[0] * dx + across[1] * dy), phase * (across[2] * dx + across[3] * dy)
    return Passing(turn, q, star, seen, found_x, found_y, across, by_readout)


@compile_kernel
def crossing(
    values: FrameValues,
    f: int,
    base: Vector,
    i: FloatArray,
    u: float,
    v: float,
    clock: FloatArray,
    w: FloatArray,
) -> Passing:
    """Return where a point crosses the line y = v of a scanner, as rows; see ``passing``."""
    time, still, rounds = clock[0], _STILL * abs(clock[2] * i[0]), 0
    while True:
        turn, q, star, seen, dx, dy = look(values, f, base, i, u, v, time, w)
        per_dy = 1.0 / dy if dy != 0.0 else nan  # a camera that stands still scans nothing
        step = (v - seen.y) * per_dy
        rounds += 1
        if rounds > _ROUNDS or not abs(step) > still:
            break
        time += step
    per_rate = 1.0 / clock[2]
    row = clock[1] + (time + step - clock[0]) * per_rate
    across = 1.0, -dx * per_dy, 0.0, -per_dy * per_rate
    return Passing(turn, q, star, seen, seen.x + dx * step, row, across, (0.0, 0.0))
