"""Photographs: cameras by what they say, positions by GNSS, what cannot be read."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image, TiffImagePlugin

from mor.api.pipeline import read_document, read_network
from tests.scenarios.small_projects import mor


def _photograph(path: Path, latitude: float, wide: int = 28, size: tuple[int, int] = (40, 30), **gps: object) -> None:
    picture = Image.new("RGB", size)
    exif = picture.getexif()
    exif[0x010F], exif[0x0110] = "Maker", "Model 5"
    inner = exif.get_ifd(0x8769)
    inner[0x920A], inner[0xA405] = TiffImagePlugin.IFDRational(88, 10), wide
    if latitude:
        part = exif.get_ifd(0x8825)
        minutes = abs(latitude) % 1 * 60
        rational = TiffImagePlugin.IFDRational
        part[1], part[2] = (
            ("S" if latitude < 0 else "N"),
            (rational(int(abs(latitude))), rational(round(minutes * 1e7), 10**7), rational(0)),
        )
        part[3], part[4] = "E", (rational(8), rational(0), rational(0))
        part[6] = rational(1203, 10)
    picture.save(path, exif=exif)


def test_a_project_of_photographs(tmp_path: Path) -> None:
    for k in range(3):
        _photograph(tmp_path / f"a{k}.jpg", 50.0 + k * 1e-4)
    _photograph(tmp_path / "tele.jpg", 0.0, wide=85)
    run = mor("new", tmp_path / "p.yaml", *sorted(tmp_path.glob("*.jpg")))
    assert run.code == 0, run.err
    assert "4 photographs of 2 cameras" in run.err
    assert "latitude 50, longitude 8, height 120.3" in run.err
    document = read_document(tmp_path / "p.yaml")
    assert list(document.data["cameras"]) == [
        "1: Maker Model 5 8.8 mm 40 x 30",
        "2: Maker Model 5 8.8 mm 40 x 30",
    ]
    rows = document.data["images"][0]["rows"]
    assert [row[0] for row in rows] == ["a0.jpg", "a1.jpg", "a2.jpg", "tele.jpg"]
    assert float(rows[2][3]) == pytest.approx(2e-4 * 111229, abs=0.01)  # a degree of latitude at 50°: 111 229 m
    assert [float(v) for v in rows[1][5:8]] == [5, 5, 10]
    network = read_network(document, tmp_path)
    assert network.start["interior/mor"][0, 0] == pytest.approx(28 / 43.2666 * 50, rel=1e-4)


def test_an_accuracy_that_is_said_is_taken(tmp_path: Path) -> None:
    _photograph(tmp_path / "a.jpg", -50.0)
    picture = Image.open(tmp_path / "a.jpg")
    exif = picture.getexif()
    exif.get_ifd(0x8825)[31] = TiffImagePlugin.IFDRational(25, 1000)
    picture.save(tmp_path / "b.jpg", exif=exif)
    assert mor("new", tmp_path / "p.yaml", tmp_path / "b.jpg").code == 0
    data = read_document(tmp_path / "p.yaml").data
    assert [float(v) for v in data["images"][0]["rows"][0][5:8]] == [0.025, 0.025, 0.05]
    assert data["datum"] == "free"


def test_a_damaged_picture_is_told(tmp_path: Path) -> None:
    (tmp_path / "x.jpg").write_bytes(b"\xff\xd8\xff\xe0 nothing")
    run = mor("new", tmp_path / "p.yaml", tmp_path / "x.jpg")
    assert run.code == 2
    assert "x.jpg: this picture cannot be read" in run.err
    assert not (tmp_path / "p.yaml").exists()
