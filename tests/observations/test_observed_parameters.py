"""Observed parameters and differences, for every kind of block."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.coordinates import OBSERVED_DIFFERENCES, OBSERVED_PARAMETERS
from mor.model.observation_types import ALL_TYPES
from mor.model.parameters import KINDS
from mor.model.rotations import rotation_from_angles

PLAIN = [key for key in KINDS if key != "rotation"]


def test_there_is_one_of_each_for_every_kind_of_block():
    assert set(OBSERVED_PARAMETERS) == set(OBSERVED_DIFFERENCES) == set(KINDS)
    for key in KINDS:
        assert {f"observed/{key}", f"difference/{key}"} <= set(ALL_TYPES)


@pytest.mark.parametrize("key", PLAIN)
def test_plain_blocks_are_observed_as_they_are(key):
    first, second = np.random.default_rng(1).standard_normal((2, 5, KINDS[key].size))
    none = np.zeros((5, 0))
    np.testing.assert_array_equal(OBSERVED_PARAMETERS[key].equation([first], none).values, first)
    difference = OBSERVED_DIFFERENCES[key].equation([first, second], none).values
    np.testing.assert_array_equal(difference, second - first)
    assert OBSERVED_PARAMETERS[key].components == KINDS[key].components


def test_rotations_are_observed_as_three_angles():
    first, second = np.array([[0.1, -0.2, 3.0]]), np.array([[0.4, 0.3, -3.1]])
    blocks = [rotation_from_angles(first), rotation_from_angles(second)]
    none = np.zeros((1, 0))
    observed = OBSERVED_PARAMETERS["rotation"]
    np.testing.assert_allclose(observed.equation(blocks[:1], none).values, first, atol=1e-15)
    np.testing.assert_allclose(
        OBSERVED_DIFFERENCES["rotation"].equation(blocks, none).values, second - first, atol=1e-14
    )
    assert observed.wraps.all()
