"""Visibility on the earth: the horizon of each place, its curvature, surfaces in national coordinates."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from mor.api.pipeline import read_document
from mor.plan.visibility import with_visible
from tests.scenarios.small_projects import mor, write

HEAD = """\
mor: 1
units: {length: m, angle: gon}
world: {crs: "EPSG:25832", heights: ellipsoidal}
"""


def _seen(folder: Path, text: str, columns: tuple[str, str]) -> set[tuple[str, str]]:
    path = write(folder, HEAD + text)
    document, _ = with_visible(read_document(path), folder)
    [frame] = [frame for label, frame in document.frames.items() if "visible" in str(label)]
    assert isinstance(frame, pl.DataFrame)
    return set(frame.select(columns).iter_rows())


@pytest.mark.parametrize(("steepest", "seen"), [("0.15 gon", 0), ("0.25 gon", 2)])
def test_two_places_look_down_at_each_other(tmp_path: Path, steepest: str, seen: int) -> None:
    """40 km apart, at one height: s/2R = 0.2 gon below the horizon of each; level in the one of the middle."""
    text = f"""\
points:
  - {{columns: [id, east, north, height], rows: [[A, 480000, 5500000, 800], [B, 520000, 5500000, 800]]}}
observations:
  - {{type: zenith_angle, visible: {{steepest: {steepest}, both_ways: true}}, values: {{sigma: 1 mgon}}}}
"""
    if seen:
        assert _seen(tmp_path, text, ("from", "to")) == {("A", "B"), ("B", "A")}
    else:
        found = mor("design", write(tmp_path, HEAD + text), "-o", tmp_path / "out")
        assert found.code == 2
        assert "nothing is seen: of 2 sights" in found.err


def test_instruments_stand_and_targets_look_along_their_own_verticals(tmp_path: Path) -> None:
    """A wall of 30 m in national coordinates, 500 km from the middle: who stands high enough looks over it."""
    text = """\
points:
  - {columns: [id, east, north, height],
     rows: [[A, 500000, 5000000, 0], [B, 500100, 5000000, 0], [C, 500100, 5000040, 0]]}
  - {columns: [id, east, north, height], rows: [[Z, 500000, 6000000, 0]]}
visibility:
  surfaces: [{polygon: [[500050, 4999990, -5], [500050, 4999990, 30], [500050, 5000010, 30], [500050, 5000010, -5]]}]
  normals: [{points: [C], direction: [-1, -0.4, 0]}]
observations:
  - {type: distance, visible: {at: [A], to: [B, C], incidence: 30 gon},
     values: {sigma: 1 mm, from_height: HEIGHT, to_height: HEIGHT}}
"""
    assert _seen(tmp_path / "low", text.replace("HEIGHT", "29.9"), ("from", "to")) == {("A", "C")}
    assert _seen(tmp_path / "high", text.replace("HEIGHT", "30.1"), ("from", "to")) == {
        ("A", "B"),
        ("A", "C"),
    }
    away = text.replace("HEIGHT", "30.1").replace("[-1, -0.4, 0]", "[1, 0.4, 0]")
    assert _seen(tmp_path / "away", away, ("from", "to")) == {("A", "B")}


def test_an_image_in_a_projection_sees_what_is_on_its_format(tmp_path: Path) -> None:
    """c = 100 mm, 1000 m above: a format of 100 mm reaches 500 m to each side."""
    rows = [[f"p{k}", 500000 + 100 * k + 50, 5500000, 0] for k in range(-8, 8)]
    text = f"""\
cameras: {{K: {{image: {{width: 10000, height: 10000, pixel: 10 um}}, interior: {{c: 100}}}}}}
images:
  - {{columns: [id, camera, east, north, elevation, omega, phi, kappa], rows: [[I, K, 500000, 5500000, 1000, 0, 0, 0]]}}
points: [{{columns: [id, east, north, height], rows: {rows}}}]
observations: [{{type: image, visible: {{}}, values: {{sigma: 0.005}}}}]
"""
    assert _seen(tmp_path, text, ("image", "point")) == {("I", f"p{k}") for k in range(-5, 5)}


@pytest.mark.parametrize(
    ("world", "words"),
    [
        ('{crs: "EPSG:25832", heights: orthometric}', "corners above the geoid need its grid"),
        (
            '{crs: "EPSG:4258", heights: ellipsoidal}',
            "a surface has its corners in a projection or geocentric",
        ),
    ],
)
def test_corners_that_say_no_place(tmp_path: Path, world: str, words: str) -> None:
    names = "latitude, longitude, height" if "4258" in world else "east, north, height, geoid"
    first, second = (
        ("55, 10, 0", "55.01, 10, 0") if "4258" in world else ("500000, 5500000, 0, 45", "500100, 5500000, 0, 45")
    )
    text = f"""\
mor: 1
units: {{length: m, angle: deg}}
world: {world}
points: [{{columns: [id, {names}], rows: [[A, {first}], [B, {second}]]}}]
visibility: {{surfaces: [{{polygon: [[0, 0, 0], [1, 0, 0], [0, 1, 0]]}}]}}
observations: [{{type: distance, visible: {{}}, values: {{sigma: 0.001}}}}]
"""
    found = mor("design", write(tmp_path, text), "-o", tmp_path / "out")
    assert found.code == 2
    assert words in found.err
    assert not (tmp_path / "out").exists()
