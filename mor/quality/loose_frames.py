"""Why an image or a station is loose, told by the points it sees: none, one, two, or all on one line."""

from __future__ import annotations

import numpy as np

from mor.geometry.arrays import IntArray
from mor.quality.solved import Solved

_ON_LINE = 1e-6
"""Spread of points beside a line, as part of that along it, below which they are on it."""
_SHOWN = 4


def why_loose(solved: Solved, space: str, name: str) -> list[str]:
    """A line for a frame (``image``, ``station``) whose points cannot hold it; nothing where they could."""
    things = solved.network.things[space]
    if name not in things.numbers:
        return []
    rotation = things.part(name, "rotation")
    points = _points_seen(solved, rotation)
    names = [solved.network.blocks["point"].ids[p] for p in points]
    frame = f"{space} {name}"
    if len(points) == 0:
        return [f"{frame} sees no point."]
    if len(points) == 1:
        return [f"{frame} sees one point only, {names[0]}: it can turn about it and move around it."]
    listed = ", ".join(names[:_SHOWN]) + (f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")
    if len(points) == 2:
        return [
            f"{frame} sees two points only, {listed}: it can rotate about the line of its two points "
            "(measure a third point that is not on this line)."
        ]
    spread = np.linalg.svd(
        solved.adjustment.values["point"][points] - solved.adjustment.values["point"][points].mean(axis=0),
        compute_uv=False,
    )
    if spread[1] <= _ON_LINE * spread[0]:
        return [
            f"the points of {frame} ({listed}) lie on one line: it can rotate about this line "
            "(measure a point beside it)."
        ]
    return []


def _points_seen(solved: Solved, rotation: int) -> IntArray:
    """Point blocks that rays and directions of a frame with this rotation refer to."""
    found = [np.zeros(0, dtype=np.int64)]
    for group in solved.adjustment.problem.groups:
        slots = list(zip(group.type.slots, group.blocks, strict=True))
        here = [blocks for slot, blocks in slots if slot.kind == "rotation" and slot.part == "rotation"]
        targets = [blocks for slot, blocks in slots if slot.kind == "point" and slot.of in ("point", "to")]
        if here and targets:
            found.append(targets[-1][here[0] == rotation])
    return np.unique(np.concatenate(found))
