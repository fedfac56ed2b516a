"""Brown's model at the measured image coordinates, as PhotoModeler and DBAT (model 3) have it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras._contract import CameraModel, Projection
from mor.geometry.cameras._distortion import distort
from mor.geometry.cameras._ideal import Plane, derivatives_by_star, fill_by_camera_constant, project_ideally
from mor.units import IMAGE, NUMBER, Component, Quantity


class _Correction(NamedTuple):
    """The corrected image coordinates (x_c, y_c) of measured ones; every plain field is (n,)."""

    x: FloatArray
    y: FloatArray
    by_measured: Plane
    by_affine_x: FloatArray
    """(n, 2) derivatives of (x_c, y_c) by the x coordinate behind the affinity."""
    reduced: tuple[FloatArray, FloatArray]
    """x', y': measured coordinates reduced to the principal point."""


def _correct(interior: FloatArray, measured: FloatArray, by_coefficients: FloatArray) -> _Correction:
    """Correct ``measured`` (n, 2); derivatives by K1 … P2 go to ``by_coefficients`` (n, 2, 5)."""
    _, xh, yh, _, _, _, _, _, b1, b2 = interior.T
    x_reduced, y_reduced = measured[:, 0] - xh, measured[:, 1] - yh
    x, y = (1.0 + b1) * x_reduced + b2 * y_reduced, y_reduced
    distortion = distort(x, y, interior[:, 3:8], 0.0, by_coefficients)
    xx, yy = 1.0 + distortion.xx, 1.0 + distortion.yy
    by_measured = Plane(
        xx=xx * (1.0 + b1),
        xy=xx * b2 + distortion.xy,
        yx=distortion.xy * (1.0 + b1),
        yy=distortion.xy * b2 + yy,
    )
    by_affine_x = np.column_stack((xx, distortion.xy))
    return _Correction(x + distortion.dx, y + distortion.dy, by_measured, by_affine_x, (x_reduced, y_reduced))


def project(
    star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray
) -> Projection:
    """Measured coordinates plus the residual in the corrected image, so that computed − observed = v.

    The measured coordinates (x, y), y up, are reduced, sheared and corrected,

        x' = x − x_H,  y' = y − y_H,  then  x' ← (1 + b1) x' + b2 y'
        x_c = x' + x' (K1 r² + K2 r⁴ + K3 r⁶) + P1 (r² + 2 x'²) + 2 P2 x' y',   r² = x'² + y'²
        y_c = y' + y' (K1 r² + K2 r⁴ + K3 r⁶) + P2 (r² + 2 y'²) + 2 P1 x' y'

    and v = (−c X*/Z* − x_c, −c Y*/Z* − y_c). The image coordinates returned are (x, y) + v: they are *not*
    where the point would be seen; :func:`residuals_in_measured_image` carries v there. With positive K1 the
    image has barrel distortion.

    ``star`` (n, 3); ``interior`` (n, 10) = c, xh, yh, K1, K2, K3, P1, P2, b1, b2, with (x_H, y_H) the
    principal point in the image system, y up; ``constants`` (n, 0); ``measured`` (n, 2). ``by_interior``
    includes the dependence of the correction on x_H, y_H.

    Source: Brown 1971; signs and order of the affinity as in Börlin and Grussenmeyer's DBAT, model 3.
    """
    c = interior[:, 0]
    by_interior = np.empty((len(star), 2, 10))
    ideal = project_ideally(star, c)
    correction = _correct(interior, measured, by_interior[:, :, 3:8])
    np.negative(by_interior[:, :, 3:8], out=by_interior[:, :, 3:8])

    xy = np.empty((len(star), 2))
    xy[:, 0] = measured[:, 0] + ideal.x - correction.x
    xy[:, 1] = measured[:, 1] + ideal.y - correction.y

    one, zero = np.ones(len(star)), np.zeros(len(star))
    undistorted = Plane(one, zero, zero, one)
    fill_by_camera_constant(ideal, undistorted, by_interior[:, :, 0])
    # ∂v/∂(x_H, y_H) = +∂(x_c, y_c)/∂(x, y): moving the principal point moves the point the other way
    by_measured = correction.by_measured
    by_interior[:, 0, 1], by_interior[:, 0, 2] = by_measured.xx, by_measured.xy
    by_interior[:, 1, 1], by_interior[:, 1, 2] = by_measured.yx, by_measured.yy
    for column, reduced in enumerate(correction.reduced, start=8):
        by_interior[:, :, column] = -correction.by_affine_x * reduced[:, np.newaxis]
    return Projection(xy, derivatives_by_star(ideal, undistorted), by_interior)


def residuals_in_measured_image(
    residuals: FloatArray, interior: FloatArray, measured: FloatArray
) -> FloatArray:
    """Carry residuals (n, 2) of the corrected image to the measured one: w = J⁻¹ v, J = ∂(x_c, y_c)/∂(x, y).

    ``interior`` (n, 10) and ``measured`` (n, 2) as in :func:`project`; the result (n, 2) is in image units,
    adjusted − observed again. It is exact to first order in v: the correction of (measured + w) equals the
    ideal coordinates but for terms of second order.

    Where the correction folds the image (det J ≤ 0, possible only outside the area the distortion was
    determined in) no measured coordinates belong to the ideal ones and the result is nan.
    """
    by_measured = _correct(interior, measured, np.empty((len(measured), 2, 5))).by_measured
    determinant = by_measured.xx * by_measured.yy - by_measured.xy * by_measured.yx
    inverse = 1.0 / np.where(determinant > 0.0, determinant, np.nan)
    x, y = residuals.T
    moved = np.empty_like(residuals)
    moved[:, 0] = (by_measured.yy * x - by_measured.xy * y) * inverse
    moved[:, 1] = (by_measured.xx * y - by_measured.yx * x) * inverse
    return moved


BROWN = CameraModel(
    key="brown",
    components=(
        Component("c", IMAGE),
        Component("xh", IMAGE),
        Component("yh", IMAGE),
        Component("K1", Quantity(image=-2)),
        Component("K2", Quantity(image=-4)),
        Component("K3", Quantity(image=-6)),
        Component("P1", Quantity(image=-1)),
        Component("P2", Quantity(image=-1)),
        Component("b1", NUMBER),
        Component("b2", NUMBER),
    ),
    constants=(),
    project=project,
    corrects_measured=True,
)
"""Camera model ``brown``."""
