"""Height differences on the earth: of heights above the geoid, as levels give them, and above the ellipsoid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.earth import Horizon
from mor.observations._between import BETWEEN_SLOTS, FROM_TO
from mor.observations._contract import Computed, ObservationType
from mor.observations.earth.ends import GEOID, end_constants
from mor.units import LENGTH, Component


def ellipsoidal_height_difference(horizon: Horizon) -> ObservationType:
    """Δh = h(to) − h(from), with the heights of instrument and target above their marks."""

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        start, start_height, end, end_height = blocks
        below, above = horizon.foot(start), horizon.foot(end)
        one = np.ones((len(start), 1, 1))
        difference = (above.height - below.height)[:, None] + end_height - start_height
        return Computed(difference, (-below.up[:, None, :], -one, above.up[:, None, :], one))

    return ObservationType(
        key="ellipsoidal_height_difference",
        components=(Component("dz", LENGTH),),
        references=FROM_TO,
        slots=BETWEEN_SLOTS,
        equation=equation,
        distances=("from", "to"),
        between_marks=True,
    )


def height_difference(horizon: Horizon) -> ObservationType:
    """ΔH = Δh − (N(to) − N(from)): levelled, with the corrections of its height system already on it."""
    plain = ellipsoidal_height_difference(horizon)

    def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
        above_ellipsoid = plain.equation(blocks, constants)
        rise = constants[:, 1:] - constants[:, :1]
        return Computed(above_ellipsoid.values - rise, above_ellipsoid.jacobians)

    return ObservationType(
        key="height_difference",
        components=plain.components,
        references=plain.references,
        slots=plain.slots,
        equation=equation,
        constants=end_constants(["from", "to"], [GEOID]),
        distances=plain.distances,
        between_marks=True,
    )
