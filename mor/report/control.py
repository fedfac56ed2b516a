"""How well points and images are controlled: mean redundancy number, largest test value of their observations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mor.geometry.arrays import AnyIntArray, BoolArray, FloatArray, IntArray
from mor.observations import ObservationGroup
from mor.observations.names import places_of
from mor.quality.pieces import ROWS_AT_A_TIME
from mor.quality.solved import Solved


def control_of_points(solved: Solved, numbers: IntArray) -> dict[str, FloatArray]:
    """Columns ``mean_r`` and ``largest_w`` of point blocks (n,), over all observations that name them as a target."""
    count = len(solved.network.blocks["point"].ids)

    def owners(group: ObservationGroup) -> list[AnyIntArray]:
        return [
            blocks
            for slot, blocks in zip(group.type.slots, group.blocks, strict=True)
            if slot.kind == "point" and slot.of != "image"
        ]

    mean, largest = _over(solved, owners, count)
    return {"mean_r": mean[numbers], "largest_w": largest[numbers]}


def control_of_images(solved: Solved) -> dict[str, FloatArray]:
    """The same columns of all images, over their rays."""
    images = solved.network.things["image"]

    def owners(group: ObservationGroup) -> list[AnyIntArray]:
        if not group.type.key.startswith(("image/", "follower/")):
            return []
        return [places_of(group.references[0], images.ids)]

    mean, largest = _over(solved, owners, len(images.ids))
    return {"mean_r": mean, "largest_w": largest}


def _over(
    solved: Solved, owners: Callable[[ObservationGroup], list[AnyIntArray]], count: int
) -> tuple[FloatArray, FloatArray]:
    total, number, largest = np.zeros(count), np.zeros(count), np.zeros(count)
    quality = solved.quality
    if quality is None:
        return np.full(count, np.nan), np.full(count, np.nan)
    groups = zip(quality.adjustment.problem.groups, quality.groups, quality.reliability, strict=True)
    for group, one, tests in groups:
        whose = owners(group)
        for first in range(0, group.count if whose else 0, ROWS_AT_A_TIME):
            rows = slice(first, first + ROWS_AT_A_TIME)
            active: BoolArray = group.mask[rows] & ~group.left_out[rows]
            r = np.where(active, np.nan_to_num(one.at(rows).r), 0.0).sum(axis=1)
            size = np.where(active, np.nan_to_num(np.abs(tests.at(rows).test)), 0.0).max(axis=1, initial=0.0)
            for blocks in whose:
                np.add.at(total, blocks[rows], r)
                np.add.at(number, blocks[rows], active.sum(axis=1))
                np.maximum.at(largest, blocks[rows], size)
    seen = number > 0
    return np.where(seen, total / np.maximum(number, 1), np.nan), np.where(seen, largest, np.nan)
