"""Deviations in space, notes of results, and what the overlays of the network are drawn from."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from mor.errors import Message
from mor.model.observation_types import PLAIN_TYPES
from mor.report.identity import note_rows
from mor.report.page_data import (
    _drawn_kinds,
    _to_sigma,
    detectable_effects,
    deviations,
    scale_of_effects,
    sights,
)
from mor.report.view import View
from tests.scenarios.small_projects import LEVELLING, mor, write


def row(point: str, component: str, v: float) -> dict[str, object]:
    return {"point": point, "component": component, "unit": "m", "v": v}


def test_deviations_in_space() -> None:
    """3-4-12 makes 13; a point without a height counts in plan alone."""
    rows = [row("A", "x", 3.0), row("A", "y", -4.0), row("A", "z", 12.0), row("B", "x", 1.0)]
    x, _, _, space = deviations(pl.DataFrame(rows))
    assert (x["count"], x["mean"], x["largest"]) == (2, 2.0, 3.0)
    assert x["rms"] == pytest.approx(np.sqrt(5.0))
    assert (space["component"], space["count"], space["rms"], space["mean"]) == ("3-D", 1, 13.0, None)


def test_notes_have_places_that_tell_nothing_of_the_machine(tmp_path: Path) -> None:
    notes = [Message("strange", str(tmp_path / "data" / "a.csv"), 7), Message("no place")]
    assert note_rows(notes, tmp_path) == [
        {"message": "strange", "file": "data/a.csv", "line": 7},
        {"message": "no place", "file": "", "line": 0},
    ]


def test_notes_stand_in_the_results(tmp_path: Path) -> None:
    text = LEVELLING.replace("[C, A, -2.001, 0.001]", "[C, A, -2.001, 0.001], [C, B, -1.0, 100.0]")
    mor("adjust", write(tmp_path, text), "--no-html")
    noted = json.loads((tmp_path / "project.results" / "results.json").read_text(encoding="utf-8"))["notes"]
    said = mor("check", tmp_path / "project.yaml").err
    assert all(one["message"] in said for one in noted)


def test_external_reliability_of_every_point_has_its_place(building_view: View) -> None:
    effects, names = detectable_effects(building_view), building_view.points["id"]
    assert [names[k] for k in effects["point"]] == building_view.external["point"].to_list()
    sizes = np.linalg.norm(effects.select("dx", "dy", "dz").to_numpy(), axis=1)
    assert len(sizes) > 100
    extent = max(float(np.ptp(building_view.points[name].to_numpy())) for name in "xyz")
    assert 0.02 < scale_of_effects(building_view, effects) * np.quantile(sizes, 0.9) / extent < 0.07


def test_scale_bars_of_a_block_are_told_from_distances(building_view: View) -> None:
    kinds = sights(building_view).group_by("kind").len()
    count = dict(kinds.iter_rows())
    assert count["scale"] >= 2
    assert count["distance"] > 0


def test_every_observation_between_places_is_drawn() -> None:
    drawn = _drawn_kinds()
    between = {kind.name for kind in PLAIN_TYPES.values() if kind.distances or len(kind.references) == 3}
    assert between <= set(drawn)
    assert drawn["gnss_vector"] == "vector"
    assert drawn["ellipsoidal_height_difference"] == drawn["height_difference"] == "levelling"
    assert drawn["azimuth"] == drawn["zenith_directions"] == "direction"
    assert drawn["mean_sea_level_distance"] == "distance"
    assert "gnss_position" not in drawn


def test_rounding_is_far_below_sigma() -> None:
    rng = np.random.default_rng(3)
    x = rng.uniform(-1e6, 1e6, 500)
    frame = pl.DataFrame(
        {"x": x, "y": x, "z": x, "sx": np.full(500, 0.02), "sy": np.full(500, 1e-5), "sz": np.zeros(500)}
    )
    rounded = _to_sigma(frame)
    assert np.abs(rounded["x"].to_numpy() - x).max() < 1e-3 * 0.02
    assert np.abs(rounded["y"].to_numpy() - x).max() < 1e-3 * 1e-5
    assert (rounded["z"].to_numpy() == x).all()
