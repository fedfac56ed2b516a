"""How well observations are explained: what is left of vᵀPv, with a price for everything that was chosen to fit.

Models that differ in their number of unknowns, in the units of their observations, and in how many others were looked
through are compared by −2 ln of how likely the observations are (J. Rissanen 1978; G. Schwarz 1978):

    L = Σ min(s², 2 ln n + 2 ln s) + 2 n ln k + q ln n + 2 ln m − 2 Σ r ln |dl'/dl|

with s = |v|/(k σ). An observation that does not fit at all costs what it takes to say which of n it is, and how large
its error: a model is not judged by errors that it is not about. k is 1, or where that is shorter the robust factor of
all σ: no model is better than another for σ that are all too small. q additional unknowns, the best of m alike; r is
the part of the changed observations that is controlled (:func:`mor.diagnose.situation.controlled_part`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mor.adjustment.linearise import misclosures
from mor.arrays import FloatArray
from mor.observations import ObservationGroup
from mor.parameters.index import Values

_MEDIAN = 0.6745
"""Median of |x| of a standard normal x."""


def sizes_of(groups: Sequence[ObservationGroup], values: Values) -> tuple[FloatArray, ...]:
    """|v|/σ (n, m) of every group at some values, 0 where not observed."""
    return tuple(
        np.nan_to_num(np.abs(misclosures(group, values)) / group.given_sigma, nan=0.0, posinf=1e30)
        for group in groups
    )


def cost_of_residuals(sizes: Sequence[FloatArray], count: int, most: float = np.inf) -> float:
    """Σ min(s², 2 ln n + 2 ln s) + 2 n ln k of |v|/σ (n, m) by group, ``count`` being n.

    ``most``: what k may be at most, told by all observations, where these are only some: a few that contradict each
    other would have any k at a place that fits none of them.
    """
    every = observed(sizes)
    factor = min(factor_of_sigmas(sizes), most)
    return cost_of_sums(sums_of_costs(every, factor, count), factor)


class Costs(NamedTuple):
    """Sums over some observations."""

    plain: float
    """Σ min(s², 2 ln n + 2 ln s) with k = 1."""
    scaled: float
    """The same with another k."""
    size: int
    """Their number."""


def sums_of_costs(sizes: FloatArray, factor: float, count: int) -> Costs:
    """Sums over |v|/σ (s,) out of ``count`` observations, with k = 1 and with ``factor``, where that is larger."""
    plain = float(np.sum(costs_of_sizes(sizes, count)))
    scaled = float(np.sum(costs_of_sizes(sizes / factor, count))) if factor > 1.0 else plain
    return Costs(plain, scaled, sizes.size)


def cost_of_sums(sums: Costs, factor: float) -> float:
    """What observations cost, with the better of k = 1 and k = ``factor``."""
    if factor <= 1.0:
        return sums.plain
    return min(sums.plain, sums.scaled + 2.0 * sums.size * float(np.log(factor)))


def observed(sizes: Sequence[FloatArray]) -> FloatArray:
    """(s,) all |v|/σ of groups that are not 0."""
    return np.concatenate([np.zeros(0), *(size[size > 0.0] for size in sizes)])


def costs_of_sizes(sizes: FloatArray, count: int) -> FloatArray:
    """min(s², 2 ln n + 2 ln s) of each of some |v|/(k σ) out of ``count`` observations."""
    price = 2.0 * np.log(max(count, 2))
    found: FloatArray = np.minimum(sizes**2, price + 2.0 * np.log(np.maximum(sizes, 1.0)))
    return found


def factor_of_sigmas(sizes: Sequence[FloatArray]) -> float:
    """Robust factor of all σ: the median of |v|/σ (n, m) by group over that of a normal distribution; 1 without any."""
    every = observed(sizes)
    return robust_sigma(every) if every.size else 1.0


def robust_sigma(sizes: FloatArray) -> float:
    """σ (n,) absolute deviations have by their median; 0 of none."""
    return float(np.median(sizes)) / _MEDIAN if sizes.size else 0.0


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
