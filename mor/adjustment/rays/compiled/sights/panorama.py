"""The panorama for compiled linearisation: a point at a time, as ``mor.geometry.cameras.panorama`` has it for many."""

from __future__ import annotations

from math import asin, atan2, cos, nan, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.compilation import compile_kernel


class Swing(NamedTuple):
    """The line camera, turned until a point is in its line.

    Attributes:
        angle: α, within half a turn.
        waves: a1 sin α + b1 cos α + a2 sin 2α + b2 cos 2α, and its derivative by α.
        aside: how far to the right of the axis the sight passes.
        square, distance: X*² + Z*², and its root ρ.
        reach: √(ρ² − s²).
        depth: the same from the projection centre; nan where it is not ahead of it.
        slope: t = Y*/depth.
        u: tan(atan t − pitch).
    """

    angle: float
    waves: tuple[float, float]
    aside: float
    square: float
    distance: float
    reach: float
    depth: float
    slope: float
    u: float


@compile_kernel
def swung(X: float, Y: float, Z: float, i: FloatArray) -> Swing:
    """Return the line camera of interior orientation ``i`` (14,) turned to a point X, Y, Z in the image system."""
    square, s = X * X + Z * Z, i[5] + i[6] * Y
    distance, rest = sqrt(square), square - s * s
    reach = sqrt(rest) if rest > 0.0 else nan
    angle = atan2(X, -Z) - (asin(s / distance) if rest > 0.0 else nan)
    angle -= 2.0 * pi * np.floor(angle / (2.0 * pi) + 0.5)
    depth = reach - i[4] if reach > i[4] else nan
    slope = Y / depth
    one, other = (sin(angle), cos(angle)), (sin(2.0 * angle), cos(2.0 * angle))
    value = i[10] * one[0] + i[11] * one[1] + i[12] * other[0] + i[13] * other[1]
    change = i[10] * one[1] - i[11] * one[0] + 2.0 * (i[12] * other[1] - i[13] * other[0])
    sine, cosine = sin(i[7]), cos(i[7])
    u = (slope * cosine - sine) / (cosine + slope * sine)
    return Swing(angle, (value, change), s, square, distance, reach, depth, slope, u)


@compile_kernel
def whole_turns(per_radian: float, xh: float, turned: float, measured: float) -> float:
    """Return 2π times the turns to the one that the measured x is nearest to."""
    whole: float = 2.0 * pi * np.floor((measured - xh - per_radian * turned) / (2.0 * pi * per_radian) + 0.5)
    return whole


@compile_kernel
def panorama_point(X: float, Y: float, Z: float, i: FloatArray, measured: float) -> tuple[float, float]:
    """Return the image coordinates of a point; ``measured`` is its x, which says the turn."""
    at, per_radian = swung(X, Y, Z, i), i[0] * (1.0 + i[3])
    turned = at.angle + at.waves[0]
    turned += whole_turns(per_radian, i[1], turned, measured)
    ys = i[0] * at.u
    return i[1] + per_radian * turned, i[2] + ys * (1.0 + ys * ys * (i[8] + ys * ys * i[9]))


@compile_kernel
def project_panorama(
    X: float,
    Y: float,
    Z: float,
    i: FloatArray,
    measured: float,
    by_star: FloatArray,
    by_interior: FloatArray,
) -> tuple[float, float]:
    """Return the same, and set the derivatives by X, Y, Z (2, 3) and by the interior orientation (2, 14)."""
    c, rate, A1, A2, per_radian = i[0], i[3], i[8], i[9], i[0] * (1.0 + i[3])
    angle, (value, change), s, square, distance, reach, depth, slope, u = swung(X, Y, Z, i)
    turned = angle + value
    turned += whole_turns(per_radian, i[1], turned, measured)
    ys = c * u
    ys2 = ys * ys
    by_ys = 1.0 + ys2 * (3.0 * A1 + 5.0 * ys2 * A2)
    along, upwards = per_radian * (1.0 + change), by_ys * c * (1.0 + u * u) / (1.0 + slope * slope)
    by_depth, by_distance = -upwards * slope / depth, s / (distance * reach)
    by_star[0, 0] = along * (-Z / square + by_distance * X / distance)
    by_star[0, 1] = -along * i[6] / reach
    by_star[0, 2] = along * (X / square + by_distance * Z / distance)
    by_star[1, 0], by_star[1, 2] = by_depth * X / reach, by_depth * Z / reach
    by_star[1, 1] = upwards / depth - by_depth * s * i[6] / reach
    by_interior[:, :14] = 0.0
    by_interior[0, 0], by_interior[1, 0] = (1.0 + rate) * turned, by_ys * u
    by_interior[0, 1] = by_interior[1, 2] = 1.0
    by_interior[0, 3] = c * turned
    by_interior[1, 4] = -by_depth
    by_interior[0, 5], by_interior[1, 5] = -along / reach, -by_depth * s / reach
    by_interior[0, 6], by_interior[1, 6] = by_interior[0, 5] * Y, by_interior[1, 5] * Y
    by_interior[1, 7] = -by_ys * c * (1.0 + u * u)
    by_interior[1, 8], by_interior[1, 9] = ys * ys2, ys * ys2 * ys2
    by_interior[0, 10], by_interior[0, 11] = per_radian * sin(angle), per_radian * cos(angle)
    by_interior[0, 12], by_interior[0, 13] = per_radian * sin(2.0 * angle), per_radian * cos(2.0 * angle)
    return i[1] + per_radian * turned, i[2] + ys * (1.0 + ys2 * (A1 + ys2 * A2))
