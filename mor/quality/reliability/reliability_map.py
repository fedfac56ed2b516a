"""The reliability map: for every point, image, station and set how well its observations control each other.

Of each thing it is known which of its observations has the smallest redundancy number, the smallest error ∇ that would
be found there, and how far an error that is not found can move it. With δ̄0 the external reliability of an observation
(W. Baarda, 1968), no function f of the unknowns moves by more than δ̄0 σ_f; the position of a thing hence by no more
than the largest δ̄0 of its observations times the longest semi-axis of its error ellipsoid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray, across
from mor.geometry import tolerant
from mor.project.network.build import Network
from mor.quality.assess import Quality
from mor.quality.in_chunks import ROWS_AT_A_TIME, in_pieces
from mor.quality.reliability.detectable_errors import Reliability
from mor.quality.reliability.influence_on_unknowns import Entry
from mor.quality.tests.partitions import Partition, partitions

_ALIKE = 1e-9
"""Difference of redundancy numbers that is round-off."""
_FRAMES = ("image", "station", "set")
_OF_FRAMES = ("image", "station", "system")


class Controlled(NamedTuple):
    """How well each of k things is controlled; (k,) arrays, of what no observation refers to NaN and −1."""

    of: str
    """``point``, ``image``, ``station`` or ``set``."""
    names: tuple[str, ...]
    observations: IntArray
    """Number of its observations: a ray is two of them."""
    smallest_r: FloatArray
    weakest: IntArray
    """(k, 3) group, row and component of the observation with the smallest redundancy number."""
    shift: FloatArray
    """Bound of what an undetected error moves its position by; infinite where something is not controlled at all."""

    def entry(self, k: int) -> Entry:
        """The weakest observation of one of them."""
        return Entry(*(int(number) for number in self.weakest[k]))

    def worst(self, count: int) -> IntArray:
        """Numbers of the things with the smallest redundancy numbers, the worst first."""
        seen = np.flatnonzero(np.isfinite(self.smallest_r))
        return seen[np.argsort(self.smallest_r[seen], kind="stable")[:count]]


class _Seen(NamedTuple):
    """Classes (k,) of some rows of a group, and what is known of these."""

    number: int
    rows: slice
    classes: IntArray
    tests: Reliability

    def external(self) -> FloatArray:
        """δ̄0 (k, m): infinite where an observation is not controlled, NaN where there is none."""
        r, known = self.tests.quality.r, self.tests.external
        external = np.where(np.isfinite(r) & ~np.isfinite(known), np.inf, known)
        return np.where(np.isfinite(r), external, np.nan)


def uncontrolled(quality: Quality, number: int) -> BoolArray:
    """(n, m) observations of a group whose redundancy number is below the least one."""
    one, least = quality.groups[number], quality.levels.least_redundancy

    def of_rows(rows: slice) -> BoolArray:
        return np.asarray(np.nan_to_num(one.at(rows).r, nan=1.0) < least)

    return in_pieces(one.v.shape, of_rows)


def uncontrolled_count(quality: Quality) -> int:
    """Number of observations whose redundancy number is below the least one."""
    return int(sum(np.count_nonzero(uncontrolled(quality, k)) for k in range(len(quality.groups))))


def reliability_map(quality: Quality, network: Network) -> list[Controlled]:
    """Points first, then images, stations and sets."""
    problem = quality.adjustment.problem
    axes = np.sqrt(np.maximum(tolerant.eigvalsh(np.nan_to_num(quality.cofactors["point"]))[:, -1], 0.0))
    points = network.things["point"]
    blocks = points.parts["position"]
    place = np.full(len(axes), -1)
    place[blocks] = np.arange(len(blocks))
    found = [_of_points(quality, points.ids, place, axes[blocks])]
    for partition in partitions(problem, network):
        if partition.of in _FRAMES:
            found.append(_of_partition(quality, partition, _axes_of(partition, network, axes)))
    return found


def _axes_of(partition: Partition, network: Network, axes: FloatArray) -> FloatArray:
    """(k,) longest semi-axes of the positions of images and stations."""
    things = network.things["image" if partition.of == "image" else "station"]
    numbers = [things.numbers[name] for name in partition.names]
    return axes[things.parts["position"][numbers]]


def _of_points(quality: Quality, names: tuple[str, ...], place: IntArray, axes: FloatArray) -> Controlled:
    def seen() -> Iterator[_Seen]:
        groups = quality.adjustment.problem.groups
        for number, group in enumerate(groups):
            named = [
                blocks
                for slot, blocks in zip(group.type.slots, group.blocks, strict=True)
                if slot.kind == "point" and slot.of not in _OF_FRAMES
            ]
            for rows in _pieces(group.count):
                some = quality.reliability[number].at(rows)
                for blocks in named:
                    yield _Seen(number, rows, place[blocks[rows]], some)

    return _gathered("point", names, seen, axes)


def _of_partition(quality: Quality, partition: Partition, axes: FloatArray) -> Controlled:
    def seen() -> Iterator[_Seen]:
        for number, tests in enumerate(quality.reliability):
            for rows in _pieces(len(tests.quality.v)):
                classes = partition.of_rows(number, rows)
                if classes is not None:
                    yield _Seen(number, rows, classes, tests.at(rows))

    return _gathered(partition.of, tuple(partition.names), seen, axes)


def _pieces(count: int) -> Iterator[slice]:
    for first in range(0, count, ROWS_AT_A_TIME):
        yield slice(first, first + ROWS_AT_A_TIME)


def _gathered(
    of: str, names: tuple[str, ...], seen: Callable[[], Iterator[_Seen]], axes: FloatArray
) -> Controlled:
    """What the rows say of each class, in two passes: the smallest r, then whose it is."""
    count = len(names)
    observations = np.zeros(count, dtype=np.int64)
    smallest, largest = np.full(count, np.inf), np.zeros(count)
    for one in seen():
        inside = one.classes >= 0
        classes, r = one.classes[inside], np.nan_to_num(one.tests.quality.r[inside], nan=np.inf)
        known = across(np.add, np.isfinite(r).astype(np.int64))
        observations += np.bincount(classes, known, count).astype(np.int64)
        np.minimum.at(smallest, classes, across(np.minimum, r))
        external = np.nan_to_num(one.external()[inside], posinf=np.inf)
        np.maximum.at(largest, classes, across(np.maximum, external))
    weakest = np.full((count, 3), -1, dtype=np.int64)
    for one in seen():
        wanted = np.where(one.classes >= 0, smallest[one.classes], np.nan)
        # Of observations that are equally weak, to round-off, the first: the same ones in every run.
        row, component = np.nonzero(one.tests.quality.r <= wanted[:, None] * (1.0 + _ALIKE) + _ALIKE)
        classes, first = np.unique(one.classes[row], return_index=True)
        new = weakest[classes, 0] < 0
        classes, first = classes[new], first[new]
        weakest[classes] = np.stack(
            [np.full(len(first), one.number), row[first] + (one.rows.start or 0), component[first]], axis=1
        )
    smallest = np.where(np.isfinite(smallest), smallest, np.nan)
    with np.errstate(invalid="ignore"):
        shift = np.where(np.isfinite(smallest), np.where(axes > 0.0, largest * axes, 0.0), np.nan)
    return Controlled(of, names, observations, smallest, weakest, shift)


def detectable(quality: Quality, entries: IntArray) -> FloatArray:
    """(k,) ∇ of observations (k, 3), in internal units; infinite where nothing controls them."""
    found = np.full(len(entries), np.inf)
    for number in np.unique(entries[:, 0]):
        here = np.flatnonzero(entries[:, 0] == number)
        smallest = quality.reliability[number].at(entries[here, 1]).smallest
        found[here] = smallest[np.arange(len(here)), entries[here, 2]]
    return np.where(np.isfinite(found), found, np.inf)
