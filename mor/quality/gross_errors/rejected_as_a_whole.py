"""Things of which data snooping took most observations out: then rather they are wrong, as a whole, than each of these.

Where more than half of what an image, a set of directions or a point was seen by is gone, what is left may be the wrong
half: it agrees with itself, and no test of what was taken out against the rest can tell.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from mor.arrays import IntArray
from mor.quality.gross_errors.data_snooping import Snooping

_FRAMES = ("image", "station", "system")
_AT_LEAST = 3
"""Observations taken out from which on something is told."""


class TakenOut(NamedTuple):
    """A thing and its observation rows."""

    kind: str
    """``rotation`` for images and instruments, ``point`` for what they see, or are measured between."""
    block: int
    excluded: int
    observations: int

    @property
    def mostly(self) -> bool:
        """True where more than half were taken out."""
        return is_mostly_out(self.excluded, self.observations)


def is_mostly_out(excluded: int, observations: int) -> bool:
    """True where more than half of some rows were taken out, and enough to tell."""
    return 2 * excluded > observations and excluded >= _AT_LEAST


def mostly_out(snooping: Snooping) -> list[TakenOut]:
    """Frames and points of which more than half of the observations were taken out."""
    return [one for one in taken_out(snooping) if one.mostly]


def taken_out(snooping: Snooping, also: Collection[tuple[str, str]] = ()) -> list[TakenOut]:
    """Frames and points of which observations were taken out; ``also`` some others (kind, name), where observed."""
    blocks = snooping.quality.adjustment.problem.index.blocks
    found = []
    for kind in ("rotation", "point"):
        if kind not in blocks:
            continue
        ids = blocks[kind].ids
        out, whole = _counted(snooping, kind, len(ids))
        told = out > 0
        if also:
            told |= (whole > 0) & np.array([(kind, name) in also for name in ids], dtype=bool)
        found += [TakenOut(kind, int(b), int(out[b]), int(whole[b])) for b in np.flatnonzero(told)]
    return found


def _counted(snooping: Snooping, kind: str, count: int) -> tuple[IntArray, IntArray]:
    """(b,) rows of each block of a kind that were taken out, and that there were."""
    out, whole = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    groups = snooping.quality.adjustment.problem.groups
    for kept_out, group in zip(snooping.kept_out, groups, strict=True):
        inside = (group.mask & ~kept_out).any(axis=1)
        gone = inside & (group.left_out & ~kept_out).any(axis=1)
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind == kind and (kind == "rotation" or slot.of not in _FRAMES):
                out += np.bincount(blocks[gone], minlength=count)
                whole += np.bincount(blocks[inside], minlength=count)
    return out, whole
