"""The FOV camera of Devernay and Faugeras, as COLMAP has it, in this program's image axes."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras._contract import CameraModel, Projection
from mor.units import IMAGE, NUMBER, Component

_SERIES = 0.01
"""Below this q the series of h and h' is exact to the last digit: its first term left out is q⁹/19."""
_TERMS = 9


def _arctangent(q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """h = atan(√q)/√q and dh/dq, both (n,), for q ≥ 0; at q = 0 they are 1 and −1/3."""
    small = q < _SERIES
    safe = np.where(small, 1.0, q)
    root = np.sqrt(safe)
    h = np.arctan(root) / root
    slope = (1.0 / (1.0 + safe) - h) / (2.0 * safe)
    near = np.where(small, q, 0.0)
    signs = [(-1.0) ** i / (2 * i + 1) for i in range(_TERMS + 1)]
    h_near = np.polynomial.polynomial.polyval(near, signs)
    slope_near = np.polynomial.polynomial.polyval(near, [i * signs[i] for i in range(1, _TERMS + 1)])
    return np.where(small, h_near, h), np.where(small, slope_near, slope)


def project(
    star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray
) -> Projection:
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
    components=(
        *(Component(name, IMAGE) for name in ("fx", "fy", "cx", "cy")),
        Component("omega", NUMBER),
    ),
    constants=(),
    project=project,
)
"""Camera model ``fov``."""
