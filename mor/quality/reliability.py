"""Reliability of every observation: what a gross error in it would look like, and what it would do if not found.

In its general form, for correlated observations too (W. Baarda, 1968), with e the unit vector of an observation, P the
weights and Q_vv the cofactors of the residuals:

    test value                 w_B = eᵀPv / √(eᵀ P Q_vv P e),         standard normal without gross error
    estimated gross error      ∇̂ = −eᵀPv / (eᵀ P Q_vv P e),           −v/r without correlations
    smallest detectable one    ∇ = δ0 / √(eᵀ P Q_vv P e),             δ0² the non-centrality of α0, β0
    external reliability       δ̄0 = ∇ √(eᵀ P e − eᵀ P Q_vv P e),      bound of its effect on any function f of the
                                                                      unknowns, in units of σ_f
None of them depends on the datum. Without correlations w_B is the normalised residual v/σ_v.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.geometry.arrays import FloatArray
from mor.observations import ObservationGroup
from mor.quality.redundancy import ObservationQuality
from mor.quality.tests import CONTROLLED


class Reliability(NamedTuple):
    """Reliability of one observation group, (n, m) each; NaN where there is no test. For σ0 = 1."""

    test: FloatArray
    """w_B; for excluded observations that of the test whether they fit."""
    error: FloatArray
    """Estimated gross error, in the sense observed − true."""
    smallest: FloatArray
    """∇, the smallest detectable gross error."""
    external: FloatArray
    """δ̄0."""


def reliability(group: ObservationGroup, quality: ObservationQuality, ncp: float) -> Reliability:
    """Reliability of a group, ``ncp`` = δ0²."""
    controlled = np.nan_to_num(quality.q_weighted) > CONTROLLED * np.nan_to_num(quality.precision, nan=np.inf)
    q = np.where(controlled, quality.q_weighted, np.nan)
    root = np.sqrt(q)
    smallest = np.sqrt(ncp) / root
    hidden = np.maximum(quality.precision - q, 0.0)
    result = Reliability(quality.weighted / root, -quality.weighted / q, smallest, smallest * np.sqrt(hidden))
    return _with_excluded(group, quality, result, ncp)


def _with_excluded(
    group: ObservationGroup, quality: ObservationQuality, result: Reliability, ncp: float
) -> Reliability:
    """Excluded observations against what all others say of them: v has the variance σ² + q, q that of the others."""
    out = group.left_out
    if not out.any():
        return result
    spread = np.sqrt(group.given_sigma[out] ** 2 + quality.q_adjusted[out])
    for array, values in (
        (result.test, quality.v[out] / spread),
        (result.error, -quality.v[out]),
        (result.smallest, np.sqrt(ncp) * spread),
        (result.external, np.zeros(len(spread))),
    ):
        array[out] = values
    return result


def student_square(test: FloatArray, omega: float, redundancy: int) -> FloatArray:
    """t² = w² / ((Ω − w²)/(f − 1)): the test with σ0 estimated from all other observations; F(1, f − 1) distributed."""
    if redundancy <= 1:
        return np.full(test.shape, np.nan)
    square = test**2
    rest = (omega - square) / (redundancy - 1)
    ratio: FloatArray = square / np.where(rest > 0.0, rest, np.nan)
    return ratio
