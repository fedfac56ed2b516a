"""Directions of semi-axes on the page: with their lengths they make the covariance again, in any axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from mor.report.page_data import covariances, directions_of_semi_axes
from mor.report.view import View


@pytest.mark.parametrize(
    ("xy", "angles", "zero"),
    [("en", "clockwise", "north"), ("ne", "counterclockwise", "east"), ("ws", "clockwise", "south")],
)
def test_semi_axes_make_the_covariance(building_view: View, xy: str, angles: str, zero: str) -> None:
    axes = {"xy": xy, "angles": angles, "bearings_from": zero}
    view = replace(building_view, summary={**building_view.summary, "axes": axes})
    found = directions_of_semi_axes(view)
    sense = 1.0 if angles == "clockwise" else -1.0
    start = {"north": 0.0, "east": 0.5, "south": 1.0}[zero] * np.pi
    unit = np.pi / 200.0
    total = np.zeros((found.height, 3, 3))
    for axis in "abc":
        azimuth = start + sense * unit * found[f"ellipsoid_azimuth_{axis}"].fill_nan(0.0).to_numpy()
        elevation = unit * found[f"ellipsoid_elevation_{axis}"].fill_nan(0.0).to_numpy()
        level = np.cos(elevation)
        compass = {"e": level * np.sin(azimuth), "n": level * np.cos(azimuth)}
        compass |= {"w": -compass["e"], "s": -compass["n"]}
        along = np.stack([compass[xy[0]], compass[xy[1]], np.sin(elevation)], axis=-1)
        length = view.points[f"ellipsoid_{axis}"].fill_null(0.0).to_numpy()
        total += length[:, None, None] ** 2 * along[:, :, None] * along[:, None]
    expected = covariances(view.points)
    size = np.linalg.norm(expected, axis=(1, 2)).max()
    np.testing.assert_allclose(total, expected, atol=5e-3 * size)


def test_no_direction_without_length(building_view: View) -> None:
    flat = building_view.points.with_columns(pl.lit(0.0).alias("sx"), pl.lit(0.0).alias("sy"))
    found = directions_of_semi_axes(replace(building_view, points=flat))
    free = (building_view.points["sz"].fill_null(0.0) > 0.0).to_numpy()
    assert found["ellipsoid_azimuth_b"].is_nan().all()
    assert np.isfinite(found["ellipsoid_elevation_a"].to_numpy()[free]).all()
    assert found["ellipsoid_elevation_a"].to_numpy()[free] == pytest.approx(100.0)
