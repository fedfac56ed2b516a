"""OpenCV's radial-tangential model with its rational extension, in this program's image axes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras._contract import CameraModel, Projection
from mor.units import IMAGE, NUMBER, Component


class _Radial(NamedTuple):
    """The radial factor T = N/M and what its derivatives need; every field is (n,)."""

    factor: FloatArray
    slope: FloatArray
    """dT/d(r²)."""
    denominator: FloatArray
    """M."""
    powers: tuple[FloatArray, FloatArray, FloatArray]
    """r², r⁴, r⁶."""


def _radial(r2: FloatArray, numerator: FloatArray, denominator: FloatArray) -> _Radial:
    """T(r²) = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶); coefficients are (3, n)."""
    r4 = r2 * r2
    r6 = r4 * r2
    above = 1.0 + numerator[0] * r2 + numerator[1] * r4 + numerator[2] * r6
    below = 1.0 + denominator[0] * r2 + denominator[1] * r4 + denominator[2] * r6
    above_slope = numerator[0] + 2.0 * numerator[1] * r2 + 3.0 * numerator[2] * r4
    below_slope = denominator[0] + 2.0 * denominator[1] * r2 + 3.0 * denominator[2] * r4
    factor = above / below
    return _Radial(factor, (above_slope - factor * below_slope) / below, below, (r2, r4, r6))


def project(
    star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray
) -> Projection:
    """Image coordinates x = u, y = −v, with (u, v) OpenCV's image coordinates, u right and v down.

    OpenCV's camera axes (right, down, forward) are (X*, −Y*, −Z*). With a = −X*/Z*, b = Y*/Z*, r² = a² + b²
    and T = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶),

        a' = a T + 2 p1 a b + p2 (r² + 2 a²),     x =  (fx a' + cx)
        b' = b T + p1 (r² + 2 b²) + 2 p2 a b,     y = −(fy b' + cy)

    All twelve numbers are OpenCV's own, signs included. fx takes the place of the camera constant c.
    (cx, cy) is the principal point seen from the origin of the image coordinates, cx to the right and cy
    *down*: OpenCV's numbers unchanged where that origin is OpenCV's (the centre of the upper left pixel);
    where the origin was moved to (u0, v0), cx − u0 and cy − v0. fx, fy, cx, cy are in image units, the
    distortion coefficients are numbers.

    ``star`` (n, 3); ``interior`` (n, 12) = fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6 (OpenCV's order);
    ``constants`` (n, 0); ``measured`` (n, 2) is not looked at.

    Source: OpenCV documentation, "Camera Calibration and 3D Reconstruction", function projectPoints.
    """
    fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6 = interior.T
    per_depth = -1.0 / star[:, 2]
    a, b = star[:, 0] * per_depth, -star[:, 1] * per_depth
    aa, bb, twice_ab = a * a, b * b, 2.0 * a * b
    r2 = aa + bb
    radial = _radial(r2, np.stack((k1, k2, k3)), np.stack((k4, k5, k6)))
    tangential_a, tangential_b = r2 + 2.0 * aa, r2 + 2.0 * bb
    a_distorted = a * radial.factor + p1 * twice_ab + p2 * tangential_a
    b_distorted = b * radial.factor + p1 * tangential_b + p2 * twice_ab

    xy = np.empty((len(star), 2))
    xy[:, 0] = fx * a_distorted + cx
    xy[:, 1] = -fy * b_distorted - cy

    by_interior = np.zeros((len(star), 2, 12))
    by_interior[:, 0, 0] = a_distorted
    by_interior[:, 1, 1] = -b_distorted
    by_interior[:, 0, 2] = 1.0
    by_interior[:, 1, 3] = -1.0
    by_interior[:, 0, 6], by_interior[:, 1, 6] = fx * twice_ab, -fy * tangential_b
    by_interior[:, 0, 7], by_interior[:, 1, 7] = fx * tangential_a, -fy * twice_ab
    _fill_by_radial(radial, fx * a, -fy * b, by_interior)
    return Projection(xy, _by_star(a, b, per_depth, radial, interior), by_interior)


def _by_star(
    a: FloatArray, b: FloatArray, per_depth: FloatArray, radial: _Radial, interior: FloatArray
) -> FloatArray:
    """Derivatives (n, 2, 3) of (x, y) by the image system's coordinates, through (a, b)."""
    fx, fy, p1, p2 = interior[:, 0], interior[:, 1], interior[:, 6], interior[:, 7]
    by_a = radial.factor + 2.0 * (a * a * radial.slope + p1 * b + 3.0 * p2 * a)
    by_b = radial.factor + 2.0 * (b * b * radial.slope + 3.0 * p1 * b + p2 * a)
    mixed = 2.0 * (a * b * radial.slope + p1 * a + p2 * b)  # ∂a'/∂b = ∂b'/∂a
    by_star = np.empty((len(a), 2, 3))
    by_star[:, 0, 0] = fx * by_a * per_depth
    by_star[:, 0, 1] = -fx * mixed * per_depth
    by_star[:, 0, 2] = fx * (by_a * a + mixed * b) * per_depth
    by_star[:, 1, 0] = -fy * mixed * per_depth
    by_star[:, 1, 1] = fy * by_b * per_depth
    by_star[:, 1, 2] = -fy * (mixed * a + by_b * b) * per_depth
    return by_star


def _fill_by_radial(radial: _Radial, x: FloatArray, y: FloatArray, by_interior: FloatArray) -> None:
    """Derivatives by k1, k2, k3 and k4, k5, k6; (x, y) is the image point without distortion, reduced."""
    for power, above, below in zip(radial.powers, (4, 5, 8), (9, 10, 11), strict=True):
        share = power / radial.denominator
        by_interior[:, 0, above], by_interior[:, 1, above] = x * share, y * share
        share = -radial.factor * share
        by_interior[:, 0, below], by_interior[:, 1, below] = x * share, y * share


OPENCV = CameraModel(
    key="opencv",
    components=(
        *(Component(name, IMAGE) for name in ("fx", "fy", "cx", "cy")),
        *(Component(name, NUMBER) for name in ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    ),
    constants=(),
    project=project,
)
"""Camera model ``opencv``."""
