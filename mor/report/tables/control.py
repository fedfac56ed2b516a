"""Mean redundancy number and largest |w| by point and by image."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import polars as pl

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


def sums_of_control(solved: Solved, kind: str, names: list[str]) -> pl.DataFrame:
    """Sums over the observations of some points, or images: what their columns come from where several parts see them.

    Columns: id, Σ r, active observations, largest test value, rays, other rows, Σ v² of image coordinates as given.
    """
    things = solved.network.things[kind]
    size = len(solved.network.blocks["point"].ids) if kind == "point" else len(things.ids)
    sums, largest = np.zeros((5, size)), np.zeros(size)
    quality = solved.quality
    assert quality is not None
    for group, one, tests in zip(
        quality.adjustment.problem.groups, quality.groups, quality.reliability, strict=True
    ):
        ray = is_image_point(group.type)
        for owner, blocks in owners_of_rows(solved, group):
            if owner != kind:
                continue
            active: BoolArray = group.mask & ~group.left_out
            r = np.where(active, np.nan_to_num(one.r), 0.0).sum(axis=1)
            test = np.where(active, np.nan_to_num(np.abs(tests.test)), 0.0).max(axis=1, initial=0.0)
            factors = group.external.factors if ray and group.external is not None else 1.0
            squares = np.nansum((one.v / factors) ** 2, axis=1)
            rows = np.ones(group.count)
            for k, amount in enumerate((r, active.sum(axis=1), rows * ray, rows * (not ray), squares * ray)):
                np.add.at(sums[k], blocks, amount)
            np.maximum.at(largest, blocks, test)
    numbers = np.array([things.numbers[name] for name in names], dtype=np.int64)
    at = things.parts["position"][numbers] if kind == "point" else numbers
    columns = dict(zip(("r", "active", "rays", "others", "squares"), sums[:, at], strict=True))
    return pl.DataFrame({"id": pl.Series(names, dtype=pl.String), **columns, "largest": largest[at]})
