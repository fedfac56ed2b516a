"""Whether the standardised residuals of tables are normal with one factor: then a σ is wrong, and nothing else.

A gross error, a wrong height or a wrong name also makes vᵀPv too large, but its residuals are not normal with any
factor. Two tests of |w|/s are made for each table, s being the factor: the test of A. N. Kolmogorov (1933) against
|N(0, 1)|, and that of the largest value. Both together have the level ``LEVEL`` for each table. The residuals are
correlated and s is estimated from them, so the tests reject true hypotheses a little less often than that.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from scipy.special import kolmogorov, ndtr, ndtri

from mor.arrays import FloatArray
from mor.quality.assess import Quality

LEVEL = 1e-3
_MEDIAN = 0.6744897501960817
"""Median of |x| of a standard normal x."""
_AT_LEAST = 5
"""Tested observations of a table from which on their distribution is judged."""


def fits_one_factor(quality: Quality) -> bool:
    """Return True if the w of every table are normal with the same factor."""
    sizes = [_tested(quality, number) for number in range(len(quality.groups))]
    every = np.concatenate([np.zeros(0), *sizes])
    if len(every) < _AT_LEAST:
        return True
    factor = float(np.median(every)) / _MEDIAN
    judged = [one for one in (every, *sizes) if len(one) >= _AT_LEAST]
    return factor > 0.0 and all(_is_normal(one / factor, LEVEL / len(judged)) for one in judged)


def factor_of_group(quality: Quality, number: int) -> float | None:
    """Return the robust factor of the w of a table, None if too few of its observations are tested."""
    sizes = _tested(quality, number)
    factor = float(np.median(sizes)) / _MEDIAN if len(sizes) >= _AT_LEAST else 0.0
    return factor if factor > 0.0 else None


def fits_factor(quality: Quality, number: int, factor: float) -> bool:
    """Return True if the w of a table are normal with a factor."""
    return _is_normal(_tested(quality, number) / factor, LEVEL)


def _tested(quality: Quality, number: int) -> FloatArray:
    """(k,) |w| of the observations of a table that take part in the adjustment and are controlled."""
    group = quality.adjustment.problem.groups[number]
    test = np.abs(quality.reliability[number].at(slice(None)).test)[group.mask & ~group.left_out]
    return cast("FloatArray", test[np.isfinite(test)])


def _is_normal(sizes: FloatArray, level: float) -> bool:
    """Return True if absolute values (k,) may be those of a standard normal distribution."""
    count = len(sizes)
    if sizes.max() > -ndtri(0.25 * level / count):
        return False
    expected = 2.0 * ndtr(np.sort(sizes)) - 1.0
    steps = np.arange(count + 1) / count
    distance = max(float(np.max(steps[1:] - expected)), float(np.max(expected - steps[:-1])))
    root = np.sqrt(count)
    return bool(kolmogorov((root + 0.12 + 0.11 / root) * distance) > 0.5 * level)
