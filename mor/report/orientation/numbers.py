"""Arrays as plain data, and small tables of what has a σ."""

from __future__ import annotations

from typing import Any

import numpy as np

from mor.arrays import FloatArray
from mor.geometry.rotations import angles_by_tangent

ANGLES = ("omega", "phi", "kappa")


def number(value: Any) -> float | None:
    """A number, or nothing if there is none."""
    return float(value) if np.isfinite(value) else None


def numbers(array: FloatArray) -> Any:
    """Nested lists of an array."""
    return [numbers(row) for row in array] if np.ndim(array) > 1 else [number(value) for value in array]


def with_sigma(names: tuple[str, ...], values: FloatArray, sigmas: FloatArray) -> dict[str, float | None]:
    """``x: 1.0, sx: 0.1`` …"""
    return {
        **{name: number(value) for name, value in zip(names, values, strict=True)},
        **{f"s{name}": number(sigma) for name, sigma in zip(names, sigmas, strict=True)},
    }


def sigmas(covariance: FloatArray) -> FloatArray:
    """Standard deviations (…, k) of covariances (…, k, k)."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("...ii->...i", covariance), 0.0)))


def correlation(covariance: FloatArray) -> FloatArray:
    """Correlations (k, k); not a number for what is held."""
    sigma = sigmas(covariance)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(covariance / np.outer(sigma, sigma))


def by_turn(angles: FloatArray) -> FloatArray:
    """d(ω, φ, κ)/dδ (3, 3); not a number where φ = ±100 gon and ω and κ are one angle."""
    rows = angles_by_tangent(angles)
    return rows if np.all(np.isfinite(rows)) else np.full((3, 3), np.nan)
