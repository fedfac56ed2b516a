"""Observations about the vertical of their place: the twins of the terrestrial types on the earth.

What an instrument measures refers to the vertical where it stands, and instrument and target are above their marks
along the verticals there. With the local axes R (east, north, up; of the plumb line where its deflection is given) at
the instrument, and the direction u_i to the zenith at each end,

    X_i* = R (X_i + h_i u_i − X_instrument)

are the positions the plain type sees, without heights. R and u are evaluated at the adjusted places; that they turn by
1/R_earth with every metre the place moves stays out of the Jacobian, never out of the function.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.earth import Horizon
from mor.observations._contract import Computed, ObservationType
from mor.observations.earth.ends import DEFLECTIONS, end_constants, ends_of
from mor.units import Component


def about_plumb_line(type_: ObservationType, horizon: Horizon) -> ObservationType:
    """The twin of a type about the plumb line; constants besides its own: ξ, η at each end."""
    further = end_constants([end.name for end in ends_of(type_)], DEFLECTIONS)
    return _about_vertical(type_, horizon, (*type_.constants, *further))


def about_normal(type_: ObservationType, horizon: Horizon) -> ObservationType:
    """The twin of a type about the normal of the ellipsoid."""
    return _about_vertical(type_, horizon, type_.constants)


def _about_vertical(
    type_: ObservationType, horizon: Horizon, constants: tuple[Component, ...]
) -> ObservationType:
    ends, own_constants = ends_of(type_), len(type_.constants)
    deflected = len(constants) > own_constants

    def equation(blocks: Sequence[FloatArray], given: FloatArray) -> Computed:
        own = list(blocks)
        station = blocks[ends[0].position]
        axes = []
        for k, end in enumerate(ends):
            first = own_constants + 2 * k
            deflection = given[:, first : first + 2] if deflected else None
            axes.append(horizon.local_axes(blocks[end.position], deflection))
        for end, there in zip(ends, axes, strict=True):
            vector = blocks[end.position] - station
            if end.height >= 0:
                vector = vector + blocks[end.height] * there[:, 2]
                own[end.height] = np.zeros_like(blocks[end.height])
            own[end.position] = np.einsum("nij,nj->ni", axes[0], vector)
        computed = type_.equation(own, given[:, :own_constants])
        jacobians = list(computed.jacobians)
        for end, there in zip(ends, axes, strict=True):
            jacobians[end.position] = jacobians[end.position] @ axes[0]
            if end.height >= 0:
                jacobians[end.height] = jacobians[end.position] @ there[:, 2][:, :, None]
        return Computed(computed.values, tuple(jacobians))

    return type_._replace(constants=constants, equation=equation, about_local_vertical=True)
