"""Metashape's frame camera, in this program's image axes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras._contract import CameraModel, Projection
from mor.units import IMAGE, NUMBER, Component


class _Distorted(NamedTuple):
    """a', b' and their derivatives; every field is (n,)."""

    a: FloatArray
    b: FloatArray
    a_by_a: FloatArray
    a_by_b: FloatArray
    b_by_a: FloatArray
    b_by_b: FloatArray


def project(
    star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray
) -> Projection:
    """Image coordinates x = u − w/2, y = −(v − h/2), with (u, v) Metashape's, u right and v down from the corner.

    Metashape's camera axes (right, down, forward) are (X*, −Y*, −Z*). With a = −X*/Z*, b = Y*/Z*, r² = a² + b²,
    T = 1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸ and M = 1 + p3 r² + p4 r⁴,

        a' = a T + (p1 (r² + 2 a²) + 2 p2 a b) M,     x =  (cx + a' f + a' b1 + b' b2)
        b' = b T + (p2 (r² + 2 b²) + 2 p1 a b) M,     y = −(cy + b' f)

    All thirteen numbers are Metashape's own; its p1 and p2 are OpenCV's p2 and p1. cx, cy count from the image centre,
    right and down. ``star`` (n, 3); ``interior`` (n, 13) = f, cx, cy, b1, b2, k1, k2, k3, k4, p1, p2, p3, p4;
    ``constants`` (n, 0); ``measured`` (n, 2) is not looked at.

    Source: Agisoft Metashape User Manual, appendix "Camera models", frame cameras.
    """
    f, cx, cy, b1, b2 = interior[:, :5].T
    per_depth = -1.0 / star[:, 2]
    a, b = star[:, 0] * per_depth, -star[:, 1] * per_depth
    found = _distorted(a, b, interior)
    wide = f + b1
    xy = np.empty((len(star), 2))
    xy[:, 0] = cx + wide * found.a + b2 * found.b
    xy[:, 1] = -cy - f * found.b

    by_star = np.empty((len(star), 2, 3))
    x_by_a, x_by_b = wide * found.a_by_a + b2 * found.b_by_a, wide * found.a_by_b + b2 * found.b_by_b
    for row, (by_a, by_b) in enumerate(((x_by_a, x_by_b), (-f * found.b_by_a, -f * found.b_by_b))):
        by_star[:, row, 0] = by_a * per_depth
        by_star[:, row, 1] = -by_b * per_depth
        by_star[:, row, 2] = (by_a * a + by_b * b) * per_depth
    return Projection(xy, by_star, _by_interior(a, b, found, interior))


def _distorted(a: FloatArray, b: FloatArray, interior: FloatArray) -> _Distorted:
    k1, k2, k3, k4, p1, p2, p3, p4 = interior[:, 5:].T
    r2 = a * a + b * b
    T = 1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    T_slope = k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3 + r2 * 4.0 * k4))
    M, M_slope = 1.0 + r2 * (p3 + r2 * p4), p3 + 2.0 * p4 * r2
    side_a = p1 * (r2 + 2.0 * a * a) + 2.0 * p2 * a * b
    side_b = p2 * (r2 + 2.0 * b * b) + 2.0 * p1 * a * b
    cross = 2.0 * a * b * T_slope + 2.0 * (p1 * b + p2 * a) * M
    return _Distorted(
        a=a * T + side_a * M,
        b=b * T + side_b * M,
        a_by_a=T + 2.0 * a * a * T_slope + (6.0 * p1 * a + 2.0 * p2 * b) * M + 2.0 * a * side_a * M_slope,
        a_by_b=cross + 2.0 * b * side_a * M_slope,
        b_by_a=cross + 2.0 * a * side_b * M_slope,
        b_by_b=T + 2.0 * b * b * T_slope + (6.0 * p2 * b + 2.0 * p1 * a) * M + 2.0 * b * side_b * M_slope,
    )


def _by_interior(a: FloatArray, b: FloatArray, found: _Distorted, interior: FloatArray) -> FloatArray:
    """Derivatives (n, 2, 13) by the interior components."""
    f, b1, b2 = interior[:, 0], interior[:, 3], interior[:, 4]
    p1, p2, p3, p4 = interior[:, 9:].T
    r2 = a * a + b * b
    M = 1.0 + r2 * (p3 + r2 * p4)
    side_a = p1 * (r2 + 2.0 * a * a) + 2.0 * p2 * a * b
    side_b = p2 * (r2 + 2.0 * b * b) + 2.0 * p1 * a * b
    result = np.zeros((len(a), 2, 13))
    result[:, 0, 0], result[:, 1, 0] = found.a, -found.b
    result[:, 0, 1], result[:, 1, 2] = 1.0, -1.0
    result[:, 0, 3], result[:, 0, 4] = found.a, found.b
    moves = [(a * r2**k, b * r2**k) for k in (1, 2, 3, 4)]
    moves += [((r2 + 2.0 * a * a) * M, 2.0 * a * b * M), (2.0 * a * b * M, (r2 + 2.0 * b * b) * M)]
    moves += [(side_a * r2, side_b * r2), (side_a * r2 * r2, side_b * r2 * r2)]
    for column, (da, db) in enumerate(moves, start=5):
        result[:, 0, column] = (f + b1) * da + b2 * db
        result[:, 1, column] = -f * db
    return result


METASHAPE = CameraModel(
    key="metashape",
    components=(
        *(Component(name, IMAGE) for name in ("f", "cx", "cy", "b1", "b2")),
        *(Component(name, NUMBER) for name in ("k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4")),
    ),
    constants=(),
    project=project,
)
"""Camera model ``metashape``."""
