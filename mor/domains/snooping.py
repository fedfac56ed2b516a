"""Data snooping over domains: the rounds of :mod:`mor.quality.gross_errors.data_snooping`, adjusted over domains.

Every adjustment without some observations has a layer of the store of its own, so that the one before it is still there
where it is no solution.
"""

from __future__ import annotations

import gc
from collections.abc import Collection, Iterator, Mapping
from typing import NamedTuple

from mor.adjustment.domains.adjust import Joined, adjust
from mor.adjustment.domains.domain import Domain, Key
from mor.adjustment.domains.store import Store
from mor.adjustment.domains.tree import Engine
from mor.domains.elsewhere import STAGE, out_where_moved, seen
from mor.domains.prepared import Prepared, numbered
from mor.domains.preparing import Head, take_out
from mor.domains.settling import Solution, quality_of, solution_of, with_cofactors
from mor.project.domains.part_network import PartNetwork
from mor.quality.diagnosis.self_check import beyond_use, is_complete
from mor.quality.gross_errors.data_snooping import (
    Ended,
    Excluded,
    Out,
    excluded_entries,
    rounds,
)
from mor.quality.gross_errors.other_places import Masks
from mor.quality.gross_errors.worst_first import (
    Block,
    Candidate,
    Entry,
    Tested,
    candidates,
    flagged_rows,
    rows_of_blocks,
    worst_first,
)


class Part(NamedTuple):
    """What a domain tells of its observations."""

    redundancy: float
    """Σ r."""
    useless: tuple[tuple[str, str, int], ...]
    """Unknowns whose σ is larger than the domain they live in."""
    excluded: tuple[Excluded, ...]
    candidates: tuple[Candidate, ...]
    shared: Mapping[Block, int]
    """Points and frames that other domains have, too, and how many rows they have here."""


def tests_of_domain(store: Store, d: int, solution: Solution) -> Part:
    """Test the observations of a domain; the flagged ones are kept."""
    gc.collect()  # what is left of the domain before goes first
    quality = quality_of(store, d, solution)
    problem, part = quality.adjustment.problem, store.load(f"network/{d}")
    flagged = flagged_rows(quality)
    store.save(f"flagged/{d}", flagged)
    return Part(
        quality.redundancy_sum,
        tuple((kind, name, 0) for one in beyond_use(quality) for kind, name, _ in one.unknowns),
        excluded_entries(quality, kept_out(store, d), d),
        tuple(candidates(flagged, (), part.places, d)),
        {
            (kind, name): int(counts[block])
            for kind, counts in rows_of_blocks(problem).items()
            for block, name in enumerate(problem.index.blocks[kind].ids)
            if part.is_common(kind, name)
        },
    )


def kept_out(store: Store, d: int) -> Masks:
    """What takes no part in a domain even before anything is taken out."""
    before: Domain = store.base.load(f"domain/{d}")
    return tuple(group.left_out for group in before.problem.groups)


def candidates_but(store: Store, d: int, cannot: Collection[Entry]) -> tuple[Candidate, ...]:
    """What may go of a domain, some entries apart."""
    part: PartNetwork = store.load(f"network/{d}")
    return tuple(candidates(store.load(f"flagged/{d}"), cannot, part.places, d))


class InDomains(NamedTuple):
    """An assessed adjustment of domains without what is out: :class:`mor.quality.gross_errors.data_snooping.Tried`.

    What the domains know of it is forgotten once another one has come of it.
    """

    engine: Engine
    ready: Prepared
    joined: Joined
    solution: Solution
    parts: tuple[Part, ...]
    numbers: Iterator[int]
    """Of layers: none is used twice, for what is late may still write into the one before."""

    @property
    def redundancy(self) -> int:
        """n − u + d."""
        return self.joined.redundancy

    @property
    def useless(self) -> tuple[Key, ...]:
        """Unknowns whose σ is larger than the domain they live in."""
        return tuple(key for part in self.parts for key in part.useless)

    @property
    def redundancy_sum(self) -> float:
        """Σ r over all domains."""
        return float(sum(part.redundancy for part in self.parts))

    @property
    def excluded(self) -> tuple[Excluded, ...]:
        """What is out, domain by domain."""
        return tuple(one for part in self.parts for one in part.excluded)

    def worst(self, cannot: Collection[Entry]) -> list[Tested]:
        """What goes in a round."""
        shared: dict[Block, int] = {}
        for part in self.parts:
            for block, rows in part.shared.items():
                shared[block] = shared.get(block, 0) + rows
        found = [part.candidates for part in self.parts]
        for d in {entry.part for entry in cannot}:
            mine = frozenset(entry for entry in cannot if entry.part == d)
            found[d] = self.engine.result(self.engine.submit(candidates_but, d, mine))
        return worst_first((one for some in found for one in some), shared)

    def without(self, out: Out) -> InDomains | None:
        """The same without other entries, or nothing where that is no solution."""
        found = self._tried(out, self.joined.values)
        if found is not None:
            self._forget()
        return found

    def elsewhere(self, out: Out) -> tuple[InDomains, Out] | None:
        """The same with points where all their observations put them, if that costs less."""
        if not out:
            return None
        count, stage = self.joined.sizes.observations + len(self.excluded), self.joined.values
        here = seen(self.engine, self.joined.domains, stage, count)
        others = out_where_moved(self.engine, here, stage, self._by_domain(out))
        found = self._tried(others, STAGE) if others is not None else None
        if found is None or others is None:
            return None
        there = seen(found.engine, self.joined.domains, found.joined.values, count)
        if there.cost < here.cost:
            self._forget()
            return found, others
        found.engine.store.clear()
        return None

    def _tried(self, out: Out, stage: str) -> InDomains | None:
        """The same without other entries, from the values of a stage; nothing where that is no solution."""
        engine, last = self.engine.layer(f"{next(self.numbers)}"), self.engine.store
        tasks = [engine.submit(take_out, d, some, last, stage) for d, some in enumerate(self._by_domain(out))]
        heads: list[Head] = [engine.result(task) for task in tasks]
        ready = numbered(engine, engine.store.load("divided"), heads)
        joined = adjust(engine, ready.boundaries, ready.sizes, self.joined.free)
        found = None
        if joined.outcome.is_solution:
            solution = solution_of(engine, joined, ready.project.settings)
            found = tested(engine, ready, joined, solution, self.numbers)
        if found is None or not is_complete(found.redundancy_sum, found.redundancy):
            engine.store.clear()
            return None
        return found

    def _by_domain(self, out: Out) -> list[set[Entry]]:
        return [{entry for entry in out if entry.part == d} for d in self.joined.domains]

    def _forget(self) -> None:
        """The base keeps what is the same in all layers, the networks and their plans."""
        store = self.engine.store
        store.clear(*(("divided", "network", "domain") if store is store.base else ()))


def tested(
    engine: Engine,
    ready: Prepared,
    joined: Joined,
    solution: Solution,
    numbers: Iterator[int],
) -> InDomains:
    """Test the observations of an adjustment that is a solution."""
    parts = with_cofactors(engine, joined, lambda d: engine.submit(tests_of_domain, d, solution))
    return InDomains(engine, ready, joined, solution, tuple(parts), numbers)


def snoop(first: InDomains) -> Ended[InDomains]:
    """Snoop from a tested adjustment of all observations."""
    return rounds(first, Out(), first.redundancy)
