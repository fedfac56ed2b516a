"""The story of an adjustment in domains: divide, prepare, adjust, snoop, assess.

project file → Project → parts of its tables → domains → joined adjustment → parts of the results
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import NamedTuple

from mor.adjustment.domains.adjust import Joined, adjust
from mor.adjustment.domains.store import Store
from mor.adjustment.domains.tasks import carrying
from mor.adjustment.domains.tree import Engine
from mor.adjustment.state import Watcher
from mor.domains.assessing import Assessed, Kind, Order, Rounds, assess_domain
from mor.domains.fixed_points import Fixed, tests_of_shared
from mor.domains.prepared import Prepared
from mor.domains.preparing import Divided
from mor.domains.reweighting import Tested, Weighted, iterated, with_sums
from mor.domains.robust import robust
from mor.domains.settled_sigma import with_settled_sigma
from mor.domains.settling import Solution, checked, solution_of, with_cofactors
from mor.domains.snooping import InDomains, snoop, tested
from mor.errors import mistakes_in
from mor.machine import largest_resident
from mor.pipeline import check_named
from mor.project.domains.parts import divide
from mor.project.domains.refusals import refuse_unsupported, with_snooping
from mor.project.file.model import Datum
from mor.project.file.nodes import Document
from mor.project.file.validation import validate
from mor.quality.assess import Whole
from mor.report.results.json import INLINE


class Outcomes(NamedTuple):
    """What became of it."""

    prepared: Prepared
    joined: Joined
    store: Store
    """Where the domains have what they know."""
    whole: Whole | None = None
    assessed: tuple[Assessed, ...] = ()
    fixed: tuple[Fixed, ...] = ()
    """Tests of fixed points that several domains observe."""

    @property
    def redundancy_sum(self) -> float:
        """Σ r over all domains."""
        return float(sum(one.redundancy for one in self.assessed))

    @property
    def resident(self) -> float:
        """Largest resident size of a process."""
        return max([largest_resident(), *(one.resident for one in self.assessed)])


def divided(
    document: Document, source: Path, scratch: Path, rays_of_domain: int, snoop: bool = False
) -> Divided:
    """Divide the tables of a project into files in a scratch folder. Raises :class:`InputError`.

    ``snoop``: data snooping is asked for, whatever the project says.
    """
    project = with_snooping(validate(document), snoop)
    refuse_unsupported(project, document)
    parts = divide(project, document, source, scratch / "tables", rays_of_domain)
    return Divided(project, document, source.resolve(), parts, int(sum(parts.rays)))


def solved(
    engine: Engine,
    ready: Prepared,
    folder: Path,
    kind: Kind,
    residuals: bool,
    watch: Watcher | None = None,
    assessing: Callable[[int], Callable[[int], None]] = lambda domains: lambda assessed: None,
) -> Outcomes:
    """Adjust prepared domains; where there is a solution, assess it and write the parts of the tables.

    ``assessing`` is called between the two with the number of domains; what it returns is told how many more are done.
    """
    settings = ready.project.settings
    free = ready.project.datum != "fixed"
    joined = adjust(engine, ready.boundaries, ready.sizes, free, settings.max_iterations, watch)
    ready, joined = with_settled_sigma(engine, ready, joined, watch)
    if not joined.outcome.is_solution:
        return Outcomes(ready, joined, engine.store)
    done = assessing(len(joined.domains))
    if isinstance(ready.project.datum, Datum) and ready.project.datum.minimal is not None:
        tasks = [engine.submit(carrying, d) for d in joined.domains]
        with mistakes_in(ready.document.file):
            check_named(sum(engine.result(task) for task in tasks), joined.null_space.movements)
    first = solution_of(engine, joined, settings)
    few = ready.sizes.observations <= INLINE
    order = Order(first, folder, kind, residuals, few, ready.parts.images)
    if settings.snooping:
        return _snooped(tested(engine, ready, joined, first, count(1)), order, done)
    weighted = Weighted(engine, ready, joined)
    if settings.robust is not None:
        order = order._replace(light=robust(weighted, first, settings.robust, count(1)))
    if settings.variance_components == "iterate":
        return _iterated(with_sums(weighted, first), order, done)

    def after(d: int) -> None:
        _forget(engine, ready, joined, d)
        done(1)

    assessed = with_cofactors(engine, joined, lambda d: engine.submit(assess_domain, d, order), after)
    useless = tuple(key for one in assessed for key in one.useless)
    sums = sum(one.redundancy for one in assessed)
    sound = checked(joined, useless, sums)
    if not sound.outcome.is_solution:
        return Outcomes(ready, sound, engine.store)
    return _with_fixed(engine, Outcomes(ready, joined, engine.store, first.whole, tuple(assessed)), first)


def _forget(engine: Engine, ready: Prepared, joined: Joined, d: int) -> None:
    """Drop what a domain knows once it is assessed: results take the room of state.

    Not where fixed points are in several domains, whose tests come last; what is not divided is asked for to the end.
    """
    if any(head.ties_fixed for head in ready.heads):
        return
    stages = dict.fromkeys((joined.stage, joined.values))
    names = [f"{kind}/{stage}" for kind in ("stage", "step", "values") for stage in stages]
    names += ["domain", "outer", "null", "datum", "through"]
    if d == ready.parts.lonely:
        names.remove(f"values/{joined.values}")
    else:
        names.append("network")
    for name in names:
        engine.store.drop(f"{name}/{d}")


def _snooped(first: InDomains, order: Order, done: Callable[[int], None]) -> Outcomes:
    """Snoop from a tested adjustment; where it is a solution, assess what is left and write the parts of the tables."""
    sound = checked(first.joined, first.useless, first.redundancy_sum)
    if not sound.outcome.is_solution:
        return Outcomes(first.ready, sound, first.engine.store)
    ended = snoop(first)
    last, engine = ended.tried, ended.tried.engine
    through = Rounds(first.solution.whole.sigma0, ended.steps, ended.clean)
    order = order._replace(solution=last.solution, rounds=through)
    assessed = _assessed(engine, last.joined, order, done)
    joined = last.joined._replace(iterations=first.joined.iterations)
    found = Outcomes(last.ready, joined, engine.store, last.solution.whole, assessed)
    return _with_fixed(engine, found, last.solution)


def _iterated(first: Tested, order: Order, done: Callable[[int], None]) -> Outcomes:
    """Iterate variance components into the weights; where all is sound, assess what comes of it."""
    before = first.weighted
    sound = checked(before.joined, first.useless, first.redundancy_sum)
    if not sound.outcome.is_solution:
        return Outcomes(before.ready, sound, before.engine.store)
    found = iterated(first, count(1))
    last, engine = found.last, found.last.engine
    order = order._replace(solution=found.solution, components=found.components)
    assessed = _assessed(engine, last.joined, order, done)
    joined = last.joined._replace(iterations=before.joined.iterations)
    outcomes = Outcomes(last.ready, joined, engine.store, found.solution.whole, assessed)
    return _with_fixed(engine, outcomes, found.solution)


def _assessed(
    engine: Engine, joined: Joined, order: Order, done: Callable[[int], None]
) -> tuple[Assessed, ...]:
    """Assess all domains, cofactors of whose outer unknowns are in the store already."""
    found = []
    for task in [engine.submit(assess_domain, d, order) for d in joined.domains]:
        found.append(engine.result(task))
        done(1)
    return tuple(found)


def _with_fixed(engine: Engine, found: Outcomes, solution: Solution) -> Outcomes:
    """With tests of the fixed points that several domains observe, where there are any."""
    if not any(one.added.fixed_in_several for one in found.assessed):
        return found
    return found._replace(fixed=tests_of_shared(engine, found.joined, solution))
