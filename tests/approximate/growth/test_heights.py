"""Heights carried over known differences."""

import numpy as np
import pytest

from mor.start.levelled import _carry_heights
from mor.start.part import empty_part


@pytest.mark.parametrize("wrong", [-2.5, 2.5])
def test_one_wrong_difference_of_several_does_not_tell_a_height(wrong):
    """Station 5 sees four points of known height; the last of its differences is of another point."""
    part = empty_part(7)
    part.points[:4, 2] = [1.0, 2.0, 3.0, 4.0]
    true = np.array([1.0, 2.0, 3.0, 4.0]) - 10.0
    true[3] += wrong
    assert _carry_heights(part, np.full(4, 5), np.arange(4), true)
    assert part.points[5, 2] == 10.0
    assert np.isnan(part.points[[4, 6], 2]).all()


def test_heights_are_carried_either_way_and_known_ones_stay():
    part = empty_part(4)
    part.points[0, 2] = 100.0
    ends = np.array([0, 2, 3]), np.array([1, 0, 0])
    assert _carry_heights(part, *ends, np.array([5.0, 7.0, np.nan]))
    np.testing.assert_array_equal(part.points[:, 2], [100.0, 105.0, 93.0, np.nan])
    assert not _carry_heights(part, *ends, np.array([6.0, 8.0, np.nan])), "they are known now"
    np.testing.assert_array_equal(part.points[:, 2], [100.0, 105.0, 93.0, np.nan])
