"""The overlap map against counting cell by cell; rays of points in classes; pictures of both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from mor.errors import InputError
from mor.report.figures import RAY_CLASSES, overlap
from mor.report.plots import overlap_and_rays, style
from mor.report.view import View, places, rays_of


def test_every_image_counts_once_in_the_cells_of_its_points(building_view: View) -> None:
    rays = rays_of(building_view)
    found = overlap(building_view, rays)
    assert found is not None
    seen: dict[tuple[int, int], set[int]] = {}
    for frame, point in zip(rays.frame.tolist(), rays.point.tolist(), strict=True):
        if frame < building_view.images.height:
            place = (places(building_view)[point][list(found.axes)] - found.first) / found.step
            seen.setdefault((round(place[1]), round(place[0])), set()).add(frame)
    expected = np.zeros_like(found.images)
    for cell, frames in seen.items():
        expected[cell] = len(frames)
    np.testing.assert_array_equal(found.images, expected)
    assert found.images.max() > 4


def test_no_map_where_images_span_no_area(building_view: View) -> None:
    line = replace(
        building_view,
        points=building_view.points.with_columns(pl.lit(0.0).alias("y"), pl.lit(0.0).alias("z")),
    )
    assert overlap(line, rays_of(line)) is None
    with style(), pytest.raises(InputError, match="cannot plot overlap"):
        overlap_and_rays(line)


def test_classes_of_the_picture_hold_every_point_with_rays(building_view: View) -> None:
    with style():
        figure = overlap_and_rays(building_view)
    drawn = sum(len(line.get_xdata()) for line in figure.axes[1].lines)
    assert drawn == (building_view.points["rays"] > 0).sum()
    assert [low for low, _ in RAY_CLASSES[1:]] == [high + 1 for _, high in RAY_CLASSES[:-1] if high]
