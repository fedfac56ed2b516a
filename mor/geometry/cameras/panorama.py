"""A panorama: a line camera that turns about an axis and lays its lines side by side on a cylinder."""

from __future__ import annotations

from typing import NamedTuple

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

    along = per_radian * (1.0 + np.sum(interior[:, 10:] * _slopes(waves), axis=1))  # ∂x/∂α
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
    by_star = _by_star(star, interior[:, 6], at, along, upwards)
    return Projection(np.stack([x + 2.0 * np.pi * per_radian * turns, y], axis=1), by_star, by_interior)


class _Turned(NamedTuple):
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


def _turned_to(star: FloatArray, interior: FloatArray) -> _Turned:
    X, Y, Z = star.T
    ahead, aside, lean = interior[:, 4:7].T
    distance, s = np.hypot(X, Z), aside + lean * Y
    with np.errstate(invalid="ignore", divide="ignore"):
        reach = np.sqrt(distance**2 - s**2)
        angle = np.arctan2(X, -Z) - np.arcsin(s / distance)
    angle = angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))
    depth = np.where(reach > ahead, reach - ahead, np.nan)
    return _Turned(angle, s, distance, reach, depth, Y / depth)


def _by_star(
    star: FloatArray, lean: FloatArray, at: _Turned, along: FloatArray, upwards: FloatArray
) -> FloatArray:
    """Derivatives (n, 2, 3) by X*, Y*, Z*, with ∂x/∂α ``along`` and ∂y/∂t ``upwards``."""
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
