"""How well observations are explained: what is left of vᵀPv, with a price for everything that was chosen to fit.

Models that differ in their number of unknowns, in the units of their observations, and in how many others were looked
through are compared by −2 ln of how likely the observations are (J. Rissanen 1978; G. Schwarz 1978):

    L = Σ min(s², 2 ln n + 2 ln s) + 2 n ln k + q ln n + 2 ln m − 2 Σ r ln |dl'/dl|

with s = |v|/(k σ). An observation that does not fit at all costs what it takes to say which of n it is, and how large
its error: a model is not judged by errors that it is not about. k is 1, or where that is shorter the robust factor of
all σ: no model is better than another for σ that are all too small. q additional unknowns, the best of m alike; r is
the part of the changed observations that is controlled (``hypotheses/controlled_part.py``).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import FloatArray

_MEDIAN = 0.6745
"""Median of |x| of a standard normal x."""


def cost_of_residuals(sizes: Sequence[FloatArray], count: int) -> float:
    """Σ min(s², 2 ln n + 2 ln s) + 2 n ln k of |v|/σ (n, m) by group, ``count`` being n."""
    every = np.concatenate([np.zeros(0), *(size[size > 0.0] for size in sizes)])
    factor = factor_of_sigmas(sizes)
    plain = _cost(every, count)
    return (
        plain
        if factor <= 1.0
        else min(plain, _cost(every / factor, count) + 2.0 * every.size * np.log(factor))
    )


def factor_of_sigmas(sizes: Sequence[FloatArray]) -> float:
    """Robust factor of all σ: the median of |v|/σ (n, m) by group over that of a normal distribution; 1 without any."""
    every = np.concatenate([np.zeros(0), *(size[size > 0.0] for size in sizes)])
    return float(np.median(every)) / _MEDIAN if every.size else 1.0


def _cost(sizes: FloatArray, count: int) -> float:
    price = 2.0 * np.log(max(count, 2))
    return float(np.sum(np.minimum(sizes**2, price + 2.0 * np.log(np.maximum(sizes, 1.0)))))


def price_of_gross_error(count: int) -> float:
    """|v|/σ beyond which one of ``count`` observations costs less as a gross error: s² = 2 ln n + 2 ln s."""
    price = 2.0 * np.log(max(count, 2))
    s = np.sqrt(price)
    for _ in range(20):
        s = np.sqrt(price + 2.0 * np.log(s))
    return float(s)


def cost_of_choice(count: int, candidates: int, parameters: int, stretch: float) -> float:
    """The rest of L."""
    return parameters * float(np.log(max(count, 2))) + 2.0 * float(np.log(max(candidates, 1))) - 2.0 * stretch
