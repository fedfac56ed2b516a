"""Networks as STAR*NET input: real ones written and read again adjust to the same; what it cannot say is told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import read_document, solve_network
from mor.errors import InputError
from mor.formats import read_foreign, write_foreign
from mor.formats.starnet import degrees, dms
from mor.project.document import Document
from tests.reference_data import NETWORKS, network_name, network_of, point_results


def _again(source: Path, folder: Path) -> tuple[Path, list[str]]:
    out = write_foreign(read_document(source), source.parent, folder / "again.dat", "starnet")
    for path, content in out.files.items():
        path.write_bytes(content)
    return folder / "again.dat", [note.message for note in out.notes]


REAL = [path for path in NETWORKS if path.parent.name == "gama"][::2]
REAL += [path for path in NETWORKS if path.match("textbook/[bk]*.yaml")][::2]


@pytest.mark.parametrize("path", REAL, ids=network_name)
def test_real_networks_adjust_to_the_same(path: Path, tmp_path: Path) -> None:
    """All that STAR*NET can say: correlations and vectors it cannot; a free datum is given back by hand."""
    source = read_document(path)
    try:
        again, notes = _again(path, tmp_path)
    except InputError as error:
        _said_rightly(source, str(error))
        return
    if any("cannot store" in note for note in notes):
        assert {entry["type"] for entry in source.data["observations"]} & {"vector", "coordinates"}
        return
    theirs = read_foreign(again, "starnet")
    theirs = replace(theirs, data={**theirs.data, "datum": source.data.get("datum", "fixed")})
    first, second = (solve_network(network_of(document, tmp_path)) for document in (source, theirs))
    before, after = point_results(first), point_results(second)
    metres, M = first.network.edge.metres, first.network.edge.matrix
    assert set(before) == set(after)
    used = ["xyz".index(c) for c in first.network.project.settings.dimensions]
    assert len(used) > 1 or "plan coordinates" in " ".join(notes)
    scale = max(float(np.abs(xyz).max()) for xyz, _ in before.values()) * metres
    for name, (xyz, sigma) in before.items():
        limit = 1e-9 * max(scale, 1.0)
        np.testing.assert_allclose(after[name][0][used], (M @ xyz * metres)[used], rtol=0, atol=limit, err_msg=name)
        ours = np.abs(M) @ sigma * metres
        np.testing.assert_allclose(after[name][1], ours, rtol=1e-6, atol=1e-12, err_msg=name)


def _said_rightly(source: Document, words: str) -> None:
    entries = source.data["observations"]
    correlated = any("covariance" in entry or "cluster" in entry for entry in entries)
    vectors = any(entry["type"] in ("vector", "coordinates") for entry in entries)
    assert "no correlations" in words
    assert correlated or vectors


NET = """mor: 1
title: all kinds
units: {length: mm, angle: gon}
axes: {xy: ne, angles: counterclockwise, bearings_from: south}
points:
  - columns: [id, x, y, z]
    rows: [[A-1, 0, 0, 10000], [B, 100000, 0, 10000]]
    fixed: [x, y, z]
  - columns: [id, x, y, z, sigma_z]
    rows: [[C, 50000, 80000, 12000, 5]]
  - columns: [id, x, y]
    rows: [[D, 20000, -40000]]
stations:
  - columns: [id, point, height]
    rows: [[S, A-1, 1500]]
observations:
  - type: zenith_directions
    columns: [station, to, horizontal, zenith, to_height, face]
    rows: [[S, B, 10, 100.13, 1300, 1], [S, C, 345.57, 98.79, 1300, 1], [S, C, 145.56, 301.21, 1300, 2]]
    values: {sigma: 5 mgon}
  - type: distance
    columns: [from, to, distance, from_height, to_height]
    rows: [[A-1, C, 94358, 1500, 1300], [B, D, 89449, 0, 0], [A-1, D, 44735, 0, 0]]
    values: {sigma: 2}
  - type: horizontal_distance
    columns: [from, to, distance, sigma]
    rows: [[B, C, 94340, 3]]
  - type: vertical_direction
    columns: [from, to, vertical_direction, sigma]
    rows: [[A-1, D, 1.52, 0.01]]
  - type: bearing
    columns: [from, to, bearing, sigma]
    rows: [[B, C, 64.43, 0.01]]
  - type: angle
    columns: [at, from, to, angle, sigma]
    rows: [[A-1, B, D, 70.49, 0.01]]
  - type: height_difference
    columns: [from, to, dz, sigma]
    rows: [[B, D, 1070, 4]]
"""


def test_every_kind_in_other_units_axes_and_senses(tmp_path: Path) -> None:
    path = tmp_path / "net.yaml"
    path.write_text(NET)
    again, notes = _again(path, tmp_path)
    assert ".SEPARATOR ," in again.read_text()
    assert "points without a height: 1" in " ".join(notes)
    first = solve_network(network_of(read_document(path), tmp_path))
    second = solve_network(network_of(read_foreign(again, "starnet"), tmp_path))
    before, after = point_results(first), point_results(second)
    M = first.network.edge.matrix
    for name in "CD":
        np.testing.assert_allclose(after[name][0], M @ before[name][0] / 1e3, rtol=0, atol=1e-9)
        np.testing.assert_allclose(after[name][1], np.abs(M) @ before[name][1] / 1e3, rtol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("A-1", "A 1", "names in STAR.NET have no blanks"),
        (
            "height]\n    rows: [[S, A-1, 1500]]",
            "height]\n    rows: [[S, A-1, 1500]]\n    level: 2 mgon",
            "levelled",
        ),
        ("rows: [[B, D, 1070, 4]]", "rows: [[B, D, 1070, 4]]\n    covariance: [[16]]", "no correlations"),
    ],
)
def test_what_it_cannot_say_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = tmp_path / "net.yaml"
    path.write_text(NET.replace(old, new))
    with pytest.raises(InputError, match=words):
        _again(path, tmp_path)


def test_angles_come_back() -> None:
    for angle in np.random.default_rng(1).uniform(-7.0, 7.0, 200).tolist():
        assert np.deg2rad(degrees(dms(angle))) == pytest.approx(angle % (2 * np.pi), abs=2e-14)
    assert degrees(dms(-1e-17)) == 0.0
