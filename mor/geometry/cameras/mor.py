"""The camera model of MOR: distortion added to, and evaluated at, the ideal image coordinates."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras._contract import CameraModel, Projection
from mor.geometry.cameras._distortion import distort
from mor.geometry.cameras._ideal import Plane, derivatives_by_star, fill_by_camera_constant, project_ideally
from mor.units import IMAGE, NUMBER, Component, Quantity


def project(
    star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray
) -> Projection:
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
    plane = Plane(1.0 + distortion.xx + c1, distortion.xy + c2, distortion.xy, 1.0 + distortion.yy)

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
    project=project,
)
"""Camera model ``mor``."""
