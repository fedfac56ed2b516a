"""Camera models for wide angles: OpenCV, fisheye, field of view, thin prism, panorama."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.model.lens import CameraModel, Projection
from mor.types import FloatArray
from mor.units import IMAGE, LENGTH, NUMBER, Component, Quantity

# ---- OpenCV's fisheye model (Kannala and Brandt), in this program's image axes, up to and beyond 90 degrees.


class _Ray(NamedTuple):
    """Direction of the points in OpenCV's axes (right, down, forward); every field is (n,)."""

    angle: FloatArray
    """θ, from the viewing direction, 0 … π."""
    right: FloatArray
    down: FloatArray
    """(right, down): unit vector of the azimuth, (1, 0) straight ahead, nan straight behind."""
    inverse_distance: FloatArray
    """1/ρ, ρ from the projection centre."""
    cosine: FloatArray
    tangential: FloatArray
    """θ/(ρ sin θ): object length across the radius to equidistant image length."""


def _rays(star: FloatArray) -> _Ray:
    """Angles and directions of the points ``star`` (n, 3)."""
    x, y, z = star[:, 0], -star[:, 1], -star[:, 2]
    off_axis = np.hypot(x, y)
    inverse_distance = 1.0 / np.hypot(off_axis, z)
    angle = np.arctan2(off_axis, z)
    aside = off_axis > 0.0
    # atan2 keeps its relative accuracy down to the smallest angle, hence θ/s needs no series; only s = 0
    # is taken out: the limit is 1/ρ ahead, and straight behind there is none.
    safe = np.where(aside, off_axis, 1.0)
    on_axis = np.where(z > 0.0, 1.0, np.nan)
    return _Ray(
        angle=angle,
        right=np.where(aside, x / safe, on_axis),
        down=np.where(aside, y / safe, 0.0 * on_axis),
        inverse_distance=inverse_distance,
        cosine=z * inverse_distance,
        tangential=np.where(aside, angle / safe, on_axis * inverse_distance),
    )


def project_fisheye(star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray) -> Projection:
    """Image coordinates x = u, y = −v, with (u, v) OpenCV's image coordinates, u right and v down.

    OpenCV's camera axes (right, down, forward) are (X*, −Y*, −Z*). With s = √(X*² + Y*²),
    θ = atan2(s, −Z*) and θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸),

        a' = θ_d X*/s,     x =  (fx (a' + alpha b') + cx)
        b' = −θ_d Y*/s,    y = −(fy b' + cy)

    All nine numbers are OpenCV's own; fx, fy, cx, cy are meant as in :mod:`mor.model.fisheye`.
    θ runs from 0 to π, so points beside and behind the camera (Z* ≥ 0) have images too, where OpenCV's own
    function, which divides by the depth, gives a wrong one. Straight ahead the limit is exact; straight
    behind (X* = Y* = 0 < Z*) there is no azimuth, and the result is nan.

    ``star`` (n, 3); ``interior`` (n, 9) = fx, fy, cx, cy, k1, k2, k3, k4, alpha; ``constants`` (n, 0);
    ``measured`` (n, 2) is not looked at.

    Source: Kannala and Brandt 2006, the radially symmetric part; OpenCV documentation, namespace cv::fisheye.
    """
    fx, fy, cx, cy, k1, k2, k3, k4, alpha = interior.T
    ray = _rays(star)
    square = ray.angle * ray.angle
    stretch = 1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4)))
    slope = 1.0 + square * (3.0 * k1 + square * (5.0 * k2 + square * (7.0 * k3 + square * 9.0 * k4)))
    bent = ray.angle * stretch  # θ_d
    a, b = bent * ray.right, bent * ray.down

    xy = np.empty((len(star), 2))
    xy[:, 0] = fx * (a + alpha * b) + cx
    xy[:, 1] = -fy * b - cy

    by_interior = np.zeros((len(star), 2, 9))
    by_interior[:, 0, 0] = a + alpha * b
    by_interior[:, 1, 1] = -b
    by_interior[:, 0, 2] = 1.0
    by_interior[:, 1, 3] = -1.0
    by_interior[:, 0, 8] = fx * b
    x_radial, y_radial = fx * (ray.right + alpha * ray.down), -fy * ray.down
    power = ray.angle
    for column in range(4, 8):
        power = power * square
        by_interior[:, 0, column], by_interior[:, 1, column] = x_radial * power, y_radial * power
    return Projection(xy, _fisheye_by_star(ray, stretch, slope, interior), by_interior)


def _fisheye_by_star(ray: _Ray, stretch: FloatArray, slope: FloatArray, interior: FloatArray) -> FloatArray:
    """Derivatives (n, 2, 3) of (x, y) by the image system's coordinates.

    Along the azimuth the image moves by g = θ_d' cos θ/ρ, across it by h = θ_d/s, per object length; with the
    forward depth by −θ_d' sin θ/ρ along the azimuth. g and h meet at 1/ρ on the axis, so their difference
    needs no care: it is small beside h there.
    """
    fx, fy, alpha = interior[:, 0], interior[:, 1], interior[:, 8]
    along = slope * ray.cosine * ray.inverse_distance
    across = stretch * ray.tangential
    a_by_x = across + ray.right * ray.right * (along - across)
    a_by_y = ray.right * ray.down * (along - across)  # = ∂b'/∂x
    b_by_y = across + ray.down * ray.down * (along - across)
    by_depth = -slope * np.sin(ray.angle) * ray.inverse_distance
    a_by_z, b_by_z = by_depth * ray.right, by_depth * ray.down

    by_star = np.empty((len(ray.angle), 2, 3))
    by_star[:, 0, 0] = fx * (a_by_x + alpha * a_by_y)
    by_star[:, 0, 1] = -fx * (a_by_y + alpha * b_by_y)
    by_star[:, 0, 2] = -fx * (a_by_z + alpha * b_by_z)
    by_star[:, 1, 0] = -fy * a_by_y
    by_star[:, 1, 1] = fy * b_by_y
    by_star[:, 1, 2] = fy * b_by_z
    return by_star


FISHEYE = CameraModel(
    key="fisheye",
    components=(
        *(Component(name, IMAGE) for name in ("fx", "fy", "cx", "cy")),
        *(Component(name, NUMBER) for name in ("k1", "k2", "k3", "k4", "alpha")),
    ),
    constants=(),
    project=project_fisheye,
    sees_behind=True,
)
"""Camera model ``fisheye``."""


# ---- OpenCV's radial-tangential model with its rational extension, in this program's image axes.


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


def project_opencv(star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray) -> Projection:
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
    # Derivatives by k1, k2, k3 and k4, k5, k6; (x, y) is the image point without distortion, reduced.
    x = fx * a
    y = -fy * b
    for power, above, below in zip(radial.powers, (4, 5, 8), (9, 10, 11), strict=True):
        share = power / radial.denominator
        by_interior[:, 0, above], by_interior[:, 1, above] = x * share, y * share
        share = -radial.factor * share
        by_interior[:, 0, below], by_interior[:, 1, below] = x * share, y * share
    return Projection(xy, _by_star(a, b, per_depth, radial, interior), by_interior)


def _by_star(a: FloatArray, b: FloatArray, per_depth: FloatArray, radial: _Radial, interior: FloatArray) -> FloatArray:
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


OPENCV = CameraModel(
    key="opencv",
    components=(
        *(Component(name, IMAGE) for name in ("fx", "fy", "cx", "cy")),
        *(Component(name, NUMBER) for name in ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    ),
    constants=(),
    project=project_opencv,
)
"""Camera model ``opencv``."""


# ---- The FOV camera of Devernay and Faugeras, as COLMAP has it, in this program's image axes.


def _arctangent(q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """h = atan(√q)/√q and dh/dq, both (n,), for q ≥ 0; at q = 0 they are 1 and −1/3."""
    # Below this q the series of h and h' is exact to the last digit: its first term left out is q⁹/19.
    series = 0.01
    small = q < series
    safe = np.where(small, 1.0, q)
    root = np.sqrt(safe)
    h = np.arctan(root) / root
    slope = (1.0 / (1.0 + safe) - h) / (2.0 * safe)
    near = np.where(small, q, 0.0)
    terms = 9
    signs = [(-1.0) ** i / (2 * i + 1) for i in range(terms + 1)]
    h_near = np.polynomial.polynomial.polyval(near, signs)
    slope_near = np.polynomial.polynomial.polyval(near, [i * signs[i] for i in range(1, terms + 1)])
    return np.where(small, h_near, h), np.where(small, slope_near, slope)


def project_fov(star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray) -> Projection:
    """Image coordinates x = u, y = −v, with (u, v) COLMAP's, u right and v down.

    With a = −X*/Z*, b = Y*/Z*, r² = a² + b² and t = 2 tan(ω/2),

        T = atan(t r) / (ω r),     x = (fx a T + cx),     y = −(fy b T + cy)

    ω = ``omega`` (rad) is the field of view of an ideal fisheye; ω → 0 is the central projection without distortion,
    where the derivative by ω vanishes. ``star`` (n, 3); ``interior`` (n, 5) = fx, fy, cx, cy, omega; ``constants``
    (n, 0); ``measured`` (n, 2) is not looked at.

    Source: Devernay and Faugeras 2001, equation (13); COLMAP ``sensor/models.h``, FOV, of which this is the formula
    without its approximations for small ω and r.
    """
    fx, fy, cx, cy, omega = interior.T
    per_depth = -1.0 / star[:, 2]
    a, b = star[:, 0] * per_depth, -star[:, 1] * per_depth
    r2 = a * a + b * b
    # t/ω and its derivative: with τ = tan(ω/2)/(ω/2), which is 1 at ω = 0, where dτ/dω vanishes
    wide = omega != 0.0
    safe = np.where(wide, omega, 1.0)
    t = 2.0 * np.tan(omega / 2.0)
    tau = np.where(wide, t / safe, 1.0)
    tau_slope = np.where(wide, (1.0 + t * t / 4.0 - tau) / safe, 0.0)
    h, slope = _arctangent(t * t * r2)
    T = tau * h
    by_r2 = tau * slope * t * t
    by_omega = tau_slope * h + tau * slope * 2.0 * t * (1.0 + t * t / 4.0) * r2

    xy = np.stack([fx * a * T + cx, -(fy * b * T + cy)], axis=1)
    by_interior = np.zeros((len(star), 2, 5))
    by_interior[:, 0, 0], by_interior[:, 1, 1] = a * T, -b * T
    by_interior[:, 0, 2], by_interior[:, 1, 3] = 1.0, -1.0
    by_interior[:, 0, 4], by_interior[:, 1, 4] = fx * a * by_omega, -fy * b * by_omega
    by_star = np.empty((len(star), 2, 3))
    mixed = 2.0 * a * b * by_r2
    by_a, by_b = T + 2.0 * a * a * by_r2, T + 2.0 * b * b * by_r2
    for row, (scale, first, second) in enumerate(((fx, by_a, mixed), (-fy, mixed, by_b))):
        by_star[:, row, 0] = scale * first * per_depth
        by_star[:, row, 1] = -scale * second * per_depth
        by_star[:, row, 2] = scale * (first * a + second * b) * per_depth
    return Projection(xy, by_star, by_interior)


FOV = CameraModel(
    key="fov",
    components=(*(Component(name, IMAGE) for name in ("fx", "fy", "cx", "cy")), Component("omega", NUMBER)),
    constants=(),
    project=project_fov,
)
"""Camera model ``fov``."""


# ---- COLMAP's fisheyes with tangential and thin prism terms, in this program's image axes.


class _DistortedPoints(NamedTuple):
    """Distorted a', b' of n points and their derivatives."""

    ab: FloatArray
    """(n, 2)."""
    slopes: FloatArray
    """(n, 2, 2) by the undistorted ones."""
    by_coefficients: FloatArray
    """(n, 2, k) by the distortion coefficients, in their order."""


def _equidistant(star: FloatArray) -> tuple[FloatArray, FloatArray]:
    """a = θ X*/s, b = −θ Y*/s (n, 2), right and down, and their derivatives (n, 2, 3) by X*, Y*, Z*."""
    interior = np.zeros((len(star), 9))
    interior[:, :2] = 1.0
    plain = project_fisheye(star, interior, np.empty((len(star), 0)), np.empty((len(star), 2)))
    down = np.array([1.0, -1.0])
    return plain.xy * down, plain.by_star * down[:, None]


def _assembled(interior: FloatArray, bent: _DistortedPoints, by_star: FloatArray) -> Projection:
    """x = fx a' + cx, y = −(fy b' + cy) with all derivatives; the components begin with fx, fy, cx, cy."""
    scale = interior[:, :2] * np.array([1.0, -1.0])
    xy = scale * bent.ab + interior[:, 2:4] * np.array([1.0, -1.0])
    by_interior = np.zeros((len(interior), 2, interior.shape[1]))
    by_interior[:, 0, 0], by_interior[:, 1, 1] = bent.ab[:, 0], -bent.ab[:, 1]
    by_interior[:, 0, 2], by_interior[:, 1, 3] = 1.0, -1.0
    by_interior[:, :, 4:] = scale[:, :, None] * bent.by_coefficients
    return Projection(xy, scale[:, :, None] * (bent.slopes @ by_star), by_interior)


def _side(a: FloatArray, b: FloatArray, p: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Tangential terms (n, 2) with ``p`` on (r² + 2 a²) and (r² + 2 b²), their slopes, their derivatives by p."""
    r2, ab = a * a + b * b, 2.0 * a * b
    by_p = np.stack([np.stack([r2 + 2.0 * a * a, ab], -1), np.stack([ab, r2 + 2.0 * b * b], -1)], 1)
    moved = by_p[:, :, 0] * p[0][:, None] + by_p[:, :, 1] * p[1][:, None]
    mixed = 2.0 * (p[0] * b + p[1] * a)
    slopes = np.stack(
        [
            np.stack([6.0 * p[0] * a + 2.0 * p[1] * b, mixed], -1),
            np.stack([mixed, 6.0 * p[1] * b + 2.0 * p[0] * a], -1),
        ],
        1,
    )
    return moved, slopes, by_p


def _radially(ab: FloatArray, coefficients: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """T = 1 + Σ k_i r²ⁱ of (n, 2) and (n, k): T, dT/d(r²), and the powers r²ⁱ (n, k)."""
    r2 = np.sum(ab * ab, axis=1)
    count = coefficients.shape[1]
    powers = np.stack([r2 ** (i + 1) for i in range(count)], axis=1)
    lower = np.stack([(i + 1.0) * r2**i for i in range(count)], axis=1)
    return 1.0 + np.sum(coefficients * powers, axis=1), np.sum(coefficients * lower, axis=1), powers


def project_thin_prism(
    star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray
) -> Projection:
    """Image coordinates x = u, y = −v, with (u, v) COLMAP's, u right and v down.

    With s = √(X*² + Y*²), θ = atan2(s, −Z*), a = θ X*/s, b = −θ Y*/s, r² = a² + b² = θ²,
    T = 1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸,

        a' = a T + 2 p1 a b + p2 (r² + 2 a²) + sx1 r²,     x =  (fx a' + cx)
        b' = b T + 2 p2 a b + p1 (r² + 2 b²) + sy1 r²,     y = −(fy b' + cy)

    ``star`` (n, 3); ``interior`` (n, 12) = fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, sx1, sy1; ``constants`` (n, 0);
    ``measured`` (n, 2) is not looked at. Straight behind the camera there is no image (nan), as in ``fisheye``.

    Source: COLMAP documentation and ``sensor/models.h``, THIN_PRISM_FISHEYE.
    """
    plain, by_star = _equidistant(star)
    k = interior[:, [4, 5, 8, 9]]
    a, b = plain.T
    T, slope, powers = _radially(plain, k)
    moved, side, by_p = _side(a, b, (interior[:, 7], interior[:, 6]))
    prism = interior[:, 10:]
    r2 = a * a + b * b
    found = plain * T[:, None] + moved + prism * r2[:, None]
    slopes = side + 2.0 * (plain * slope[:, None] + prism)[:, :, None] * plain[:, None, :]
    slopes += T[:, None, None] * np.eye(2)
    by = np.zeros((len(star), 2, 8))
    by[:, :, [0, 1, 4, 5]] = plain[:, :, None] * powers[:, None, :]
    by[:, :, [3, 2]] = by_p
    by[:, 0, 6], by[:, 1, 7] = r2, r2
    return _assembled(interior, _DistortedPoints(found, slopes, by), by_star)


def project_rad_tan(star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray) -> Projection:
    """Image coordinates x = u, y = −v, with (u, v) COLMAP's, u right and v down.

    As :func:`project_thin_prism`, with tangential and prism terms at the coordinates that the radial ones moved: with
    T = 1 + k0 θ² + k1 θ⁴ + … + k5 θ¹², α = a T, β = b T, ρ² = α² + β²,

        a' = α + p0 (ρ² + 2 α²) + 2 p1 α β + s0 ρ² + s1 ρ⁴,     x =  (fx a' + cx)
        b' = β + p1 (ρ² + 2 β²) + 2 p0 α β + s2 ρ² + s3 ρ⁴,     y = −(fy b' + cy)

    ``star`` (n, 3); ``interior`` (n, 16) = fx, fy, cx, cy, k0 … k5, p0, p1, s0 … s3; ``constants`` (n, 0);
    ``measured`` (n, 2) is not looked at.

    Source: COLMAP ``sensor/models.h``, RAD_TAN_THIN_PRISM_FISHEYE; Project Aria documentation, Fisheye624.
    """
    plain, by_star = _equidistant(star)
    T, slope, powers = _radially(plain, interior[:, 4:10])
    moved = plain * T[:, None]
    a, b = moved.T
    radial = 2.0 * slope[:, None, None] * plain[:, :, None] * plain[:, None, :] + T[:, None, None] * np.eye(2)
    aside, side, by_p = _side(a, b, (interior[:, 10], interior[:, 11]))
    r2 = a * a + b * b
    first, second = interior[:, [12, 14]], interior[:, [13, 15]]
    found = moved + aside + first * r2[:, None] + second * (r2 * r2)[:, None]
    later = side + 2.0 * (first + 2.0 * second * r2[:, None])[:, :, None] * moved[:, None, :] + np.eye(2)
    by = np.zeros((len(star), 2, 12))
    by[:, :, :6] = later @ (plain[:, :, None] * powers[:, None, :])
    by[:, :, 6:8] = by_p
    for row, column in ((0, 8), (1, 10)):
        by[:, row, column], by[:, row, column + 1] = r2, r2 * r2
    return _assembled(interior, _DistortedPoints(found, later @ radial, by), by_star)


_PINHOLE = tuple(Component(name, IMAGE) for name in ("fx", "fy", "cx", "cy"))

THIN_PRISM = CameraModel(
    key="thin-prism-fisheye",
    components=(*_PINHOLE, *(Component(name, NUMBER) for name in ("k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"))),
    constants=(),
    project=project_thin_prism,
    sees_behind=True,
)
"""Camera model ``thin-prism-fisheye``."""
RAD_TAN_THIN_PRISM = CameraModel(
    key="rad-tan-thin-prism-fisheye",
    components=(
        *_PINHOLE,
        *(Component(name, NUMBER) for name in ("k0", "k1", "k2", "k3", "k4", "k5", "p0", "p1", "s0", "s1", "s2", "s3")),
    ),
    constants=(),
    project=project_rad_tan,
    sees_behind=True,
)
"""Camera model ``rad-tan-thin-prism-fisheye``."""


# ---- A panorama: a line camera that turns about an axis and lays its lines side by side on a cylinder.


def project_panorama(star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray) -> Projection:
    """Image coordinates of a camera whose line turns about the y axis of the image system; its middle looks along −z.

    Turned by α to the right, the line camera has its projection centre at ``ahead`` along the sight and ``aside`` to
    the right of it. A point is in the line, which leans by ``lean``, where to the right of the centre it is as far as
    lean · Y*. With ρ = √(X*² + Z*²), s = aside + lean Y*, t = Y*/(√(ρ² − s²) − ahead),

        α = atan2(X*, −Z*) − asin(s/ρ)                    u = tan(atan t − pitch)
        x = xh + c (1 + rate) (α + a1 sin α + b1 cos α + a2 sin 2α + b2 cos 2α)
        y = yh + y_s (1 + A1 y_s² + A2 y_s⁴),             y_s = c u

    x counts on through whole turns, to the one that the measured x is nearest to.

    ``star`` (n, 3); ``interior`` (n, 14) = c, xh, yh, rate, ahead, aside, lean, pitch, A1, A2, a1, b1, a2, b2;
    ``constants`` (n, 0); ``measured`` (n, 2). A point as near to the axis as the projection centre has no image: nan.

    Source: after Schneider and Maas 2006, who have these effects to first order.
    """
    c, xh, yh, rate, A1, A2 = interior[:, [0, 1, 2, 3, 8, 9]].T
    pitch, per_radian = interior[:, 7], c * (1.0 + rate)
    at = _turned_to(star, interior)
    waves = np.stack([f(k * at.angle) for k in (1.0, 2.0) for f in (np.sin, np.cos)], axis=1)
    turned = at.angle + np.sum(interior[:, 10:] * waves, axis=1)
    x = xh + per_radian * turned
    turns = np.nan_to_num(np.round((measured[:, 0] - x) / (2.0 * np.pi * per_radian)))
    turned = turned + 2.0 * np.pi * turns
    u = (at.slope * np.cos(pitch) - np.sin(pitch)) / (np.cos(pitch) + at.slope * np.sin(pitch))
    ys = c * u
    y = yh + ys * (1.0 + ys**2 * (A1 + ys**2 * A2))
    y_by_ys = 1.0 + ys**2 * (3.0 * A1 + 5.0 * ys**2 * A2)

    along = per_radian * (
        1.0
        + np.sum(
            interior[:, 10:] * np.stack([waves[:, 1], -waves[:, 0], 2.0 * waves[:, 3], -2.0 * waves[:, 2]], axis=1),
            axis=1,
        )
    )  # ∂x/∂α
    upwards = y_by_ys * c * (1.0 + u**2) / (1.0 + at.slope**2)  # ∂y/∂t
    by_interior = np.zeros((len(star), 2, interior.shape[1]))
    by_interior[:, 0, 0], by_interior[:, 1, 0] = (1.0 + rate) * turned, y_by_ys * u
    by_interior[:, 0, 1] = by_interior[:, 1, 2] = 1.0
    by_interior[:, 0, 3] = c * turned
    by_interior[:, 1, 4] = upwards * at.slope / at.depth
    for column, by_s in ((5, np.ones_like(u)), (6, star[:, 1])):
        by_interior[:, 0, column] = -along * by_s / at.reach
        by_interior[:, 1, column] = upwards * at.slope / at.depth * at.aside / at.reach * by_s
    by_interior[:, 1, 7] = -y_by_ys * c * (1.0 + u**2)
    by_interior[:, 1, 8], by_interior[:, 1, 9] = ys**3, ys**5
    by_interior[:, 0, 10:] = per_radian[:, None] * waves
    by_star = _panorama_by_star(star, interior[:, 6], at, along, upwards)
    return Projection(np.stack([x + 2.0 * np.pi * per_radian * turns, y], axis=1), by_star, by_interior)


class _LineCameraPoints(NamedTuple):
    """The line camera, turned until the points are in its line; every field is (n,)."""

    angle: FloatArray
    """α, within half a turn."""
    aside: FloatArray
    """s: how far to the right of the axis the sight passes."""
    distance: FloatArray
    """ρ, from the axis."""
    reach: FloatArray
    """√(ρ² − s²)."""
    depth: FloatArray
    """The same from the projection centre; nan where it is not ahead of it."""
    slope: FloatArray
    """t: height over depth."""


def _turned_to(star: FloatArray, interior: FloatArray) -> _LineCameraPoints:
    X, Y, Z = star.T
    ahead, aside, lean = interior[:, 4:7].T
    distance, s = np.hypot(X, Z), aside + lean * Y
    with np.errstate(invalid="ignore", divide="ignore"):
        reach = np.sqrt(distance**2 - s**2)
        angle = np.arctan2(X, -Z) - np.arcsin(s / distance)
    angle = angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))
    depth = np.where(reach > ahead, reach - ahead, np.nan)
    return _LineCameraPoints(angle, s, distance, reach, depth, Y / depth)


def _panorama_by_star(
    star: FloatArray, lean: FloatArray, at: _LineCameraPoints, along: FloatArray, upwards: FloatArray
) -> FloatArray:
    X, _, Z = star.T
    by_distance = at.aside / (at.distance * at.reach)  # ∂α/∂ρ
    by_depth = -upwards * at.slope / at.depth
    by_star = np.empty((len(star), 2, 3))
    by_star[:, 0, 0] = along * (-Z / at.distance**2 + by_distance * X / at.distance)
    by_star[:, 0, 1] = -along * lean / at.reach
    by_star[:, 0, 2] = along * (X / at.distance**2 + by_distance * Z / at.distance)
    by_star[:, 1, 0] = by_depth * X / at.reach
    by_star[:, 1, 1] = upwards / at.depth - by_depth * at.aside * lean / at.reach
    by_star[:, 1, 2] = by_depth * Z / at.reach
    return by_star


PANORAMA = CameraModel(
    key="panorama",
    components=(
        *(Component(name, IMAGE) for name in ("c", "xh", "yh")),
        Component("rate", NUMBER),
        *(Component(name, LENGTH) for name in ("ahead", "aside")),
        *(Component(name, NUMBER) for name in ("lean", "pitch")),
        Component("A1", Quantity(image=-2)),
        Component("A2", Quantity(image=-4)),
        *(Component(name, NUMBER) for name in ("a1", "b1", "a2", "b2")),
    ),
    constants=(),
    project=project_panorama,
    sees_behind=True,
    central=False,
    corrects_measured=True,
)
"""Camera model ``panorama``."""
