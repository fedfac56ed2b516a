"""Parts of a network that no observation connects: each would need a datum of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mor.arrays import IntArray
from mor.observations import ObservationGroup
from mor.project.network.build import Network

_TIES = ("point", "rotation", "base")
"""Kinds of blocks that tie observations together in space. A shared camera or refraction coefficient does not."""
_NAMED = ("image", "station", "system", "point")


@dataclass(frozen=True)
class Part:
    """Names of the things in one part, by namespace."""

    names: dict[str, tuple[str, ...]]
    held: bool
    """True where fixed points are among them."""

    @property
    def size(self) -> int:
        """Number of things."""
        return sum(len(names) for names in self.names.values())


def connected_parts(network: Network, groups: Sequence[ObservationGroup]) -> tuple[Part, ...]:
    """Parts of the network, the largest first; fixed points are one part with all that is tied to any of them.

    What was left out belongs to none.
    """
    blocks = network.blocks
    first, count = {}, 1  # node 0 is the ground: everything that is fixed
    for kind in _TIES:
        if kind in blocks:
            first[kind] = count
            count += len(blocks[kind].ids)
    links: list[tuple[IntArray, IntArray]] = []
    timed = network.things["image"].parts["trajectory"] >= 0
    poses = network.things["image"].parts["position"][timed]
    for kind, start in first.items():
        held = np.flatnonzero(~blocks[kind].free.any(axis=1))
        held = np.setdiff1d(held, poses) if kind == "point" else held
        if kind == "point":
            links.append((np.zeros_like(held), held + start))
    links += [(ends[0], ends[1]) for ends in _on_trajectories(network, first["point"])]
    for group in groups:
        nodes = [
            numbers + first[slot.kind]
            for slot, numbers in zip(group.type.slots, group.blocks, strict=True)
            if slot.kind in first
        ]
        links += [(nodes[0], other) for other in nodes[1:]]
    ends = (
        [np.concatenate(side) for side in zip(*links, strict=True)] if links else [np.zeros(0, dtype=int)] * 2
    )
    # Imported here: only networks that are not determined come to this.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(ends[0])), (ends[0], ends[1])), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    return _parts(network, labels.astype(np.int64), first["point"])


def _on_trajectories(network: Network, first_point: int) -> Iterator[tuple[IntArray, IntArray]]:
    """Nodes of the positions of images on trajectories, each with those of all its knots: a trajectory is one thing."""
    images = network.things["image"]
    for number, trajectory in enumerate(network.trajectories.values()):
        poses = images.parts["position"][images.parts["trajectory"] == number]
        knots = trajectory.positions + first_point
        yield np.repeat(poses + first_point, len(knots)), np.tile(knots, len(poses))


def _parts(network: Network, labels: IntArray, first_point: int) -> tuple[Part, ...]:
    """Things by the part their position belongs to."""
    collected: dict[int, dict[str, list[str]]] = {}
    absent = network.absent.get("point", np.zeros(len(network.blocks["point"].ids), dtype=bool))
    for space in _NAMED:
        things = network.things[space]
        for name, position in zip(things.ids, things.parts["position"], strict=True):
            if absent[position]:
                continue
            part = int(labels[first_point + int(position)])
            collected.setdefault(part, {}).setdefault(space, []).append(name)
    parts = [
        Part({space: tuple(names) for space, names in found.items()}, held=number == labels[0])
        for number, found in collected.items()
    ]
    return tuple(sorted(parts, key=lambda part: -part.size))
