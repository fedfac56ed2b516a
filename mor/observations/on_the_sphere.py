"""Image rays as directions: what a camera sees, as a theodolite in its place would have it.

Coordinates x = −c X*/Z* run away where a point comes near the plane of the camera, and come back on the other side:
from bad start values least squares climbs over that ridge, or comes to rest behind it. The direction d = X*/|X*| of
the point is as smooth as it is bounded. Computed − observed is the arc θ from the measured ray u to d, in two axes
across d,

    y = −θ Eᵀ u / sin θ,   cos θ = u · d,

the logarithmic map of the sphere. The axes E(d) come along with d, and the Jacobian is taken for Eᵀ ∂d: then Jᵀy is
exactly the gradient of ½ θ², and JᵀJ is never less than its curvature, which is 1 along the arc and θ cot θ ≤ 1
across it (H. Karcher 1977). So a Gauss-Newton step does not overshoot on the sphere, however far off the ray is. The
interior orientation is taken as it is.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.cameras import CAMERA_MODELS, CameraModel, Projection
from mor.observations._contract import ObservationType
from mor.observations.image import FOLLOWER_SLOTS, IMAGE_TYPES, image_coordinates
from mor.observations.time.rolling_shutter import MOVING
from mor.units import NUMBER, Component

RAY = tuple(Component(f"ray {c}", NUMBER) for c in "xyz")
"""Constants of a row: the measured ray u, of unit length."""
_KEY = "on the sphere "
_FRAMES = ("image", "follower")


@cache
def on_the_sphere(type_: ObservationType) -> ObservationType | None:
    """The type with the same slots and directions in place of image coordinates.

    ``None`` of points that are at infinity, or move, and of images on a trajectory. What is read out row by row is
    taken for a frame.
    """
    form, _, key = type_.key.partition("/")
    if key not in CAMERA_MODELS or type_.still is not None or form not in (*_FRAMES, MOVING):
        return None
    if form == MOVING:
        return on_the_sphere(IMAGE_TYPES[key])
    model = CAMERA_MODELS[key]._replace(project=_arcs, constants=RAY)
    found = image_coordinates(model, FOLLOWER_SLOTS if form == "follower" else ())
    return found._replace(key=_KEY + type_.key)


def is_on_the_sphere(type_: ObservationType) -> bool:
    """True for types that :func:`on_the_sphere` has made."""
    return type_.key.startswith(_KEY)


def stereographic(rays: FloatArray) -> FloatArray:
    """(n, 2) coordinates of unit rays (n, 3), which stand in place of the measured ones: 0 where a camera looks to."""
    return np.asarray(rays[:, :2] / np.maximum(1.0 - rays[:, 2:], 1e-300))


def image_scale(
    model: CameraModel, rays: FloatArray, interior: FloatArray, constants: FloatArray
) -> FloatArray:
    """(n,) image units per radian at unit rays (n, 3), in the mean; ``constants`` as image rows have them."""
    projection = model.project(rays, interior, constants[:, 2:], constants[:, :2])
    across = np.swapaxes(_axes_across(rays), 1, 2)
    scale: FloatArray = np.sqrt(np.abs(np.linalg.det(projection.by_star @ across)))
    return scale


def _arcs(star: FloatArray, interior: FloatArray, constants: FloatArray, measured: FloatArray) -> Projection:
    """The arcs (n, 2) from the measured rays, and their derivatives in axes that come along."""
    length = np.linalg.norm(star, axis=1)
    length[length == 0.0] = 1.0
    direction = star / length[:, None]
    axes = _axes_across(direction)
    across = np.einsum("nki,ni->nk", axes, constants)
    sine = np.linalg.norm(across, axis=1)
    arc = np.arctan2(sine, np.einsum("ni,ni->n", constants, direction))
    stretch = np.where(sine > 0.0, arc / np.where(sine > 0.0, sine, 1.0), 1.0)
    by_interior = np.zeros((len(star), 2, interior.shape[1]))
    return Projection(-stretch[:, None] * across, axes / length[:, None, None], by_interior)


def _axes_across(direction: FloatArray) -> FloatArray:
    """Two orthonormal axes (n, 2, 3) across unit vectors (n, 3), without a case (T. Duff et al. 2017)."""
    x, y, z = direction.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    axes = np.empty((len(direction), 2, 3))
    axes[:, 0] = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    axes[:, 1] = np.stack([b, sign + y * y * a, -y], axis=1)
    return axes
