"""Pix4D's parameter files: cameras with its own numbers, poses, tie points, control, mistakes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import solve_network
from mor.errors import InputError
from mor.formats import format_of, read_foreign
from mor.formats.pix4d import read_control
from mor.model.cameras import CAMERA_MODELS
from mor.model.rotations import angles_from_rotation, exponential
from tests.reference_data import network_of, point_results

HEAD = (
    "fileName imageWidth imageHeight \ncamera matrix K [3x3]\nradial distortion [3x1]\ntangential distortion [2x1]\n"
    "camera position t [3x1]\ncamera rotation R [3x3]\ncamera model m = K [R|-Rt] X\n\n"
)
CAMERA = (3600.0, 2010.0, 1490.0, -0.05, 0.02, -0.01, 0.0003, -0.0002)
OFFSET = np.array([332000.0, 3488000.0, 100.0])
_DOWN = np.diag([1.0, -1.0, -1.0])


def _image(point: np.ndarray, centre: np.ndarray, R: np.ndarray) -> tuple[float, float]:
    """Pix4D's equations as its manual has them: homogeneous point, distortion, then f and the principal point."""
    f, cx, cy, r1, r2, r3, t1, t2 = CAMERA
    x, y, z = R @ (point - centre)
    x, y = x / z, y / z
    r = x * x + y * y
    factor = 1.0 + r1 * r + r2 * r**2 + r3 * r**3
    u = factor * x + 2.0 * t1 * x * y + t2 * (r + 2.0 * x * x)
    v = factor * y + 2.0 * t2 * x * y + t1 * (r + 2.0 * y * y)
    return float(f * u + cx), float(f * v + cy)


def project(seed: int = 3, images: int = 6, points: int = 25) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """Files of a block that agrees with itself, and the places of its points."""
    rng = np.random.default_rng(seed)
    places = {f"p{k}": np.array([*rng.uniform(0, 40, 2), rng.uniform(0, 8)]) for k in range(points)}
    cameras, poses, marks = HEAD, "imageName X Y Z Omega Phi Kappa\n", ""
    f, cx, cy, *distortion = CAMERA
    for k in range(images):
        R = exponential(rng.normal(0, 0.1, 3)) @ _DOWN @ exponential(np.array([0, 0, k % 2 * 1.5]))
        centre = np.array([5 + 6.0 * k, 20 + 8 * (k % 3 - 1), 50.0])
        numbers = [[f, 0, cx], [0, f, cy], [0, 0, 1], distortion[:3], distortion[3:], centre, *R]
        cameras += f"DJI_{k}.JPG 4000 3000\n" + "".join(" ".join(map(repr, map(float, row))) + "\n" for row in numbers)
        angles = np.degrees(angles_from_rotation(_DOWN @ R))
        poses += f"DJI_{k}.JPG " + " ".join(repr(float(v)) for v in (*(centre + OFFSET), *angles)) + "\n"
        seen = [(name, _image(place, centre, R)) for name, place in places.items()]
        marks += f"DJI_{k}\n" + "".join(f"{name} {x!r} {y!r} 3.5\n" for name, (x, y) in seen) + "-99\n"
    control = "".join(f"p{k} " + " ".join(map(repr, (places[f"p{k}"] + OFFSET).tolist())) + "\n" for k in range(5))
    files = {
        "a_calibrated_camera_parameters.txt": cameras,
        "a_calibrated_external_camera_parameters.txt": poses,
        "a_tp_pix4d.txt": marks,
        "a_measured_gcps_position.txt": control,
        "a_offset.xyz": " ".join(map(repr, OFFSET.tolist())),
    }
    return files, {name: place + OFFSET for name, place in places.items()}


def written(folder: Path, files: dict[str, str]) -> Path:
    """The files in a folder."""
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder


def test_a_block_by_its_own_equations_is_adjusted_to_nothing_left(tmp_path: Path) -> None:
    files, places = project()
    folder = written(tmp_path, files)
    assert format_of(folder) == format_of(folder / "a_tp_pix4d.txt") == "pix4d"
    document = read_foreign(folder)
    solved = solve_network(network_of(document, folder))
    assert solved.quality.sigma0 < 1e-4
    found = point_results(solved)
    for name, place in places.items():
        np.testing.assert_allclose(found[name][0], place, atol=1e-5)
    notes = " ".join(note.message for note in document.notes)
    for words in ("all are free", "σ = 0.02 m", "σ = 1 px"):
        assert words in notes


def test_a_real_camera_matrix_has_the_printed_angles() -> None:
    """Rotation and ω, φ, κ of one image of a public file."""
    R = np.array([
        [-0.49632901575943477734, 0.86794436424468834890, -0.01816834310427051929],
        [0.86649900151927328196, 0.49400145706385401034, -0.07170802455019638366],
        [-0.05326338781351704077, -0.05133362440616233424, -0.99726018196053234366],
    ])  # fmt: skip
    assert np.degrees(angles_from_rotation(_DOWN @ R)) == pytest.approx([-2.946680, 3.053212, 119.804001], abs=1e-6)


def test_the_camera_is_that_of_the_manual() -> None:
    """Image coordinates of the reader's camera are those of Pix4D's equations."""
    f, cx, cy, r1, r2, r3, t1, t2 = CAMERA
    model = CAMERA_MODELS["metashape"]
    values = {"f": f, "cx": cx - 2000, "cy": cy - 1500, "k1": r1, "k2": r2, "k3": r3, "p1": t2, "p2": t1}
    interior = np.array([[values.get(c.name, 0.0) for c in model.components]])
    point = np.array([3.0, -2.0, 10.0])
    found = model.project((_DOWN @ point)[None], interior, np.zeros((1, 0)), np.zeros((1, 2))).xy[0]
    assert found * [1, -1] + [2000, 1500] == pytest.approx(_image(point, np.zeros(3), np.eye(3)), abs=1e-9)


def test_without_external_parameters_poses_are_local_ones_with_the_offset(tmp_path: Path) -> None:
    files, _ = project()
    external = files.pop("a_calibrated_external_camera_parameters.txt").split("\n")[1].split()[1:]
    row = read_foreign(written(tmp_path, files)).data["images"][0]["rows"][0]
    assert [float(text) for text in row[2:]] == pytest.approx([float(text) for text in external], abs=1e-9)


def test_poses_that_contradict_are_told(tmp_path: Path) -> None:
    files, _ = project()
    name = "a_calibrated_external_camera_parameters.txt"
    files[name] = files[name].replace("DJI_2.JPG 332", "DJI_2.JPG 333")
    notes = [str(note) for note in read_foreign(written(tmp_path, files)).notes]
    assert any(":4: 1 pose of the external" in note and "DJI_2.JPG" in note for note in notes)


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("a_CAMERAS", "0.0 3600.0 1490.0", "0.0 3700.0 1490.0", ":9: image DJI_0.JPG: expected K"),
        ("a_CAMERAS", "DJI_1.JPG 4000 3000", "DJI_1.JPG", ":19: found 'DJI_1.JPG', expected"),
        ("a_CAMERAS", "0.0 0.0 1.0\n", "0.0 0.0\n", ":9: image DJI_0.JPG: line 12: found 2 numbers"),
        ("a_tp_pix4d.txt", "p0 ", "p0 x", "expected a number"),
        ("a_measured_gcps_position.txt", "p1 ", "p0 ", ":2: control point 'p0' is there already"),
        ("a_offset.xyz", "332000.0", "", "expected three numbers"),
    ],
)  # fmt: skip
def test_mistakes_have_their_lines(tmp_path: Path, file: str, old: str, new: str, words: str) -> None:
    file = file.replace("CAMERAS", "calibrated_camera_parameters.txt")
    files, _ = project()
    assert old in files[file]
    files[file] = files[file].replace(old, new, 1)
    with pytest.raises(InputError) as error:
        read_foreign(written(tmp_path, files))
    assert file in str(error.value)
    assert words in str(error.value)


def test_two_projects_in_a_folder_are_refused(tmp_path: Path) -> None:
    files, _ = project()
    folder = written(tmp_path, {**files, "b_tp_pix4d.txt": ""})
    with pytest.raises(InputError, match="parameters of 2 projects"):
        read_foreign(folder)
    assert read_foreign(folder / "a_tp_pix4d.txt").data["title"] == "a"


def test_control_as_it_is_imported(tmp_path: Path) -> None:
    path = tmp_path / "gcp.csv"
    path.write_text("label,X,Y,Z,accH,accV\nA,1,2,3,0.01,0.03\nB,4,5,6\n")
    (table,) = read_control(path).data["points"]
    assert table["rows"][0] == ["A", "1.0", "2.0", "3.0", "0.01", "0.01", "0.03"]
    assert table["rows"][1][4:] == ["0.02"] * 3


CAM = """Pix4D camera calibration file 0
#Focal Length mm assuming a sensor width of 17.49998592000000030566x13.12498944000000200560mm
F 15.01175404934517487732
#Principal Point mm
Px 8.48210511970419922534
Py 6.33434629978042273990
#Symmetrical Lens Distortion Coeffs
K1 0.03833474118270804865
K2 -0.01750917966495743258
K3 0.02049798716391852335
#Tangential Lens Distortion Coeffs
T1 0.00240851666319534747
T2 0.00292562392135245920
"""
"""A public file."""
_SAME = (
    "a.JPG 4608 3456\n3952.81247514184087776812 0 2233.46124792750424603582\n"
    "0 3952.81247514184087776812 1667.92521335858214115433\n0 0 1\n"
    "0.03833474118270804865 -0.01750917966495743258 0.02049798716391852335\n"
    "0.00240851666319534747 0.00292562392135245920\n0 0 9\n1 0 0\n0 -1 0\n0 0 -1\n"
)
"""The same camera in the parameters of its project, with another pose."""


def test_the_camera_file_has_the_camera_of_the_parameters(tmp_path: Path) -> None:
    """In millimetres what the parameters have in pixels: the same place for every ray."""
    (tmp_path / "x.txt").write_text(CAM)
    assert format_of(tmp_path / "x.txt") == "pix4d-cam"
    document = read_foreign(tmp_path / "x.txt")
    assert any("add image:" in note.message for note in document.notes)
    (tmp_path / "p").mkdir()
    path = written(tmp_path / "p", {"a_calibrated_camera_parameters.txt": HEAD + _SAME})
    model = CAMERA_MODELS["metashape"]
    places = []
    rays = np.array([[0.0, 0.0, -1.0], [0.4, 0.3, -1.0], [-0.5, 0.2, -1.1], [0.1, -0.4, -0.9]])
    for found in (document, read_foreign(path, "pix4d")):
        (camera,) = found.data["cameras"].values()
        values = {key: float(value["free"]) for key, value in camera["interior"].items()}
        interior = np.tile([values.get(component.name, 0.0) for component in model.components], (len(rays), 1))
        places.append(model.project(rays, interior, np.zeros((len(rays), 0)), np.zeros((len(rays), 2))).xy)
    np.testing.assert_allclose(places[0], places[1] * 17.49998592 / 4608.0, atol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("F 15", "G 15", r"x\.cam:3: found 'G 15.*, expected one of F, Px"),
        ("Px 8", "F 8", r"x\.cam:5: F is there twice"),
        ("width of", "size", r"x\.cam:1: camera 0: the size of the sensor behind #Focal Length is missing"),
        ("Py 6.33434629978042273990\n", "", r"x\.cam:1: camera 0: Py is missing"),
        ("K1 0", "K1 x", r"x\.cam:8: found 'x\.0383.*, expected a number"),
        (CAM, "Px 1\n", r"x\.cam:1: .*expected 'Pix4D camera calibration file' in the first line"),
        (CAM, CAM + CAM, r"x\.cam:14: camera 0 is there twice"),
    ],
)
def test_mistakes_of_camera_files(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in CAM
    (tmp_path / "x.cam").write_text(CAM.replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        read_foreign(tmp_path / "x.cam")
