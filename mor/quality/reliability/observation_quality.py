"""Quality of the observations of one group: what is kept of it, and what follows from that.

For ten million rays every array counts. Of an uncorrelated observation only the residual v and the part 1 − r of an
error that the adjusted value absorbs are kept; cofactors and weighted residuals follow from these and σ. The joint test
of its components is kept once for a row. Correlated observations, which are few, keep theirs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray, SmallestIntArray
from mor.quality.in_chunks import in_pieces, sum_of_known


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
    """What an error of 1 does to the points of the observation, in the datum of the adjustment: see ``carried.py``."""
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
        """Of a piece of the group, whose columns all ask for it; nobody may change it."""
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
