"""Parts of a network of which some rows alone tell, and the medians of those: what is far off is no gross error.

A ray is judged by how well most of its group fit. But where an image is, and how turned, its own rays alone tell; and
where the network lies, those to given points. Their part of a group is so small that the group comes to fit without
them: an image that is off by more than others has lost all its rays before they could draw it to its place, and a block
that fits itself beside its control points those to these. So rows are judged by the median of their part as well, the
larger of both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.problem import Problem
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.observations import ObservationGroup

_MEDIAN = 0.6745
"""Median of |x| of a standard normal x."""
_FRAME = "rotation"
"""Kind of the blocks that are frames: of an image or an instrument."""


class Parts(NamedTuple):
    """Of one group: the entries that take part, and how they are divided."""

    used: BoolArray
    """(n, m)."""
    divisions: tuple[IntArray, ...]
    """(n,) each: the number of the part that a row alone tells of, −1 where there is none."""

    def sigmas(self, sizes: FloatArray) -> FloatArray:
        """(n, 1) robust σ of the part of every row, the largest of all divisions, from |v|/σ (n, m); 0 without any."""
        largest = np.zeros(len(sizes))
        for part in self.divisions:
            rows, components = np.nonzero(self.used & (part >= 0)[:, None])
            medians = _medians(part[rows], sizes[rows, components], int(part.max(initial=-1)) + 1)
            largest = np.maximum(largest, np.append(medians, 0.0)[part] / _MEDIAN)
        return largest[:, None]


def parts_of(problem: Problem) -> tuple[Parts, ...]:
    """The parts of every group: frames, and where the network lies."""
    given: BoolArray = np.asarray(~(problem.index.columns["point"] >= 0).any(axis=1))
    return tuple(
        Parts(group.mask & ~group.left_out, (_frames(group), _tied(group, given))) for group in problem.groups
    )


def whole(problem: Problem) -> tuple[Parts, ...]:
    """Every group undivided."""
    return tuple(Parts(group.mask & ~group.left_out, ()) for group in problem.groups)


def _frames(group: ObservationGroup) -> IntArray:
    """(n,) the frame of every row; −1 where there is none."""
    frames = [
        blocks for slot, blocks in zip(group.type.slots, group.blocks, strict=True) if slot.kind == _FRAME
    ]
    return np.asarray(frames[0], dtype=np.int64) if frames else np.full(group.count, -1)


def _tied(group: ObservationGroup, given: BoolArray) -> IntArray:
    """(n,) 0 for rows at a point that is given, −1 for others."""
    tied = np.zeros(group.count, dtype=bool)
    for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
        if slot.kind == "point":
            tied |= given[blocks]
    return np.where(tied, 0, -1)


def _medians(part: IntArray, sizes: FloatArray, count: int) -> FloatArray:
    """(count,) medians of the sizes (e,) of every part (e,); 0 where it has none."""
    order = np.lexsort((sizes, part))
    part, sizes = part[order], sizes[order]
    first = np.searchsorted(part, np.arange(count + 1))
    number, begin = np.diff(first), first[:-1]
    medians = np.zeros(count)
    some = number > 0
    low, high = ((begin + (number - 1) // 2)[some], (begin + number // 2)[some])
    medians[some] = 0.5 * (sizes[low] + sizes[high])
    return medians
