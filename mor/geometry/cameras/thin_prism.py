"""COLMAP's fisheyes with tangential and thin prism terms, in this program's image axes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras._contract import CameraModel, Projection
from mor.geometry.cameras.fisheye import project as project_equidistantly
from mor.units import IMAGE, NUMBER, Component


class _Bent(NamedTuple):
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
    plain = project_equidistantly(star, interior, np.empty((len(star), 0)), np.empty((len(star), 2)))
    down = np.array([1.0, -1.0])
    return plain.xy * down, plain.by_star * down[:, None]


def _assembled(interior: FloatArray, bent: _Bent, by_star: FloatArray) -> Projection:
    """x = fx a' + cx, y = −(fy b' + cy) with all derivatives; the components begin with fx, fy, cx, cy."""
    scale = interior[:, :2] * np.array([1.0, -1.0])
    xy = scale * bent.ab + interior[:, 2:4] * np.array([1.0, -1.0])
    by_interior = np.zeros((len(interior), 2, interior.shape[1]))
    by_interior[:, 0, 0], by_interior[:, 1, 1] = bent.ab[:, 0], -bent.ab[:, 1]
    by_interior[:, 0, 2], by_interior[:, 1, 3] = 1.0, -1.0
    by_interior[:, :, 4:] = scale[:, :, None] * bent.by_coefficients
    return Projection(xy, scale[:, :, None] * (bent.slopes @ by_star), by_interior)


def _side(
    a: FloatArray, b: FloatArray, p: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
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
    return _assembled(interior, _Bent(found, slopes, by), by_star)


def project_rad_tan(
    star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray
) -> Projection:
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
    return _assembled(interior, _Bent(found, later @ radial, by), by_star)


_PINHOLE = tuple(Component(name, IMAGE) for name in ("fx", "fy", "cx", "cy"))
_RADIAL_FIRST = ("k0", "k1", "k2", "k3", "k4", "k5", "p0", "p1", "s0", "s1", "s2", "s3")

THIN_PRISM = CameraModel(
    key="thin-prism-fisheye",
    components=(
        *_PINHOLE,
        *(Component(name, NUMBER) for name in ("k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1")),
    ),
    constants=(),
    project=project_thin_prism,
    sees_behind=True,
)
"""Camera model ``thin-prism-fisheye``."""
RAD_TAN_THIN_PRISM = CameraModel(
    key="rad-tan-thin-prism-fisheye",
    components=(*_PINHOLE, *(Component(name, NUMBER) for name in _RADIAL_FIRST)),
    constants=(),
    project=project_rad_tan,
    sees_behind=True,
)
"""Camera model ``rad-tan-thin-prism-fisheye``."""
