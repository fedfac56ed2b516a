"""The contract of camera models, and the parts that several of them share."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mor.types import FloatArray
from mor.units import Component

# ---- Define a camera model: names of its interior parameters and one vectorised projection.


class Projection(NamedTuple):
    """Computed image coordinates of n points and their derivatives."""

    xy: FloatArray
    """(n, 2) image coordinates, image unit of the camera, x right, y up."""
    by_star: FloatArray
    """(n, 2, 3) derivatives by X*, Y*, Z*, the point in the image system."""
    by_interior: FloatArray
    """(n, 2, k) derivatives by the k interior components."""


class CameraModel(NamedTuple):
    """A camera model as a value.

    ``project(star, interior, constants, measured)`` takes the points in the image system (n, 3), the interior
    components (n, k), the constants of the camera (n, q) and the measured image coordinates (n, 2), and returns
    a :class:`Projection`. A model that corrects the *measured* coordinates (Brown) returns computed values moved
    back to the measured ones, so that computed − observed is the residual in its own corrected image.
    """

    key: str
    components: tuple[Component, ...]
    constants: tuple[Component, ...]
    project: Callable[[FloatArray, FloatArray, FloatArray, FloatArray], Projection]
    sees_behind: bool = False
    """True if points with Z* ≥ 0 can be imaged (fisheye beyond 180 degrees)."""
    central: bool = True
    """True if images are central projections onto one plane but for distortion, which has a radial part."""
    corrects_measured: bool = False
    """True if ``project`` looks at the measured coordinates at all."""


# ---- The radial and decentring polynomials that MOR and both Brown models share.
#
# With r² = x² + y² and an optional second zero crossing r0 of the radial part:
#
#     dx = x [K1 (r² − r0²) + K2 (r⁴ − r0⁴) + K3 (r⁶ − r0⁶)] + P1 (r² + 2 x²) + 2 P2 x y
#     dy = y [K1 (r² − r0²) + K2 (r⁴ − r0⁴) + K3 (r⁶ − r0⁶)] + P2 (r² + 2 y²) + 2 P1 x y
#
# Source: Brown 1971; the zero crossing r0 after Wester-Ebbinghaus 1981.


class Distortion(NamedTuple):
    """dx, dy and their derivatives by x and y; every field is (n,).

    (dx, dy) is the gradient of a potential, hence ∂dx/∂y = ∂dy/∂x: one field ``xy`` holds both.
    """

    dx: FloatArray
    dy: FloatArray
    xx: FloatArray
    xy: FloatArray
    yy: FloatArray


def distort(
    x: FloatArray, y: FloatArray, coefficients: FloatArray, r0: FloatArray | float, by_coefficients: FloatArray
) -> Distortion:
    """Distortion at (x, y), each (n,), with ``coefficients`` (n, 5) = K1, K2, K3, P1, P2.

    The derivatives by the five coefficients are written into ``by_coefficients`` (n, 2, 5), usually a slice
    of a larger array. ``r0`` is (n,), or 0.0 for the plain polynomial.
    """
    k1, k2, k3, p1, p2 = coefficients.T
    xx, yy, twice_xy = x * x, y * y, 2.0 * x * y
    power2 = xx + yy
    power4 = power2 * power2
    # dq/d(r²) first: it needs the powers before the zero crossing is taken off them
    slope = k1 + 2.0 * k2 * power2 + 3.0 * k3 * power4
    zero2 = np.square(r0)
    radial = (power2 - zero2, power4 - zero2**2, power4 * power2 - zero2**3)
    q = k1 * radial[0] + k2 * radial[1] + k3 * radial[2]
    decentring_x, decentring_y = power2 + 2.0 * xx, power2 + 2.0 * yy

    for column, power in enumerate(radial):
        np.multiply(x, power, out=by_coefficients[:, 0, column])
        np.multiply(y, power, out=by_coefficients[:, 1, column])
    by_coefficients[:, 0, 3] = decentring_x
    by_coefficients[:, 1, 3] = by_coefficients[:, 0, 4] = twice_xy
    by_coefficients[:, 1, 4] = decentring_y

    p1_x, p2_y = 2.0 * p1 * x, 2.0 * p2 * y
    return Distortion(
        dx=x * q + p1 * decentring_x + p2 * twice_xy,
        dy=y * q + p2 * decentring_y + p1 * twice_xy,
        xx=q + 2.0 * xx * slope + 3.0 * p1_x + p2_y,
        xy=twice_xy * slope + 2.0 * (p1 * y + p2 * x),
        yy=q + 2.0 * yy * slope + 3.0 * p2_y + p1_x,
    )


# ---- The ideal central projection, and the chain rule from the ideal image to the image point's derivatives.


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


class PlaneDerivatives(NamedTuple):
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
    return IdealImage(camera_constant * x_by_c, camera_constant * y_by_c, x_by_c, y_by_c, scale, inverse_depth)


def derivatives_by_star(ideal: IdealImage, plane: PlaneDerivatives) -> FloatArray:
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


def fill_by_camera_constant(ideal: IdealImage, plane: PlaneDerivatives, out: FloatArray) -> None:
    """Write the derivatives of the image coordinates by c into ``out`` (n, 2)."""
    out[:, 0] = plane.xx * ideal.x_by_c + plane.xy * ideal.y_by_c
    out[:, 1] = plane.yx * ideal.x_by_c + plane.yy * ideal.y_by_c
