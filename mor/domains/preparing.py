"""From the tables of a domain to what the solver needs of it."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

from mor.adjustment.domains.domain import Domain, Key, plan_domain
from mor.adjustment.domains.store import Store
from mor.adjustment.memory import memory_of_adjustment
from mor.arrays import BoolArray, IntArray
from mor.domains.starting import Places, started
from mor.errors import Problem as Mistake
from mor.errors import Undeterminable
from mor.machine import largest_resident
from mor.preparation import make_problem
from mor.project.domains.part_network import PartNetwork, read_part
from mor.project.domains.parts import Parts
from mor.project.file.model import Project
from mor.project.file.nodes import Document
from mor.quality.gross_errors.data_snooping import without_entries
from mor.quality.gross_errors.worst_first import Entry


class Divided(NamedTuple):
    """A project that was divided; what every task begins with."""

    project: Project
    document: Document
    source: Path
    """Folder that tables are found from."""
    parts: Parts
    observations: int
    """Image points of the whole project: what decides whether compiling is worth it."""


class Head(NamedTuple):
    """What is known of a domain before it is solved."""

    keys: list[Key]
    """Names of its outer unknowns."""
    inner: int
    """Number of the other ones."""
    observations: int
    need: float
    """Bytes that iterations and statistics take, by the estimate."""
    resident: float
    """Largest resident size of the process so far."""
    notes: tuple[Mistake, ...]
    ties_fixed: bool
    """True where other domains may observe a fixed coordinate of this one, too: its test needs all of their systems."""


class Begun(NamedTuple):
    """What has become of the tables of a domain."""

    head: Head | None
    """Nothing where points have no start values."""
    missing: tuple[Undeterminable, ...]
    found: Places
    """Start values that were worked out, of points that another domain has, too."""


def prepare(store: Store, d: int, places: Places | None = None) -> Begun:
    """Read and plan a domain; its network, plan and start values are kept. Raises :class:`InputError`.

    ``places`` are start values of points that all others have worked out: of what is not divided.
    """
    divided: Divided = store.load("divided")
    part = read_part(divided.project, divided.document, divided.parts, d, divided.source)
    network = part.network
    start, missing, found = started(part, places)
    if missing:
        return Begun(None, missing, found)
    problem = make_problem(network, start, start)
    domain = plan_domain(problem, start, part.common(problem.index))
    # What is divided has no σ that depends on the adjustment: only the ground is planned anew from its observations.
    store.save(f"network/{d}", part if d == divided.parts.ground else part.without_observations())
    store.save(f"domain/{d}", domain)
    store.save(f"values/0/{d}", start)
    return Begun(head_of(domain, part, d), (), found)


def take_out(store: Store, d: int, out: Collection[Entry], last: Store, stage: str) -> Head:
    """Begin anew without some entries, at the values of a stage of another layer ``last``, in the layer ``store``."""
    values = last.load(f"values/{stage}/{d}")
    domain: Domain = store.base.load(f"domain/{d}")
    part: PartNetwork = store.load(f"network/{d}")
    store.save(f"values/0/{d}", values)
    if out:
        problem = without_entries(domain.problem, out)
        domain = plan_domain(problem, values, part.common(problem.index))
        store.save(f"domain/{d}", domain)
    return head_of(domain, part, d)


def head_of(domain: Domain, part: PartNetwork, d: int) -> Head:
    """What is known of a planned domain; the first one has the notes."""
    problem, notes = domain.problem, part.network.notes if d == 0 else ()
    inner = problem.index.count - len(domain.outer)
    need = memory_of_adjustment(domain.plan) + 3.0 * 8.0 * len(domain.outer) ** 2
    return Head(
        domain.keys(),
        inner,
        problem.observations,
        need,
        largest_resident(),
        notes,
        part.shares_fixed_coordinates(problem.index),
    )


def number_outer(store: Store, d: int, numbers: IntArray, first: BoolArray) -> None:
    """Keep the common numbers (s,) of the outer unknowns, and which of them this domain is the first to have."""
    store.save(f"numbers/{d}", (numbers, first))
