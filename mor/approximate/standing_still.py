"""Points that move, as start values take them: where they are once, for they have not moved far."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.observations import ObservationGroup
from mor.project.network.build import Network


def standing_still(network: Network) -> Network:
    """The network with one place for every point, whatever the time; movements are left to the adjustment."""
    if not network.motion.points:
        return network
    stays = _stays(network)
    later = np.array(sorted(network.motion.stands_for), dtype=np.int64)
    start = network.start["point"].copy()
    start[later] = np.nan_to_num(start[later])
    points = network.blocks["point"]
    free = points.free.copy()
    free[later] = False
    blocks = {**network.blocks, "point": points._replace(free=free)}
    groups = tuple(_still(group, stays) for group in network.groups)
    return replace(network, groups=groups, blocks=blocks, start={**network.start, "point": start})


def at_all_times(network: Network, start: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Start values with those of a point at every time of which nothing is known."""
    if not network.motion.stands_for:
        return dict(start)
    points = start["point"].copy()
    later = np.array(sorted(network.motion.stands_for), dtype=np.int64)
    points[later] = network.start["point"][later]
    own = points[_stays(network)[later]]
    points[later] = np.where(np.isnan(points[later]), own, points[later])
    return {**start, "point": points}


def _stays(network: Network) -> IntArray:
    """(points,) block of the place of each block."""
    stays = np.arange(len(network.blocks["point"].ids))
    for later, block in network.motion.stands_for.items():
        stays[later] = block
    return stays


def _still(group: ObservationGroup, stays: IntArray) -> ObservationGroup:
    plain = group.type.still or group.type
    constants, blocks = group.constants[:, : len(plain.constants)], group.blocks[: len(plain.slots)]
    placed = tuple(
        stays[numbers] if slot.kind == "point" else numbers
        for slot, numbers in zip(plain.slots, blocks, strict=True)
    )
    return replace(group, type=plain, blocks=placed, constants=constants)
