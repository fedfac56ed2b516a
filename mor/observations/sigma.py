"""σ models: what depends on the length of the sight is added once, at the start values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mor.arrays import FloatArray
from mor.observations._contract import ObservationGroup
from mor.parameters.index import Values


def with_sigma_model(group: ObservationGroup, values: Values) -> ObservationGroup:
    """The group with σ² = a² + (b·d)² + centring², d the distance between its two positions at the given values.

    b·d applies to lengths. An error of the set-up is an error in the horizontal position of instrument or target,
    either way, or in its height; the instrument stands at the first reference of the type. How it acts on an
    observation is what its derivatives by these positions say, for every type: a horizontal error e acts with e on a
    distance, with e/s on a direction, not on a height difference, and with √(e_t²(1/a² + 1/b²) + e_i² c²/(ab)²) on an
    angle with legs a, b and targets c apart.
    """
    if group.ppm == 0.0 and not any(group.centring):
        return group
    variance = group.sigma**2
    if group.ppm:
        lengths = np.array([component.quantity.length == 1 for component in group.type.components])
        growing = (group.ppm * 1e-6 * _distances(group, values)) ** 2
        variance = variance + np.where(lengths[None, :], growing[:, None], 0.0)
    return replace(group, sigma=np.sqrt(variance + _centring_variance(group, values)))


def _centring_variance(group: ObservationGroup, values: Values) -> FloatArray:
    blocks = [values[slot.kind][number] for slot, number in zip(group.type.slots, group.blocks, strict=True)]
    jacobians = group.type.equation(blocks, group.constants).jacobians
    variance = np.zeros(group.observed.shape)
    for slot, jacobian in zip(group.type.slots, jacobians, strict=True):
        if slot.part == "position":
            at_instrument = slot.of == group.type.references[0].name
            set_up = group.centring
            across = set_up.instrument if at_instrument else set_up.target
            upwards = set_up.instrument_height if at_instrument else set_up.target_height
            variance += across**2 * np.sum(jacobian[:, :, :2] ** 2, axis=2)
            variance += (upwards * jacobian[:, :, 2]) ** 2
    return variance


def _distances(group: ObservationGroup, values: Values) -> FloatArray:
    positions = [
        values[slot.kind][number]
        for end in group.type.distances or ()
        for slot, number in zip(group.type.slots, group.blocks, strict=True)
        if slot.of == end and slot.part == "position"
    ]
    length: FloatArray = np.linalg.norm(positions[1] - positions[0], axis=1)
    return length
