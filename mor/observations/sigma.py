"""σ models: what depends on the length of the sight is added once, at the start values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mor.geometry.arrays import FloatArray
from mor.observations._contract import ObservationGroup
from mor.parameters.index import Values


def with_sigma_model(group: ObservationGroup, values: Values) -> ObservationGroup:
    """The group with σ² = a² + (b·d)² + centring², d the distance between its two positions at the given values.

    For angular components a centring error e acts as e/d; horizontal angles take the shorter of their two legs into
    account through both (the error at the station counts once for the leg named by the type).
    """
    if group.ppm == 0.0 and group.centring == (0.0, 0.0):
        return group
    distance = _distances(group, values)
    along = (group.ppm * 1e-6 * distance) ** 2 + sum(error**2 for error in group.centring)
    across = (
        sum(error**2 for error in group.centring) / np.maximum(distance, np.finfo(float).tiny ** 0.5) ** 2
    )
    angular = group.type.wraps
    extra = np.where(angular[None, :], across[:, None], along[:, None])
    return replace(group, sigma=np.sqrt(group.sigma**2 + extra))


def _distances(group: ObservationGroup, values: Values) -> FloatArray:
    ends = group.type.distances or ()
    positions = []
    for end in ends:
        for slot, number in zip(group.type.slots, group.blocks, strict=True):
            if slot.of == end and slot.part == "position":
                positions.append(values[slot.kind][number])
    length: FloatArray = np.linalg.norm(positions[1] - positions[0], axis=1)
    return length
