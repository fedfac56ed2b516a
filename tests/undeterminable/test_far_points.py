"""Far points of images with free cameras: put at infinity while nothing is known, and taken back."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mor.quality.determinability import _is_worse
from mor.quality.test_statistics import critical_value
from tests.scenarios.undeterminable.far_points import far_trial


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "given"), [(1, True), (2, False)])
def test_far_points_that_bend_the_cameras_are_taken_back_from_infinity(seed: int, given: bool, tmp_path: Path) -> None:
    assert far_trial(seed, 5, True, given, tmp_path) == ""


@pytest.mark.parametrize(("more", "worse"), [(60.0, False), (75.0, True)])
def test_points_at_infinity_are_tested_together(more: float, worse: bool) -> None:
    """Of 36 more points χ² at the level 0.001 is 68, though each of them could take 10.8."""

    def end(squares: float, points: int) -> Any:
        problem = SimpleNamespace(observations=200, index=SimpleNamespace(count=100))
        adjustment = SimpleNamespace(problem=problem, normals=SimpleNamespace(objective=squares))
        return SimpleNamespace(adjustment=adjustment, is_complete=True, suspects=None), SimpleNamespace(
            points=np.arange(points)
        )

    assert _is_worse(end(90.0, 4), end(90.0 + more, 40), critical_value(0.001)) is worse
    assert _is_worse(end(90.0, 40), end(190.0, 40), critical_value(0.001)), "no more are there that could explain it"
    assert not _is_worse(end(190.0, 40), end(90.0, 40), critical_value(0.001))
