"""Mean redundancy number and largest |w| by point and by image."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mor.arrays import AnyIntArray, BoolArray, FloatArray, IntArray
from mor.observations import ObservationGroup, is_image_point
from mor.observations.names import places_of
from mor.quality.in_chunks import ROWS_AT_A_TIME
from mor.quality.solved import Solved
from mor.report.tables.shared import once


def control_of_points(solved: Solved, numbers: IntArray) -> dict[str, FloatArray]:
    """Columns ``mean_r`` and ``largest_w`` of point blocks (n,), over all observations that name them as a target."""
    return {name: values[numbers] for name, values in _control(solved)["point"].items()}


def control_of_images(solved: Solved) -> dict[str, FloatArray]:
    """Return mean redundancy number and largest |w| of all images, over their rays."""
    return _control(solved)["image"]


def owners_of_rows(solved: Solved, group: ObservationGroup) -> Iterator[tuple[str, AnyIntArray]]:
    """Points, or images, that the rows of a group count for: which of the two, and their numbers (n,)."""
    for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
        if slot.kind == "point" and slot.of != "image":
            yield "point", blocks
    if is_image_point(group.type):
        yield "image", places_of(group.references[0], solved.network.things["image"].ids)


@once
def _control(solved: Solved) -> dict[str, dict[str, FloatArray]]:
    """Both columns of all point blocks and of all images."""
    counts = {
        "point": len(solved.network.blocks["point"].ids),
        "image": len(solved.network.things["image"].ids),
    }
    quality = solved.quality
    if quality is None:
        nothing = {key: np.full(count, np.nan) for key, count in counts.items()}
        return {key: {"mean_r": array, "largest_w": array} for key, array in nothing.items()}
    totals = {key: np.zeros((2, count)) for key, count in counts.items()}
    largest = {key: np.zeros(count) for key, count in counts.items()}
    groups = zip(quality.adjustment.problem.groups, quality.groups, quality.reliability, strict=True)
    for group, one, tests in groups:
        owners = list(owners_of_rows(solved, group))
        for first in range(0, group.count if owners else 0, ROWS_AT_A_TIME):
            rows = slice(first, first + ROWS_AT_A_TIME)
            active: BoolArray = group.mask[rows] & ~group.left_out[rows]
            r = np.where(active, np.nan_to_num(one.at(rows).r), 0.0).sum(axis=1)
            size = np.where(active, np.nan_to_num(np.abs(tests.at(rows).test)), 0.0).max(axis=1, initial=0.0)
            for key, blocks in owners:
                np.add.at(totals[key][0], blocks[rows], r)
                np.add.at(totals[key][1], blocks[rows], active.sum(axis=1))
                np.maximum.at(largest[key], blocks[rows], size)
    return {key: _columns(totals[key], largest[key]) for key in counts}


def _columns(totals: FloatArray, largest: FloatArray) -> dict[str, FloatArray]:
    total, number = totals
    seen = number > 0
    return {
        "mean_r": np.where(seen, total / np.maximum(number, 1), np.nan),
        "largest_w": np.where(seen, largest, np.nan),
    }
