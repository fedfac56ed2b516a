"""The way up from the domains to the root, and down again.

A tree is the number of a domain, or a pair of trees. Every pair is a node, called after its place: ``r`` is the root,
``r0`` and ``r1`` are what it joins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np

from mor.adjustment.domains.store import Store
from mor.adjustment.domains.tasks import Handed, join_handed
from mor.adjustment.inverse import unit_vectors, with_diagonal
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.sparse.cholesky import TOLERANCE, Factor, factorise
from mor.sparse.joining import Node, Share, added, dense, one_block
from mor.sparse.selected_inverse import selected_inverse
from mor.sparse.symbolic_factorisation import analyse

Tree: TypeAlias = "int | tuple[Tree, Tree]"


class Engine(Protocol):
    """Where tasks are done: in this process one after the other, or by workers."""

    @property
    def store(self) -> Store:
        """What all tasks share."""

    @property
    def ahead(self) -> int:
        """How many tasks may be submitted before the result of the first one is asked for."""

    def submit(self, task: Callable[..., Any], *arguments: Any) -> Any:
        """Have a task done with the store and these arguments, which may be what ``submit`` has returned."""

    def result(self, submitted: Any) -> Any:
        """What a task has returned."""

    def layer(self, name: str) -> Engine:
        """The same with a layer of the store, which tasks leave the rest of it alone with."""


class Here(NamedTuple):
    """Tasks one after the other, in this process."""

    store: Store

    @property
    def ahead(self) -> int:
        """None: they are done at once."""
        return 0

    def submit(self, task: Callable[..., Any], *arguments: Any) -> Any:
        """Do the task."""
        return task(self.store, *arguments)

    def result(self, submitted: Any) -> Any:
        """What it has returned."""
        return submitted

    def layer(self, name: str) -> Here:
        """The same with a layer of the store."""
        return Here(self.store.layer(name))


def domains_of(tree: Tree) -> tuple[int, ...]:
    """Domains of a tree, in its order."""
    return (tree,) if isinstance(tree, int) else (*domains_of(tree[0]), *domains_of(tree[1]))


@dataclass(frozen=True)
class Boundaries:
    """Numbers of the outer unknowns of all domains."""

    tree: Tree
    numbers: tuple[IntArray, ...]
    """(s,) of each domain."""
    count: int
    """How many different ones there are."""

    def complete(self, tree: Tree) -> BoolArray:
        """(count,) numbers that no domain outside of this part of the tree has."""
        inside = self._uses(domains_of(tree))
        return np.asarray(inside == self._uses(domains_of(self.tree)))

    def outer(self, tree: Tree) -> IntArray:
        """(s,) numbers that a part of the tree hands up, ascending; those of a domain in its own order."""
        if isinstance(tree, int):
            return self.numbers[tree]
        inside = self._uses(domains_of(tree))
        return np.flatnonzero((inside > 0) & ~self.complete(tree))

    def firsts(self) -> list[BoolArray]:
        """(s,) of each domain, true for the numbers that no domain before it has."""
        seen = np.zeros(self.count, dtype=bool)
        found = []
        for numbers in self.numbers:
            found.append(~seen[numbers])
            seen[numbers] = True
        return found

    @property
    def widest(self) -> int:
        """Order of the largest dense matrix of the way up."""

        def order(tree: Tree) -> tuple[set[int], int]:
            if isinstance(tree, int):
                return set(self.numbers[tree].tolist()), len(self.numbers[tree])
            (one, first), (other, second) = order(tree[0]), order(tree[1])
            together = one | other
            complete = self.complete(tree)
            return {number for number in together if not complete[number]}, max(first, second, len(together))

        return order(self.tree)[1]

    def _uses(self, domains: Sequence[int]) -> IntArray:
        used = np.zeros(self.count, dtype=np.int64)
        for d in domains:
            used[self.numbers[d]] += 1
        return used


class Root(NamedTuple):
    """What is left at the root, scaled to unit diagonal."""

    numbers: IntArray
    scale: FloatArray
    matrix: FloatArray
    """(n, n)"""
    rhs: FloatArray
    """(n, 1)"""

    def factor(self, anchors: IntArray, tolerance: float = TOLERANCE) -> Factor:
        """The factor, some unknowns (k,) anchored."""
        matrix = with_diagonal(dense(self.matrix), anchors, 1.0)
        return factorise(matrix, analyse(one_block(len(self.matrix))), tolerance)

    def solve(self, factor: Factor, rhs: FloatArray) -> FloatArray:
        """Solutions (n, k)."""
        return np.asarray(self.scale[:, None] * factor.solve(self.scale[:, None] * rhs))

    def held(self, factor: Factor, anchors: IntArray) -> FloatArray:
        """(n, k) N'⁻¹ C of the anchors."""
        units = unit_vectors(dense(self.matrix), anchors)
        return np.asarray(self.scale[:, None] * factor.solve(units))

    def inverse(self, factor: Factor) -> FloatArray:
        """(n, n) cofactors."""
        return np.asarray(selected_inverse(factor).to_dense() * self.scale[:, None] * self.scale)


def up(
    engine: Engine, boundaries: Boundaries, stage: str, leaves: Callable[[int], Any]
) -> tuple[Root, Handed]:
    """What all domains hand up, joined; ``leaves`` submits the task of a domain, whose result is what it hands up."""

    def of(tree: Tree, name: str) -> Any:
        if isinstance(tree, int):
            return leaves(tree)
        both = [of(part, f"{name}{k}") for k, part in enumerate(tree)]
        if name == "r":
            return both
        return engine.submit(join_handed, f"{stage}/{name}", both, boundaries.complete(tree))

    found = of(boundaries.tree, "r")
    handed: list[Handed] = [engine.result(one) for one in (found if isinstance(found, list) else [found])]
    together = added(
        [one.share for one in handed], np.unique(np.concatenate([one.share.numbers for one in handed]))
    )
    scale = 1.0 / np.sqrt(np.where(together.diagonal > 0.0, together.diagonal, 1.0))
    root = Root(together.numbers, scale, together.matrix * scale[:, None] * scale, together.rhs)
    vanished = tuple(key for one in handed for key in one.vanished)
    empty = Share(root.numbers[:0], np.zeros((0, 0)), np.zeros((0, 1)), np.zeros(0))
    return root, Handed(empty, sum(one.objective for one in handed), vanished)


def nodes(boundaries: Boundaries) -> list[str]:
    """Names of all nodes but the root, children before parents."""

    def of(tree: Tree, name: str) -> Iterator[str]:
        if not isinstance(tree, int):
            yield from of(tree[0], f"{name}0")
            yield from of(tree[1], f"{name}1")
            if name != "r":
                yield name

    return list(of(boundaries.tree, "r"))


def down(
    engine: Engine, boundaries: Boundaries, stage: str, root: Root, solution: FloatArray
) -> list[FloatArray]:
    """Solutions (s, k) of the outer unknowns of each domain from that of the root (n, k), nothing given inside."""
    return _down(engine, boundaries, stage, root, solution, {})


def down_step(
    engine: Engine, boundaries: Boundaries, stage: str, root: Root, solution: FloatArray
) -> list[FloatArray]:
    """The same (s, 1) of the right-hand sides that came up with the shares."""
    return _down(engine, boundaries, stage, root, solution, None)


def _down(
    engine: Engine,
    boundaries: Boundaries,
    stage: str,
    root: Root,
    solution: FloatArray,
    halves: dict[str, FloatArray] | None,
) -> list[FloatArray]:
    """``halves`` are y of the nodes; where there are none, those kept in the nodes (``None``), or zeros."""
    found = np.zeros((boundaries.count, solution.shape[1]))
    found[root.numbers] = solution
    for name in reversed(nodes(boundaries)) if solution.shape[1] else ():  # a settled datum holds nothing
        node: Node = engine.store.load(f"node/{stage}/{name}")
        none = np.zeros((len(node.pivots), solution.shape[1]))
        y = node.y if halves is None else halves.get(name, none)
        found[node.pivots] = node.backward(y, found[node.rows])
    return [found[numbers] for numbers in boundaries.numbers]


def solve(
    engine: Engine, boundaries: Boundaries, stage: str, root: Root, factor: Factor, left: list[FloatArray]
) -> list[FloatArray]:
    """Solutions (s, k) of the outer unknowns for what is left (s, k) of right-hand sides in each domain."""
    total = np.zeros((boundaries.count, left[0].shape[1]))
    for numbers, own in zip(boundaries.numbers, left, strict=True):
        np.add.at(total, numbers, own)
    halves = {}
    for name in nodes(boundaries):
        node: Node = engine.store.load(f"node/{stage}/{name}")
        both = np.concatenate([node.pivots, node.rows])
        halves[name], rest = node.forward(total[both])
        total[node.rows] = rest
    return _down(engine, boundaries, stage, root, root.solve(factor, total[root.numbers]), halves)


def inverses(
    engine: Engine, boundaries: Boundaries, stage: str, root: Root, factor: Factor
) -> Iterator[tuple[int, FloatArray]]:
    """Each domain with the cofactors (s, s) of its outer unknowns.

    What a part of the tree waits for is in the store: while a domain is worked on, its own are all that is in memory.
    """

    def of(tree: Tree, name: str, numbers: IntArray, Q: FloatArray) -> Iterator[tuple[int, FloatArray]]:
        if isinstance(tree, int):
            yield tree, Q
            return
        if name != "r":
            node: Node = engine.store.load(f"node/{stage}/{name}")
            Q, numbers = node.inverse(Q), np.concatenate([node.pivots, node.rows])
            del node
        order = np.argsort(numbers)
        wanted = [boundaries.outer(part) for part in tree]
        for k, own in enumerate(wanted):
            at = order[np.searchsorted(numbers, own, sorter=order)]
            engine.store.save(f"cofactors/{name}{k}", Q[np.ix_(at, at)])
        del Q
        for k, part in enumerate(tree):
            yield from of(part, f"{name}{k}", wanted[k], engine.store.load(f"cofactors/{name}{k}"))
            engine.store.drop(f"cofactors/{name}{k}")

    if isinstance(boundaries.tree, int):
        at = np.searchsorted(root.numbers, boundaries.numbers[boundaries.tree])
        yield boundaries.tree, root.inverse(factor)[np.ix_(at, at)]
        return
    yield from of(boundaries.tree, "r", root.numbers, root.inverse(factor))
