"""Which point the suspicious observations move, and where to: what a gross error means for the result."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.quality.assess import Quality
from mor.quality.in_chunks import in_pieces
from mor.quality.reliability.detectable_errors import Reliability
from mor.quality.reliability.influence_on_unknowns import Entry
from mor.quality.reliability.local_influence import point_movements
from mor.quality.tests.test_statistics import comparable, least_alike

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
    tested = _tested(quality, entries)
    points = [_points_of(quality, entry) for entry in entries]
    moved = point_movements(quality, entries, tested[:, _ERROR], points)
    far = _FAR * float(np.ptp(quality.adjustment.values["point"], axis=0).max(initial=0.0))
    return [_effect(*each, far) for each in zip(entries, tested, points, moved, strict=True)]


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
        for place, compared in _largest(size.ravel(), wanted):
            best.append((compared, Entry(number, *divmod(place, size.shape[1]))))
    best.sort(key=lambda pair: (-pair[0], pair[1]))
    return [entry for _, entry in best[:wanted]]


def _sizes(tests: Reliability) -> FloatArray:
    """(n, m) |w|, 0 where there is no test."""
    return in_pieces(tests.quality.v.shape, lambda rows: np.nan_to_num(np.abs(tests.at(rows).test)))


def _largest(size: FloatArray, wanted: int) -> list[tuple[int, float]]:
    """Places of the largest of the sizes (n,), and those as they are compared; equal ones in their order."""
    least = np.partition(size, len(size) - wanted)[len(size) - wanted] if len(size) > wanted else 0.0
    candidates = np.flatnonzero(size >= least_alike(float(least)))
    compared = comparable(size[candidates])
    order = np.argsort(-compared, kind="stable")[:wanted]
    return [(int(candidates[k]), float(compared[k])) for k in order if compared[k] > 0.0]


_ERROR = 2


def _tested(quality: Quality, entries: list[Entry]) -> FloatArray:
    """(k, 4) test value, redundancy number, estimated and smallest detectable error of each entry."""
    groups, rows, components = np.array(entries, dtype=np.int64).reshape(-1, 3).T
    tested = np.zeros((len(entries), 4))
    for number in np.unique(groups):
        here = np.flatnonzero(groups == number)
        tests = quality.reliability[number].at(rows[here])
        place = np.arange(len(here)), components[here]
        for k, values in enumerate((tests.test, tests.quality.r, tests.error, tests.smallest)):
            tested[here, k] = values[place]
    return tested


def _effect(entry: Entry, tested: FloatArray, points: list[int], moved: FloatArray, far: float) -> Effect:
    lengths = np.linalg.norm(moved, axis=1)
    most = int(np.argmax(lengths)) if points else -1
    test, r, error, smallest = tested.tolist()
    return Effect(
        entry,
        test,
        r,
        error,
        smallest,
        points[most] if points else -1,
        moved[most] if points else np.zeros(3),
        tells=r >= HARDLY_CONTROLLED or not points or float(lengths[most]) <= far,
    )
