"""OpenSfM blocks: a real one, camera models, ground control, what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mor.api.pipeline import read_document
from mor.errors import InputError
from mor.formats import format_of, read_foreign, write_foreign
from mor.model.cameras import CAMERA_MODELS
from tests.reference_data import missing, network_of, reference_folder

from .blocks import block, written

REAL = reference_folder("formats/opensfm")


def _folder(folder: Path, **changes: Any) -> Path:
    whole = {
        "cameras": {
            "v2 c 4000 3000": {"projection_type": "perspective", "width": 4000, "height": 3000, "focal": 0.9}
        },
        "shots": {
            name: {"rotation": [3.0, 0.1 * k, 0.0], "translation": [k, 0.5, 9.0], "camera": "v2 c 4000 3000"}
            for k, name in enumerate(("a b.jpg", "c.jpg"))
        },
        "points": {"7": {"color": [1, 2, 3], "coordinates": [0.5, 0.25, -1.0]}, "8": {"coordinates": [0.5, 1, -1]}},
        "reference_lla": {"latitude": 50.0, "longitude": 8.0, "altitude": 100.0},
    }  # fmt: skip
    whole.update({key: value for key, value in changes.items() if key in whole})
    tracks = "OPENSFM_TRACKS_VERSION_v1\n" + "".join(
        f"{image}\t{track}\t{k}\t0.1\t-0.2\t0.002\t1\t2\t3\n"
        for k, (image, track) in enumerate((i, t) for i in ("a b.jpg", "c.jpg", "gone.jpg") for t in (7, 8, 9))
    )
    (folder / "reconstruction.json").write_text(json.dumps([whole], indent=1))
    (folder / "tracks.csv").write_text(changes.get("tracks", tracks))
    return folder


@pytest.mark.skipif(REAL is None, reason=missing("formats/opensfm"))
def test_a_real_block_means_the_same() -> None:
    """Residuals of the values in the file, as OpenSfM's equation gives them, are those of mor's network."""
    assert REAL is not None
    network = network_of(read_foreign(REAL), REAL)
    whole = json.loads((REAL / "reconstruction.json").read_text())[0]
    (group,) = [group for group in network.groups if group.type.key.startswith("image")]
    assert (len(whole["shots"]), len(whole["points"])) == (19, 1191)
    assert len(network.things["image"].ids) == 19
    assert len(network.things["point"].ids) == 1191
    camera = next(iter(whole["cameras"].values()))
    model = CAMERA_MODELS["mor"]
    start = network.start
    images = network.things["image"]
    for row in range(0, len(group.observed), 97):
        shot = whole["shots"][group.references[0][row]]
        X = np.array(whole["points"][group.references[1][row]]["coordinates"])
        angle = np.linalg.norm(shot["rotation"])
        axis = np.array(shot["rotation"]) / angle
        turned = X * np.cos(angle) + np.cross(axis, X) * np.sin(angle) + axis * (axis @ X) * (1 - np.cos(angle))
        x, y, z = turned + shot["translation"]
        r2 = (x * x + y * y) / z**2
        theirs = camera["focal"] * (1 + camera["k1"] * r2 + camera["k2"] * r2**2) * np.array([x, -y]) / z * 2880
        D = start["rotation"][images.part(group.references[0][row], "rotation")]
        centre = start["point"][images.part(group.references[0][row], "position")]
        star = D @ (X - centre)
        interior = start["interior/mor"][0:1]
        ours = model.project(star[None], interior, np.zeros((1, 1)), np.zeros((1, 2))).xy[0]
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)


def test_a_folder_of_opendronemap(tmp_path: Path) -> None:
    inner = tmp_path / "opensfm"
    inner.mkdir()
    _folder(inner)
    assert format_of(tmp_path) == "opensfm"
    document = read_foreign(tmp_path)
    frame = document.frames["tracks"]
    assert frame.rows()[0] == ("a b.jpg", "7", 0.1 * 4000 + 2000, -0.2 * 4000 + 1500)
    assert frame.height == 4
    notes = " ".join(map(str, document.notes))
    assert "3 image points not read: their image is not reconstructed" in notes
    assert "2 image points not read: their track is not reconstructed" in notes


@pytest.mark.parametrize(
    ("kind", "model", "values"),
    [
        (
            "brown",
            "opencv",
            {"focal_x": 0.9, "focal_y": 0.91, "c_x": 0.01, "c_y": -0.02, "k1": 0.1, "p1": 1e-3},
        ),
        (
            "fisheye_opencv",
            "fisheye",
            {"focal_x": 0.5, "focal_y": 0.5, "c_x": 0, "c_y": 0, "k1": 0.1, "k4": 0.2},
        ),
        ("fisheye", "fisheye", {"focal": 0.5, "k1": 0.1, "k2": 0.01}),
    ],
)
def test_projection_types(tmp_path: Path, kind: str, model: str, values: dict[str, float]) -> None:
    cameras = {"v2 c 4000 3000": {"projection_type": kind, "width": 4000, "height": 3000, **values}}
    data = read_foreign(_folder(tmp_path, cameras=cameras)).data
    camera = data["cameras"]["v2 c 4000 3000"]
    assert camera["model"] == model
    assert float(camera["interior"]["cx"]["free"]) == 2000 + 4000 * values.get("c_x", 0)


def test_control_of_opendronemap_in_degrees(tmp_path: Path) -> None:
    """A hundredth of a second north of the reference point are 0.309 m (meridian radius of WGS84 at 50°)."""
    _folder(tmp_path)
    step = 0.01 / 3600
    text = f"WGS84\r\n8.0 {50 + step} 103.0 1999.5 1499.5 a\tP1\r\n8.0 50.0 100 99.5 199.5 c.jpg\tP2"
    (tmp_path / "gcp_list.txt").write_text(text, newline="")
    data = read_foreign(tmp_path).data
    rows = {row[0]: row for row in data["points"][1]["rows"]}
    assert float(rows["P1"][2]) == pytest.approx(0.01 / 3600 * np.pi / 180 * 6373000, abs=1e-3)
    assert [float(v) for v in rows["P2"][1:4]] == pytest.approx([0, 0, 0], abs=1e-9)
    assert read_foreign(tmp_path).frames["tracks"].rows()[-1] == ("c.jpg", "P2", 100.0, 200.0)
    assert "datum" not in data


def test_control_points_without_a_position_and_with_the_name_of_a_track(tmp_path: Path) -> None:
    """A point that is only measured in images is a tie point; a name of both is told apart."""
    seen = [{"shot_id": shot, "projection": [0.0, 0.25]} for shot in ("a b.jpg", "c.jpg")]
    place = {"latitude": 50.0, "longitude": 8.0, "altitude": 103.0}
    given = [{"id": "P", "observations": seen}, {"id": "7", "position": place, "observations": seen}]
    (tmp_path / "ground_control_points.json").write_text(json.dumps({"points": given}))
    document = read_foreign(_folder(tmp_path))
    rows = {row[0]: row[1:] for row in document.data["points"][-1]["rows"]}
    assert rows["P"] == [None] * 6
    assert [float(value) for value in rows["gcp 7"]] == pytest.approx([0, 0, 3, 0.02, 0.02, 0.02], abs=1e-6)
    frame = document.frames["tracks"]
    assert frame.filter(frame["point"] == "gcp 7")["x"].to_list() == [2000.0, 2000.0]
    assert "control point 7 is gcp 7 here" in " ".join(map(str, document.notes))


def test_control_in_a_projection_leaves_the_poses_out(tmp_path: Path) -> None:
    _folder(tmp_path)
    (tmp_path / "gcp_list.txt").write_text("EPSG:25832\n500000 5500000 100 99.5 199.5 c.jpg\n")
    document = read_foreign(tmp_path)
    assert document.data["images"][0]["columns"] == ["id", "camera"]
    assert "EPSG:25832" in " ".join(map(str, document.notes))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"points": {"7": {"coordinates": [0, 1]}}}, r"json:\d+: point '7': coordinates: found \[0, 1\]"),
        ({"shots": {"c.jpg": {"camera": "x"}}}, r"json:\d+: shot 'c\.jpg': camera 'x' is not among"),
        (
            {"cameras": {"K": {"projection_type": "spherical"}}},
            r"json:\d+: camera 'K': projection type 'spherical'",
        ),
        ({"tracks": "OPENSFM_TRACKS_VERSION_v1\nc.jpg\t7\t0\tx\t0.1\n"}, r"tracks\.csv:2: found 'x'"),
        ({"tracks": "c.jpg,7,0,0.1,0.1\n"}, r"tracks\.csv:1: found 1 columns"),
    ],
)
def test_mistakes_are_told_with_their_place(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_foreign(_folder(tmp_path, **changes))


def test_broken_json(tmp_path: Path) -> None:
    _folder(tmp_path)
    (tmp_path / "reconstruction.json").write_text('[{\n"shots": {"a": 1, "a": 2}, "points": NaN}]')
    with pytest.raises(InputError, match="json:2: key 'a' is given twice"):
        read_foreign(tmp_path)
    (tmp_path / "reconstruction.json").write_text('[{\n"shots": {')
    with pytest.raises(InputError, match="json:2: this is not valid JSON"):
        read_foreign(tmp_path)


def test_latitude_may_stand_first(tmp_path: Path) -> None:
    """Lists of older OpenDroneMap have it so; the numbers leave no other order."""
    _folder(tmp_path, reference_lla={"latitude": 34.4, "longitude": -119.9, "altitude": 0.0})
    path = tmp_path / "gcp_list.txt"
    path.write_text("WGS84 longlat\n34.4 -119.9 0 10 20 c.jpg\n34.4 -119.899 0 10 20 c.jpg\n")
    document = read_foreign(tmp_path)
    rows = document.data["points"][1]["rows"]
    assert [float(v) for v in rows[0][1:3]] == pytest.approx([0, 0], abs=1e-6)
    assert float(rows[1][1]) == pytest.approx(91.95, abs=0.1)
    assert "latitude is read as the first number" in " ".join(map(str, document.notes))
    path.write_text("WGS84\n-119.9 34.4 0 1 2 c.jpg\n120 95 0 10 20 c.jpg\n")
    with pytest.raises(InputError, match=r"gcp_list.txt:3: found the latitude 95"):
        read_foreign(tmp_path)


def test_control_is_written_as_a_list(tmp_path: Path) -> None:
    """Read again beside the block, points and image points of control are those of the project."""
    data = block(4, "SIMPLE_RADIAL", images=3, points=5)
    rows = data["points"][0]["rows"]
    columns = ["id", "x", "y", "z", "sigma"]
    held = [[*row, "0.01"] for row in rows[:2]]
    plan = [[*rows[2][:3], "0.01", "0.01"]]
    data["points"] = [
        {"columns": ["id", "x", "y", "z"], "rows": rows[3:]},
        {"columns": columns, "rows": held},
        {"columns": ["id", "x", "y", "sigma_x", "sigma_y"], "rows": plan},
    ]
    data["units"]["length"], data["axes"] = "mm", {"xy": "ne", "angles": "clockwise"}
    data["images"][0] = {"columns": ["id", "camera"], "rows": [row[:2] for row in data["images"][0]["rows"]]}
    out = write_foreign(read_document(written(tmp_path, data)), tmp_path, tmp_path / "gcp_list.txt", "gcp")
    (content,) = out.files.values()
    first, *lines = content.decode().splitlines()
    assert first == "EPSG:?"
    assert "EPSG:25832" in " ".join(note.message for note in out.notes)
    found = {(line.split()[5], line.split()[6]): line.split()[:5] for line in lines}
    assert len(found) == len(lines) == 9
    for image, point, x, y in data["observations"][0]["rows"]:
        if (image, point) in found:
            place = next(row for row in rows if row[0] == point)
            numbers = [float(v) for v in found[image, point]]
            expected = [float(place[2]) / 1e3, float(place[1]) / 1e3, float(place[3]) / 1e3]
            assert numbers[:2] == pytest.approx(expected[:2])
            assert np.isnan(numbers[2]) if point == rows[2][0] else numbers[2] == pytest.approx(expected[2])
            assert numbers[3:] == pytest.approx([float(x) - 0.5, float(y) - 0.5])


def test_a_pointer_in_place_of_a_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "tracks.csv").write_text("a")
    (tmp_path / "reconstruction.json").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n")
    with pytest.raises(InputError, match=r"reconstruction\.json: this is a pointer of Git LFS, not the file"):
        read_foreign(tmp_path)


def test_tracks_are_called_after_their_reconstruction(tmp_path: Path) -> None:
    _folder(tmp_path)
    for kind, end in (("reconstruction", "json"), ("tracks", "csv")):
        (tmp_path / f"{kind}.{end}").rename(tmp_path / f"{kind}_two.{end}")
    assert read_foreign(tmp_path / "reconstruction_two.json").frames["tracks"].height == 4
