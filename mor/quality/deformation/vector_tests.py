"""Tests of many vectors at once: is a velocity, a step, a movement more than chance?

T = dᵀ Q⁻¹ d/h for a vector d with cofactors Q of rank h, against χ² (σ0 known) or F (σ0 estimated). A vector of length
∇ is found with the power β0 where ∇ᵀ Q⁻¹ ∇ reaches the non-centrality λ of that test at its level: the smallest one
that every direction is found of has the length √(λ q), q the largest eigenvalue of Q.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, chndtrinc, fdtri, ncfdtrinc

from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant
from mor.quality.tests.p_values import log_p_chi2, log_p_f

_RANK = 1e-10


class VectorTests(NamedTuple):
    """Tests of n vectors of k components."""

    vectors: FloatArray
    """(n, k)."""
    cofactors: FloatArray
    """(n, k, k) for σ0 = 1."""
    statistic: FloatArray
    """(n,) dᵀ Q⁻¹ d/h for σ0 = 1."""
    freedom: IntArray
    """(n,) h; 0 where nothing has a variance."""
    longest: FloatArray
    """(n,) square root of the largest eigenvalue of Q."""

    def log_p(self, redundancy: int, variance: float | None) -> FloatArray:
        """(n,) natural logarithms of the p-values, with σ0 known, or with the estimated ``variance`` factor."""
        h = self.freedom.astype(float)
        with np.errstate(divide="ignore", invalid="ignore"):
            if variance is None or redundancy <= 0:
                found = log_p_chi2(self.statistic * h, h)
            else:
                found = log_p_f(self.statistic / variance, np.maximum(h, 1.0), redundancy)
        return np.where(self.freedom > 0, found, np.nan)


def vector_tests(d: FloatArray, q: FloatArray) -> VectorTests:
    """Tests of vectors d (n, k) with cofactors q (n, k, k); directions without any variance are left out."""
    size = np.sqrt(np.maximum(np.diagonal(q, axis1=1, axis2=2), 0.0))
    scale = np.where(size > 0.0, size, 1.0)
    eigenvalues, axes = tolerant.eigh(q / (scale[:, :, None] * scale[:, None, :]))
    used = eigenvalues > _RANK * np.maximum(eigenvalues[:, -1:], 1e-300)
    along = np.einsum("nki,nk->ni", axes, d / scale)
    total = np.sum(np.where(used, along**2 / np.where(used, eigenvalues, 1.0), 0.0), axis=1)
    freedom = np.count_nonzero(used, axis=1)
    longest = np.sqrt(np.maximum(tolerant.eigvalsh(q)[:, -1], 0.0))
    return VectorTests(d, q, total / np.maximum(freedom, 1), freedom, longest)


def noncentrality_of(freedom: int, level: float, power: float, redundancy: int | None = None) -> float:
    """λ at which the test of h degrees of freedom at a level has this power; σ0 known, or of a ``redundancy``."""
    if redundancy is None:
        return float(chndtrinc(float(chdtri(freedom, level)), freedom, 1.0 - power))
    return float(ncfdtrinc(freedom, redundancy, 1.0 - power, float(fdtri(freedom, redundancy, 1.0 - level))))
