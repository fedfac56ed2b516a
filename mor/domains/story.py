"""The story of an adjustment in domains: divide, prepare, adjust, assess.

project file → Project → parts of its tables → domains → joined adjustment → parts of the results
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mor.adjustment.domains.adjust import Joined, Sizes, adjust
from mor.adjustment.domains.domain import Key
from mor.adjustment.domains.tasks import reduce_product, refine_and_bind, settled, through
from mor.adjustment.domains.tree import Boundaries, Engine, inverses, solve
from mor.adjustment.state import Outcome, Watcher
from mor.domains.assessing import Assessed, Kind, Order, assess_domain
from mor.domains.preparing import Divided, Head, number_outer, prepare
from mor.errors import Problem as Mistake
from mor.machine import largest_resident
from mor.pipeline import levels
from mor.project.domains.parts import Parts, divide
from mor.project.domains.refusals import refuse_unsupported
from mor.project.file.model import Project
from mor.project.file.nodes import Document
from mor.project.file.validation import validate
from mor.quality.assess import Whole
from mor.quality.diagnosis.self_check import BEYOND_USE, REDUNDANCY_LOST, is_complete
from mor.quality.tests.levels import sidak


class Prepared(NamedTuple):
    """Domains that are ready to be adjusted."""

    project: Project
    parts: Parts
    heads: tuple[Head, ...]
    boundaries: Boundaries
    sizes: Sizes
    document: Document
    source: Path
    """Folder of the project."""
    keys: tuple[Key, ...]
    """Names of the outer unknowns by their numbers."""

    @property
    def notes(self) -> tuple[Mistake, ...]:
        """What was assumed on reading."""
        return tuple(note for head in self.heads for note in head.notes)

    @property
    def largest_boundary(self) -> int:
        """Most outer unknowns of a domain."""
        return max(len(numbers) for numbers in self.boundaries.numbers)


class Outcomes(NamedTuple):
    """What became of it."""

    prepared: Prepared
    joined: Joined
    whole: Whole | None = None
    assessed: tuple[Assessed, ...] = ()

    @property
    def values(self) -> str:
        """Stage whose values are those of the solution."""
        return "solution" if self.joined.moved else self.joined.stage

    @property
    def redundancy_sum(self) -> float:
        """Σ r over all domains."""
        return float(sum(one.redundancy for one in self.assessed))

    @property
    def resident(self) -> float:
        """Largest resident size of a process."""
        return max([largest_resident(), *(one.resident for one in self.assessed)])


def divided(document: Document, source: Path, scratch: Path, rays_of_domain: int) -> Divided:
    """Divide the tables of a project into files in a scratch folder. Raises :class:`InputError`."""
    project = validate(document)
    refuse_unsupported(project, document)
    parts = divide(project, document, source, scratch / "tables", rays_of_domain)
    return Divided(project, document, source.resolve(), parts, int(sum(parts.rays)))


def prepared(engine: Engine, found: Divided) -> Prepared:
    """Read and plan all domains, and number what several of them have."""
    engine.store.save("divided", found)
    domains = range(found.parts.count)
    heads: list[Head] = [engine.result(part) for part in [engine.submit(prepare, d) for d in domains]]
    number_of: dict[Key, int] = {}
    numbers = tuple(
        np.array([number_of.setdefault(key, len(number_of)) for key in head.keys], dtype=np.int64)
        for head in heads
    )
    boundaries = Boundaries(found.parts.tree, numbers, len(number_of))
    tasks = [engine.submit(number_outer, d, numbers[d], first) for d, first in enumerate(boundaries.firsts())]
    for task in tasks:
        engine.result(task)
    unknowns = sum(head.inner for head in heads) + len(number_of)
    sizes = Sizes(sum(head.observations for head in heads), unknowns)
    return Prepared(
        found.project,
        found.parts,
        tuple(heads),
        boundaries,
        sizes,
        found.document,
        found.source,
        tuple(number_of),
    )


def solved(
    engine: Engine,
    ready: Prepared,
    folder: Path,
    kind: Kind,
    residuals: bool,
    watch: Watcher | None = None,
    assessing: Callable[[], object] = lambda: None,
) -> Outcomes:
    """Adjust prepared domains; where there is a solution, assess it and write the parts of the tables."""
    project = ready.project
    free = project.datum != "fixed"
    joined = adjust(engine, ready.boundaries, ready.sizes, free, project.settings.max_iterations, watch)
    if not joined.outcome.is_solution:
        return Outcomes(ready, joined)
    assessing()
    binding, core = _datum(engine, joined)
    chosen = levels(project.settings)
    if chosen.familywise is not None:
        chosen = chosen._replace(snooping=sidak(chosen.familywise, ready.sizes.observations))
    whole = Whole(joined.redundancy, joined.objective, chosen, project.settings.sigma == "aposteriori")
    values = Outcomes(ready, joined).values
    movements = joined.null_space.movements
    order = Order(
        joined.stage, values, whole, binding, core, movements, folder, kind, residuals, ready.parts.images
    )
    factor = joined.root.factor(joined.null_space.anchors)
    tasks: list[Any] = [None] * len(ready.heads)
    for d, Q in inverses(engine, joined.boundaries, joined.stage, joined.root, factor):
        engine.store.save(f"outer/{d}", Q)
        tasks[d] = engine.submit(assess_domain, d, order)
    return _checked(Outcomes(ready, joined, whole, tuple(engine.result(task) for task in tasks)))


def _checked(found: Outcomes) -> Outcomes:
    """As :func:`mor.quality.diagnosis.self_check.checked`: no solution where σ are beyond use, or Σ r is lost."""
    useless = tuple(key for one in found.assessed for key in one.useless)
    if useless:
        lost = found.joined._replace(outcome=Outcome.SINGULAR, reason=BEYOND_USE, loose=useless)
        return Outcomes(found.prepared, lost)
    if not is_complete(found.redundancy_sum, found.joined.redundancy):
        lost = found.joined._replace(outcome=Outcome.NOT_CONVERGED, reason=REDUNDANCY_LOST)
        return Outcomes(found.prepared, lost)
    return found


def _datum(engine: Engine, joined: Joined) -> tuple[np.ndarray, np.ndarray]:
    """H and BᵀQB of the S-transformation; null vectors without round-off and Q B are kept by the domains."""
    stage, boundaries, root = joined.stage, joined.boundaries, joined.root
    factor = root.factor(joined.null_space.anchors)

    def each(task: Callable[[int], Any]) -> list[Any]:
        return [engine.result(part) for part in [task(d) for d in joined.domains]]

    if joined.defect == 0:
        each(lambda d: engine.submit(settled, d, stage))
        return np.zeros((0, 0)), np.zeros((0, 0))
    left = each(lambda d: engine.submit(reduce_product, d, stage))
    outer = solve(engine, boundaries, stage, root, factor, left)
    bound = each(lambda d: engine.submit(refine_and_bind, d, stage, outer[d]))
    across = sum(one.across for one in bound)
    outer = solve(engine, boundaries, stage, root, factor, [one.left for one in bound])
    core = sum(each(lambda d: engine.submit(through, d, stage, outer[d])))
    return np.asarray(np.linalg.inv(across)), np.asarray(core)
