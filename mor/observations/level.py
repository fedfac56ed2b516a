"""Observed level of a frame: its tilt in instrument axes, the first two components of D e_Z (MOR 2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.frames import by_rotation
from mor.observations._contract import Computed, ObservationType, Reference, Slot
from mor.units import ANGLE, Component


def equation(blocks: Sequence[FloatArray], constants: FloatArray) -> Computed:
    """(D13, D23): zero for a levelled frame; invariant under a turn about the vertical."""
    (rotation,) = blocks
    vertical = rotation[:, :, 2]
    axes = np.broadcast_to(np.eye(3)[:2], (len(vertical), 2, 3))
    return Computed(vertical[:, :2].copy(), (by_rotation(axes, vertical),))


LEVEL = ObservationType(
    key="level",
    components=(Component("tilt_x", ANGLE), Component("tilt_y", ANGLE)),
    references=(Reference("frame", ("station", "image", "system")),),
    slots=(Slot("rotation", "frame", "rotation"),),
    equation=equation,
)
