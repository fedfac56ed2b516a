"""Observations in plan coordinates and heights above a sphere: the twins of the plain types with `curvature`.

The blocks of positions are plan coordinates x, y and the height z (:class:`mor.geometry.earth.LocalSphere`). The value
of an observation is computed in three dimensions: with Cartesian positions X, the axes R of the horizon of the
instrument and the vertical u at each end,

    X_i* = R (X_i + h_i u_i − X_instrument)

are the positions that the plain type sees, without heights. Types that do not refer to a vertical (vectors, local
systems, image coordinates) see X_i + h_i (u_i − e_Z). Height differences and coordinates need no twin: z is the height.

The derivatives are those of the plain type, of parallel verticals. They differ from the exact ones by d/R, d the length
of the sight, and keep what a plane network leaves free exactly free: shifts, and the turn about the vertical. The
iteration evaluates the exact function, so its result does not depend on them beyond d/R of a standard deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.earth import LocalSphere
from mor.observations._contract import Computed, ObservationType
from mor.observations.earth.ends import ends_of

_ABOUT_VERTICAL = (
    "distance",
    "horizontal_distance",
    "distance_ratio",
    "directions",
    "zenith_directions",
    "bearing",
    "vertical_direction",
    "zenith_angle",
    "angle",
    "spatial_angle",
)
_CARTESIAN = ("vector", "local")
_IMAGES = ("image/", "follower/")
"""What the keys of image coordinates begin with."""
_RADIUS = "earth radius"


@cache
def on_sphere(type_: ObservationType, sphere: LocalSphere, metres: float = 1.0) -> ObservationType:
    """Return the twin of a plain type on a sphere; the type itself where it does not change.

    ``metres`` per unit of length: the default of the constant ``earth radius``, which is in metres, becomes that of
    the sphere, so that the coefficient of refraction refers to it.
    """
    if type_.key not in (*_ABOUT_VERTICAL, *_CARTESIAN) and not type_.key.startswith(_IMAGES):
        return type_
    ends = ends_of(type_)
    levelled = type_.key in _ABOUT_VERTICAL

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
        return Computed(
            type_.equation(own, constants).values, type_.equation(blocks, constants).jacobians
        )

    constants = tuple(
        c._replace(default=sphere.radius * metres) if c.name == _RADIUS else c for c in type_.constants
    )
    return type_._replace(equation=equation, constants=constants, about_local_vertical=True, flat=type_)
