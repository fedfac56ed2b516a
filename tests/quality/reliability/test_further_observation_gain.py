"""What a further observation gains: hᵀ (I + q)⁻¹ h, also where q has less than full rank to its last digit."""

from __future__ import annotations

import numpy as np
import pytest

from mor.quality.reliability_map import _gain


def test_gain_of_ordinary_cofactors() -> None:
    h, q = np.array([0.3, -0.2]), np.array([[0.5, 0.1], [0.1, 0.4]])
    assert _gain(h, q) == pytest.approx(h @ np.linalg.inv(np.eye(2) + q) @ h, rel=1e-12)


def test_gain_of_cofactors_that_are_large_and_of_rank_one() -> None:
    """I + q is singular in double precision; across q the gain is that of q = 0, along it nothing."""
    q = 1e30 * np.array([[1.0, 1.0], [1.0, 1.0]])
    assert _gain(np.array([1.0, -1.0]), q) == pytest.approx(2.0, rel=1e-9)
    assert _gain(np.array([1.0, 1.0]), q) == pytest.approx(0.0, abs=1e-9)
    assert _gain(np.array([1.0, 1.0]), np.full((2, 2), np.nan)) == 0.0
