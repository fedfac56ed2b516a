"""The part that some observations have in vᵀPv: how it is distributed.

Ω_g = v_gᵀ P_g v_g of whitened residuals with the cofactors R_g, a diagonal block of the projection R, is a sum of
squares of independent normal variables, weighted with the eigenvalues λ of R_g, 0 ≤ λ ≤ 1. It is χ² only where all of
them are 0 or 1, as for all observations together. It has

    E Ω_g = Σλ = tr R_g = Σr,    Var Ω_g = 2 Σλ² = 2 tr R_g²,    third cumulant 8 Σλ³ = 8 tr R_g³,

and (Ω_g − Σλ)/√(2 Σλ²) is compared with (χ²_ν − ν)/√(2ν), ν = (Σλ²)³/(Σλ³)², which has the same three (E. S. Pearson,
1959; J. P. Imhof, 1961). That one begins above 0 where λ differ much; below the mean it is (Σλ²/Σλ) χ²_ν with the first
two, ν = (Σλ)²/Σλ² (F. E. Satterthwaite, 1946), instead.

Σr is known of all observations. Σλ² is not, as it needs cofactors between each two of them; it lies between (Σr)²/n,
all λ alike, and Σr, all λ 0 or 1. What both say alike needs no more. Where they differ it is worked out: exactly for
few observations, for many by M. F. Hutchinson's (1989) estimate from a few random vectors of signs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import gammainc

from mor.arrays import FloatArray
from mor.quality.reliability.whitened_rows import WhitenedRows
from mor.quality.tests.p_values import log_p_chi2

PROBES = 96
"""Observations up to which moments are exact, and vectors of signs for more: Σλ² is off by 2/√(96 ν) of itself then."""


class Moments(NamedTuple):
    """Σλ, Σλ² and Σλ³ of k quadratic forms, (k,) each."""

    first: FloatArray
    second: FloatArray
    third: FloatArray

    @property
    def freedom(self) -> FloatArray:
        """(k,) ν."""
        return np.asarray(self.second**3 / self.third**2)


def bounds(redundancy: FloatArray, count: FloatArray) -> tuple[Moments, Moments]:
    """Moments (k,) of least and largest variance that Σr (k,) of so many observations (k,) allows."""
    each = redundancy / np.maximum(count, 1.0)
    largest = np.minimum(redundancy, 1.0)  # all in eigenvalues of 1, or in one below 1
    return tuple(  # type: ignore[return-value]
        Moments(redundancy, redundancy * one, redundancy * one**2)
        for one in (each, np.maximum(largest, each))
    )


def moments(rows: WhitenedRows, redundancy: float) -> Moments:
    """Moments (1,) of the part of vᵀPv of the chosen observations; ``redundancy`` is their Σr."""
    count = rows.size
    probes = np.eye(count)
    if count > PROBES:
        signs = np.random.default_rng(1989).integers(0, 2, (count, PROBES))
        probes = (2.0 * signs - 1.0) / np.sqrt(PROBES)
    once = rows.residuals_of(probes)[0]
    second, third = float(np.sum(once**2)), float(np.sum(once * rows.residuals_of(once)[0]))
    least, largest = bounds(np.array([redundancy]), np.array([float(count)]))
    second = float(np.clip(second, least.second[0], largest.second[0]))
    third = float(np.clip(third, second**2 / redundancy, second * largest.third[0] / largest.second[0]))
    return Moments(np.array([redundancy]), np.array([second]), np.array([third]))


def log_tail(omega: FloatArray, of: Moments) -> FloatArray:
    """ln of twice the smaller of P(Ω_g ≥ ω) and P(Ω_g ≤ ω), (k,): the two-sided probability; at most 0."""
    freedom = np.broadcast_to(of.freedom, omega.shape)
    square = np.maximum(freedom + (omega - of.first) * np.sqrt(freedom / of.second), 0.0)
    half = np.broadcast_to(0.5 * of.first**2 / of.second, omega.shape)
    with np.errstate(divide="ignore"):
        below = np.log(gammainc(half, np.maximum(omega, 0.0) * half / of.first))
    one_sided = np.where(omega > of.first, log_p_chi2(square, freedom), below)
    two_sided: FloatArray = np.minimum(np.log(2.0) + one_sided, 0.0)
    return two_sided
