"""Results for other programs: point clouds, maps, drawings, camera files."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

import mor
from mor.api.pipeline import read_document
from mor.cli import run
from mor.errors import InputError
from mor.formats import write_foreign

from .blocks import block, written

LEVELS = """mor: 1
title: "A <net> & more"
axes: {xy: ne}
points:
  - columns: [id, x, y, z]
    rows: [[A, 0, 0, 10], [B, 100, 0, 10]]
    fixed: [x, y, z]
  - columns: [id, x, y, z]
    rows: [[C, 50, 80, 12], [free, "", "", ""]]
observations:
  - type: distance
    columns: [from, to, distance]
    rows: [[A, C, 94.36], [B, C, 94.35], [C, A, 94.361], [A, free, 10], [B, free, 95], [C, free, 88]]
    values: {sigma: 5 mm}
  - type: height_difference
    columns: [from, to, dz, sigma]
    rows: [[A, C, 2.0, 1 mm], [A, free, 1, 1 mm]]
"""


@pytest.fixture
def results(tmp_path: Path) -> Path:
    text = LEVELS.replace('[free, "", "", ""]', "[free, 9, 4, 11]")
    (tmp_path / "net.yaml").write_text(text)
    run(["adjust", str(tmp_path / "net.yaml"), "-o", str(tmp_path / "out"), "--no-html", "--quiet"])
    return tmp_path / "out" / "adjusted.yaml"


def _files(source: Path, key: str, name: str) -> bytes:
    out = write_foreign(read_document(source), source.parent, source.parent / name, key)
    return next(iter(out.files.values()))


def test_ply(results: Path) -> None:
    lines = _files(results, "ply", "a.ply").decode().splitlines()
    at = lines.index("end_header")
    assert "element vertex 4" in lines
    assert lines[at - 1] == "property double sz"
    assert [float(v) for v in lines[at + 1].split()] == [0, 0, 10, 0, 0, 0]
    assert min(float(v) for v in lines[at + 3].split()[3:]) > 1e-4


def test_geojson(results: Path) -> None:
    features = json.loads(_files(results, "geojson", "a.geojson"))["features"]
    kinds = [feature["properties"]["kind"] for feature in features]
    assert kinds.count("point") == 4
    lines = [
        (f["properties"]["from"], f["properties"]["to"]) for f in features if f["properties"]["kind"] == "observed"
    ]
    assert lines == [("A", "C"), ("B", "C"), ("A", "free"), ("B", "free"), ("C", "free")]


def test_landxml_has_north_first(results: Path) -> None:
    """The project's x is north: LandXML's first number is x as well."""
    root = ElementTree.fromstring(_files(results, "landxml", "a.landxml"))
    points = {p.get("name"): p.text for p in root.iter() if p.tag.endswith("CgPoint")}
    assert points["B"] is not None
    assert [float(v) for v in points["B"].split()] == [100, 0, 10]
    assert next(p for p in root if p.tag.endswith("Project")).get("name") == "A <net> & more"


def test_dxf(results: Path, tmp_path: Path) -> None:
    ezdxf = pytest.importorskip("ezdxf")
    path = tmp_path / "a.dxf"
    path.write_bytes(_files(results, "dxf", "a.dxf"))
    sheet = ezdxf.readfile(path)
    layers = [entity.dxf.layer for entity in sheet.modelspace()]
    assert {name: layers.count(name) for name in ("points", "names", "observations", "ellipses")} == {
        "points": 4, "names": 4, "observations": 5, "ellipses": 2,
    }  # fmt: skip
    assert not sheet.audit().errors


def test_opencv_sees_the_same(tmp_path: Path) -> None:
    """cv2.projectPoints with the file it reads is where the image points are, half a pixel aside."""
    source = written(tmp_path, block(6, "FULL_OPENCV", noise=0.0))
    path = tmp_path / "camera.yml"
    path.write_bytes(_files(source, "opencv", "camera.yml"))
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    K, k = (storage.getNode(name).mat() for name in ("camera_matrix", "distortion_coefficients"))
    network = mor.read(str(source)).network
    (group,) = network.groups
    image, point = (network.things[name] for name in ("image", "point"))
    for row in range(0, len(group.observed), 17):
        D = network.start["rotation"][image.part(group.references[0][row], "rotation")]
        X0 = network.start["point"][image.part(group.references[0][row], "position")]
        X = network.start["point"][point.part(group.references[1][row], "position")]
        R = np.diag([1.0, -1.0, -1.0]) @ D
        seen = cv2.projectPoints(X[None], cv2.Rodrigues(R)[0], -R @ X0, K, k)[0].ravel() + 0.5
        np.testing.assert_allclose(seen, group.observed[row] * [1, -1], rtol=0, atol=1e-6)


def test_without_coordinates_there_is_nothing_to_draw(tmp_path: Path) -> None:
    path = tmp_path / "net.yaml"
    text = LEVELS.replace("[A, 0, 0, 10], [B, 100, 0, 10]", '[A, "", "", 10]').replace(
        "[C, 50, 80, 12]", '[C, "", "", ""]'
    )
    path.write_text(text.replace("fixed: [x, y, z]", "fixed: [z]"))
    with pytest.raises(InputError, match="no point has coordinates"):
        _files(path, "ply", "a.ply")
