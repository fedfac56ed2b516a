"""OpenCV's fisheye model (Kannala and Brandt), in this program's image axes, up to and beyond 90 degrees."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras._contract import CameraModel, Projection
from mor.units import IMAGE, NUMBER, Component


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


def project(
    star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray
) -> Projection:
    """Image coordinates x = u, y = −v, with (u, v) OpenCV's image coordinates, u right and v down.

    OpenCV's camera axes (right, down, forward) are (X*, −Y*, −Z*). With s = √(X*² + Y*²),
    θ = atan2(s, −Z*) and θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸),

        a' = θ_d X*/s,     x =  (fx (a' + alpha b') + cx)
        b' = −θ_d Y*/s,    y = −(fy b' + cy)

    All nine numbers are OpenCV's own; fx, fy, cx, cy are meant as in :mod:`mor.geometry.cameras.opencv`.
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
    return Projection(xy, _by_star(ray, stretch, slope, interior), by_interior)


def _by_star(ray: _Ray, stretch: FloatArray, slope: FloatArray, interior: FloatArray) -> FloatArray:
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
    project=project,
    sees_behind=True,
)
"""Camera model ``fisheye``."""
