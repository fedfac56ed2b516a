"""Statistics of single observations, significance levels, p-values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np
from scipy.special import (
    betainc,
    betaln,
    chdtrc,
    chdtri,
    chndtrix,
    gammaincc,
    gammaincinv,
    gammaln,
    log_ndtr,
    ndtr,
    ndtri,
)

from mor.model import rotations
from mor.types import BoolArray, FloatArray, IntArray, SmallestIntArray, pieces

# ---- Arrays of many observations worked out a piece at a time, so that what stands between takes no room.

Found = TypeVar("Found", FloatArray, BoolArray)

ROWS_AT_A_TIME = 250_000


def in_pieces(shape: tuple[int, ...], work: Callable[[slice], Found]) -> Found:
    """The array of a shape (n, …) whose rows the work finds, so many at a time; each depends on its own row alone."""
    if shape[0] <= ROWS_AT_A_TIME:
        return work(slice(None))
    first = work(slice(0, ROWS_AT_A_TIME))
    result = np.empty(shape, dtype=first.dtype)
    result[:ROWS_AT_A_TIME] = first
    for start in range(ROWS_AT_A_TIME, shape[0], ROWS_AT_A_TIME):
        rows = slice(start, start + ROWS_AT_A_TIME)
        result[rows] = work(rows)
    return result


def largest_entries(
    shape: tuple[int, int], work: Callable[[slice], FloatArray], count: int
) -> tuple[IntArray, FloatArray]:
    """Places (k,) and sizes of the ``count`` largest entries of an array (n, m), and of all like them.

    The work finds some rows of it. Entries are alike if :func:`comparable` makes them the same number.
    """
    places, sizes = np.zeros(0, dtype=np.int64), np.zeros(0)
    for rows in pieces(shape[0], ROWS_AT_A_TIME):
        size = work(rows).ravel()
        places = np.concatenate([places, rows.start * shape[1] + np.arange(len(size))])
        sizes = np.concatenate([sizes, size])
        if len(sizes) > count:
            kept = sizes >= least_alike(float(np.partition(sizes, -count)[-count]))
            places, sizes = places[kept], sizes[kept]
    return places, sizes


def sum_of_known(shape: tuple[int, int], work: Callable[[slice], FloatArray]) -> float:
    """The sum of what the work finds, but for NaN.

    It is added up by halves, as numpy does it within an array: to the last digit ``nansum`` over the whole, where no
    half cuts a row in two, as of one or two components.
    """
    rows, width = shape

    def of_part(first: int, count: int) -> float:
        if count <= ROWS_AT_A_TIME:
            values = work(slice(first, first + count))
            return float(np.sum(np.where(np.isnan(values), 0.0, values)))
        half = (count * width // 2) // 8 * 8 // width or count // 2
        return of_part(first, half) + of_part(first + half, count - half)

    return of_part(0, rows)


# ---- Quality of the observations of one group: what is kept of it, and what follows from that.
#
# For ten million rays every array counts. Of an uncorrelated observation only the residual v and the part 1 −
# r of an error that the adjusted value absorbs are kept; cofactors and weighted residuals follow from these
# and σ. The joint test of its components is kept once for a row. Correlated observations, which are few, keep
# theirs.


class Correlated(NamedTuple):
    """Quality of the k correlated entries of a group, (k,) each; the properties of ``ObservationQuality``."""

    rows: IntArray
    components: IntArray
    r: FloatArray
    q_adjusted: FloatArray
    q_residual: FloatArray
    weighted: FloatArray
    precision: FloatArray
    q_weighted: FloatArray
    joint: FloatArray
    freedom: FloatArray


@dataclass(frozen=True)
class ObservationQuality:
    """Quality of one observation group, (n, m) each; NaN where there is no observation.

    Excluded entries have residuals and cofactors of their adjusted values, but no r, and no part in any sum.
    """

    v: FloatArray
    """Residuals, adjusted − observed."""
    absorbed: FloatArray
    """1 − r: part of an error that goes into the adjusted value; for uncorrelated entries."""
    carried: FloatArray
    """Effect of an error of 1 on the points of the observation, in the datum of the adjustment."""
    joint_of_row: FloatArray
    """(n,) statistic of the joint test of the uncorrelated components of a row, χ² with ``freedom``."""
    freedom_of_row: SmallestIntArray
    """(n,) number of these components that are controlled independently of each other."""
    sigma: FloatArray
    """Standard deviations the adjustment worked with."""
    out: BoolArray
    """Excluded entries."""
    correlated: Correlated | None = None

    def at(self, rows: IntArray | slice) -> ObservationQuality:
        """Quality of some of the rows."""
        if isinstance(rows, slice) and rows == slice(None):
            return self
        return ObservationQuality(
            self.v[rows],
            self.absorbed[rows],
            self.carried[rows],
            self.joint_of_row[rows],
            self.freedom_of_row[rows],
            self.sigma[rows],
            self.out[rows],
            _at(self.correlated, np.arange(len(self.v))[rows]) if self.correlated else None,
        )

    @property
    def r(self) -> FloatArray:
        """Redundancy numbers."""
        return self._active("r", lambda one: np.clip(1.0 - one.absorbed, 0.0, 1.0))

    @property
    def joint(self) -> FloatArray:
        """Statistic of the joint test of the components of a row, χ² with ``freedom``; the same for each of them."""
        return self._active("joint", lambda one: one._of_row(one.joint_of_row))

    @property
    def freedom(self) -> FloatArray:
        """Number of components of a row that are controlled independently of each other."""
        return self._active("freedom", lambda one: one._of_row(one.freedom_of_row))

    @property
    def q_adjusted(self) -> FloatArray:
        """Cofactors (variances for σ0 = 1) of the adjusted observations."""
        return self._corrected("q_adjusted", lambda one: one.absorbed * one.sigma**2)

    @property
    def q_residual(self) -> FloatArray:
        """Cofactors of the residuals; 0 where an observation is not controlled at all."""
        return self._active("q_residual", lambda one: np.clip(1.0 - one.absorbed, 0.0, 1.0) * one.sigma**2)

    @property
    def weighted(self) -> FloatArray:
        """P v, so that Σ v · P v is the part of vᵀPv a group contributes, correlated or not; 0 where excluded."""
        weighted = self._corrected("weighted", lambda one: one.v * one._weight)
        weighted[self.out] = 0.0
        return weighted

    @property
    def precision(self) -> FloatArray:
        """Diagonal of P."""
        return self._active("precision", lambda one: one._weight.copy())

    @property
    def q_weighted(self) -> FloatArray:
        """Diagonal of P Q_vv P, the cofactors of P v."""
        return self._active("q_weighted", lambda one: np.clip(1.0 - one.absorbed, 0.0, 1.0) * one._weight)

    @cached_property
    def _weight(self) -> FloatArray:
        return 1.0 / np.where(np.isfinite(self.v), self.sigma, np.nan) ** 2

    def _of_row(self, values: FloatArray | SmallestIntArray) -> FloatArray:
        return np.where(np.isfinite(self.v), values[:, None], np.nan)

    def _active(self, name: str, of_rows: _OfRows) -> FloatArray:
        values = self._corrected(name, of_rows)
        values[self.out] = np.nan
        return values

    def _corrected(self, name: str, of_rows: _OfRows) -> FloatArray:
        plain = replace(self, correlated=None) if self.correlated is not None else self
        values = in_pieces(self.v.shape, lambda rows: of_rows(plain.at(rows)))
        if self.correlated is not None:
            values[self.correlated.rows, self.correlated.components] = getattr(self.correlated, name)
        return values


def redundancy_of(quality: ObservationQuality) -> float:
    """Σ r of a group."""
    return sum_of_known(quality.v.shape, lambda rows: quality.at(rows).r)


def omega_of(quality: ObservationQuality) -> float:
    """Σ v·Pv, the part of vᵀPv of a group."""

    def of_rows(rows: slice) -> FloatArray:
        one = quality.at(rows)
        return one.v * one.weighted

    return sum_of_known(quality.v.shape, of_rows)


def _at(correlated: Correlated, rows: IntArray) -> Correlated | None:
    """The entries that stand in these rows, which may come in any order and more than once."""
    order = np.argsort(correlated.rows, kind="stable")
    first, last = (np.searchsorted(correlated.rows, rows, side, sorter=order) for side in ("left", "right"))
    count = last - first
    if not count.any():
        return None
    place = np.repeat(np.arange(len(rows)), count)
    nth = np.arange(len(place)) - np.repeat(np.cumsum(count) - count, count)
    entries = order[first[place] + nth]
    return Correlated(*(array[entries] for array in correlated))._replace(rows=place)


_OfRows: TypeAlias = Callable[[ObservationQuality], FloatArray]
"""Elementwise in the rows of a group."""


# ---- Levels of tests that belong together: non-centrality, B-method, familywise levels.
#
# W. Baarda (1968) ties all tests of an adjustment to one error: what the test of a single observation finds with the
# power β0 at the level α0 shall be found with β0 by every test, whatever its dimension. Its size is given by the
# non-centrality δ0². Levels of tests of higher dimension follow from it.


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
        slope = float(np.exp(-0.5 * (k - delta) ** 2) - np.exp(-0.5 * (k + delta) ** 2)) / np.sqrt(2.0 * np.pi)
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


LEVEL = 1e-3
"""Of every question beside the tests that the project asks for: is anything rejected, is a hypothesis better than none,
does a note on the input say more than chance."""


def sidak(familywise: float, tests: int) -> float:
    """Level of each of n independent tests of which, together, one rejects by mistake with ``familywise``."""
    return float(-np.expm1(np.log1p(-familywise) / max(tests, 1)))


# ---- Logarithms of p-values, right also where the p-value itself is smaller than any number a computer has.


def log_p_normal(w: float | FloatArray) -> FloatArray:
    """ln P(|x| ≥ |w|), x standard normal."""
    return np.asarray(np.log(2.0) + log_ndtr(-np.abs(w)))


def log_p_chi2(square: float | FloatArray, freedom: float | FloatArray) -> FloatArray:
    """ln P(χ² ≥ ``square``); far out by the asymptotic series of the incomplete gamma function (DLMF 8.11.2)."""
    square, freedom = np.broadcast_arrays(np.asarray(square, dtype=float), np.asarray(freedom, dtype=float))
    if (freedom[np.isfinite(square)] == 2.0).all():
        return np.asarray(-0.5 * square + 0.0 * freedom)
    a, x = 0.5 * freedom, 0.5 * square
    with np.errstate(divide="ignore", invalid="ignore"):
        log_p = np.log(gammaincc(a, x))
        far = (a - 1.0) * np.log(x) - x - gammaln(a) + np.log1p((a - 1.0) / x + (a - 1.0) * (a - 2.0) / x**2)
    return np.where(np.isneginf(log_p) & np.isfinite(square), far, log_p)


def log_p_student(square: float | FloatArray, freedom: float) -> FloatArray:
    """ln P(t² ≥ ``square``) for Student's t with ``freedom`` degrees of freedom; NaN without any.

    This is F(1, f): the regularised incomplete beta function I_x(f/2, 1/2) at x = f/(f + t²). With very many degrees
    of freedom it is the normal distribution of a transformed t (G. W. Hill, 1970, Algorithm 395), to ten digits.
    """
    if freedom < 10_000.0:
        return log_p_f(square, 1.0, freedom)
    a = freedom - 0.5
    b = 48.0 * a * a
    z2 = a * np.log1p(square / freedom)
    higher = (((4.0 * z2 + 33.0) * z2 + 240.0) * z2 + 855.0) / (10.0 * b * (b + 0.8 * z2 * z2 + 100.0))
    return log_p_normal(np.sqrt(z2) * (1.0 + (z2 + 3.0) / b - higher))


def coverage_probability(factor: float, freedom: float) -> float:
    """P(|t| ≤ ``factor``), t of Student's distribution, or normal if ``freedom`` is infinite (JCGM 100:2008, G.3)."""
    if np.isinf(freedom):
        return float(-np.expm1(log_p_normal(factor)))
    return float(-np.expm1(log_p_student(factor**2, freedom)))


def log_p_f(ratio: float | FloatArray, above: float | FloatArray, freedom: float) -> FloatArray:
    """ln P(F ≥ ``ratio``) for F(``above``, ``freedom``)."""
    if freedom <= 0.0:
        return np.full(np.shape(ratio), np.nan)
    above = np.broadcast_to(np.asarray(above, dtype=float), np.shape(ratio))
    square = np.asarray(above * ratio)
    x = freedom / (freedom + square)
    with np.errstate(divide="ignore"):
        log_p = np.log(betainc(0.5 * freedom, 0.5 * above, x))
    tiny = np.isfinite(square) & ~(log_p > -600.0)
    if tiny.any():
        log_p = np.array(log_p)
        log_p[tiny] = _log_beta_tail(0.5 * freedom, 0.5 * above[tiny], square[tiny] / freedom)
    return np.asarray(log_p)


def _log_beta_tail(a: float, b: FloatArray, excess: FloatArray) -> FloatArray:
    """ln I_x(a, b) far from the middle, x = 1/(1 + excess), by the continued fraction (Lentz; DLMF 8.17.22)."""
    log_x = -np.log1p(excess)
    x, one_minus_x = np.exp(log_x), excess / (1.0 + excess)
    front = a * log_x + b * np.log(one_minus_x) - np.log(a) - betaln(a, b)
    c, d = np.ones_like(x), 1.0 / (1.0 - (a + b) * x / (a + 1.0))
    fraction = d.copy()
    for m in range(1, 2000):
        even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m))
        d, c = 1.0 / (1.0 + even * d), 1.0 + even / c
        fraction *= d * c
        odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0))
        d, c = 1.0 / (1.0 + odd * d), 1.0 + odd / c
        fraction *= d * c
        if np.abs(d * c - 1.0).max() < 1e-15:
            break
    return np.asarray(front + np.log(fraction))


# ---- The σ of most observations, whatever the others are: from the median of their sizes.

MEDIAN_OF_NORMAL = 0.6745
"""Median of |x| of a standard normal x, Φ⁻¹(3/4) to four digits."""


def robust_sigma(sizes: FloatArray) -> float:
    """σ of normal errors whose absolute values (n,) have this median; 0 without any."""
    return float(np.median(sizes)) / MEDIAN_OF_NORMAL if sizes.size else 0.0


# ---- Statistical tests on the outcome: the global test and the normalised residuals.

CONTROLLED = 1e-6
"""Redundancy number below which an observation cannot be tested: nothing else would notice an error in it."""
_DIGITS = 7
_DECIMALS = 6


class ChiSquareTest(NamedTuple):
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


def global_test(statistic: float, redundancy: int, level: float) -> ChiSquareTest:
    """χ² test of Ω = vᵀPv with f = redundancy degrees of freedom at the given level."""
    if redundancy == 0:
        return ChiSquareTest(statistic, 0.0, 0.0, level, 0)
    lower = 2.0 * float(gammaincinv(0.5 * redundancy, 0.5 * level))
    upper = float(chdtri(redundancy, 0.5 * level))
    return ChiSquareTest(statistic, lower, upper, level, redundancy)


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
    return np.asarray(np.where(finite, np.round(sizes / quantum) * quantum, sizes))


def least_alike(size: float) -> float:
    """A bound below every size that :func:`comparable` makes the same number as this one."""
    return size - 2.0 * max(size * 10.0 ** (1 - _DIGITS), 10.0**-_DECIMALS)


def critical_value(level: float) -> float:
    """Two-sided critical value of the standard normal distribution, 3.29 for 0.001."""
    return -float(ndtri(0.5 * level))


# ---- The joint test of the components of one observation: the two coordinates of a ray, the three of a vector.


def joint_statistic(weighted: FloatArray, cofactors: FloatArray, here: BoolArray) -> tuple[FloatArray, FloatArray]:
    """T = uᵀ S⁺ u (n,) and the rank of S (n,), for the components that are there (n, m).

    ``weighted`` u (n, m) and ``cofactors`` S (n, m, m) are P v and P Q_vv P, scaled to unit weights. A direction whose
    eigenvalue of S vanishes is controlled by nothing and left out. T is χ² distributed with the rank as its freedom.
    """
    if weighted.shape[1] == 1:
        safe = np.where(cofactors[:, 0, 0] > CONTROLLED, cofactors[:, 0, 0], np.inf)
        statistic = np.where(here[:, 0], np.nan_to_num(weighted[:, 0]) ** 2 / safe, 0.0)
        return statistic, (here[:, 0] & np.isfinite(safe)).astype(float)
    both = here[:, :, None] & here[:, None, :]
    S = np.where(both, cofactors, 0.0)
    u = np.where(here, np.nan_to_num(weighted), 0.0)
    if weighted.shape[1] == 2:
        # The same for two components, in closed form.
        mean, half = 0.5 * (S[:, 0, 0] + S[:, 1, 1]), 0.5 * (S[:, 0, 0] - S[:, 1, 1])
        radius = np.hypot(half, S[:, 0, 1])
        turn = 0.5 * np.arctan2(S[:, 0, 1], half)
        c, s = np.cos(turn), np.sin(turn)
        along = np.stack([c * u[:, 0] + s * u[:, 1], c * u[:, 1] - s * u[:, 0]], axis=1)
        return _along_axes(along, np.stack([mean + radius, mean - radius], axis=1))
    eigenvalues, axes = rotations.eigh(S)
    return _along_axes(np.einsum("nmk,nm->nk", axes, u), eigenvalues)


def _along_axes(along: FloatArray, eigenvalues: FloatArray) -> tuple[FloatArray, FloatArray]:
    used = eigenvalues > CONTROLLED
    parts = np.where(used, along**2 / np.where(used, eigenvalues, 1.0), 0.0)
    return parts.sum(axis=1), used.sum(axis=1).astype(float)
