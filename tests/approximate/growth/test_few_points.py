"""Few images of few points start from nothing."""

import pytest

from tests.scenarios.few_points import few_points
from tests.scenarios.mixtures.trial import compared
from tests.selection import slow_but


@pytest.mark.parametrize("seed", slow_but([0, 1, 2], range(10)))
def test_images_that_share_few_points_are_oriented(seed, tmp_path):
    trial = compared(*few_points(seed, tmp_path), frozenset())
    assert trial.reached or not trial.counts, trial.words
