"""Observations in plan coordinates and heights above a sphere: the twins of the plain types with `curvature`.

The blocks of positions are plan coordinates x, y and the height z (:class:`mor.model.earth.LocalSphere`). The value
of an observation is computed in three dimensions: with Cartesian positions X, the axes R of the horizon of the
instrument and the vertical u at each end,

    X_i* = R (X_i + h_i u_i − X_instrument)

are the positions that the plain type sees, without heights. A horizontal distance is the arc between the verticals of
both ends at the height of the instrument. Types that do not refer to a vertical (vectors, local
systems, image coordinates) see X_i + h_i (u_i − e_Z). Height differences and coordinates need no twin: z is the height.

The derivatives are those of the plain type, of parallel verticals. They differ from the exact ones by d/R, d the length
of the sight, and keep what a plane network leaves free exactly free: shifts, and the turn about the vertical. The
iteration evaluates the exact function, so its result does not depend on them beyond d/R of a standard deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from mor.model.contract import Computed, ObservationType
from mor.model.earth import LocalSphere
from mor.model.geodetic import End, ends_of
from mor.model.shapes import PERPENDICULAR_TYPES, SHAPE_TYPES
from mor.types import FloatArray


@cache
def on_sphere(type_: ObservationType, sphere: LocalSphere, metres: float = 1.0) -> ObservationType:
    """Return the twin of a plain type on a sphere; the type itself where it does not change.

    ``metres`` per unit of length: the default of the constant ``earth radius``, which is in metres, becomes that of
    the sphere, so that the coefficient of refraction refers to it.
    """
    cartesian = ("vector", "local", *SHAPE_TYPES, *(type_.key for type_ in PERPENDICULAR_TYPES.values()))
    about_vertical = (
        *("distance", "horizontal_distance", "distance_ratio", "directions", "zenith_directions"),
        *("bearing", "vertical_direction", "zenith_angle", "angle", "spatial_angle"),
    )
    # What the keys of image coordinates begin with.
    images = ("image/", "follower/")
    if type_.key not in (*about_vertical, *cartesian) and not type_.key.startswith(images):
        return type_
    ends = ends_of(type_)
    levelled, arc = type_.key in about_vertical, type_.key == "horizontal_distance"

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        own = list(blocks)
        axes = [sphere.local_axes(blocks[end.position]) for end in ends]
        places = [sphere.cartesian(blocks[end.position]) for end in ends]
        for end, there, place in zip(ends, axes, places, strict=True):
            height = blocks[end.height] if end.height >= 0 else np.zeros((len(place), 1))
            if levelled:
                own[end.position] = np.einsum("nij,nj->ni", axes[0], place + height * there[:, 2] - places[0])
                if end.height >= 0:
                    own[end.height] = np.zeros_like(height)
            else:
                own[end.position] = place + height * (there[:, 2] - np.array([0.0, 0.0, 1.0]))
        if arc:
            own[ends[1].position] = _arc(own, ends, sphere.radius - sphere.origin[2] + blocks[ends[0].position][:, 2])
        return Computed(type_.equation(own, constants).values, type_.equation(blocks, constants).jacobians)

    constants = tuple(
        c._replace(default=sphere.radius * metres) if c.name == "earth radius" else c for c in type_.constants
    )
    return type_._replace(equation=equation, constants=constants, about_local_vertical=True, flat=type_)


def _arc(local: Sequence[FloatArray], ends: Sequence[End], from_centre: FloatArray) -> FloatArray:
    """Return a vector (n, 3) of the length of the arc at the height of the instrument, in its horizon.

    ``local`` has the positions of instrument and target about the mark of the instrument, ``from_centre`` (n,) is the
    distance of that mark from the centre of the sphere.
    """
    start, target = (local[end.position] for end in ends)
    across = np.hypot(target[:, 0], target[:, 1])
    arc = (from_centre + start[:, 2]) * np.arctan2(across, from_centre + target[:, 2])
    return start + np.stack([arc, np.zeros_like(arc), np.zeros_like(arc)], axis=1)
