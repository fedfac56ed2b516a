"""Whether anything is rejected: only then causes are looked for."""

from __future__ import annotations

from enum import Enum, auto

import numpy as np

from mor.project.network.build import Network
from mor.quality.assess import Quality
from mor.quality.tests.group_tests import GroupTests, group_tests
from mor.quality.tests.levels import sidak
from mor.quality.tests.p_values import log_p_normal
from mor.quality.tests.quadratic_form import Moments, log_tail

LEVEL = 1e-3
"""Of every question that is asked: is anything rejected; is a hypothesis better than none."""


class Rejection(Enum):
    """What the tests of the verdict reject at ``LEVEL``: of all, of single observations, or of groups."""

    NOTHING = auto()
    SMALLER = auto()
    """Residuals smaller than their σ says, and nothing else."""
    LARGER = auto()
    """Residuals larger than their σ says."""


def rejection(quality: Quality, network: Network, tests: GroupTests | None = None) -> Rejection:
    """What is rejected, and to which side; ``tests`` are those of the groups, where they are known."""
    freedom = float(quality.redundancy)
    overall = freedom > 0.0 and _two_sided(quality.omega, freedom) < np.log(LEVEL)
    if (overall and quality.omega > freedom) or _largest(quality) < np.log(LEVEL):
        return Rejection.LARGER
    tests = tests or group_tests(quality, network)
    limit = np.log(sidak(LEVEL, len(tests.tests)))
    rejected = [test for test in tests.rejected if test.log_p < limit]
    if any(test.factor > 1.0 for test in rejected):
        return Rejection.LARGER
    return Rejection.SMALLER if rejected or overall else Rejection.NOTHING


def _two_sided(omega: float, freedom: float) -> float:
    """ln of the two-sided probability of χ²."""
    one = np.array([freedom])
    return float(log_tail(np.array([omega]), Moments(one, one, one))[0])


def _largest(quality: Quality) -> float:
    """ln of the probability of the largest test value among so many; 0 where none is flagged."""
    largest = 0.0
    for reliability, flags in zip(quality.reliability, quality.flagged, strict=True):
        rows = np.flatnonzero(flags.any(axis=1))
        if len(rows):
            largest = max(largest, float(np.abs(reliability.at(rows).test[flags[rows]]).max()))
    count = quality.adjustment.problem.observations
    return float(log_p_normal(np.array([largest]))[0] + np.log(max(count, 1)))
