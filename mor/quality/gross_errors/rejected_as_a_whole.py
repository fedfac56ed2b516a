"""Things of which data snooping took most observations out: then rather they are wrong, as a whole, than each of these.

Where more than half of what an image, a set of directions or a point was seen by is gone, what is left may be the wrong
half: it agrees with itself, and no test of what was taken out against the rest can tell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.quality.gross_errors.data_snooping import Snooping

_FRAMES = ("image", "station", "system")
_AT_LEAST = 3
"""Observations taken out from which on something is told."""


class MostlyOut(NamedTuple):
    """A thing and its observation rows."""

    kind: str
    """``rotation`` for images and instruments, ``point`` for what they see, or are measured between."""
    block: int
    excluded: int
    observations: int


def mostly_out(snooping: Snooping) -> list[MostlyOut]:
    """Frames and points of which more than half of the observations were taken out."""
    after = snooping.quality.adjustment.problem
    found = []
    for kind in ("rotation", "point"):
        if kind not in after.index.blocks:
            continue
        count = len(after.index.blocks[kind].ids)
        out, whole = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        for kept_out, group in zip(snooping.kept_out, after.groups, strict=True):
            inside = (group.mask & ~kept_out).any(axis=1)
            gone = inside & (group.left_out & ~kept_out).any(axis=1)
            for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
                if slot.kind == kind and (kind == "rotation" or slot.of not in _FRAMES):
                    out += np.bincount(blocks[gone], minlength=count)
                    whole += np.bincount(blocks[inside], minlength=count)
        most = np.flatnonzero((2 * out > whole) & (out >= _AT_LEAST))
        found += [MostlyOut(kind, int(b), int(out[b]), int(whole[b])) for b in most]
    return found
