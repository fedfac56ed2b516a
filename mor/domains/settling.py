"""From a joined adjustment to what every domain is given of it, to assess its own part."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from mor.adjustment.datum.defect import Defect
from mor.adjustment.datum.s_transformation import STransformation
from mor.adjustment.domains.adjust import Joined
from mor.adjustment.domains.domain import Domain, Key, Stage, cofactors_of, inverse_of
from mor.adjustment.domains.store import Store
from mor.adjustment.domains.tasks import reduce_product, refine_and_bind, settled, through
from mor.adjustment.domains.tree import Engine, inverses, solve
from mor.adjustment.state import Adjustment, Outcome, Stride
from mor.arrays import FloatArray
from mor.pipeline import levels
from mor.project.file.model import Settings
from mor.quality.assess import Quality, Whole, assessed
from mor.quality.diagnosis.self_check import BEYOND_USE, REDUNDANCY_LOST, is_complete
from mor.quality.tests.levels import sidak


class Solution(NamedTuple):
    """What every domain is given of the solution of the whole."""

    stage: str
    values: str
    """Stage of the values."""
    whole: Whole
    binding: FloatArray
    """(d, d) H = (BᵀG)⁻¹."""
    core: FloatArray
    """(d, d) BᵀQB."""
    movements: tuple[str, ...]


def solution_of(engine: Engine, joined: Joined, settings: Settings) -> Solution:
    """What domains are given of a joined adjustment that is a solution."""
    binding, core = _datum(engine, joined)
    chosen = levels(settings)
    if chosen.familywise is not None:
        chosen = chosen._replace(snooping=sidak(chosen.familywise, joined.sizes.observations))
    whole = Whole(joined.redundancy, joined.objective, chosen, settings.sigma == "aposteriori")
    return Solution(joined.stage, joined.values, whole, binding, core, joined.null_space.movements)


def with_cofactors(
    engine: Engine, joined: Joined, task: Callable[[int], Any], after: Callable[[int], None] = lambda d: None
) -> list[Any]:
    """What a task finds in each domain, cofactors of whose outer unknowns are in the store by then.

    ``after`` is told of each domain once its result is there.
    """
    factor = joined.root.factor(joined.null_space.anchors)
    found: list[Any] = [None] * len(joined.domains)
    waiting: deque[tuple[int, Any]] = deque()

    def take() -> None:
        d, submitted = waiting.popleft()
        found[d] = engine.result(submitted)
        after(d)

    for d, Q in inverses(engine, joined.boundaries, joined.stage, joined.root, factor):
        engine.store.save(f"outer/{d}", Q)
        waiting.append((d, task(d)))
        if len(waiting) > engine.ahead:
            take()
    while waiting:
        take()
    return found


def quality_of(store: Store, d: int, solution: Solution) -> Quality:
    """Quality of a domain, cofactors of its outer unknowns being in the store.

    As if it were a network of its own, what it cannot know by itself given.
    """
    domain: Domain = store.load(f"domain/{d}")
    outer: FloatArray = store.load(f"outer/{d}")
    at: Stage = store.load(f"stage/{solution.stage}/{d}")
    null, bound = store.load(f"datum/{d}")
    values = store.load(f"values/{solution.values}/{d}")
    adjustment = Adjustment(
        problem=domain.problem,
        plan=domain.plan,
        outcome=Outcome.CONVERGED,
        reason="",
        start=values,
        values=values,
        normals=at.normals.spent()._replace(objective=solution.whole.omega),
        anchors=np.zeros(0, dtype=np.int64),
        inverse=inverse_of(domain, at, null, outer),
        defect=Defect(solution.movements, null),
        constraint=bound,
        iterations=(),
        stride=Stride(np.zeros(0)),
    )
    datum = STransformation(null, solution.binding, store.load(f"through/{d}"), solution.core)
    return assessed(adjustment, cofactors_of(at, outer), datum, solution.whole)


def checked(joined: Joined, useless: tuple[Key, ...], redundancy_sum: float) -> Joined:
    """As :func:`mor.quality.diagnosis.self_check.checked`: no solution where σ are beyond use, or Σ r is lost."""
    if useless:
        return joined._replace(outcome=Outcome.SINGULAR, reason=BEYOND_USE, loose=useless)
    if not is_complete(redundancy_sum, joined.redundancy):
        return joined._replace(outcome=Outcome.NOT_CONVERGED, reason=REDUNDANCY_LOST)
    return joined


def _datum(engine: Engine, joined: Joined) -> tuple[FloatArray, FloatArray]:
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
