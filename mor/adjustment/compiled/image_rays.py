"""Kernels that linearise image rays: frame kernel, camera and whitening in one go, into the arrays of a chunk."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.compiled import compile_kernel
from mor.adjustment.compiled.cameras import image_point, project
from mor.geometry.arrays import FloatArray, IntArray


class FrameValues(NamedTuple):
    """Values of the f frames of a chunk.

    Attributes:
        model: (f,) number of the camera model, −1 where it has no compiled form: such rays are passed over.
        centre: (f, 3) rotation centre.
        D: (f, 3, 3) rotation.
        eccentricity: (f, 3).
        interior: (f, k) interior orientation, filled up with zeros.
        r0: (f,) second zero crossing of the radial distortion.
        tangent: (f, 3, 3) what turns small rotations into their columns, or none (0, 3, 3).
    """

    model: IntArray
    centre: FloatArray
    D: FloatArray
    eccentricity: FloatArray
    interior: FloatArray
    r0: FloatArray
    tangent: FloatArray


class Layout(NamedTuple):
    """First column of the derivatives by each block of a frame, −1 where they are not wanted.

    ``components`` are the components of the interior orientation whose derivatives are wanted.
    """

    position: int
    rotation: int
    height: int
    eccentricity: int
    interior: int
    components: IntArray


class Measured(NamedTuple):
    """Measurements of n rays, (n, 2) each: weights are 1/σ, 0 where nothing was observed."""

    observed: FloatArray
    weight: FloatArray
    measured: FloatArray


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
    interior = np.empty((2, values.interior.shape[1]))
    star, turn = np.empty((2, 3)), np.empty((2, 3))
    position, rotation, height = layout.position, layout.rotation, layout.height
    eccentricity, components = layout.eccentricity, layout.components
    for p in range(pointers.size - 1):
        for i in range(pointers[p], pointers[p + 1]):
            f = frame[i]
            if values.model[f] < 0:
                continue
            D, centre, e = values.D[f], values.centre[f], values.eccentricity[f]
            X, Y, Z = points[p, 0] - centre[0], points[p, 1] - centre[1], points[p, 2] - centre[2]
            a = D[0, 0] * X + D[0, 1] * Y + D[0, 2] * Z
            b = D[1, 0] * X + D[1, 1] * Y + D[1, 2] * Z
            c = D[2, 0] * X + D[2, 1] * Y + D[2, 2] * Z
            u, v = rays.measured[i, 0], rays.measured[i, 1]
            x, y = project(
                values.model[f],
                a + e[0],
                b + e[1],
                c + e[2],
                values.interior[f],
                values.r0[f],
                u,
                v,
                star,
                interior,
            )
            for m in range(2):
                w = rays.weight[i, m]
                out, own = by_others[i, m], by_point[i, m]
                if w == 0.0:
                    residual[i, m] = 0.0
                    for k in range(3):
                        own[k] = 0.0
                    for k in range(out.size):
                        out[k] = 0.0
                    continue
                residual[i, m] = ((x if m == 0 else y) - rays.observed[i, m]) * w
                s, t, d = w * star[m, 0], w * star[m, 1], w * star[m, 2]
                for k in range(3):
                    own[k] = s * D[0, k] + t * D[1, k] + d * D[2, k]
                if position >= 0:
                    for k in range(3):
                        out[position + k] = -own[k]
                if rotation >= 0:
                    turn[m, 0], turn[m, 1], turn[m, 2] = t * c - d * b, d * a - s * c, s * b - t * a
                    if values.tangent.shape[0] == 0:
                        for k in range(3):
                            out[rotation + k] = turn[m, k]
                    else:
                        T = values.tangent[f]
                        for k in range(3):
                            out[rotation + k] = (
                                turn[m, 0] * T[0, k] + turn[m, 1] * T[1, k] + turn[m, 2] * T[2, k]
                            )
                if height >= 0:
                    out[height] = -own[2]
                if eccentricity >= 0:
                    out[eccentricity], out[eccentricity + 1], out[eccentricity + 2] = s, t, d
                for k in range(components.size):
                    out[layout.interior + k] = w * interior[m, components[k]]


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
    for p in range(pointers.size - 1):
        for i in range(pointers[p], pointers[p + 1]):
            f = frame[i]
            if values.model[f] < 0:
                continue
            D, centre, e = values.D[f], values.centre[f], values.eccentricity[f]
            X, Y, Z = points[p, 0] - centre[0], points[p, 1] - centre[1], points[p, 2] - centre[2]
            x, y = image_point(
                values.model[f],
                D[0, 0] * X + D[0, 1] * Y + D[0, 2] * Z + e[0],
                D[1, 0] * X + D[1, 1] * Y + D[1, 2] * Z + e[1],
                D[2, 0] * X + D[2, 1] * Y + D[2, 2] * Z + e[2],
                values.interior[f],
                values.r0[f],
                rays.measured[i, 0],
                rays.measured[i, 1],
            )
            w = rays.weight[i]
            residual[i, 0] = (x - rays.observed[i, 0]) * w[0] if w[0] != 0.0 else 0.0
            residual[i, 1] = (y - rays.observed[i, 1]) * w[1] if w[1] != 0.0 else 0.0
