"""Of movements that fit alike that is taken which leaves cameras above what they see, where anything is seen."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mor.start.bundle import Similarity, SimilarityOutcome
from mor.start.join import _likelier
from mor.start.movement import Movement

UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0])


def _movement() -> Movement:
    other = Similarity(SimilarityOutcome.DETERMINED, 1.0, np.eye(3), np.zeros(3), np.zeros((0, 3)), 0.0)
    return Movement(1.0, UPSIDE_DOWN, np.zeros(3), 0, 0.0, 3, (other,))


@pytest.mark.parametrize(("seen", "turned"), [(0.0, np.eye(3)), (np.nan, UPSIDE_DOWN)])
def test_a_part_of_images_without_points_is_taken_as_it_fits_first(seen: float, turned: Any) -> None:
    """It ended in an internal error: there is no middle of no points."""
    source: Any = SimpleNamespace(poses={0: (np.array([0.0, 0.0, 9.0]), np.eye(3))}, points=np.full((4, 3), seen))
    scene: Any = SimpleNamespace(choices=SimpleNamespace(take=lambda _: 0))
    assert np.array_equal(_likelier(_movement(), source, scene).rotation, turned)
