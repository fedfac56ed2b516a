"""Compiled kernels: rays of images, with their derivatives."""

from __future__ import annotations

from math import asin, atan2, copysign, cos, nan, pi, sin, sqrt
from typing import NamedTuple, TypeAlias

import numpy as np

from mor.linalg.compilation import compile_inline, compile_kernel
from mor.types import FloatArray, IntArray

Vector: TypeAlias = tuple[float, float, float]
Rotation: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]
"""Row by row."""
PoseColumns: TypeAlias = tuple[int, int, int, int]
"""First columns by rotation, position, height and eccentricity, −1 where they are not wanted."""

# ---- The panorama for compiled linearisation: a point at a time, as ``mor.model.fisheye`` has it for many.


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
    X: float, Y: float, Z: float, i: FloatArray, measured: float, by_star: FloatArray, by_interior: FloatArray
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


# ---- Camera models for the compiled linearisation of image rays: one point at a time, what they are in numpy for many.
#
# The equations and their sources stand in ``mor.model.cameras``; a model that is missing here is evaluated there.

MODELS = {"mor": 0, "brown-forward": 1, "brown": 2}
"""Number of each compiled model."""
_MOR, _BROWN_FORWARD = 0, 1
PANORAMA = 3
"""Number of panoramas, which have kernels as images that stand still alone."""
ON_THE_SPHERE = 4
"""Number of what takes the place of every model where rays are directions (``mor.model.images``)."""
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
    return (x * q + p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y, y * q + p2 * (r2 + 2.0 * y * y) + 2.0 * p1 * x * y)


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
        by_star[0, 0], by_star[0, 1], by_star[0, 2] = (axes[0] * per_length, axes[1] * per_length, axes[2] * per_length)
        by_star[1, 0], by_star[1, 1], by_star[1, 2] = (axes[3] * per_length, axes[4] * per_length, axes[5] * per_length)
        return arcs(X, Y, Z, u, v, axes)
    if model == PANORAMA:
        return project_panorama(X, Y, Z, i, u, by_star, by_interior)
    seen = sight(model, X, Y, Z, i, r0, u, v)
    by_star[0, 0], by_star[0, 1], by_star[0, 2] = seen.by_star[0]
    by_star[1, 0], by_star[1, 1], by_star[1, 2] = seen.by_star[1]
    fill_by_interior(model, X, Y, Z, i, r0, u, v, seen.by_ideal, by_interior)
    return seen.x, seen.y


class ProjectedPoint(NamedTuple):
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
def sight(model: int, X: float, Y: float, Z: float, i: FloatArray, r0: float, u: float, v: float) -> ProjectedPoint:
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
    return ProjectedPoint(found_x, found_y, by_star, (xx, xy, yx, yy))


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


# ---- Kernels that linearise image rays: frame kernel, camera and whitening in one go, into the arrays of a chunk.


class Paths(NamedTuple):
    """Trajectories on which the poses of f frames depend at any time; empty (0, …) if no pose lies between knots.

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


class RayMeasurements(NamedTuple):
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
    rays: RayMeasurements,
    residual: FloatArray,
    by_point: FloatArray,
    by_others: FloatArray,
) -> None:
    """Set residuals (n, 2) and Jacobians (n, 2, 3), (n, 2, K) of rays, divided by σ; ``points`` (p, 3)."""
    model, D, centre, e, interiors, r0, tangent = values[:7]
    observed, weight, measured = rays[:3]
    interior, i = np.zeros((2, interiors.shape[1])), np.empty(interiors.shape[1])
    star, flat, width = np.empty((2, 3)), by_others.reshape(-1), by_others.shape[2]
    pose, components = pose_columns(layout), layout.components
    for p in range(pointers.size - 1):
        for n in range(pointers[p], pointers[p + 1]):
            f = frame[n]
            if model[f] < 0 or model[f] >= MOVING:
                continue
            for k in range(i.size):
                i[k] = interiors[f, k]
            X, Y, Z = points[p, 0] - centre[f, 0], points[p, 1] - centre[f, 1], points[p, 2] - centre[f, 2]
            R = rotation(D, f)
            a, b, c = rotated(R, X, Y, Z)
            u, v = measured[n, 0], measured[n, 1]
            x, y = project(model[f], a + e[f, 0], b + e[f, 1], c + e[f, 2], i, r0[f], u, v, star, interior)
            for m in range(2):
                w = weight[n, m]
                if w == 0.0:
                    residual[n, m] = 0.0
                    clear_row(by_point, by_others, n, m)
                    continue
                residual[n, m] = ((x if m == 0 else y) - observed[n, m]) * w
                by_star, row = (w * star[m, 0], w * star[m, 1], w * star[m, 2]), np.uint64((2 * n + m) * width)
                clear_columns(flat, row, 0, layout.of_motion)
                set_row(by_point, n, m, flat, row, pose, R, (a, b, c), by_star)
                if pose[0] >= 0 and tangent.shape[0] > 0:
                    into_tangent(flat, row + np.uint64(pose[0]), tangent, f)
                first = row + np.uint64(layout.interior)
                for k in range(components.size):
                    flat[first + np.uint64(k)] = w * interior[m, np.uint64(components[np.uint64(k)])]
                clear_columns(flat, row, layout.interior + components.size, width)


# Jacobians by the other unknowns are flat in the inner loops, and their places unsigned, so that none is tested for
# counting from the end. What is inlined there gets numbers, not arrays, which would be counted in and out with every
# row. Together that saves a third of the time of ``linearise``.


@compile_inline
def pose_columns(layout: Layout) -> PoseColumns:
    """Return the columns of the pose."""
    return layout.rotation, layout.position, layout.height, layout.eccentricity


@compile_inline
def rotation(D: FloatArray, f: int) -> Rotation:
    """Return the nine numbers of the rotation of a frame."""
    return D[f, 0], D[f, 1], D[f, 2], D[f, 3], D[f, 4], D[f, 5], D[f, 6], D[f, 7], D[f, 8]


@compile_inline
def rotated(D: Rotation, X: float, Y: float, Z: float) -> Vector:
    """Return D times a column."""
    return (D[0] * X + D[1] * Y + D[2] * Z, D[3] * X + D[4] * Y + D[5] * Z, D[6] * X + D[7] * Y + D[8] * Z)


@compile_inline
def by_object(D: Rotation, row: Vector) -> Vector:
    """Return a row times D."""
    s, t, d = row
    return s * D[0] + t * D[3] + d * D[6], s * D[1] + t * D[4] + d * D[7], s * D[2] + t * D[5] + d * D[8]


@compile_inline
def put_three(flat: FloatArray, place: np.uint64, numbers: Vector) -> None:
    """Store three numbers from a place on."""
    flat[place], flat[place + np.uint64(1)], flat[place + np.uint64(2)] = numbers


@compile_inline
def clear_columns(flat: FloatArray, row: np.uint64, first: int, end: int) -> None:
    """Set these columns of a row to zero."""
    for k in range(first, end):
        flat[row + np.uint64(k)] = 0.0


@compile_inline
def set_row(
    by_point: FloatArray,
    n: int,
    m: int,
    flat: FloatArray,
    row: np.uint64,
    pose: PoseColumns,
    D: Rotation,
    lever: Vector,
    by_star: Vector,
) -> None:
    """Set the Jacobian of one component by point and pose, from ``lever`` = D (X − X0) and its own by X*."""
    (a, b, c), (s, t, d) = lever, by_star
    g, h, o = by_object(D, by_star)
    by_point[n, m, 0], by_point[n, m, 1], by_point[n, m, 2] = g, h, o
    if pose[0] >= 0:
        put_three(flat, row + np.uint64(pose[0]), (t * c - d * b, d * a - s * c, s * b - t * a))
    if pose[1] >= 0:
        put_three(flat, row + np.uint64(pose[1]), (-g, -h, -o))
    if pose[2] >= 0:
        flat[row + np.uint64(pose[2])] = -o
    if pose[3] >= 0:
        put_three(flat, row + np.uint64(pose[3]), by_star)


@compile_kernel
def into_tangent(flat: FloatArray, place: np.uint64, tangent: FloatArray, f: int) -> None:
    """Turn the derivatives by a small rotation, from a place on, into those by its columns."""
    g, h, q = flat[place], flat[place + np.uint64(1)], flat[place + np.uint64(2)]
    for k in range(3):
        flat[place + np.uint64(k)] = g * tangent[f, 0, k] + h * tangent[f, 1, k] + q * tangent[f, 2, k]


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
    rays: RayMeasurements,
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
            a, b, c = rotated(rotation(D, f), X, Y, Z)
            u, v = measured[n, 0], measured[n, 1]
            x, y = image_point(model[f], a + e[f, 0], b + e[f, 1], c + e[f, 2], interior, r0[f], u, v)
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
    rays: RayMeasurements,
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
            R = rotation(D, f)
            a, b, c = rotated(R, X, Y, Z)
            u, v = measured[n, 0], measured[n, 1]
            x, y = project(model[f], a + e[f, 0], b + e[f, 1], c + e[f, 2], interior, r0[f], u, v, star, by_interior)
            g, h, q = turn[f, 0], turn[f, 1], turn[f, 2]
            s, t, o = rotated(R, moved[f, 0], moved[f, 1], moved[f, 2])
            da = b * q - c * h - s + shift[f, 0]
            db = c * g - a * q - t + shift[f, 1]
            dc = a * h - b * g - o + shift[f, 2]
            x += star[0, 0] * da + star[0, 1] * db + star[0, 2] * dc
            y += star[1, 0] * da + star[1, 1] * db + star[1, 2] * dc
            for k in range(interior.size):
                x += by_interior[0, k] * altered[f, k]
                y += by_interior[1, k] * altered[f, k]
            for m in range(2):
                w = weight[n, m]
                found = x if m == 0 else y
                if w == 0.0:
                    residual[n, m] = by_point[n, m, 0] = by_point[n, m, 1] = by_point[n, m, 2] = 0.0
                    continue
                residual[n, m] = (found - observed[n, m]) * w
                g, h, q = by_object(R, (w * star[m, 0], w * star[m, 1], w * star[m, 2]))
                by_point[n, m, 0], by_point[n, m, 1], by_point[n, m, 2] = g, h, q
