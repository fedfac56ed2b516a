"""Fours in kernels against the same in Python."""

from __future__ import annotations

import numpy as np
import pytest

from mor.linalg.compilation import compile_kernel
from mor.linalg.registers import each, fetch, four, put, same, total


def _of_all_operations(array, place, into):
    fetch(array, place + 64)
    numbers = four(array, place)
    put(into, 1, each(array, 2) * numbers - same(0.5) + 2.0 * numbers * 3.0)
    put(into, 6, numbers)
    return total(numbers * numbers)


@pytest.mark.kernels
@pytest.mark.parametrize("whole", [np.int64, np.int32])
def test_kernels_do_with_fours_what_python_does(whole):
    array = np.random.default_rng(1).standard_normal(12)
    one, other = np.zeros(11), np.zeros(11)
    found = compile_kernel(_of_all_operations)(array, whole(3), one)
    assert found == pytest.approx(_of_all_operations(array, 3, other), rel=1e-15)
    np.testing.assert_allclose(one, other, rtol=1e-14)
    assert one[0] == one[5] == one[10] == 0.0
    np.testing.assert_allclose(other[6:10], array[3:7], rtol=0.0)
    np.testing.assert_allclose(other[1:5], array[2] * array[3:7] - 0.5 + 6.0 * array[3:7], rtol=1e-14)
