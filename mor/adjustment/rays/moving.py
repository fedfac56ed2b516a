"""Image points of rolling shutters, compiled: what their equation computes, from blocks as they stand."""

from __future__ import annotations

import numpy as np

from mor.adjustment.rays.compiled import moving_rays
from mor.adjustment.rays.compiled.cameras import MODELS
from mor.arrays import SmallIntArray
from mor.observations import MOVING_TYPES, Computed, ObservationGroup
from mor.parameters.index import Values


def compiled_model(group: ObservationGroup) -> int:
    """Number of the compiled camera model of a group of moving images, −1 where there is none."""
    return next((number for key, number in MODELS.items() if group.type is MOVING_TYPES[key]), -1)


def computed_moving(group: ObservationGroup, model: int, values: Values, rows: SmallIntArray) -> Computed:
    """The same as the equation of the type, for the rows (n,) of a group."""
    kinds = [slot.kind for slot in group.type.slots[:-1]]
    arrays = [np.ascontiguousarray(values[kind].reshape(len(values[kind]), -1)) for kind in kinds]
    blocks = np.stack([numbers[rows] for numbers in group.blocks]).astype(np.int64)
    constants = group.constants[rows]
    r0 = np.ascontiguousarray(constants[:, 2]) if constants.shape[1] > 5 else np.zeros(len(rows))
    size = arrays[-1].shape[1]
    found, jacobian = np.empty((len(rows), 2)), np.empty((len(rows), 2, 20 + size))
    measured, clock = np.ascontiguousarray(constants[:, :2]), np.ascontiguousarray(constants[:, -3:])
    place = moving_rays.MovingValues(*arrays)
    moving_rays.compute(model, place, blocks, measured, r0, clock, found, jacobian)
    ends = np.cumsum([*moving_rays.COLUMNS, size])
    return Computed(found, tuple(np.split(jacobian, ends, axis=2)))
