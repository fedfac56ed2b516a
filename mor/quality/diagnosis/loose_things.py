"""Things of a network that nothing determines: found one by one, or by what a null vector moves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mor.adjustment.datum.local_defects import LocalDefects, beside, local_defects
from mor.adjustment.problem import Problem
from mor.adjustment.state import Adjustment, Outcome
from mor.arrays import BoolArray, IntArray
from mor.errors import Undeterminable
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.project.network.entities import thing_of
from mor.project.reduction import nothing_marked, without_blocks
from mor.quality.diagnosis.connected_components import connected_parts

OPEN = "unknowns are not determined by the observations"
"""Reason of an outcome."""
NO_OBSERVATION = "no observation refers to it"
TOO_FEW = "fewer observations refer to it than it has unknowns"
LOOSE = "its observations leave a direction of it open"
HANGS_ON = "it hangs on other things that are not determined"
NOT_CONNECTED = "no observation connects it with the larger part of the network"
MOVES_TOGETHER = "it can move together with others, and no observation changes"


@dataclass(frozen=True)
class Things:
    """All things of a network that may be left out: points, and images, stations … with all that is their own."""

    points: Sequence[str]
    """Names of the point blocks: things of their own, unless they are positions of images, stations …"""
    others: Sequence[tuple[str, str]]
    """(kind, name) of all other things, numbered after the points."""
    of_blocks: dict[str, IntArray]
    """(n,) thing of each block of a kind, −1 for what is no thing by itself (cameras, instruments)."""

    @property
    def count(self) -> int:
        """Number of things."""
        return len(self.points) + len(self.others)

    def name(self, number: int) -> tuple[str, str]:
        """(kind, name) of a thing."""
        first = len(self.points)
        return ("point", self.points[number]) if number < first else self.others[number - first]

    def marked(self, network: Network, chosen: BoolArray) -> dict[str, BoolArray]:
        """Blocks of the chosen things."""
        marked = nothing_marked(network)
        for kind, thing in self.of_blocks.items():
            marked[kind] = (thing >= 0) & chosen[thing]
        return marked


def things_of(network: Network) -> Things:
    """The things of a network."""
    ids = network.blocks["point"].ids if "point" in network.blocks else ()
    of_blocks = {
        kind: np.full(len(blocks.ids), -1, dtype=np.int64) for kind, blocks in network.blocks.items()
    }
    plain = np.zeros(len(ids), dtype=bool)
    plain[network.things["point"].parts["position"]] = True
    if "point" in of_blocks:
        of_blocks["point"] = np.arange(len(ids))
    numbers: dict[tuple[str, str], int] = {}
    for kind, blocks in network.blocks.items():
        others = np.flatnonzero(~plain) if kind == "point" else range(len(blocks.ids))
        for k in others:
            thing = thing_of(kind, blocks.ids[k])
            if thing[0] != kind:
                of_blocks[kind][k] = numbers.setdefault(thing, len(ids) + len(numbers))
    return Things(ids, list(numbers), of_blocks)


def without_loose(network: Network, values: Values, make: Callable[[Network, Values], Problem]) -> Network:
    """The network without things that nothing determines even where all else is known; it says which these were."""
    things = things_of(network)
    reduced = network
    while True:
        problem = make(reduced, values)
        # Beside the start values: what is singular there alone is not undetermined.
        place = beside(problem, values)
        defects = local_defects(problem, place, things.of_blocks, things.count)
        if not defects.loose.any():
            return reduced
        named = _named(things, defects, first=reduced is network)
        reduced = without_blocks(reduced, things.marked(reduced, defects.loose), named)


def _named(things: Things, defects: LocalDefects, first: bool) -> list[Undeterminable]:
    named = []
    for k in np.flatnonzero(defects.loose).tolist():
        reason = NO_OBSERVATION if defects.rows[k] == 0 else TOO_FEW if defects.too_few[k] else LOOSE
        reason = reason if first else HANGS_ON
        named.append(Undeterminable(*things.name(k), reason, "left out", int(defects.rows[k])))
    return named


def without_moved(network: Network, adjustment: Adjustment) -> Network | None:
    """The network without what the null vectors move that are no movements of it as a whole.

    ``None`` where there are none, or where they move what cannot be left out: cameras, or most of the network.
    """
    if adjustment.outcome is not Outcome.SINGULAR or not adjustment.defect.undetermined:
        return None
    things = things_of(network)
    numbers = {things.name(k): k for k in range(things.count)}
    moved, reason = _apart(network), NOT_CONNECTED
    if not moved:
        reason = MOVES_TOGETHER
        moved = {
            thing_of(kind, name)
            for direction in adjustment.defect.undetermined
            for kind, name, _ in direction.unknowns
        }
    chosen = np.zeros(things.count, dtype=bool)
    chosen[[numbers[thing] for thing in moved if thing in numbers]] = True
    marked = things.marked(network, chosen)
    left = sum(int(np.count_nonzero(network.blocks[k].free[m])) for k, m in marked.items())
    if not chosen.any() or 2 * left > adjustment.problem.index.count:
        return None
    named = [Undeterminable(*things.name(k), reason, "left out") for k in np.flatnonzero(chosen).tolist()]
    return without_blocks(network, marked, named)


def _apart(network: Network) -> set[tuple[str, str]]:
    """Things of all parts but the one that is held by fixed points, or else the largest."""
    parts = [part for part in connected_parts(network, network.groups) if part.size > 1]
    main = next((part for part in parts if part.held), parts[0] if parts else None)
    return {
        (space, name)
        for part in parts
        if part is not main
        for space, names in part.names.items()
        for name in names
    }
