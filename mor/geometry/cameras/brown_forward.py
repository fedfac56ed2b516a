"""Brown's polynomials evaluated at the ideal coordinates and subtracted: DBAT's "forward" model."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras._contract import CameraModel, Projection
from mor.geometry.cameras._distortion import distort
from mor.geometry.cameras._ideal import Plane, derivatives_by_star, fill_by_camera_constant, project_ideally
from mor.units import IMAGE, Component, Quantity


def project(
    star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray
) -> Projection:
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
    plane = Plane(1.0 - distortion.xx, -distortion.xy, -distortion.xy, 1.0 - distortion.yy)

    xy = np.empty((len(star), 2))
    xy[:, 0] = interior[:, 1] + ideal.x - distortion.dx
    xy[:, 1] = interior[:, 2] + ideal.y - distortion.dy

    fill_by_camera_constant(ideal, plane, by_interior[:, :, 0])
    by_interior[:, :, 1:3] = np.eye(2)
    return Projection(xy, derivatives_by_star(ideal, plane), by_interior)


BROWN_FORWARD = CameraModel(
    key="brown-forward",
    components=(
        Component("c", IMAGE),
        Component("xh", IMAGE),
        Component("yh", IMAGE),
        Component("K1", Quantity(image=-2)),
        Component("K2", Quantity(image=-4)),
        Component("K3", Quantity(image=-6)),
        Component("P1", Quantity(image=-1)),
        Component("P2", Quantity(image=-1)),
    ),
    constants=(),
    project=project,
)
"""Camera model ``brown-forward``."""
