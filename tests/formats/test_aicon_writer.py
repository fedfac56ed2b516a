"""AICON's flat files written and read again: a real block, other units, what they cannot say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mor.api.pipeline import read_document
from mor.errors import InputError
from mor.formats import read_foreign, write_foreign
from mor.project.document import Document
from tests.reference_data import missing, network_of, reference_folder

from .test_aicon_reader import FILES

PROJECT = """mor: 1
units: {length: m, angle: deg}
cameras:
  K:
    unit: um
    image: {width: 6000, height: 4000, pixel: 6 um}
    r0: 12.5 mm
    interior: {c: {free: 30.5 mm}, xh: {free: 10}, A1: {free: -1.5e-10}, B1: 1e-9, C1: -7e-5}
images:
  - columns: [id, camera, x, y, z, omega, phi, kappa]
    rows: [[i, K, 1, 2, 3, 10, 20, 30], [j, K, "", "", "", "", "", ""]]
points:
  - columns: [id, x, y, z]
    rows: [[P, 0.1, 0.2, 0.3]]
  - columns: [id, x, y, z, sigma_x, sigma_y, sigma_z]
    rows: [[Q, 1, 1, 1, 0.001, 0.001, 0.002], [R, 2, 1, 1, "", "", 0.002]]
  - columns: [id, x, y, z]
    rows: [[S, 3, 1, 1]]
    fixed: [x, y, z]
observations:
  - type: image
    columns: [image, point, x, y]
    rows: [[i, P, 100, -200], [i, Q, 300, 400], [j, P, 5, 6]]
    values: {sigma: 0.5}
  - type: distance
    columns: [from, to, distance, from_height]
    rows: [[P, Q, 1.2, ""], [P, R, 2.1, 1.5]]
    values: {sigma: 0.01 mm}
"""


def _again(document: Document, source: Path, folder: Path) -> tuple[Document, str]:
    out = write_foreign(document, source, folder / "again.ior", "aicon")
    for path, content in out.files.items():
        path.write_bytes(content)
    return read_foreign(folder / "again"), " ".join(note.message for note in out.notes)


def _numbers(value: Any) -> Any:
    """Plain data with numbers as numbers."""
    if isinstance(value, dict):
        return {key: _numbers(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_numbers(one) for one in value]
    try:
        return float(value)
    except (TypeError, ValueError):
        return value


def _same(first: Any, second: Any) -> None:
    if isinstance(first, dict):
        assert first.keys() == second.keys()
        for key in first:
            _same(first[key], second[key])
    elif isinstance(first, list):
        assert len(first) == len(second)
        for a, b in zip(first, second, strict=True):
            _same(a, b)
    else:
        assert first == (pytest.approx(second, rel=1e-13) if isinstance(second, float) else second)


def test_a_real_block_comes_out_as_it_was(tmp_path: Path) -> None:
    folder = reference_folder("aicon-115")
    if folder is None:
        pytest.skip(missing("aicon-115"))
    document = read_foreign(folder)
    again, _ = _again(document, folder, tmp_path)
    first, second = (_numbers({**d.data, "title": ""}) for d in (document, again))
    for table in (*first["points"], *second["points"]):
        table["rows"].sort(key=str)
    _same(first, second)


def test_known_points_states_and_bars_come_out_as_they_were(tmp_path: Path) -> None:
    for suffix, text in FILES.items():
        (tmp_path / f"wall{suffix}").write_text(text)
    document = read_foreign(tmp_path / "wall")
    again, _ = _again(document, tmp_path, tmp_path)
    _same(*(_numbers({**d.data, "title": ""}) for d in (document, again)))


def test_units_and_what_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(PROJECT)
    document = read_document(path)
    again, notes = _again(document, tmp_path, tmp_path)
    assert "1 point with control in some components only" in notes
    assert "1 distance with heights" in notes
    camera = _numbers(again.data["cameras"]["K"])
    assert camera["r0"] == pytest.approx(12.5)
    interior = {key: next(iter(value.values())) for key, value in camera["interior"].items()}
    expected = {"c": 30.5, "xh": 0.01, "A1": -1.5e-4, "B1": 1e-6, "C1": -7e-5, "A2": 0.0}
    assert {key: interior[key] for key in expected} == pytest.approx(expected)
    first, second = (network_of(d, tmp_path) for d in (document, again))
    xy = [next(g for g in n.groups if "image" in g.type.key).observed for n in (first, second)]
    np.testing.assert_allclose(xy[1] * 1e3, xy[0], rtol=1e-12)
    assert _numbers(again.data["points"][1]["rows"])[1] == ["S", 3000.0, 1000.0, 1000.0, 0.0, 0.0, 0.0]
    assert _numbers(again.data["images"][0]["rows"])[1][:2] == ["j", "K"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("pixel: 6 um}", "pixel: 6 um}\n    model: brown", "AICON has model mor"),
        ("[P, 0.1", "[P 1, 0.1", "names in AICON's files have no blanks"),
        ("units: {", "axes: {xy: ne}\nunits: {", "right-handed"),
    ],
)
def test_what_they_cannot_say_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(PROJECT.replace(old, new).replace("c: {free: 30.5 mm}", "c: {free: 30.5 mm}"))
    with pytest.raises(InputError, match=words):
        _again(read_document(path), tmp_path, tmp_path)
