"""Reliability of every observation: what a gross error in it would look like, and what it would do if not found.

In its general form, for correlated observations too (W. Baarda, 1968), with e the unit vector of an observation, P the
weights and Q_vv the cofactors of the residuals:

    test value                 w_B = eᵀPv / √(eᵀ P Q_vv P e),         standard normal without gross error
    estimated gross error      ∇̂ = −eᵀPv / (eᵀ P Q_vv P e),           −v/r without correlations
    smallest detectable one    ∇ = δ0 / √(eᵀ P Q_vv P e),             δ0² the non-centrality of α0, β0
    external reliability       δ̄0 = ∇ √(eᵀ P e − eᵀ P Q_vv P e),      bound of its effect on any function f of the
                                                                      unknowns, in units of σ_f
    influence on position      EP = ∇̂ · what an error of 1 carries into the points of the observation (``carried.py``)
None of them but EP depends on the datum. Without correlations w_B is the normalised residual v/σ_v.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.observations._contract import OUT
from mor.quality.in_chunks import in_pieces
from mor.quality.reliability.observation_quality import ObservationQuality
from mor.quality.tests.test_statistics import CONTROLLED


class Reliability(NamedTuple):
    """Reliability of one observation group, (n, m) each; NaN where there is no test. For σ0 = 1."""

    quality: ObservationQuality
    ncp: float
    """Non-centrality δ0²."""

    def at(self, rows: IntArray | slice) -> Reliability:
        """Reliability of some of the rows."""
        return Reliability(self.quality.at(rows), self.ncp)

    @property
    def test(self) -> FloatArray:
        """w_B; for excluded observations that of the test whether they fit."""
        return self._piecewise(lambda one: one._test)

    @property
    def error(self) -> FloatArray:
        """Estimated gross error, in the sense observed − true."""
        return self._piecewise(lambda one: one._error)

    @property
    def smallest(self) -> FloatArray:
        """∇, the smallest detectable gross error."""
        return self._piecewise(lambda one: one._smallest)

    @property
    def external(self) -> FloatArray:
        """δ̄0."""
        return self._piecewise(lambda one: one._external)

    def _piecewise(self, of_rows: Callable[[Reliability], FloatArray]) -> FloatArray:
        return in_pieces(self.quality.v.shape, lambda rows: of_rows(self.at(rows)))

    @property
    def _test(self) -> FloatArray:
        return self._with_excluded(self.quality.weighted / np.sqrt(self._q), lambda v, spread: v / spread)

    @property
    def _error(self) -> FloatArray:
        return self._with_excluded(-self.quality.weighted / self._q, lambda v, spread: -v)

    @property
    def _smallest(self) -> FloatArray:
        detectable = np.sqrt(self.ncp) / np.sqrt(self._q)
        return self._with_excluded(detectable, lambda v, spread: np.sqrt(self.ncp) * spread)

    @property
    def _external(self) -> FloatArray:
        q = self._q
        external = np.sqrt(self.ncp) / np.sqrt(q) * np.sqrt(np.maximum(self.quality.precision - q, 0.0))
        return self._with_excluded(external, lambda v, spread: np.zeros(len(v)))

    @property
    def influence(self) -> FloatArray:
        """EP, what the estimated error does to the position of the points of the observation; length unit."""
        influence: FloatArray = self.error * self.quality.carried
        return influence

    @property
    def _q(self) -> FloatArray:
        """Diagonal of P Q_vv P; NaN where an observation is not controlled."""
        q, precision = self.quality.q_weighted, self.quality.precision
        return np.where(q > CONTROLLED * precision, q, np.nan)

    def _with_excluded(
        self, values: FloatArray, of_excluded: Callable[[FloatArray, FloatArray], FloatArray]
    ) -> FloatArray:
        """Excluded observations against what all others say of them: v has the variance σ² + q, q of the others."""
        out = self.quality.out
        if out.any():
            spread = np.sqrt((self.quality.sigma[out] / OUT) ** 2 + self.quality.q_adjusted[out])
            values[out] = of_excluded(self.quality.v[out], spread)
        return values


def student_square(test: FloatArray, omega: float, redundancy: int) -> FloatArray:
    """t² = w² / ((Ω − w²)/(f − 1)): the test with σ0 estimated from all other observations; F(1, f − 1) distributed."""
    if redundancy <= 1:
        return np.full(test.shape, np.nan)
    square = test**2
    rest = (omega - square) / (redundancy - 1)
    ratio: FloatArray = square / np.where(rest > 0.0, rest, np.nan)
    return ratio
