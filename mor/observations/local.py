"""Coordinates in a local system: planes, lines, right angles, transferred coordinates (MOR 1.5)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.frames import by_rotation
from mor.observations._between import POSITIONS
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.units import LENGTH, Component


def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """(X̄, Ȳ, Z̄) = λ D (X − X0) + r̄.

    The offset r̄ in local axes is zero for a transferred system; for a plane its third component is the distance of
    the plane from X0, which keeps the parametrisation regular for every attitude.
    """
    origin, rotation, scale, offset, point = blocks
    turned = np.einsum("nij,nj->ni", rotation, point - origin)
    to_point = scale[:, :, None] * rotation
    identity = np.broadcast_to(np.eye(3), rotation.shape)
    return Computed(
        scale * turned + offset,
        (
            -to_point,
            by_rotation(identity * scale[:, :, None], turned),
            turned[:, :, None],
            identity,
            to_point,
        ),
    )


LOCAL = ObservationType(
    key="local",
    components=(Component("x", LENGTH), Component("y", LENGTH), Component("z", LENGTH)),
    references=(Reference("system", ("system",)), Reference("point", POSITIONS)),
    slots=(
        Slot("point", "system", "position"),
        Slot("rotation", "system", "rotation"),
        Slot("scale", "system", "scale"),
        Slot("eccentricity", "system", "offset"),
        Slot("point", "point", "position"),
    ),
    equation=equation,
)
