"""Sets of directions, gathered from all the tables that read them, in face one; and which frames know the vertical."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.observations import ObservationGroup
from mor.project.network.build import Network

KEYS = ("directions", "zenith_directions")


class DirectionSet(NamedTuple):
    """What one set read: horizontal and vertical directions in face one, NaN where there is none."""

    name: str
    position: int
    rotation: int
    height: int
    """Blocks of the station, its orientation and its instrument height."""
    points: IntArray
    heights: FloatArray
    """(n,) heights of the targets."""
    horizontal: FloatArray
    vertical: FloatArray
    sigma: FloatArray
    """(n,) radians, the larger of the two."""


def direction_sets(network: Network) -> list[DirectionSet]:
    """All sets of a network, in the order of their rotation blocks; rows of one set may stand in several tables."""
    groups = [group for group in network.groups if group.type.key in KEYS and group.count]
    if not groups:
        return []
    blocks = [np.concatenate([group.blocks[slot] for group in groups]).astype(np.int64) for slot in range(5)]
    names = np.concatenate([np.asarray(list(group.references[0]), dtype=object) for group in groups])
    readings = np.concatenate([np.stack(first_face(group), axis=1) for group in groups])
    sigma = np.concatenate([np.fmax(group.sigma[:, 0], group.sigma[:, 1]) for group in groups])
    heights = network.start["height"][:, 0]
    order = np.argsort(blocks[1], kind="stable")
    cuts = np.flatnonzero(np.diff(blocks[1][order])) + 1
    sets = []
    for rows in np.split(order, cuts):
        position, rotation, height = (int(blocks[slot][rows[0]]) for slot in range(3))
        sets.append(
            DirectionSet(
                f"station {names[rows[0]]}",
                position,
                rotation,
                height,
                blocks[3][rows],
                heights[blocks[4][rows]],
                readings[rows, 0],
                readings[rows, 1],
                sigma[rows],
            )
        )
    return sets


def first_face(group: ObservationGroup) -> tuple[FloatArray, FloatArray]:
    """Horizontal and vertical directions (n,) reduced to face one; NaN where not observed."""
    second = group.constants[:, 1] == 2.0
    horizontal = group.observed[:, 0] - np.where(second, np.pi, 0.0)
    given = group.observed[:, 1]
    if group.type.key == "zenith_directions":
        vertical = np.where(second, given - 1.5 * np.pi, 0.5 * np.pi - given)
    else:
        vertical = np.where(second, np.pi - given, given)
    return horizontal, vertical


def frame_verticals(network: Network) -> FloatArray:
    """(rotation blocks, 3) the vertical D e_Z in the axes of each frame; NaN where no angles and no level tell it."""
    start = network.start.get("rotation", np.zeros((0, 3, 3)))
    up = np.full((len(start), 3), np.nan)
    if len(start) == 0:
        return up
    free = network.blocks["rotation"].free
    fixed = ~free[:, :2].any(axis=1)
    known = fixed & np.isfinite(start).all(axis=(1, 2))
    up[known] = start[known, :, 2]
    # With κ alone unknown the vertical is the same for every κ only where the frame stands upright.
    up[fixed & ~known] = [0.0, 0.0, 1.0]
    for group in network.groups:
        if group.type.key == "level":
            tilt = group.observed
            told = np.isfinite(tilt).all(axis=1)
            z = np.sqrt(np.maximum(1.0 - np.sum(np.square(tilt), axis=1), 0.0))
            up[group.blocks[0][told]] = np.column_stack([tilt, z])[told]
    return up
