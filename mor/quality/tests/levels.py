"""Levels of tests that belong together: non-centrality, B-method, familywise levels.

W. Baarda (1968) ties all tests of an adjustment to one error: what the test of a single observation finds with the
power β0 at the level α0 shall be found with β0 by every test, whatever its dimension. Its size is given by the
non-centrality δ0². Levels of tests of higher dimension follow from it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, chndtrix, ndtr, ndtri


class Limit(NamedTuple):
    """Critical value of a test, and the level it is carried out at."""

    critical: float
    level: float


def noncentrality(level: float, power: float) -> float:
    """δ0² of the two-sided normal test: 17.0746 for α0 = 0.001 and β0 = 0.8, solved by Newton's method.

    1 − β0 = Φ(k − δ0) − Φ(−k − δ0) with Φ(−k) = α0/2, both tails counted.
    """
    k = -float(ndtri(0.5 * level))
    delta = k + float(ndtri(power))
    if power <= level:
        return 0.0
    for _ in range(50):
        missed = float(ndtr(k - delta) - ndtr(-k - delta)) - (1.0 - power)
        slope = float(np.exp(-0.5 * (k - delta) ** 2) - np.exp(-0.5 * (k + delta) ** 2)) / np.sqrt(
            2.0 * np.pi
        )
        if slope == 0.0:  # a power so near to one that both tails are beyond all numbers
            break
        step = missed / slope
        delta += step
        if abs(step) < 1e-14 * delta:
            break
    return float(delta**2)


def chi2_level(freedom: float, ncp: float, power: float) -> Limit:
    """χ² test (critical value of the sum of squares) of the B-method, for one or more degrees of freedom."""
    critical = float(chndtrix(1.0 - power, freedom, ncp))
    return Limit(critical, float(chdtrc(freedom, critical)))


def sidak(familywise: float, tests: int) -> float:
    """Level of each of n independent tests of which, together, one rejects by mistake with ``familywise``."""
    return float(-np.expm1(np.log1p(-familywise) / max(tests, 1)))
