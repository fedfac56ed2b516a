"""A panorama: a line camera that turns about an axis and lays its lines side by side on a cylinder."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras._contract import CameraModel, Projection
from mor.units import IMAGE, LENGTH, NUMBER, Component, Quantity


def project(
    star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray
) -> Projection:
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
    X, Y, Z = star.T
    c, xh, yh, rate, ahead, aside, lean, pitch, A1, A2 = interior[:, :10].T
    per_radian = c * (1.0 + rate)
    rho = np.hypot(X, Z)
    s = aside + lean * Y
    with np.errstate(invalid="ignore", divide="ignore"):
        reach = np.sqrt(rho**2 - s**2)
        alpha = np.arctan2(X, -Z) - np.arcsin(s / rho)
    alpha = alpha - 2.0 * np.pi * np.round(alpha / (2.0 * np.pi))
    depth = reach - ahead
    depth = np.where(depth > 0.0, depth, np.nan)
    t = Y / depth
    u = (t * np.cos(pitch) - np.sin(pitch)) / (np.cos(pitch) + t * np.sin(pitch))
    waves = np.stack([np.sin(alpha), np.cos(alpha), np.sin(2.0 * alpha), np.cos(2.0 * alpha)], axis=1)
    turned = alpha + np.sum(interior[:, 10:] * waves, axis=1)
    full = 2.0 * np.pi * per_radian
    x = xh + per_radian * turned
    turns = np.nan_to_num(np.round((measured[:, 0] - x) / full))
    ys = c * u
    stretch = 1.0 + ys**2 * (A1 + ys**2 * A2)
    slope = 1.0 + ys**2 * (3.0 * A1 + 5.0 * ys**2 * A2)
    xy = np.stack([x + turns * full, yh + ys * stretch], axis=1)

    along = per_radian * (1.0 + np.sum(interior[:, 10:] * _slopes(waves), axis=1))
    upwards = slope * c * (1.0 + u**2) / (1.0 + t**2)
    by_star = np.empty((len(star), 2, 3))
    by_rho = s / (rho * reach)  # ∂α/∂ρ
    by_star[:, 0, 0] = along * (-Z / rho**2 + by_rho * X / rho)
    by_star[:, 0, 1] = along * -lean / reach
    by_star[:, 0, 2] = along * (X / rho**2 + by_rho * Z / rho)
    by_depth = -upwards * t / depth
    by_star[:, 1, 0] = by_depth * X / reach
    by_star[:, 1, 1] = upwards / depth - by_depth * s * lean / reach
    by_star[:, 1, 2] = by_depth * Z / reach

    by_interior = np.zeros((len(star), 2, interior.shape[1]))
    by_interior[:, 0, 0] = (1.0 + rate) * (turned + 2.0 * np.pi * turns)
    by_interior[:, 1, 0] = slope * u
    by_interior[:, 0, 1] = by_interior[:, 1, 2] = 1.0
    by_interior[:, 0, 3] = c * (turned + 2.0 * np.pi * turns)
    by_interior[:, 1, 4] = -by_depth
    for column, by_s in ((5, np.ones_like(Y)), (6, Y)):
        by_interior[:, 0, column] = -along * by_s / reach
        by_interior[:, 1, column] = -by_depth * s * by_s / reach
    by_interior[:, 1, 7] = -slope * c * (1.0 + u**2)
    by_interior[:, 1, 8], by_interior[:, 1, 9] = ys**3, ys**5
    by_interior[:, 0, 10:] = per_radian[:, None] * waves
    return Projection(xy, by_star, by_interior)


def _slopes(waves: FloatArray) -> FloatArray:
    """Derivatives (n, 4) of sin α, cos α, sin 2α, cos 2α by α."""
    return np.stack([waves[:, 1], -waves[:, 0], 2.0 * waves[:, 3], -2.0 * waves[:, 2]], axis=1)


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
    project=project,
    sees_behind=True,
    central=False,
    corrects_measured=True,
)
"""Camera model ``panorama``."""
