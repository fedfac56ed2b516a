"""Logarithms of p-values, right also where the p-value itself is smaller than any number a computer has."""

from __future__ import annotations

import numpy as np
from scipy.special import betainc, betaln, gammaincc, gammaln, log_ndtr

from mor.arrays import FloatArray

_TERMS = 2000
_MANY = 10_000.0


def log_p_normal(w: FloatArray) -> FloatArray:
    """ln P(|x| ≥ |w|), x standard normal."""
    log_p: FloatArray = np.log(2.0) + log_ndtr(-np.abs(w))
    return log_p


def log_p_chi2(square: FloatArray, freedom: FloatArray) -> FloatArray:
    """ln P(χ² ≥ ``square``); far out by the asymptotic series of the incomplete gamma function (DLMF 8.11.2)."""
    if (freedom[np.isfinite(square)] == 2.0).all():
        return -0.5 * square + 0.0 * freedom
    a, x = 0.5 * freedom, 0.5 * square
    with np.errstate(divide="ignore", invalid="ignore"):
        log_p = np.log(gammaincc(a, x))
        far = (a - 1.0) * np.log(x) - x - gammaln(a) + np.log1p((a - 1.0) / x + (a - 1.0) * (a - 2.0) / x**2)
    return np.where(np.isneginf(log_p) & np.isfinite(square), far, log_p)


def log_p_student(square: FloatArray, freedom: float) -> FloatArray:
    """ln P(t² ≥ ``square``) for Student's t with ``freedom`` degrees of freedom; NaN without any.

    This is F(1, f): the regularised incomplete beta function I_x(f/2, 1/2) at x = f/(f + t²). With very many degrees
    of freedom it is the normal distribution of a transformed t (G. W. Hill, 1970, Algorithm 395), to ten digits.
    """
    if freedom < _MANY:
        return log_p_f(square, 1.0, freedom)
    a = freedom - 0.5
    b = 48.0 * a * a
    z2 = a * np.log1p(square / freedom)
    higher = (((4.0 * z2 + 33.0) * z2 + 240.0) * z2 + 855.0) / (10.0 * b * (b + 0.8 * z2 * z2 + 100.0))
    return log_p_normal(np.sqrt(z2) * (1.0 + (z2 + 3.0) / b - higher))


def log_p_f(ratio: FloatArray, above: float | FloatArray, freedom: float) -> FloatArray:
    """ln P(F ≥ ``ratio``) for F(``above``, ``freedom``)."""
    if freedom <= 0.0:
        return np.full(np.shape(ratio), np.nan)
    above = np.broadcast_to(np.asarray(above, dtype=float), np.shape(ratio))
    square = above * ratio
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
    for m in range(1, _TERMS):
        even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m))
        d, c = 1.0 / (1.0 + even * d), 1.0 + even / c
        fraction *= d * c
        odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0))
        d, c = 1.0 / (1.0 + odd * d), 1.0 + odd / c
        fraction *= d * c
        if np.abs(d * c - 1.0).max() < 1e-15:
            break
    return np.asarray(front + np.log(fraction))
