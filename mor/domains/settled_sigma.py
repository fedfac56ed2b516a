"""σ that depend on distances, taken at the result of the adjustment: as on one machine, whatever the start values were.

Lengths are in one domain, with all else that is not divided.
"""

from __future__ import annotations

from dataclasses import replace

from mor.adjustment.domains.adjust import Joined, adjust
from mor.adjustment.domains.domain import Domain, plan_domain
from mor.adjustment.domains.store import Store
from mor.adjustment.domains.tree import Engine
from mor.adjustment.state import Watcher, counting_on
from mor.domains.prepared import Prepared, numbered
from mor.domains.preparing import Head, head_of
from mor.pipeline import SIGMA_ROUNDS, same_sigma
from mor.preparation import make_problem
from mor.project.domains.part_network import PartNetwork


def with_settled_sigma(
    engine: Engine, ready: Prepared, joined: Joined, watch: Watcher | None
) -> tuple[Prepared, Joined]:
    """Domains and their adjustment with σ that depend on distances as these come out."""
    entries = (*ready.project.observations, *ready.project.checks)
    if not any(entry.ppm or entry.centring is not None for entry in entries):
        return ready, joined
    lonely, most = ready.parts.lonely, ready.project.settings.max_iterations
    for _ in range(SIGMA_ROUNDS):
        if not joined.outcome.is_solution:
            break
        head: Head | None = engine.result(engine.submit(take_sigma, lonely, joined.values))
        if head is None:
            break
        for task in [engine.submit(begin_at, d, joined.values, d == lonely) for d in joined.domains]:
            engine.result(task)
        heads = [head if d == lonely else one for d, one in enumerate(ready.heads)]
        ready = numbered(engine, engine.store.load("divided"), heads)
        count = len(joined.iterations)
        again = adjust(engine, ready.boundaries, ready.sizes, joined.free, most, counting_on(watch, count))
        further = tuple(step._replace(number=step.number + count) for step in again.iterations)
        joined = again._replace(iterations=joined.iterations + further)
    return ready, joined


def take_sigma(store: Store, d: int, stage: str) -> Head | None:
    """Plan a domain anew with the σ that its distances have at the values of a stage; nothing where it has these."""
    part: PartNetwork = store.load(f"network/{d}")
    before: Domain = store.load(f"domain/{d}")
    values = store.load(f"values/{stage}/{d}")
    problem = replace(before.problem, groups=make_problem(part.network, values, values).groups)
    if same_sigma(problem, before.problem):
        return None
    domain = plan_domain(problem, values, part.common(problem.index))
    store.save(f"settled/{d}", domain)
    return head_of(domain, part, d)


def begin_at(store: Store, d: int, stage: str, anew: bool) -> None:
    """Let the next adjustment begin at the values of a stage; ``anew``: with the domain that was planned anew."""
    store.save(f"values/0/{d}", store.load(f"values/{stage}/{d}"))
    if anew:
        store.save(f"domain/{d}", store.load(f"settled/{d}"))
