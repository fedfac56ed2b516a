"""Helpers for arrays against what numpy has itself."""

from __future__ import annotations

import numpy as np
import pytest

from mor.types import across


@pytest.mark.parametrize("width", [1, 2, 3])
@pytest.mark.parametrize("combine", [np.minimum, np.maximum, np.add])
def test_across_is_what_reduce_gives(combine: np.ufunc, width: int) -> None:
    rows = np.random.default_rng(width).normal(size=(50, width))
    rows[::7, width - 1] = np.nan
    assert across(combine, rows).tobytes() == combine.reduce(rows, axis=1).tobytes()
