"""What an adjustment is while it is iterated and when it is over: values, system, datum, history, outcome."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from typing import NamedTuple

import numpy as np

from mor.adjustment.datum.defect import Defect
from mor.adjustment.datum.s_transformation import Constraint
from mor.adjustment.inverse import Inverse
from mor.adjustment.normals import Normals
from mor.adjustment.plan import Plan
from mor.adjustment.problem import Problem
from mor.adjustment.secants import NOTHING_LEARNT, Secants
from mor.arrays import FloatArray, IntArray
from mor.parameters.index import Values

_SHORTEST = 0.02
"""Part of a step along weak directions that is taken at least."""

A_WEAK_TURN = "a turn of the whole network is not determined in any useful way"
RAN_AWAY = "the iteration ran away from the start values to where unknowns are not determined"
STANDS_STILL = "the iteration stands still"
SINGULAR_MINIMUM = "a movement of the network changes no observation where the sum of squares is smallest"
"""Reasons of outcomes."""


class Outcome(Enum):
    """How an adjustment ended."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not converged"
    DIVERGED = "diverged"
    SINGULAR = "singular"

    @property
    def is_solution(self) -> bool:
        """True where the values are a least-squares solution."""
        return self is Outcome.CONVERGED


class Iteration(NamedTuple):
    """One step: objective before it, its size in units of σ, the damping it needed, the redundancy of the system."""

    number: int
    objective: float
    largest_change: float
    damping: float
    redundancy: int

    @property
    def sigma0(self) -> float | None:
        """σ0 before the step, in units of the one given a priori; nothing where nothing is redundant."""
        return float(np.sqrt(self.objective / self.redundancy)) if self.redundancy > 0 else None


class Stride(NamedTuple):
    """The last step along weak directions, and what was taken of it: how far the next one may go.

    Gauss-Newton takes a residual for small and may overshoot on a curve: with ρ the ratio of the true curvature to the
    one it sees, a share s of a step leaves 1 − sρ of it for the next one. From that ρ is known, and s = 1/ρ hits.
    """

    whole: FloatArray
    """(u,) the Gauss-Newton step along weak directions."""
    share: float = 1.0

    @property
    def weak(self) -> FloatArray:
        """(u,) the part of it to take."""
        return self.share * self.whole

    def next(self, whole: FloatArray) -> Stride:
        """The stride after this one, for the Gauss-Newton step (u,) there."""
        size = float(self.whole @ self.whole) if len(self.whole) == len(whole) else 0.0
        if size == 0.0 or self.share == 0.0:
            return Stride(whole)
        ratio = (1.0 - float(self.whole @ whole) / size) / self.share
        return Stride(whole, float(np.clip(1.0 / ratio, _SHORTEST, 1.0)) if ratio > 1.0 else 1.0)


class Adjustment(NamedTuple):
    """Outcome of the solver, complete with the inverse of the system at the solution."""

    problem: Problem
    plan: Plan
    outcome: Outcome
    reason: str
    start: Values
    values: Mapping[str, FloatArray]
    normals: Normals
    anchors: IntArray
    inverse: Inverse
    defect: Defect
    constraint: Constraint
    iterations: tuple[Iteration, ...]
    stride: Stride
    damping: float = 1e-4
    """Damping μ with which the next damped step begins; the first is that of Ceres."""
    secants: Secants = NOTHING_LEARNT
    """What the last steps say of the curvature; empty where they do not creep."""
    kernels: bool = False
    """True where compiled kernels did the work, False where plain NumPy did."""


Watcher = Callable[[Iteration], None]
"""Is told of every iteration."""


def counting_on(watch: Watcher | None, count: int) -> Watcher | None:
    """A watcher that is told of iterations numbered after ``count`` earlier ones."""
    if watch is None:
        return None
    return lambda step: watch(step._replace(number=step.number + count))
