"""Coordinates in a local system: planes, lines, right angles, transferred coordinates (MOR 1.5)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.geometry.arrays import FloatArray
from mor.geometry.frames import by_rotation
from mor.observations._between import POSITIONS
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.units import LENGTH, Component



def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """(X̄, Ȳ, Z̄) = λ D (X − X0)."""
    origin, rotation, scale, point = blocks
    turned = np.einsum("nij,nj->ni", rotation, point - origin)
    to_point = scale[:, :, None] * rotation
    scaled = np.broadcast_to(np.eye(3), rotation.shape) * scale[:, :, None]
    return Computed(
        scale * turned, (-to_point, by_rotation(scaled, turned), turned[:, :, None], to_point)
    )


LOCAL = ObservationType(
    key="local",
    components=(Component("x", LENGTH), Component("y", LENGTH), Component("z", LENGTH)),
    references=(Reference("system", ("system",)), Reference("point", POSITIONS)),
    slots=(
        Slot("point", "system", "position"),
        Slot("rotation", "system", "rotation"),
        Slot("scale", "system", "scale"),
        Slot("point", "point", "position"),
    ),
    equation=equation,
)
