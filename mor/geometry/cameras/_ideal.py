"""The ideal central projection, and the chain rule from the ideal image to the image point's derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray


class IdealImage(NamedTuple):
    """Distortion-free image coordinates of n points and what their derivatives need; every field is (n,)."""

    x: FloatArray
    """x_s = −c X*/Z*."""
    y: FloatArray
    """y_s = −c Y*/Z*."""
    x_by_c: FloatArray
    """∂x_s/∂c = −X*/Z*."""
    y_by_c: FloatArray
    """∂y_s/∂c = −Y*/Z*."""
    scale: FloatArray
    """∂x_s/∂X* = ∂y_s/∂Y* = −c/Z*: image length per object length."""
    inverse_depth: FloatArray
    """−1/Z*, positive in front of the camera."""


class Plane(NamedTuple):
    """Derivatives of final image coordinates (x, y) by ideal ones (x_s, y_s); every field is (n,)."""

    xx: FloatArray
    xy: FloatArray
    """∂x/∂y_s."""
    yx: FloatArray
    """∂y/∂x_s."""
    yy: FloatArray


def project_ideally(star: FloatArray, camera_constant: FloatArray) -> IdealImage:
    """Central projection x_s = −c X*/Z*, y_s = −c Y*/Z* of the points ``star`` (n, 3), with c (n,).

    Source: Wester-Ebbinghaus 1984, equation (2). A point with Z* = 0 has no image; the caller leaves it out.
    """
    inverse_depth = -1.0 / star[:, 2]
    x_by_c = star[:, 0] * inverse_depth
    y_by_c = star[:, 1] * inverse_depth
    scale = camera_constant * inverse_depth
    return IdealImage(
        camera_constant * x_by_c, camera_constant * y_by_c, x_by_c, y_by_c, scale, inverse_depth
    )


def derivatives_by_star(ideal: IdealImage, plane: Plane) -> FloatArray:
    """Derivatives (n, 2, 3) of the image coordinates by X*, Y*, Z*.

    With s = −c/Z*, ∂(x_s, y_s)/∂(X*, Y*, Z*) = [[s, 0, −x_s/Z*], [0, s, −y_s/Z*]], multiplied from the left
    by ``plane``.
    """
    by_star = np.empty((len(ideal.x), 2, 3))
    x_by_depth = ideal.x * ideal.inverse_depth
    y_by_depth = ideal.y * ideal.inverse_depth
    by_star[:, 0, 0] = plane.xx * ideal.scale
    by_star[:, 0, 1] = plane.xy * ideal.scale
    by_star[:, 0, 2] = plane.xx * x_by_depth + plane.xy * y_by_depth
    by_star[:, 1, 0] = plane.yx * ideal.scale
    by_star[:, 1, 1] = plane.yy * ideal.scale
    by_star[:, 1, 2] = plane.yx * x_by_depth + plane.yy * y_by_depth
    return by_star


def fill_by_camera_constant(ideal: IdealImage, plane: Plane, out: FloatArray) -> None:
    """Write the derivatives of the image coordinates by c into ``out`` (n, 2)."""
    out[:, 0] = plane.xx * ideal.x_by_c + plane.xy * ideal.y_by_c
    out[:, 1] = plane.yx * ideal.x_by_c + plane.yy * ideal.y_by_c
