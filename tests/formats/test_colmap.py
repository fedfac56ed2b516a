"""COLMAP models: real ones, round trips of every camera model, rigs, what is refused."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np
import pytest

import mor
from mor.api.pipeline import read_document, read_network, solve_network
from mor.errors import InputError
from mor.formats import format_of, read_foreign, write_foreign
from mor.model.cameras import CAMERA_MODELS
from mor.quality.plausibility import measured_twice
from tests.reference_data import missing, network_of, point_results, reference_folder

from .blocks import MODELS, block, written

REAL = reference_folder("formats/colmap")


def _write(target: Path, files: dict[Path, bytes]) -> Path:
    target.mkdir()
    for path, content in files.items():
        path.write_bytes(content)
    return target


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("key", ["colmap", "colmap-binary"])
def test_round_trips_are_identities(tmp_path: Path, model: str, key: str) -> None:
    source = written(tmp_path, block(3, model))
    document = read_document(source)
    target = tmp_path / "model"
    out = write_foreign(document, tmp_path, target, key)
    folder = _write(target, out.files)
    assert format_of(folder) == "colmap"
    again = read_foreign(folder)
    before, after = network_of(document, tmp_path), network_of(again, folder)
    assert before.groups[0].references[0].numbers.tolist() == after.groups[0].references[0].numbers.tolist()
    np.testing.assert_allclose(after.groups[0].observed, before.groups[0].observed, rtol=0, atol=1e-9)
    for kind, values in before.start.items():
        np.testing.assert_allclose(after.start[kind], values, rtol=1e-12, atol=1e-12, err_msg=kind)
        np.testing.assert_array_equal(after.blocks[kind].free, before.blocks[kind].free)


def test_adjusted_results_before_and_after_are_equal(tmp_path: Path) -> None:
    source = written(tmp_path, block(5, "OPENCV"))
    document = read_document(source)
    folder = _write(tmp_path / "model", write_foreign(document, tmp_path, tmp_path / "model", "colmap").files)
    results = [
        point_results(solve_network(network_of(d, p)))
        for d, p in ((document, tmp_path), (read_foreign(folder), folder))
    ]
    for name, (xyz, sigma) in results[0].items():
        np.testing.assert_allclose(results[1][name][0], xyz, rtol=0, atol=1e-9)
        np.testing.assert_allclose(results[1][name][1], sigma, rtol=1e-7)


@pytest.mark.skipif(REAL is None, reason=missing("formats/colmap"))
def test_a_real_model_is_adjusted_to_the_cost_of_colmap() -> None:
    """Both numbers are those of COLMAP (README of the set): as it stands, and after its own bundle adjustment."""
    assert REAL is not None
    result = mor.adjust(str(REAL))
    solved = result.solved
    assert len(solved.network.things["image"].ids) == 23
    assert len(solved.network.things["point"].ids) == 1443
    cost = sum(float((q.v**2).sum()) for q in solved.quality.groups)
    assert sum(len(g.observed) for g in solved.network.groups) == 5931
    assert cost <= 7268.697 * (1 + 1e-6)
    assert cost == pytest.approx(7268.697, rel=1e-6)


@pytest.mark.skipif(REAL is None, reason=missing("formats/colmap"))
def test_colmap_finds_the_same_in_what_is_written(tmp_path: Path) -> None:
    """pycolmap reads what is written and finds the sum of squares that it finds in the model itself."""
    pycolmap = pytest.importorskip("pycolmap")
    assert REAL is not None
    document = read_foreign(REAL)
    sums = []
    for folder in (
        REAL,
        *(
            _write(tmp_path / key, write_foreign(document, REAL, tmp_path / key, key).files)
            for key in ("colmap", "colmap-binary")
        ),
    ):
        model = pycolmap.Reconstruction(str(folder))
        residuals = [
            image.project_point(model.points3D[ray.point3D_id].xyz) - ray.xy
            for _, image in sorted(model.images.items())
            for ray in image.points2D
            if ray.has_point3D()
        ]
        sums.append(np.array(residuals))
    assert (sums[0] ** 2).sum() == pytest.approx(7319.1209, abs=1e-4)
    for other in sums[1:]:
        np.testing.assert_allclose(other, sums[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_every_camera_model_means_the_same_to_colmap(tmp_path: Path, model: str) -> None:
    """Points projected by pycolmap from the written files are where mor's model sees them."""
    pycolmap = pytest.importorskip("pycolmap")
    source = written(tmp_path, block(8, model, noise=0.0))
    out = write_foreign(read_document(source), tmp_path, tmp_path / "model", "colmap")
    read = pycolmap.Reconstruction(str(_write(tmp_path / "model", out.files)))
    assert next(iter(read.cameras.values())).model_name == model
    for image in read.images.values():
        for ray in image.points2D:
            there = image.project_point(read.points3D[ray.point3D_id].xyz)
            np.testing.assert_allclose(there, ray.xy, rtol=0, atol=1e-9)


RIG = {
    "cameras.txt": "# cameras\r\n1 PINHOLE 800 600 700 700 400 300\r\n2 PINHOLE 800 600 710 710 400 300\r\n",
    "images.txt": "1 1 0 0 0 0 0 5 1 left 1.jpg\n10 20 1 30 40 -1 50 60 2\n"
    "2 0.9998 0 0.02 0 -0.5 0 5 2 right 1.jpg\n11 20 1 51 60 2\n",
    "points3D.txt": "1 0 0 1 9 9 9 0.5 1 0 2 0\n2 1 0 1 9 9 9 0.5 1 2 2 1\n",
    "rigs.txt": "1 2 CAMERA 1 CAMERA 2 1 0.9998000199980001 0 0.02 0 -0.5 0 0\n",
    "frames.txt": "1 1 1 0 0 0 0 0 5 2 CAMERA 1 1 CAMERA 2 2",
}


def _rig(folder: Path, old: str = "", new: str = "") -> Path:
    target = folder / "rig"
    target.mkdir()
    for name, text in RIG.items():
        changed = text.replace(old, new) if old else text
        (target / name).write_text(changed.replace("CAMERA ", "") if name == "x" else changed, newline="")
    return target


def test_a_rig_is_a_pair(tmp_path: Path) -> None:
    document = read_foreign(_rig(tmp_path))
    assert document.data["pairs"][0]["rows"][0][0] == "rig 1 camera 2"
    rows = [row[0] for row in document.data["images"][0]["rows"]]
    assert rows == ["left 1.jpg", "right 1.jpg"]
    base = [float(v) for v in document.data["pairs"][0]["rows"][0][1:4]]
    assert np.linalg.norm(base) == pytest.approx(0.5)
    assert "1 image point of no object point" in " ".join(map(str, document.notes))


def test_image_points_of_no_object_point_may_have_no_coordinates(tmp_path: Path) -> None:
    """Undistortion loses points far outside of the image: COLMAP writes them as nan."""
    folder = _rig(tmp_path, "30 40 -1", "nan nan -1")
    assert read_foreign(folder).frames["images"].height == 4
    text = (folder / "images.txt").read_text()
    (folder / "images.txt").write_text(text.replace("50 60 2", "nan nan 2"))
    with pytest.raises(InputError, match=r"'left 1\.jpg': an image coordinate is not a number"):
        read_document(folder)


def test_a_point_twice_in_an_image_is_told_without_a_line(tmp_path: Path) -> None:
    """The rows of a model's image points are no lines of its files."""
    network = read_network(read_document(_rig(tmp_path, "40 -1 50", "40 1 50")), tmp_path)
    (note,) = measured_twice(network)
    assert (note.line, note.message) == (0, "image left 1.jpg has point 1 twice")


@pytest.mark.parametrize("alone", [False, True])
def test_cameras_of_undistorted_images_are_held(tmp_path: Path, alone: bool) -> None:
    """COLMAP's ``image_undistorter`` writes a PINHOLE camera for each image: they come from a calibration."""
    folder = _rig(tmp_path)
    for name in ("rigs.txt", "frames.txt") if alone else ():
        (folder / name).unlink()
    document = read_foreign(folder)
    interiors = [camera["interior"]["fx"] for camera in document.data["cameras"].values()]
    key = "fixed" if alone else "free"
    assert [float(value[key]) for value in interiors] == [700.0, 710.0]
    assert ("the cameras are held" in " ".join(map(str, document.notes))) == alone


def test_cameras_of_no_image_are_left_out(tmp_path: Path) -> None:
    """COLMAP lists the cameras of images that it has not registered, too: nothing would determine them."""
    document = read_foreign(_rig(tmp_path, "# cameras\r\n", "3 PINHOLE 800 600 720 720 400 300\r\n"))
    assert list(document.data["cameras"]) == ["1", "2"]
    assert "1 camera of no image not read" in " ".join(map(str, document.notes))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("1 PINHOLE 800", "1 PINHOL 800", r"cameras\.txt:2: found camera model 'PINHOL'"),
        ("700 700 400 300", "700 700 400", r"cameras\.txt:2: found 3 parameters, expected 4: fx, fy, cx, cy"),
        ("11 20 1 51", "11 20 51", r"images\.txt:4: found 5 numbers"),
        ("11 20 1 51", "11 2o 1 51", r"images\.txt:4: expected x, y"),
        ("2 1 0 1 9", "2 1 0 nan 9", r"points3D\.txt:2: found 'nan'"),
        ("51 60 2", "51 60 3", "image 'right 1.jpg': point 3 is not among the points"),
        ("-0.5 0 5 2", "-0.5 0 5 3", "image 'right 1.jpg': camera 3 is not among the cameras"),
        ("right 1", "left 1", "image 'left 1.jpg' is there twice"),
        ("2 PINHOLE 800 600 710 710", "2 FOV 800 600 710 710 400 300 0.9 #", "found 8 parameters"),
    ],
)
def test_mistakes_are_told_with_their_place(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_foreign(_rig(tmp_path, old, new))


def test_a_cut_binary_file_is_told(tmp_path: Path) -> None:
    source = written(tmp_path, block(3, "PINHOLE"))
    out = write_foreign(read_document(source), tmp_path, tmp_path / "m", "colmap-binary")
    folder = _write(tmp_path / "m", out.files)
    whole = (folder / "images.bin").read_bytes()
    (folder / "images.bin").write_bytes(whole[:-5])
    with pytest.raises(InputError, match=r"images\.bin: byte \d+: found \d+ bytes"):
        read_foreign(folder)
    (folder / "images.bin").write_bytes(struct.pack("<Q", 1 << 60) + whole[8:])
    with pytest.raises(InputError, match=r"images\.bin: byte 8"):
        read_foreign(folder)


def test_what_colmap_cannot_say_is_told(tmp_path: Path) -> None:
    data = block(3, "PINHOLE")
    data["points"][0]["rows"][0][0] = "corner A"
    for row in data["observations"][0]["rows"]:
        row[1] = "corner A" if row[1] == "1" else row[1]
    data["observations"].append(
        {
            "type": "distance",
            "columns": ["from", "to", "distance", "sigma"],
            "rows": [["2", "3", "1", "1 mm"]],
        }
    )
    data["points"][0]["fixed"] = ["x"]
    out = write_foreign(read_document(written(tmp_path, data)), tmp_path, tmp_path / "m", "colmap")
    notes = " ".join(note.message for note in out.notes)
    assert "observations distance" in notes
    assert "fixed or observed" in notes
    assert out.files[tmp_path / "m" / "point_names.csv"].startswith(b"point3D,name\n1,corner A\n")
    data["cameras"]["7"].update(model="brown", interior={"c": "1000"})
    with pytest.raises(InputError, match="camera 7: no model of COLMAP says"):
        write_foreign(read_document(written(tmp_path, data)), tmp_path, tmp_path / "m", "colmap")


@pytest.mark.parametrize(
    ("model", "parameters"),
    [
        ("SIMPLE_RADIAL_FISHEYE", "700 400 300 -0.05"),
        ("RADIAL_FISHEYE", "700 400 300 -0.05 0.01"),
        ("SIMPLE_FISHEYE", "700 400 300"),
        ("FISHEYE", "700 710 400 300"),
    ],
)
def test_fisheyes_with_few_parameters(tmp_path: Path, model: str, parameters: str) -> None:
    """pycolmap sees a point where mor's fisheye sees it; one focal length is said to be two unknowns."""
    pycolmap = pytest.importorskip("pycolmap")
    folder = _rig(tmp_path, "1 PINHOLE 800 600 700 700 400 300", f"1 {model} 800 600 {parameters}")
    document = read_foreign(folder)
    assert ("two unknowns" in " ".join(map(str, document.notes))) == (len(parameters.split()) != 4 or model[0] == "S")
    interior = {k: float(v.get("free") or v["fixed"]) for k, v in document.data["cameras"]["1"]["interior"].items()}
    fisheye = CAMERA_MODELS["fisheye"]
    row = np.array([[interior.get(c.name, 0.0) for c in fisheye.components]])
    camera = pycolmap.Reconstruction(str(folder)).cameras[1]
    for X in ([0.3, -0.2, 1.0], [-2.0, 1.0, 1.5]):
        star = np.array([[X[0], -X[1], -X[2]]])
        ours = fisheye.project(star, row, np.zeros((1, 0)), np.zeros((1, 2))).xy[0] * [1, -1]
        np.testing.assert_allclose(camera.img_from_cam(np.array([X])).ravel(), ours, rtol=0, atol=1e-9)


def test_models_without_a_counterpart_say_what_is_lost(tmp_path: Path) -> None:
    from mor.formats.colmap.model import LOST, MODELS

    assert set(LOST) == {name for name, model in MODELS.items() if not model.ours}
    for name, text in RIG.items():
        (tmp_path / name).write_text(text)
    other = "2 EUCM 800 600 710 710 400 300 0.5 1"
    cameras = re.sub(r"^2 PINHOLE .*$", other, RIG["cameras.txt"], flags=re.MULTILINE)
    (tmp_path / "cameras.txt").write_text(cameras)
    with pytest.raises(InputError, match=r"EUCM has no counterpart in mor: its alpha and beta"):
        read_foreign(tmp_path)


def test_a_folder_without_one_of_the_files_says_which(tmp_path: Path) -> None:
    for name in ("cameras.bin", "points3D.bin"):
        (tmp_path / name).write_bytes(b"\0" * 8)
    with pytest.raises(InputError, match=r"this folder has no images\.bin; a COLMAP model has"):
        read_document(tmp_path)


def test_a_whole_model_as_text_counts_beside_a_part_of_a_binary_one(tmp_path: Path) -> None:
    folder = _rig(tmp_path)
    whole = read_foreign(folder).data
    (folder / "cameras.bin").write_bytes(b"\0" * 8)
    assert read_foreign(folder).data == whole
