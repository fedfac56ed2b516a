"""From the tables of a domain to what the solver needs of it."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.adjustment.domains.domain import Key, plan_domain
from mor.adjustment.domains.store import Store
from mor.adjustment.memory import memory_of_adjustment
from mor.arrays import BoolArray, IntArray
from mor.errors import InputError
from mor.errors import Problem as Mistake
from mor.machine import largest_resident
from mor.parameters.index import all_known, with_shared_components
from mor.preparation import make_problem
from mor.project.domains.part_network import PartNetwork, read_part
from mor.project.domains.parts import Parts
from mor.project.file.model import Project
from mor.project.file.nodes import Document


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


def prepare(store: Store, d: int) -> Head:
    """Read and plan a domain; its network, plan and start values are kept. Raises :class:`InputError`."""
    divided: Divided = store.load("divided")
    part = read_part(divided.project, divided.document, divided.parts, d, divided.source)
    network = part.network
    if not all_known(network.start):
        raise InputError([Mistake(_without_start(part), network.file)])
    start = with_shared_components(network.blocks, network.start)
    problem = make_problem(network, start, start)
    domain = plan_domain(problem, start, part.common(problem.index))
    store.save(f"network/{d}", part)
    store.save(f"domain/{d}", domain)
    store.save(f"values/0/{d}", start)
    inner = problem.index.count - len(domain.outer)
    notes = network.notes if d == 0 else ()
    need = memory_of_adjustment(domain.plan) + 3.0 * 8.0 * len(domain.outer) ** 2
    return Head(domain.keys(), inner, problem.observations, need, largest_resident(), notes)


def _without_start(part: PartNetwork) -> str:
    """Which blocks have no start value; the first few are named."""
    names = [
        part.network.blocks[kind].ids[block]
        for kind, values in part.network.start.items()
        for block in np.flatnonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))[:3].tolist()
    ]
    words = ", ".join(names[:5])
    return f"no start value: {words}; domains need those of all unknowns (mor approximate works them out)"


def number_outer(store: Store, d: int, numbers: IntArray, first: BoolArray) -> None:
    """Keep the common numbers (s,) of the outer unknowns, and which of them this domain is the first to have."""
    store.save(f"numbers/{d}", (numbers, first))
