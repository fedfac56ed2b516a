"""Brown's model with the affinity, or its shear alone, after the distortion: DBAT's models 4 and 5."""

from __future__ import annotations

from functools import partial

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras._contract import CameraModel, Projection
from mor.geometry.cameras._distortion import distort
from mor.geometry.cameras._ideal import Plane, derivatives_by_star, fill_by_camera_constant, project_ideally
from mor.geometry.cameras.brown import BROWN


def project(
    star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray, before: float
) -> Projection:
    """Measured coordinates plus the residual in the corrected image, so that computed − observed = v.

    ``before`` is 1 where b1 scales before the shift of the principal point, 0 where it scales after the distortion.
    With the distortion D of :mod:`mor.geometry.cameras.brown`, b = ``before`` · b1 and a = b1 − b:

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
    undistorted = Plane(one, zero, zero, one)
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
        project=partial(project, before=before),
        corrects_measured=True,
    )


BROWN_4 = _model("brown-4", before=0.0)
"""Camera model ``brown-4``: scale and shear after the distortion."""
BROWN_5 = _model("brown-5", before=1.0)
"""Camera model ``brown-5``: scale before the shift of the principal point, shear after the distortion."""
