"""Lines whose points had no coordinates on reading: which point beside them carries their turn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mor.arrays import FloatArray
from mor.observations import ObservationGroup
from mor.observations.names import names_of
from mor.project.network.build import Network
from mor.project.network.features import farthest_from_line, feature_label, turned_towards


def with_lines_turned(
    network: Network, start: Mapping[str, FloatArray]
) -> tuple[Network, Mapping[str, FloatArray]]:
    """Lines whose points had no coordinates on reading get the farthest point to carry their turn, and turn to it."""
    if not any(feature.type == "line" for feature in network.project.features):
        return network, start
    rotations = start["rotation"].copy()
    positions = network.things["point"].parts["position"]
    groups = list(network.groups)
    for number, group in enumerate(groups):
        if not _has_carrier(group, network) or np.isfinite(network.start["point"][group.blocks[4]]).all():
            continue
        members = start["point"][group.blocks[4][:-1]]
        known = np.isfinite(members).all(axis=1)
        centre = members[known].mean(axis=0) if known.any() else np.zeros(3)
        D = rotations[rotation := int(group.blocks[1][0])]
        farthest = farthest_from_line(start["point"][positions], D, centre)
        if farthest >= 0:
            beside = np.append(group.blocks[4][:-1], positions[farthest])
            names = names_of([*list(group.references[1])[:-1], network.things["point"].ids[farthest]])
            groups[number] = replace(
                group, blocks=(*group.blocks[:4], beside), references=(group.references[0], names)
            )
            rotations[rotation] = turned_towards(start["point"][positions[farthest]] - centre, D)
    return replace(network, groups=tuple(groups)), {**start, "rotation": rotations}


def _has_carrier(group: ObservationGroup, network: Network) -> bool:
    """True for the group of a line with a point beside it that carries its turn."""
    lines = {feature_label(feature) for feature in network.project.features if feature.type == "line"}
    return group.name in lines and group.type.key == "local" and bool(np.isnan(group.observed[-1, 0]))
