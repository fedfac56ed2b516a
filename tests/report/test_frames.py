"""Frames of figures: the bulk of the places, and the way to what stands outside."""

from __future__ import annotations

import numpy as np
import pytest

from mor.report.layout import at_edge, frame_of, with_distances


def test_far_places_do_not_widen_the_frame() -> None:
    grid = np.stack(np.meshgrid(np.arange(10.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
    assert frame_of(grid) is None
    assert frame_of(np.vstack([grid, [[30.0, 3.0]]])) is None, "eight median distances are near"
    found = frame_of(np.vstack([grid, [[10_000.0, 3.0], [np.nan, 1.0]]]))
    assert found is not None
    np.testing.assert_array_equal(found, [[0.0, 0.0], [9.0, 5.0]])


@pytest.mark.parametrize("places", [np.zeros((0, 3)), np.zeros((5, 3)), np.full((2, 3), np.nan)])
def test_degenerate_places_have_no_frame(places: np.ndarray) -> None:
    assert frame_of(places) is None


def test_places_outside_stand_at_the_edge() -> None:
    xy = np.array([[5.0, 1.0], [10.0, 2.0], [105.0, 1.0], [5.0, -30.0], [15.0, 3.0]])
    edge, distance = at_edge(xy, np.zeros(2), np.array([10.0, 2.0]))
    np.testing.assert_allclose(edge, [[5.0, 1.0], [10.0, 2.0], [10.0, 1.0], [5.0, 0.0], [10.0, 2.0]])
    np.testing.assert_allclose(distance, [0.0, 0.0, 95.0, 30.0, np.sqrt(26.0)])
    assert with_distances(["A", "B"], np.array([0.0, 8054.3]), "m") == ["A", "B, 8054 m"]
