"""Parts of a network that no observation connects: each would need a datum of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from mor.arrays import IntArray
from mor.quality.solved import Solved

_TIES = ("point", "rotation", "base")
"""Kinds of blocks that tie observations together in space. A shared camera or refraction coefficient does not."""
_NAMED = ("image", "station", "system", "point")


@dataclass(frozen=True)
class Part:
    """Names of the things in one part, by namespace."""

    names: dict[str, tuple[str, ...]]

    @property
    def size(self) -> int:
        """Number of things."""
        return sum(len(names) for names in self.names.values())


def connected_parts(solved: Solved) -> tuple[Part, ...]:
    """Parts of the network, the largest first; fixed points are one part with all that is tied to any of them."""
    blocks = solved.network.blocks
    first, count = {}, 1  # node 0 is the ground: everything that is fixed
    for kind in _TIES:
        if kind in blocks:
            first[kind] = count
            count += len(blocks[kind].ids)
    links: list[tuple[IntArray, IntArray]] = []
    for kind, start in first.items():
        held = np.flatnonzero(~blocks[kind].free.any(axis=1))
        if kind == "point":
            links.append((np.zeros_like(held), held + start))
    for group in solved.adjustment.problem.groups:
        nodes = [
            numbers + first[slot.kind]
            for slot, numbers in zip(group.type.slots, group.blocks, strict=True)
            if slot.kind in first
        ]
        links += [(nodes[0], other) for other in nodes[1:]]
    ends = (
        [np.concatenate(side) for side in zip(*links, strict=True)] if links else [np.zeros(0, dtype=int)] * 2
    )
    graph = coo_array((np.ones(len(ends[0])), (ends[0], ends[1])), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    return _parts(solved, labels.astype(np.int64), first["point"])


def _parts(solved: Solved, labels: IntArray, first_point: int) -> tuple[Part, ...]:
    """Things by the part their position belongs to."""
    collected: dict[int, dict[str, list[str]]] = {}
    for space in _NAMED:
        things = solved.network.things[space]
        for name, position in zip(things.ids, things.parts["position"], strict=True):
            part = int(labels[first_point + int(position)])
            collected.setdefault(part, {}).setdefault(space, []).append(name)
    parts = [Part({space: tuple(names) for space, names in found.items()}) for found in collected.values()]
    return tuple(sorted(parts, key=lambda part: -part.size))
