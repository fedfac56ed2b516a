"""Components that are equal, or differ by a known amount: they are one unknown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mor.project.network.entities import BlockStore

Node = tuple[int, int]
"""Number of a block, number of a component."""


class Equality(NamedTuple):
    """One component of two blocks of a kind: that of ``second`` is that of ``first`` plus ``difference``, exactly."""

    component: int
    first: int
    second: int
    difference: float


class ContradictionError(ValueError):
    """What is to be equal cannot be; ``number`` of the equality that contradicts, where it is one of them."""

    def __init__(self, words: str, number: int | None = None) -> None:
        super().__init__(words)
        self.number = number


@dataclass
class _Classes:
    """Components tied to each other, each by its difference from the one that is the unknown (union-find)."""

    above: dict[Node, tuple[Node, float]] = field(default_factory=dict)

    def find(self, node: Node) -> tuple[Node, float]:
        """The component that stands for all that are tied to this one, and how much this one exceeds it."""
        total = 0.0
        while node in self.above:
            node, apart = self.above[node]
            total += apart
        return node, total

    def tie(self, first: Node, second: Node, difference: float) -> float:
        """Tie two components; returned is by how much this contradicts what was tied before."""
        (one, of_one), (other, of_other) = self.find(first), self.find(second)
        apart = of_one + difference - of_other
        if one == other:
            return apart
        if one < other:
            self.above[other] = (one, apart)
        else:
            self.above[one] = (other, -apart)
        return 0.0

    def members(self) -> Mapping[Node, list[tuple[Node, float]]]:
        """For each unknown all components it stands for, with their differences from it, itself first."""
        found: dict[Node, list[tuple[Node, float]]] = {}
        for node in sorted(self.above):
            root, apart = self.find(node)
            found.setdefault(root, [(root, 0.0)]).append((node, apart))
        return found


def settle_equalities(store: BlockStore, equalities: Iterable[Equality]) -> None:
    """Make one unknown of all components of a kind that are tied to each other, with one status and start value.

    One that is fixed fixes all. What is observed of any of them stays observed. Components that are shared already
    (image-variant interiors) are tied too. Raises :class:`ContradictionError`.
    """
    classes = _Classes()
    for (block, component), owner in store.shared.items():
        apart = store.differences.get((block, component), 0.0)
        classes.tie((owner, component), (block, component), apart)
    full = 2.0 * np.pi if store.kind.is_rotation else np.inf
    for number, tie in enumerate(equalities):
        over = classes.tie((tie.first, tie.component), (tie.second, tie.component), tie.difference)
        if not _nothing(over, tie.difference, full):
            raise ContradictionError(f"this contradicts other exact differences, by {abs(over):g}", number)
    for root, members in classes.members().items():
        _settle(store, members, full)
        for (block, component), apart in members[1:]:
            store.shared[block, component] = root[0]
            store.differences[block, component] = apart


def _nothing(value: float, scale: float, full: float) -> bool:
    """Return True if a value is zero but for round-off, and for whole turns."""
    rest = float(np.remainder(value + 0.5 * full, full) - 0.5 * full) if np.isfinite(full) else value
    return abs(rest) <= 1e-9 * max(abs(scale), 1e-3)


def _settle(store: BlockStore, members: list[tuple[Node, float]], full: float) -> None:
    """One status and one start value, but for their differences, for components that are one unknown."""
    table = store.merged()
    known = [(node, table.values[node] - apart) for node, apart in members if not table.free[node]]
    for node, value in known[1:]:
        if not _nothing(value - known[0][1], value, full):
            names = f"{store.ids[known[0][0][0]]} and {store.ids[node[0]]}"
            raise ContradictionError(f"this contradicts what {names} are fixed at")
    starts = [
        (table.values[node] if np.isnan(table.start[node]) else table.start[node]) - apart
        for node, apart in members
    ]
    value = known[0][1] if known else next((start for start in starts if np.isfinite(start)), np.nan)
    for node, apart in members:
        observed = np.isfinite(table.sigma[node])
        if known and observed:
            fixed, seen = store.ids[known[0][0][0]], store.ids[node[0]]
            raise ContradictionError(f"{fixed} is fixed; {seen}, the same but for that, cannot be observed")
        (table.start if observed else table.values)[node] = value + apart
        table.free[node] = not known
        if not observed:
            table.start[node] = np.nan
