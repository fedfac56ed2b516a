"""Robust estimation by iteratively reweighted least squares: for starting, and for comparison with least squares.

The weight of an observation is multiplied by a factor that depends on its residual, s = |v|/(σ √r) with r its
redundancy number under the weights the observations came with (leverage would hide an error otherwise):

    l1       1/max(s, ½)                        the sum of absolute residuals (smoothed near 0): starts everywhere
    danish   1 for s ≤ 2, exp(1 − (s/2)²) beyond, after the L1 rounds: what is far off no longer counts (redescending)

T. Krarup, J. Juhl, K. Kubik (1980): Götterdämmerung over least squares adjustment.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from mor.adjustment.linearise import misclosures
from mor.adjustment.problem import Problem
from mor.adjustment.solve import Settings, adjust
from mor.adjustment.state import Adjustment
from mor.arrays import BoolArray, FloatArray
from mor.parameters.index import Values
from mor.quality.assess import Quality
from mor.quality.gross_errors.exclusion import reweighted

Method = Literal["l1", "danish"]
ROUNDS = 60
SETTLED = 0.01
"""Largest relative change of a factor at which the weights have settled."""
_SMALLEST = 1e-8
"""Factor on a weight below which nothing is made lighter: the system must stay regular."""
_LIGHT = 0.1
"""Factor on a weight below which an observation counts as rejected."""


class Robust(NamedTuple):
    """A robust solution."""

    method: Method
    adjustment: Adjustment
    factors: tuple[FloatArray, ...]
    """Factors on the weights of each group (n, m), 1 where not observed."""
    settled: bool

    @property
    def rejected(self) -> tuple[BoolArray, ...]:
        """Observations that hardly count."""
        groups = self.adjustment.problem.groups
        return tuple((f < _LIGHT) & group.mask for f, group in zip(self.factors, groups, strict=True))


def robust_estimate(quality: Quality, method: Method, settings: Settings | None = None) -> Robust:
    """Robust solution that starts from an assessed least-squares one."""
    problem = quality.adjustment.problem
    spread = spread_of(quality)
    adjustment = quality.adjustment
    factors = factors_of(problem, adjustment.values, spread, "l1")
    settled = False
    for stage in stages_of(method):
        settled = False
        for _ in range(ROUNDS):
            scaled = reweighted(problem, [1.0 / np.sqrt(f) for f in factors])
            found = adjust(scaled, adjustment.values, settings)
            if not found.outcome.is_solution:
                return Robust(method, adjustment, factors, False)
            adjustment, before = found, factors
            factors = factors_of(problem, adjustment.values, spread, stage)
            if change_of(factors, before) < SETTLED:
                settled = True
                break
    return Robust(method, adjustment, factors, settled)


def stages_of(method: Method) -> tuple[Method, ...]:
    """What is done one after the other: the sum of absolute residuals starts everywhere."""
    return ("l1",) if method == "l1" else ("l1", "danish")


def spread_of(quality: Quality) -> tuple[FloatArray, ...]:
    """√r (n, m) of each group, never so small that an uncontrolled observation is judged by noise."""
    return tuple(np.sqrt(np.maximum(np.nan_to_num(group.r, nan=1.0), 0.01)) for group in quality.groups)


def change_of(factors: tuple[FloatArray, ...], before: tuple[FloatArray, ...]) -> float:
    """Largest relative change of a factor, as a logarithm."""
    pairs = zip(factors, before, strict=True)
    return max((float(np.abs(np.log(a / b)).max(initial=0.0)) for a, b in pairs), default=0.0)


def factors_of(
    problem: Problem, values: Values, spread: tuple[FloatArray, ...], method: Method
) -> tuple[FloatArray, ...]:
    """Factors (n, m) on the weights of each group that its residuals at some values ask for."""
    result = []
    for group, root in zip(problem.groups, spread, strict=True):
        size = np.nan_to_num(np.abs(misclosures(group, values)) / group.sigma) / root
        if method == "l1":
            factor = 1.0 / np.maximum(size, 0.5) * 0.5
        else:
            factor = np.where(size <= 2.0, 1.0, np.exp(np.minimum(1.0 - (size / 2.0) ** 2, 0.0)))
        result.append(np.where(group.mask, np.maximum(factor, _SMALLEST), 1.0))
    return tuple(result)
