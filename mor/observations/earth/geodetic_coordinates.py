"""Observed latitude, longitude and height of a position; heights alone, above the ellipsoid and above the geoid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.earth import Horizon
from mor.observations._between import POSITIONS
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.observations.earth.ends import GEOID, end_constants
from mor.units import ANGLE, LENGTH, Component

_POINT = (Reference("point", POSITIONS),)
_SLOT = (Slot("point", "point", "position"),)


def geodetic_position(horizon: Horizon) -> ObservationType:
    """(φ, λ, h): geodetic latitude, longitude, ellipsoidal height."""

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        geodetic = horizon.to_geodetic(blocks[0])
        by_position = horizon.local_axes(blocks[0])[:, [1, 0, 2]]
        M, N = horizon.ellipsoid.radii(geodetic[:, 0])
        by_position[:, 0] /= (M + geodetic[:, 2])[:, None]
        by_position[:, 1] /= ((N + geodetic[:, 2]) * np.cos(geodetic[:, 0]))[:, None]
        return Computed(geodetic, (by_position,))

    return ObservationType(
        key="geodetic_position",
        components=(Component("latitude", ANGLE), Component("longitude", ANGLE), Component("height", LENGTH)),
        references=_POINT,
        slots=_SLOT,
        equation=equation,
    )


def ellipsoidal_height(horizon: Horizon) -> ObservationType:
    """h, along the normal of the ellipsoid."""

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        foot = horizon.foot(blocks[0])
        return Computed(foot.height[:, None], (foot.up[:, None, :],))

    return ObservationType(
        key="ellipsoidal_height",
        components=(Component("height", LENGTH),),
        references=_POINT,
        slots=_SLOT,
        equation=equation,
    )


def orthometric_height(horizon: Horizon) -> ObservationType:
    """H = h − N, above the geoid (or quasigeoid) that N is of."""
    above_ellipsoid = ellipsoidal_height(horizon).equation

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        height = above_ellipsoid(blocks, constants)
        return Computed(height.values - constants, height.jacobians)

    return ObservationType(
        key="orthometric_height",
        components=(Component("height", LENGTH),),
        references=_POINT,
        slots=_SLOT,
        equation=equation,
        constants=end_constants(["point"], [GEOID]),
    )
