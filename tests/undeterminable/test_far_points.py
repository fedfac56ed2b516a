"""Far points of images with free cameras: put at infinity while nothing is known, and taken back."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.scenarios.undeterminable.far_points import far_trial


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "given"), [(1, True), (2, False)])
def test_far_points_that_bend_the_cameras_are_taken_back_from_infinity(seed: int, given: bool, tmp_path: Path) -> None:
    assert far_trial(seed, 5, True, given, tmp_path) == ""
