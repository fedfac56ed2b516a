"""Which point the suspicious observations move, and where to: what a gross error means for the result."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.geometry.arrays import FloatArray, IntArray
from mor.quality.assess import Quality
from mor.quality.influence import Entry
from mor.quality.local_influence import point_movements
from mor.quality.pieces import in_pieces
from mor.quality.reliability import Reliability
from mor.quality.tests import comparable

MOST = 200
"""Observations that are explained at most."""
AT_LEAST = 10
"""Observations that are explained where none is flagged."""


class Effect(NamedTuple):
    """What an observation does to the point it moves most."""

    entry: Entry
    test: float
    r: float
    error: float
    """Estimated gross error."""
    smallest: float
    """Smallest detectable one."""
    point: int
    """Point block that moves most among those the observation names, −1 where it names no free point."""
    movement: FloatArray
    """(3,) its movement by the estimated error, in the datum of the adjustment, internal axes."""
    tells: bool
    """False where the estimated error says nothing: next to nothing controls the observation, and it would move the
    point by a good part of the size of the network, where no linear estimate holds."""


HARDLY_CONTROLLED = 1e-4
"""Redundancy number below which an error is estimated from less than a ten thousandth of it."""
_FAR = 0.1
"""Part of the size of the network beyond which a movement is none that an observation could cause unseen."""


def effects(quality: Quality) -> list[Effect]:
    """Effects of the flagged observations, the worst first; of the worst few where none is flagged."""
    entries = _chosen(quality)
    errors = np.array(
        [quality.reliability[e.group].at(np.array([e.row])).error[0, e.component] for e in entries]
    )
    points = [_points_of(quality, entry) for entry in entries]
    moved = point_movements(quality, entries, errors, points)
    return [_effect(quality, *each) for each in zip(entries, points, moved, strict=True)]


def _points_of(quality: Quality, entry: Entry) -> list[int]:
    """Free point blocks that an observation names; frames' own positions are not among them."""
    problem = quality.adjustment.problem
    group, columns = problem.groups[entry.group], problem.index.columns["point"]
    named = [
        int(blocks[entry.row])
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True)
        if slot.kind == "point" and slot.of != "image"
    ]
    return [point for point in named if (columns[point] >= 0).any()]


def _chosen(quality: Quality) -> list[Entry]:
    flagged = sum(int(flags.sum()) for flags in quality.flagged)
    wanted = min(flagged, MOST) or AT_LEAST
    best: list[tuple[float, Entry]] = []
    for number, (one, group) in enumerate(
        zip(quality.reliability, quality.adjustment.problem.groups, strict=True)
    ):
        size = _sizes(one)
        size[group.left_out] = 0.0
        order = _largest(size, wanted)
        for place in order[size.ravel()[order] > 0.0]:
            row, component = divmod(int(place), size.shape[1])
            best.append((float(size[row, component]), Entry(number, row, component)))
    best.sort(key=lambda pair: (-pair[0], pair[1]))
    return [entry for _, entry in best[:wanted]]


def _sizes(tests: Reliability) -> FloatArray:
    """(n, m) |w| as it is compared, 0 where there is no test."""
    return in_pieces(
        tests.quality.v.shape, lambda rows: comparable(np.nan_to_num(np.abs(tests.at(rows).test)))
    )


def _largest(size: FloatArray, count: int) -> IntArray:
    """Places in the flat array of the largest, the largest first, equal ones in their order."""
    flat = size.ravel()
    limit = np.partition(flat, len(flat) - count)[len(flat) - count] if count < len(flat) else 0.0
    among = np.flatnonzero(flat >= limit)
    order: IntArray = among[np.argsort(-flat[among], kind="stable")[:count]]
    return order


def _effect(quality: Quality, entry: Entry, points: list[int], moved: FloatArray) -> Effect:
    tests, place = quality.reliability[entry.group].at(np.array([entry.row])), (0, entry.component)
    most = int(np.argmax(np.linalg.norm(moved, axis=1))) if points else -1
    r, size = (
        float(tests.quality.r[place]),
        np.ptp(quality.adjustment.values["point"], axis=0).max(initial=0.0),
    )
    far = bool(points) and float(np.linalg.norm(moved[most])) > _FAR * size
    return Effect(
        entry,
        float(tests.test[place]),
        r,
        float(tests.error[place]),
        float(tests.smallest[place]),
        points[most] if points else -1,
        moved[most] if points else np.zeros(3),
        tells=r >= HARDLY_CONTROLLED or not far,
    )
