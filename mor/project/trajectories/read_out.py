"""Rolling shutters on trajectories: which knots a row depends on follows from its time, by the readout time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mor.arrays import FloatArray
from mor.observations import ObservationGroup
from mor.observations.time.rolling_shutter import PHASE, READOUT_SLOT, phases
from mor.observations.time.shutter_on_trajectory import is_read_out_along
from mor.observations.time.trajectory import knot_count
from mor.project.network.build import Network
from mor.project.trajectories.images import TRAJECTORY


def read_out_at(
    network: Network, group: ObservationGroup, place: Mapping[str, FloatArray]
) -> ObservationGroup:
    """The group with the knots about the times of its measured rows, by the readout time at a place.

    Any group but image coordinates of rolling shutters on trajectories, and one that has them already, comes back as it
    is.
    """
    if not is_read_out_along(group.type):
        return group
    image, slots = group.references[0], group.type.slots
    count = 2 * knot_count(group.type)
    knots, constants = np.array(group.blocks[:count]), group.constants.copy()
    clock_at = [constant.name for constant in group.type.constants].index("time since knot")
    readout = place[READOUT_SLOT.kind][group.blocks[slots.index(READOUT_SLOT)], 0]
    later = readout * phases(constants[:, :2], constants[:, clock_at - len(PHASE) : clock_at])
    times = np.array([network.image_times.get(name, np.nan) for name in image.known])
    flown = np.array([network.things["image"].numbers[name] for name in image.known])
    flown = network.things["image"].parts[TRAJECTORY][flown]
    for number, trajectory in enumerate(network.trajectories.values()):
        mine = np.flatnonzero(flown[image.numbers] == number)
        clock = trajectory.clock(times[image.numbers[mine]], later[mine])
        width = clock.constants.shape[1]
        if len(mine):
            constants[mine, clock_at : clock_at + width] = clock.constants
            knots[:, mine] = trajectory.blocks(clock)
    if all(np.array_equal(*pair) for pair in zip(knots, group.blocks[:count], strict=True)):
        return group
    return replace(group, constants=constants, blocks=(*knots, *group.blocks[count:]))
