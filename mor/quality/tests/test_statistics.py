"""Statistical tests on the outcome: the global test and the normalised residuals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, gammaincinv, ndtri

from mor.arrays import FloatArray
from mor.quality.in_chunks import in_pieces
from mor.quality.reliability.observation_quality import ObservationQuality

CONTROLLED = 1e-6
"""Redundancy number below which an observation cannot be tested: nothing else would notice an error in it."""
_DIGITS = 7
_DECIMALS = 6


class GlobalTest(NamedTuple):
    """Two-sided χ² test of vᵀPv against the redundancy, for σ0 a priori = 1."""

    statistic: float
    lower: float
    upper: float
    level: float
    redundancy: int

    @property
    def accepted(self) -> bool:
        """True where the statistic lies between the limits, or where there is no redundancy to test."""
        return self.redundancy == 0 or self.lower <= self.statistic <= self.upper


def global_test(statistic: float, redundancy: int, level: float) -> GlobalTest:
    """χ² test of Ω = vᵀPv with f = redundancy degrees of freedom at the given level."""
    if redundancy == 0:
        return GlobalTest(statistic, 0.0, 0.0, level, 0)
    lower = 2.0 * float(gammaincinv(0.5 * redundancy, 0.5 * level))
    upper = float(chdtri(redundancy, 0.5 * level))
    return GlobalTest(statistic, lower, upper, level, redundancy)


def normalised_residuals(quality: ObservationQuality) -> FloatArray:
    """w = v/σ_v (n, m) for σ0 = 1; NaN where r is (nearly) zero, for then there is no test."""
    return in_pieces(quality.v.shape, lambda rows: _normalised(quality.at(rows)))


def _normalised(quality: ObservationQuality) -> FloatArray:
    testable = np.nan_to_num(quality.r) > CONTROLLED
    q = np.where(testable, quality.q_residual, 0.0)
    return np.where(q > 0.0, quality.v / np.sqrt(np.where(q > 0.0, q, 1.0)), np.nan)


def comparable(sizes: FloatArray) -> FloatArray:
    """Sizes of test values ≥ 0, or NaN, to sort by: rounded to the digits in which runs of the same input agree.

    The two rays of a point have equal ones, say, and the last bit must not say which of them comes first.
    """
    finite = np.isfinite(sizes) & (sizes > 0.0)
    exponent = np.floor(np.log10(np.where(finite, sizes, 1.0)))
    quantum = 10.0 ** np.maximum(exponent + 1 - _DIGITS, -_DECIMALS)
    rounded: FloatArray = np.where(finite, np.round(sizes / quantum) * quantum, sizes)
    return rounded


def least_alike(size: float) -> float:
    """A bound below every size that :func:`comparable` makes the same number as this one."""
    return size - 2.0 * max(size * 10.0 ** (1 - _DIGITS), 10.0**-_DECIMALS)


def critical_value(level: float) -> float:
    """Two-sided critical value of the standard normal distribution, 3.29 for 0.001."""
    return -float(ndtri(0.5 * level))
