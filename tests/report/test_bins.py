"""Histograms of test values: nothing is lost, and nothing grows with the largest of them."""

from __future__ import annotations

import numpy as np
import pytest

from mor.report.layout import OUTERMOST, normal_bins


@pytest.mark.parametrize("largest", [0.0, 0.3, 2.0, 9.9, 1e3, 1e15, np.inf])
@pytest.mark.parametrize("critical", [1.0, 3.29, 9.8, 37.0])
def test_every_value_is_in_a_class(largest: float, critical: float) -> None:
    w = np.array([-largest, -1.0, 0.0, 0.1, 1.0, largest])
    bins = normal_bins(w, critical)
    assert np.histogram(bins.w, bins.edges)[0].sum() == len(w)
    assert bins.limit > critical
    assert len(bins.edges) <= 8.0 * max(OUTERMOST, critical + 1.5) + 1
    assert bins.beyond == np.count_nonzero(np.abs(w) > bins.limit)


def test_values_within_stay_where_they_are() -> None:
    w = np.linspace(-3.1, 3.1, 101)
    np.testing.assert_array_equal(normal_bins(w, 3.29).w, w)
