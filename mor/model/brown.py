"""Camera models after Brown: radial and decentring distortion, affinity and shear."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from mor.model.lens import (
    CameraModel,
    PlaneDerivatives,
    Projection,
    derivatives_by_star,
    distort,
    fill_by_camera_constant,
    project_ideally,
)
from mor.types import FloatArray
from mor.units import IMAGE, NUMBER, Component, Quantity

# ---- Brown's model at the measured image coordinates, as PhotoModeler and DBAT (model 3) have it.


class _Correction(NamedTuple):
    """The corrected image coordinates (x_c, y_c) of measured ones; every plain field is (n,)."""

    x: FloatArray
    y: FloatArray
    by_measured: PlaneDerivatives
    by_affine_x: FloatArray
    """(n, 2) derivatives of (x_c, y_c) by the x coordinate behind the affinity."""
    reduced: tuple[FloatArray, FloatArray]
    """x', y': measured coordinates reduced to the principal point."""


def _correct(interior: FloatArray, measured: FloatArray, by_coefficients: FloatArray) -> _Correction:
    _, xh, yh, _, _, _, _, _, b1, b2 = interior.T
    x_reduced, y_reduced = measured[:, 0] - xh, measured[:, 1] - yh
    x, y = (1.0 + b1) * x_reduced + b2 * y_reduced, y_reduced
    distortion = distort(x, y, interior[:, 3:8], 0.0, by_coefficients)
    xx, yy = 1.0 + distortion.xx, 1.0 + distortion.yy
    by_measured = PlaneDerivatives(
        xx=xx * (1.0 + b1), xy=xx * b2 + distortion.xy, yx=distortion.xy * (1.0 + b1), yy=distortion.xy * b2 + yy
    )
    by_affine_x = np.column_stack((xx, distortion.xy))
    return _Correction(x + distortion.dx, y + distortion.dy, by_measured, by_affine_x, (x_reduced, y_reduced))


def project_brown(star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray) -> Projection:
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
    undistorted = PlaneDerivatives(one, zero, zero, one)
    fill_by_camera_constant(ideal, undistorted, by_interior[:, :, 0])
    # ∂v/∂(x_H, y_H) = +∂(x_c, y_c)/∂(x, y): moving the principal point moves the point the other way
    by_measured = correction.by_measured
    by_interior[:, 0, 1], by_interior[:, 0, 2] = by_measured.xx, by_measured.xy
    by_interior[:, 1, 1], by_interior[:, 1, 2] = by_measured.yx, by_measured.yy
    for column, reduced in enumerate(correction.reduced, start=8):
        by_interior[:, :, column] = -correction.by_affine_x * reduced[:, np.newaxis]
    return Projection(xy, derivatives_by_star(ideal, undistorted), by_interior)


def residuals_in_measured_image(residuals: FloatArray, interior: FloatArray, measured: FloatArray) -> FloatArray:
    """Carry residuals (n, 2) of the corrected image to the measured one: w = J⁻¹ v, J = ∂(x_c, y_c)/∂(x, y).

    ``interior`` (n, 10) and ``measured`` (n, 2) as in :func:`project_brown`; the result (n, 2) is in image units,
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
    project=project_brown,
    corrects_measured=True,
)
"""Camera model ``brown``."""


# ---- Brown's model with the affinity, or its shear alone, after the distortion: DBAT's models 4 and 5.


def project_affine_after(
    star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray, before: float
) -> Projection:
    """Measured coordinates plus the residual in the corrected image, so that computed − observed = v.

    ``before`` is 1 where b1 scales before the shift of the principal point, 0 where it scales after the distortion.
    With the distortion D of :mod:`mor.model.brown`, b = ``before`` · b1 and a = b1 − b:

        x' = (1 + b) x − x_H,  y' = y − y_H,  (x_d, y_d) = (x', y') + D(x', y')
        x_c = (1 + a) x_d + b2 y_d,  y_c = y_d
        v   = (−c X*/Z* − x_c, −c Y*/Z* − y_c)

    ``star`` (n, 3); ``interior`` (n, 10) = c, xh, yh, K1, K2, K3, P1, P2, b1, b2; ``constants`` (n, 0);
    ``measured`` (n, 2). Source: Börlin and Grussenmeyer's DBAT, models 4 and 5.
    """
    c, xh, yh, _, _, _, _, _, b1, b2 = interior.T
    stretched, after = 1.0 + before * b1, 1.0 + (1.0 - before) * b1
    x, y = stretched * measured[:, 0] - xh, measured[:, 1] - yh
    by_interior = np.empty((len(star), 2, 10))
    terms = by_interior[:, :, 3:8]
    distortion = distort(x, y, interior[:, 3:8], 0.0, terms)
    terms[:, 0] = after[:, np.newaxis] * terms[:, 0] + b2[:, np.newaxis] * terms[:, 1]
    np.negative(terms, out=terms)
    x_d, y_d = x + distortion.dx, y + distortion.dy
    xx, xy, yy = 1.0 + distortion.xx, distortion.xy, 1.0 + distortion.yy

    ideal = project_ideally(star, c)
    xy_computed = measured + np.column_stack((ideal.x - after * x_d - b2 * y_d, ideal.y - y_d))
    one, zero = np.ones(len(star)), np.zeros(len(star))
    undistorted = PlaneDerivatives(one, zero, zero, one)
    fill_by_camera_constant(ideal, undistorted, by_interior[:, :, 0])
    # moving the principal point moves the reduced point the other way: ∂v/∂(x_H, y_H) = +∂(x_c, y_c)/∂(x', y')
    by_interior[:, 0, 1], by_interior[:, 0, 2] = after * xx + b2 * xy, after * xy + b2 * yy
    by_interior[:, 1, 1], by_interior[:, 1, 2] = xy, yy
    by_interior[:, :, 8] = -before * measured[:, :1] * by_interior[:, :, 1]
    by_interior[:, 0, 8] -= (1.0 - before) * x_d
    by_interior[:, 0, 9], by_interior[:, 1, 9] = -y_d, 0.0
    return Projection(xy_computed, derivatives_by_star(ideal, undistorted), by_interior)


def _model(key: str, before: float) -> CameraModel:
    return CameraModel(
        key=key,
        components=BROWN.components,
        constants=(),
        project=partial(project_affine_after, before=before),
        corrects_measured=True,
    )


BROWN_4 = _model("brown-4", before=0.0)
"""Camera model ``brown-4``: scale and shear after the distortion."""
BROWN_5 = _model("brown-5", before=1.0)
"""Camera model ``brown-5``: scale before the shift of the principal point, shear after the distortion."""


# ---- Brown's polynomials evaluated at the ideal coordinates and subtracted: DBAT's "forward" model.


def project_forward(star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray) -> Projection:
    """Image coordinates x = x_H + x_s − dx, y = y_H + y_s − dy with x_s = −c X*/Z*, y_s = −c Y*/Z*, c > 0.

    With r² = x_s² + y_s²,

        dx = x_s (K1 r² + K2 r⁴ + K3 r⁶) + P1 (r² + 2 x_s²) + 2 P2 x_s y_s
        dy = y_s (K1 r² + K2 r⁴ + K3 r⁶) + P2 (r² + 2 y_s²) + 2 P1 x_s y_s

    The signs are those of ``brown``, a correction, so positive K1 is barrel distortion; the model is MOR's
    with A = −K, B = −P, r0 = 0. The K and P of the two Brown models agree in the first order of the
    distortion only.

    ``star`` (n, 3); ``interior`` (n, 8) = c, xh, yh, K1, K2, K3, P1, P2; ``constants`` (n, 0); ``measured``
    (n, 2) is not looked at.

    Source: Brown 1971; the form as in Börlin and Grussenmeyer's DBAT, model −1.
    """
    by_interior = np.empty((len(star), 2, 8))
    ideal = project_ideally(star, interior[:, 0])
    distortion = distort(ideal.x, ideal.y, interior[:, 3:8], 0.0, by_interior[:, :, 3:8])
    np.negative(by_interior[:, :, 3:8], out=by_interior[:, :, 3:8])
    plane = PlaneDerivatives(1.0 - distortion.xx, -distortion.xy, -distortion.xy, 1.0 - distortion.yy)

    xy = np.empty((len(star), 2))
    xy[:, 0] = interior[:, 1] + ideal.x - distortion.dx
    xy[:, 1] = interior[:, 2] + ideal.y - distortion.dy

    fill_by_camera_constant(ideal, plane, by_interior[:, :, 0])
    by_interior[:, :, 1:3] = np.eye(2)
    return Projection(xy, derivatives_by_star(ideal, plane), by_interior)


BROWN_FORWARD = CameraModel(
    key="brown-forward",
    components=BROWN.components[:8],  # no affinity
    constants=(),
    project=project_forward,
)
"""Camera model ``brown-forward``."""


# ---- The camera model of MOR: distortion added to, and evaluated at, the ideal image coordinates.


def project_mor(star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray) -> Projection:
    """Image coordinates x = x_H + x_s + dx, y = y_H + y_s + dy with x_s = −c X*/Z*, y_s = −c Y*/Z*, c > 0.

    With r² = x_s² + y_s² and q = A1 (r² − r0²) + A2 (r⁴ − r0⁴) + A3 (r⁶ − r0⁶),

        dx = x_s q + B1 (r² + 2 x_s²) + 2 B2 x_s y_s + C1 x_s + C2 y_s
        dy = y_s q + B2 (r² + 2 y_s²) + 2 B1 x_s y_s

    ``star`` (n, 3); ``interior`` (n, 10) = c, xh, yh, A1, A2, A3, B1, B2, C1, C2; ``constants`` (n, 1) = r0;
    ``measured`` (n, 2) is not looked at. r0, the second zero crossing of the radial distortion, is a choice
    of parametrisation (it couples A and c), not an unknown.

    Source: Wester-Ebbinghaus 1984, equation (2); distortion terms after Wester-Ebbinghaus 1981.
    """
    c, xh, yh, _, _, _, _, _, c1, c2 = interior.T
    by_interior = np.empty((len(star), 2, 10))
    ideal = project_ideally(star, c)
    distortion = distort(ideal.x, ideal.y, interior[:, 3:8], constants[:, 0], by_interior[:, :, 3:8])
    plane = PlaneDerivatives(1.0 + distortion.xx + c1, distortion.xy + c2, distortion.xy, 1.0 + distortion.yy)

    xy = np.empty((len(star), 2))
    xy[:, 0] = xh + ideal.x + distortion.dx + c1 * ideal.x + c2 * ideal.y
    xy[:, 1] = yh + ideal.y + distortion.dy

    fill_by_camera_constant(ideal, plane, by_interior[:, :, 0])
    by_interior[:, :, 1:3] = np.eye(2)
    by_interior[:, 0, 8] = ideal.x
    by_interior[:, 0, 9] = ideal.y
    by_interior[:, 1, 8:] = 0.0
    return Projection(xy, derivatives_by_star(ideal, plane), by_interior)


MOR = CameraModel(
    key="mor",
    components=(
        Component("c", IMAGE),
        Component("xh", IMAGE),
        Component("yh", IMAGE),
        Component("A1", Quantity(image=-2)),
        Component("A2", Quantity(image=-4)),
        Component("A3", Quantity(image=-6)),
        Component("B1", Quantity(image=-1)),
        Component("B2", Quantity(image=-1)),
        Component("C1", NUMBER),
        Component("C2", NUMBER),
    ),
    constants=(Component("r0", IMAGE),),
    project=project_mor,
)
"""Camera model ``mor``."""


# ---- Metashape's frame camera, in this program's image axes.


class _Distorted(NamedTuple):
    """a', b' and their derivatives; every field is (n,)."""

    a: FloatArray
    b: FloatArray
    a_by_a: FloatArray
    a_by_b: FloatArray
    b_by_a: FloatArray
    b_by_b: FloatArray


def project_metashape(
    star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray
) -> Projection:
    """Image coordinates x = u − w/2, y = −(v − h/2), with (u, v) Metashape's, u right and v down from the corner.

    Metashape's camera axes (right, down, forward) are (X*, −Y*, −Z*). With a = −X*/Z*, b = Y*/Z*, r² = a² + b²,
    T = 1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸ and M = 1 + p3 r² + p4 r⁴,

        a' = a T + (p1 (r² + 2 a²) + 2 p2 a b) M,     x =  (cx + a' f + a' b1 + b' b2)
        b' = b T + (p2 (r² + 2 b²) + 2 p1 a b) M,     y = −(cy + b' f)

    All thirteen numbers are Metashape's own; its p1 and p2 are OpenCV's p2 and p1. cx, cy count from the image centre,
    right and down. ``star`` (n, 3); ``interior`` (n, 13) = f, cx, cy, b1, b2, k1, k2, k3, k4, p1, p2, p3, p4;
    ``constants`` (n, 0); ``measured`` (n, 2) is not looked at.

    Source: Agisoft Metashape User Manual, appendix "Camera models", frame cameras.
    """
    f, cx, cy, b1, b2 = interior[:, :5].T
    per_depth = -1.0 / star[:, 2]
    a, b = star[:, 0] * per_depth, -star[:, 1] * per_depth
    found = _distorted(a, b, interior)
    wide = f + b1
    xy = np.empty((len(star), 2))
    xy[:, 0] = cx + wide * found.a + b2 * found.b
    xy[:, 1] = -cy - f * found.b

    by_star = np.empty((len(star), 2, 3))
    x_by_a, x_by_b = wide * found.a_by_a + b2 * found.b_by_a, wide * found.a_by_b + b2 * found.b_by_b
    for row, (by_a, by_b) in enumerate(((x_by_a, x_by_b), (-f * found.b_by_a, -f * found.b_by_b))):
        by_star[:, row, 0] = by_a * per_depth
        by_star[:, row, 1] = -by_b * per_depth
        by_star[:, row, 2] = (by_a * a + by_b * b) * per_depth
    return Projection(xy, by_star, _by_interior(a, b, found, interior))


def _distorted(a: FloatArray, b: FloatArray, interior: FloatArray) -> _Distorted:
    k1, k2, k3, k4, p1, p2, p3, p4 = interior[:, 5:].T
    r2 = a * a + b * b
    T = 1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    T_slope = k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3 + r2 * 4.0 * k4))
    M, M_slope = 1.0 + r2 * (p3 + r2 * p4), p3 + 2.0 * p4 * r2
    side_a = p1 * (r2 + 2.0 * a * a) + 2.0 * p2 * a * b
    side_b = p2 * (r2 + 2.0 * b * b) + 2.0 * p1 * a * b
    cross = 2.0 * a * b * T_slope + 2.0 * (p1 * b + p2 * a) * M
    return _Distorted(
        a=a * T + side_a * M,
        b=b * T + side_b * M,
        a_by_a=T + 2.0 * a * a * T_slope + (6.0 * p1 * a + 2.0 * p2 * b) * M + 2.0 * a * side_a * M_slope,
        a_by_b=cross + 2.0 * b * side_a * M_slope,
        b_by_a=cross + 2.0 * a * side_b * M_slope,
        b_by_b=T + 2.0 * b * b * T_slope + (6.0 * p2 * b + 2.0 * p1 * a) * M + 2.0 * b * side_b * M_slope,
    )


def _by_interior(a: FloatArray, b: FloatArray, found: _Distorted, interior: FloatArray) -> FloatArray:
    """Derivatives (n, 2, 13) by the interior components."""
    f, b1, b2 = interior[:, 0], interior[:, 3], interior[:, 4]
    p1, p2, p3, p4 = interior[:, 9:].T
    r2 = a * a + b * b
    M = 1.0 + r2 * (p3 + r2 * p4)
    side_a = p1 * (r2 + 2.0 * a * a) + 2.0 * p2 * a * b
    side_b = p2 * (r2 + 2.0 * b * b) + 2.0 * p1 * a * b
    result = np.zeros((len(a), 2, 13))
    result[:, 0, 0], result[:, 1, 0] = found.a, -found.b
    result[:, 0, 1], result[:, 1, 2] = 1.0, -1.0
    result[:, 0, 3], result[:, 0, 4] = found.a, found.b
    moves = [(a * r2**k, b * r2**k) for k in (1, 2, 3, 4)]
    moves += [((r2 + 2.0 * a * a) * M, 2.0 * a * b * M), (2.0 * a * b * M, (r2 + 2.0 * b * b) * M)]
    moves += [(side_a * r2, side_b * r2), (side_a * r2 * r2, side_b * r2 * r2)]
    for column, (da, db) in enumerate(moves, start=5):
        result[:, 0, column] = (f + b1) * da + b2 * db
        result[:, 1, column] = -f * db
    return result


METASHAPE = CameraModel(
    key="metashape",
    components=(
        *(Component(name, IMAGE) for name in ("f", "cx", "cy", "b1", "b2")),
        *(Component(name, NUMBER) for name in ("k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4")),
    ),
    constants=(),
    project=project_metashape,
)
"""Camera model ``metashape``."""
