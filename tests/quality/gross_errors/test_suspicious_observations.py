"""The worst observations are those a full sort finds, whatever the last digit of equal ones."""

from __future__ import annotations

import numpy as np
import pytest

from mor.quality import test_statistics
from mor.quality.test_statistics import comparable, largest_entries, least_alike


@pytest.mark.parametrize("wanted", [1, 7, 200, 5000])
@pytest.mark.parametrize("scale", [1e3, 1.0, 1e-7])
def test_the_largest_are_those_of_a_full_sort(wanted: int, scale: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(test_statistics, "ROWS_AT_A_TIME", 700)
    random = np.random.default_rng(wanted)
    size = np.round(random.exponential(scale, 3000), 2) if scale == 1.0 else random.exponential(scale, 3000)
    size = np.repeat(size, 2) * (1.0 + 1e-12 * random.standard_normal(6000))
    size[::11] = 0.0
    places, found = largest_entries((3000, 2), lambda rows: size.reshape(3000, 2)[rows], wanted)
    assert (found == size[places]).all()
    order = np.argsort(-comparable(size), kind="stable")[:wanted]
    assert places[np.argsort(-comparable(found), kind="stable")[:wanted]].tolist() == order.tolist()


@pytest.mark.parametrize("size", [1e-9, 3e-6, 0.0999999, 0.1, 1.0, 3.29, 9.9999999, 12345.678])
def test_nothing_alike_lies_below_the_bound(size: float) -> None:
    below = least_alike(size) * np.array([1.0, 1.0 - 1e-15]) - np.array([0.0, 1e-15])
    assert (comparable(np.maximum(below, 0.0)) <= comparable(np.array([size]))).all()
    beside = size * (1.0 + np.linspace(-1e-5, 1e-5, 20001))
    alike = beside[comparable(beside) == comparable(np.array([size]))]
    assert alike.min() >= least_alike(size)
