"""Camera models for the compiled linearisation of image rays: one point at a time, what they are in numpy for many.

The equations and their sources stand in ``mor.geometry.cameras``; a model that is missing here is evaluated there.
"""

from __future__ import annotations

from math import atan2, copysign, sqrt
from typing import NamedTuple

from mor.adjustment.rays.compiled.sights.panorama import panorama_point, project_panorama
from mor.arrays import FloatArray
from mor.compilation import compile_kernel

MODELS = {"mor": 0, "brown-forward": 1, "brown": 2}
"""Number of each compiled model."""
_MOR, _BROWN_FORWARD = 0, 1
PANORAMA = 3
"""Number of panoramas, which have kernels as images that stand still alone."""
ON_THE_SPHERE = 4
"""Number of what takes the place of every model where rays are directions (``mor.observations.on_the_sphere``)."""
MOVING = 8
"""Added to the number of a model where the rows are read out one after the other; what is left by it is the model."""
ALONG, CROSSING = 16, 32
"""Added to it where the pose is one between knots: of images, read out row by row or not, and of the lines of a
scanner."""


@compile_kernel
def distortion(
    x: float, y: float, k1: float, k2: float, k3: float, p1: float, p2: float, r0: float
) -> tuple[float, float]:
    """Return dx, dy of the radial and decentring polynomials."""
    r2, z2 = x * x + y * y, r0 * r0
    q = k1 * (r2 - z2) + k2 * (r2 * r2 - z2 * z2) + k3 * (r2 * r2 * r2 - z2 * z2 * z2)
    return (
        x * q + p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y,
        y * q + p2 * (r2 + 2.0 * y * y) + 2.0 * p1 * x * y,
    )


@compile_kernel
def distortion_slopes(
    x: float, y: float, k1: float, k2: float, k3: float, p1: float, p2: float, r0: float
) -> tuple[float, float, float]:
    """Return ∂dx/∂x, ∂dx/∂y = ∂dy/∂x, ∂dy/∂y."""
    r2, z2 = x * x + y * y, r0 * r0
    q = k1 * (r2 - z2) + k2 * (r2 * r2 - z2 * z2) + k3 * (r2 * r2 * r2 - z2 * z2 * z2)
    slope = k1 + 2.0 * k2 * r2 + 3.0 * k3 * r2 * r2
    return (
        q + 2.0 * x * x * slope + 6.0 * p1 * x + 2.0 * p2 * y,
        2.0 * x * y * slope + 2.0 * (p1 * y + p2 * x),
        q + 2.0 * y * y * slope + 6.0 * p2 * y + 2.0 * p1 * x,
    )


@compile_kernel
def fill_by_distortion(x: float, y: float, r0: float, sign: float, by_interior: FloatArray) -> None:
    """Set columns 3 … 7 of ``by_interior`` (2, k): derivatives of sign · (dx, dy) by the five coefficients."""
    r2, z2 = x * x + y * y, r0 * r0
    radial = r2 - z2, r2 * r2 - z2 * z2, r2 * r2 * r2 - z2 * z2 * z2
    for k in range(3):
        by_interior[0, 3 + k] = sign * x * radial[k]
        by_interior[1, 3 + k] = sign * y * radial[k]
    by_interior[0, 6] = sign * (r2 + 2.0 * x * x)
    by_interior[1, 6] = sign * 2.0 * x * y
    by_interior[0, 7] = by_interior[1, 6]
    by_interior[1, 7] = sign * (r2 + 2.0 * y * y)


@compile_kernel
def across(X: float, Y: float, Z: float) -> tuple[float, float, float, float, float, float]:
    """Return the two axes across the direction of X, Y, Z."""
    length = sqrt(X * X + Y * Y + Z * Z)
    per_length = 1.0 / length if length > 0.0 else 1.0
    x, y, z = X * per_length, Y * per_length, Z * per_length
    sign = copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return 1.0 + sign * x * x * a, sign * b, -sign * x, b, sign + y * y * a, -y


@compile_kernel
def arcs(
    X: float, Y: float, Z: float, u: float, v: float, axes: tuple[float, float, float, float, float, float]
) -> tuple[float, float]:
    """Return the arcs to the direction of X, Y, Z from the ray whose stereographic coordinates are u, v."""
    s = u * u + v * v
    i, j, k = 2.0 * u / (1.0 + s), 2.0 * v / (1.0 + s), (s - 1.0) / (1.0 + s)
    along_first = axes[0] * i + axes[1] * j + axes[2] * k
    along_second = axes[3] * i + axes[4] * j + axes[5] * k
    sine = sqrt(along_first * along_first + along_second * along_second)
    length = sqrt(X * X + Y * Y + Z * Z)
    cosine = (X * i + Y * j + Z * k) / length if length > 0.0 else 0.0
    stretch = atan2(sine, cosine) / sine if sine > 0.0 else 1.0
    return -stretch * along_first, -stretch * along_second


@compile_kernel
def image_point(
    model: int, X: float, Y: float, Z: float, i: FloatArray, r0: float, u: float, v: float
) -> tuple[float, float]:
    """Return the image coordinates of a point X, Y, Z in the image system; (u, v) are the measured ones."""
    if model == ON_THE_SPHERE:
        axes = across(X, Y, Z)
        return arcs(X, Y, Z, u, v, axes)
    if model == PANORAMA:
        return panorama_point(X, Y, Z, i, u)
    x, y = -i[0] * X / Z, -i[0] * Y / Z
    if model == _MOR:
        dx, dy = distortion(x, y, i[3], i[4], i[5], i[6], i[7], r0)
        return i[1] + x + dx + i[8] * x + i[9] * y, i[2] + y + dy
    if model == _BROWN_FORWARD:
        dx, dy = distortion(x, y, i[3], i[4], i[5], i[6], i[7], 0.0)
        return i[1] + x - dx, i[2] + y - dy
    a, b = u - i[1], v - i[2]
    a_affine = (1.0 + i[8]) * a + i[9] * b
    dx, dy = distortion(a_affine, b, i[3], i[4], i[5], i[6], i[7], 0.0)
    return u + x - a_affine - dx, v + y - b - dy


@compile_kernel
def project(
    model: int,
    X: float,
    Y: float,
    Z: float,
    i: FloatArray,
    r0: float,
    u: float,
    v: float,
    by_star: FloatArray,
    by_interior: FloatArray,
) -> tuple[float, float]:
    """Return the image coordinates, and set their derivatives by X, Y, Z (2, 3) and by the interior (2, k)."""
    if model == ON_THE_SPHERE:
        length, axes = sqrt(X * X + Y * Y + Z * Z), across(X, Y, Z)
        per_length = 1.0 / length if length > 0.0 else 1.0
        by_star[0, 0], by_star[0, 1], by_star[0, 2] = (
            axes[0] * per_length,
            axes[1] * per_length,
            axes[2] * per_length,
        )
        by_star[1, 0], by_star[1, 1], by_star[1, 2] = (
            axes[3] * per_length,
            axes[4] * per_length,
            axes[5] * per_length,
        )
        return arcs(X, Y, Z, u, v, axes)
    if model == PANORAMA:
        return project_panorama(X, Y, Z, i, u, by_star, by_interior)
    seen = sight(model, X, Y, Z, i, r0, u, v)
    by_star[0, 0], by_star[0, 1], by_star[0, 2] = seen.by_star[0]
    by_star[1, 0], by_star[1, 1], by_star[1, 2] = seen.by_star[1]
    fill_by_interior(model, X, Y, Z, i, r0, u, v, seen.by_ideal, by_interior)
    return seen.x, seen.y


class Sight(NamedTuple):
    """A point in the image.

    Attributes:
        x, y: image coordinates.
        by_star: their derivatives by X, Y, Z.
        by_ideal: their derivatives by the ideal image coordinates, xx, xy, yx, yy.
    """

    x: float
    y: float
    by_star: tuple[tuple[float, float, float], tuple[float, float, float]]
    by_ideal: tuple[float, float, float, float]


@compile_kernel
def sight(model: int, X: float, Y: float, Z: float, i: FloatArray, r0: float, u: float, v: float) -> Sight:
    """Return the image coordinates of a point X, Y, Z in the image system, with their derivatives by it."""
    per_depth = -1.0 / Z
    x, y = i[0] * X * per_depth, i[0] * Y * per_depth
    xx, xy, yx, yy = 1.0, 0.0, 0.0, 1.0
    if model == _MOR or model == _BROWN_FORWARD:
        forward = model == _BROWN_FORWARD
        sign, zero = (-1.0, 0.0) if forward else (1.0, r0)
        dx, dy = distortion(x, y, i[3], i[4], i[5], i[6], i[7], zero)
        sxx, sxy, syy = distortion_slopes(x, y, i[3], i[4], i[5], i[6], i[7], zero)
        xx, xy, yx, yy = 1.0 + sign * sxx, sign * sxy, sign * sxy, 1.0 + sign * syy
        found_x, found_y = i[1] + x + sign * dx, i[2] + y + sign * dy
        if not forward:
            xx += i[8]
            xy += i[9]
            found_x += i[8] * x + i[9] * y
    else:
        a, b = u - i[1], v - i[2]
        a_affine = (1.0 + i[8]) * a + i[9] * b
        dx, dy = distortion(a_affine, b, i[3], i[4], i[5], i[6], i[7], 0.0)
        found_x, found_y = u + x - a_affine - dx, v + y - b - dy
    scale, x_by_depth, y_by_depth = i[0] * per_depth, x * per_depth, y * per_depth
    by_star = (
        (xx * scale, xy * scale, xx * x_by_depth + xy * y_by_depth),
        (yx * scale, yy * scale, yx * x_by_depth + yy * y_by_depth),
    )
    return Sight(found_x, found_y, by_star, (xx, xy, yx, yy))


@compile_kernel
def fill_by_interior(
    model: int,
    X: float,
    Y: float,
    Z: float,
    i: FloatArray,
    r0: float,
    u: float,
    v: float,
    by_ideal: tuple[float, float, float, float],
    by_interior: FloatArray,
) -> None:
    """Set the derivatives (2, k) of the image coordinates by the interior orientation."""
    per_depth = -1.0 / Z
    x_by_c, y_by_c = X * per_depth, Y * per_depth
    xx, xy, yx, yy = by_ideal
    if model == _MOR or model == _BROWN_FORWARD:
        x, y = i[0] * x_by_c, i[0] * y_by_c
        sign, zero = (-1.0, 0.0) if model == _BROWN_FORWARD else (1.0, r0)
        fill_by_distortion(x, y, zero, sign, by_interior)
        by_interior[0, 1], by_interior[0, 2] = 1.0, 0.0
        by_interior[1, 1], by_interior[1, 2] = 0.0, 1.0
        if model == _MOR:
            by_interior[0, 8], by_interior[0, 9] = x, y
            by_interior[1, 8], by_interior[1, 9] = 0.0, 0.0
    else:
        a, b = u - i[1], v - i[2]
        a_affine = (1.0 + i[8]) * a + i[9] * b
        sxx, sxy, syy = distortion_slopes(a_affine, b, i[3], i[4], i[5], i[6], i[7], 0.0)
        fill_by_distortion(a_affine, b, 0.0, -1.0, by_interior)
        sxx, syy = 1.0 + sxx, 1.0 + syy
        by_interior[0, 1], by_interior[0, 2] = sxx * (1.0 + i[8]), sxx * i[9] + sxy
        by_interior[1, 1], by_interior[1, 2] = sxy * (1.0 + i[8]), sxy * i[9] + syy
        by_interior[0, 8], by_interior[0, 9] = -sxx * a, -sxx * b
        by_interior[1, 8], by_interior[1, 9] = -sxy * a, -sxy * b
    by_interior[0, 0] = xx * x_by_c + xy * y_by_c
    by_interior[1, 0] = yx * x_by_c + yy * y_by_c
