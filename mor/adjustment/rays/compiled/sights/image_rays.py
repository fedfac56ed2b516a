"""Kernels that linearise image rays: frame kernel, camera and whitening in one go, into the arrays of a chunk."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.rays.compiled.sights.cameras import MOVING, image_point, project
from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_inline, compile_kernel


class Paths(NamedTuple):
    """What the poses of f frames depend on whatever their time; none (0, …) where no pose is one between knots.

    Attributes:
        knots: (f,) knots k of a pose, 0 for frames that have a pose of their own. That of a frame is its knot 0.
        weights: (f, 4, 4) coefficients of the weights of the knots as polynomials of the time since knot 0.
        reach: (f, 3, 3) D_0 (X_k − X_0) of the other knots.
        turns: (f, 3, 3) θ_k.
        inverse: (f, 3, 3, 3) inverses of the right Jacobians of these.
        tangent: (f, 3, 3, 3) what turns their small rotations into their columns, or none (0, …).
    """

    knots: IntArray
    weights: FloatArray
    reach: FloatArray
    turns: FloatArray
    inverse: FloatArray
    tangent: FloatArray


class FrameValues(NamedTuple):
    """Values of the f frames of a chunk.

    Attributes:
        model: (f,) number of the camera model, −1 where it has no compiled form: such rays are passed over. Those of
            rolling shutters, from ``MOVING`` on, and along trajectories, from ``ALONG`` on, have kernels of their own
            (``moving_rays``, ``path_rays``).
        D: (f, 9) rotation, row by row.
        centre: (f, 3) rotation centre.
        eccentricity: (f, 3).
        interior: (f, k) interior orientation, filled up with zeros.
        r0: (f,) second zero crossing of the radial distortion.
        tangent: (f, 3, 3) what turns small rotations into their columns, or none (0, 3, 3).
        velocity, rate: (f, 3) motion while a frame is read out, in its own axes.
        readout: (f,) time from the first row to the last.
        clock: (f, 3) part of the readout that has passed at x, y: by x, by y, and at 0.
        paths: see there.
    """

    model: IntArray
    D: FloatArray
    centre: FloatArray
    eccentricity: FloatArray
    interior: FloatArray
    r0: FloatArray
    tangent: FloatArray
    velocity: FloatArray
    rate: FloatArray
    readout: FloatArray
    clock: FloatArray
    paths: Paths


class FrameChange(NamedTuple):
    """Changes of the blocks of f frames; all arrays are zero where nothing changes.

    Attributes:
        centre: (f, 3) of the rotation centre.
        turn: (f, 3) small rotation.
        eccentricity: (f, 3).
        interior: (f, k).
        velocity, rate: (f, 3).
        readout: (f,).
        knots: (f, 3, 2, 3) positions and small rotations of the further knots of a trajectory, or none (0, …).
    """

    centre: FloatArray
    turn: FloatArray
    eccentricity: FloatArray
    interior: FloatArray
    velocity: FloatArray
    rate: FloatArray
    readout: FloatArray
    knots: FloatArray


class Layout(NamedTuple):
    """First column of the derivatives by each block of a frame, −1 where they are not wanted.

    ``components`` are the components of the interior orientation whose derivatives are wanted; ``knots`` (3, 2) are
    the first columns by rotation and position of the further knots of trajectories, or none (0, 2). The first
    ``of_motion`` columns are those by readout time, further knots, velocity and rate.
    """

    of_motion: int
    readout: int
    velocity: int
    rate: int
    rotation: int
    position: int
    height: int
    eccentricity: int
    interior: int
    components: IntArray
    knots: IntArray


class Measured(NamedTuple):
    """Measurements of n rays, (n, 2) each: weights are 1/σ, 0 where nothing was observed.

    ``clock`` (n, 3) is when rays along trajectories are: time since knot 0, row, and seconds by rows; none (0, 3) where
    there are no such rays.
    """

    observed: FloatArray
    weight: FloatArray
    measured: FloatArray
    clock: FloatArray


@compile_kernel
def linearise(
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
    """Set residuals (n, 2) and Jacobians (n, 2, 3), (n, 2, K) of rays, divided by σ; ``points`` (p, 3)."""
    model, D, centre, e, interiors, r0, tangent = values[:7]
    observed, weight, measured = rays[:3]
    interior, i = np.zeros((2, interiors.shape[1])), np.empty(interiors.shape[1])
    star = np.empty((2, 3))
    for p in range(pointers.size - 1):
        for n in range(pointers[p], pointers[p + 1]):
            f = frame[n]
            if model[f] < 0 or model[f] >= MOVING:
                continue
            for k in range(i.size):
                i[k] = interiors[f, k]
            X, Y, Z = points[p, 0] - centre[f, 0], points[p, 1] - centre[f, 1], points[p, 2] - centre[f, 2]
            a = D[f, 0] * X + D[f, 1] * Y + D[f, 2] * Z
            b = D[f, 3] * X + D[f, 4] * Y + D[f, 5] * Z
            c = D[f, 6] * X + D[f, 7] * Y + D[f, 8] * Z
            u, v = measured[n, 0], measured[n, 1]
            x, y = project(model[f], a + e[f, 0], b + e[f, 1], c + e[f, 2], i, r0[f], u, v, star, interior)
            for m in range(2):
                w = weight[n, m]
                found = x if m == 0 else y
                if w == 0.0:
                    residual[n, m] = 0.0
                    clear_row(by_point, by_others, n, m)
                    continue
                residual[n, m] = (found - observed[n, m]) * w
                s, t, d = w * star[m, 0], w * star[m, 1], w * star[m, 2]
                set_row(by_point, by_others, n, m, layout, D, tangent, f, a, b, c, s, t, d)
                for k in range(layout.of_motion):
                    by_others[n, m, k] = 0.0
                for k in range(layout.components.size):
                    by_others[n, m, layout.interior + k] = w * interior[m, layout.components[k]]
                for k in range(layout.interior + layout.components.size, by_others.shape[2]):
                    by_others[n, m, k] = 0.0


@compile_inline
def set_row(
    by_point: FloatArray,
    by_others: FloatArray,
    n: int,
    m: int,
    layout: Layout,
    D: FloatArray,
    tangent: FloatArray,
    f: int,
    a: float,
    b: float,
    c: float,
    s: float,
    t: float,
    d: float,
) -> None:
    """Set the Jacobian of one component by point and pose, from D (X − X0) = (a, b, c) and its own by X* (s, t, d)."""
    g, h, o = (
        s * D[f, 0] + t * D[f, 3] + d * D[f, 6],
        s * D[f, 1] + t * D[f, 4] + d * D[f, 7],
        s * D[f, 2] + t * D[f, 5] + d * D[f, 8],
    )
    by_point[n, m, 0], by_point[n, m, 1], by_point[n, m, 2] = g, h, o
    if layout.position >= 0:
        by_others[n, m, layout.position] = -g
        by_others[n, m, layout.position + 1] = -h
        by_others[n, m, layout.position + 2] = -o
    if layout.rotation >= 0:
        g, h, q = t * c - d * b, d * a - s * c, s * b - t * a
        if tangent.shape[0] > 0:
            T = tangent[f]
            g, h, q = (
                g * T[0, 0] + h * T[1, 0] + q * T[2, 0],
                g * T[0, 1] + h * T[1, 1] + q * T[2, 1],
                g * T[0, 2] + h * T[1, 2] + q * T[2, 2],
            )
        by_others[n, m, layout.rotation] = g
        by_others[n, m, layout.rotation + 1] = h
        by_others[n, m, layout.rotation + 2] = q
    if layout.height >= 0:
        by_others[n, m, layout.height] = -o
    if layout.eccentricity >= 0:
        by_others[n, m, layout.eccentricity] = s
        by_others[n, m, layout.eccentricity + 1] = t
        by_others[n, m, layout.eccentricity + 2] = d


@compile_kernel
def clear_row(by_point: FloatArray, by_others: FloatArray, n: int, m: int) -> None:
    """Set the Jacobian of a component that was not observed to zero."""
    for k in range(3):
        by_point[n, m, k] = 0.0
    for k in range(by_others.shape[2]):
        by_others[n, m, k] = 0.0


@compile_kernel
def residuals(
    values: FrameValues,
    frame: IntArray,
    pointers: IntArray,
    points: FloatArray,
    rays: Measured,
    residual: FloatArray,
) -> None:
    """Set residuals (n, 2) divided by σ, and nothing else."""
    model, D, centre, e, interiors, r0 = values[:6]
    observed, weight, measured = rays[:3]
    interior = np.empty(interiors.shape[1])
    for p in range(pointers.size - 1):
        for n in range(pointers[p], pointers[p + 1]):
            f = frame[n]
            if model[f] < 0 or model[f] >= MOVING:
                continue
            for k in range(interior.size):
                interior[k] = interiors[f, k]
            X, Y, Z = points[p, 0] - centre[f, 0], points[p, 1] - centre[f, 1], points[p, 2] - centre[f, 2]
            x, y = image_point(
                model[f],
                D[f, 0] * X + D[f, 1] * Y + D[f, 2] * Z + e[f, 0],
                D[f, 3] * X + D[f, 4] * Y + D[f, 5] * Z + e[f, 1],
                D[f, 6] * X + D[f, 7] * Y + D[f, 8] * Z + e[f, 2],
                interior,
                r0[f],
                measured[n, 0],
                measured[n, 1],
            )
            w, z = weight[n, 0], weight[n, 1]
            residual[n, 0] = (x - observed[n, 0]) * w if w != 0.0 else 0.0
            residual[n, 1] = (y - observed[n, 1]) * z if z != 0.0 else 0.0


@compile_kernel
def follow(
    values: FrameValues,
    change: FrameChange,
    frame: IntArray,
    pointers: IntArray,
    points: FloatArray,
    rays: Measured,
    residual: FloatArray,
    by_point: FloatArray,
) -> None:
    """Set residuals (n, 2) after a small change of the frames, to first order, and the Jacobian by the point.

    With q = D (X − X0) the point moves in the image system by q × δ − D ΔX0 + Δr0*.
    """
    model, D, centre, e, interiors, r0 = values[:6]
    moved, turn, shift, altered = change[:4]
    observed, weight, measured = rays[:3]
    interior, by_interior = np.empty(interiors.shape[1]), np.zeros((2, interiors.shape[1]))
    star = np.empty((2, 3))
    for p in range(pointers.size - 1):
        for n in range(pointers[p], pointers[p + 1]):
            f = frame[n]
            if model[f] < 0 or model[f] >= MOVING:
                continue
            for k in range(interior.size):
                interior[k] = interiors[f, k]
            X, Y, Z = points[p, 0] - centre[f, 0], points[p, 1] - centre[f, 1], points[p, 2] - centre[f, 2]
            a = D[f, 0] * X + D[f, 1] * Y + D[f, 2] * Z
            b = D[f, 3] * X + D[f, 4] * Y + D[f, 5] * Z
            c = D[f, 6] * X + D[f, 7] * Y + D[f, 8] * Z
            u, v = measured[n, 0], measured[n, 1]
            x, y = project(
                model[f], a + e[f, 0], b + e[f, 1], c + e[f, 2], interior, r0[f], u, v, star, by_interior
            )
            s, t, o = moved[f, 0], moved[f, 1], moved[f, 2]
            g, h, q = turn[f, 0], turn[f, 1], turn[f, 2]
            da = b * q - c * h - D[f, 0] * s - D[f, 1] * t - D[f, 2] * o + shift[f, 0]
            db = c * g - a * q - D[f, 3] * s - D[f, 4] * t - D[f, 5] * o + shift[f, 1]
            dc = a * h - b * g - D[f, 6] * s - D[f, 7] * t - D[f, 8] * o + shift[f, 2]
            x += star[0, 0] * da + star[0, 1] * db + star[0, 2] * dc
            y += star[1, 0] * da + star[1, 1] * db + star[1, 2] * dc
            for k in range(interior.size):
                x += by_interior[0, k] * altered[f, k]
                y += by_interior[1, k] * altered[f, k]
            for m in range(2):
                w = weight[n, m]
                found = x if m == 0 else y
                residual[n, m] = (found - observed[n, m]) * w if w != 0.0 else 0.0
                s, t, o = w * star[m, 0], w * star[m, 1], w * star[m, 2]
                for k in range(3):
                    by_point[n, m, k] = s * D[f, k] + t * D[f, 3 + k] + o * D[f, 6 + k] if w != 0.0 else 0.0
