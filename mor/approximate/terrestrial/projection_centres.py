"""Observations to projection centres, as start values take them: as to the places of the images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mor.observations import PLAIN_TYPES, PROJECTION_CENTRE_TYPES, ObservationGroup, some_rows
from mor.project.network.build import Network

_PLAIN_OF = {twin.key: PLAIN_TYPES[key] for key, twin in PROJECTION_CENTRE_TYPES.items()}


def to_places(network: Network) -> Network:
    """The network with plain observations in place of those that take projection centres.

    An eccentricity is left to the adjustment; of a stereo follower the place is that of its leader, so its rows go.
    """
    if not any(group.type.key in _PLAIN_OF for group in network.groups):
        return network
    groups = tuple(
        _plain(network, group) if group.type.key in _PLAIN_OF else group for group in network.groups
    )
    return replace(network, groups=groups)


def _plain(network: Network, group: ObservationGroup) -> ObservationGroup:
    plain = _PLAIN_OF[group.type.key]
    stands = np.ones(group.count, dtype=bool)
    for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
        if slot.kind == "base":
            stands &= (network.start["base"][blocks] == 0.0).all(axis=1) & ~network.blocks["base"].free[
                blocks
            ].any(axis=1)
    kept = some_rows(group, np.flatnonzero(stands))
    return replace(kept, type=plain, blocks=kept.blocks[: len(plain.slots)])
