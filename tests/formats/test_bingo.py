"""BINGO: a block that comes out as it was, records, mistakes with their lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mor
from mor.api.pipeline import read_document, solve_network
from mor.errors import InputError
from mor.formats import format_of, read_foreign, write_foreign
from mor.formats.recognition import bingo_angles, rotation_from_bingo
from mor.model.rotations import rotation_from_angles
from tests.reference_data import network_of, point_results


def block(images: int = 6, points: int = 20) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """Files of a block without errors (c = 50 mm, principal point 0.05, −0.02 mm), and the places of its points."""
    rng = np.random.default_rng(4)
    places = {f"{k + 100}": np.array([*rng.uniform(0, 60, 2), rng.uniform(0, 10)]) for k in range(points)}
    lines = []
    for k in range(images):
        D = rotation_from_angles(np.array([*rng.normal(0, 0.1, 2), k % 2 * 1.6]))
        centre = np.array([10.0 + 8 * k, 25.0 + 10 * (k % 3), 70.0])
        lines.append(f"{k + 1}  RMK")
        for name, place in places.items():
            X, Y, Z = D @ (place - centre)
            lines.append(f"  {name} {-50.0 * X / Z + 0.05:.7f} {-50.0 * Y / Z - 0.02:.7f}")
        lines.append("-99")
    ground = ["* a comment", "CAPA RMK 0 50.0 0.05 -0.02", "ECCA RMK 0 0 0"]
    for kind, chosen in (("CONT", ("100", "101", "102", "103")), ("CHCK", ("110", "999"))):
        for name in chosen:
            x, y, z = places.get(name, np.zeros(3)).tolist()
            ground.append(f"{kind} {name} {x!r} {y!r} {z!r} 1")
    return {
        "image.dat": "\r\n".join(lines),
        "geoin.dat": "\n".join(ground),
        "itera.dat": "ORIA 1 0 0 0 0 0 0 RMK\nPARA 1\n",
    }, places


def written(folder: Path, files: dict[str, str]) -> Path:
    """The files in a folder."""
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder


def test_a_block_comes_out_as_it_was(tmp_path: Path) -> None:
    files, places = block()
    folder = written(tmp_path, files)
    assert format_of(folder) == format_of(folder / "image.dat") == "bingo"
    document = read_foreign(folder)
    found = point_results(solve_network(network_of(document, folder)))
    for name, place in places.items():
        np.testing.assert_allclose(found[name][0], place, atol=1e-4)
    assert document.data["checks"][0]["rows"][0][0] == "110"
    notes = " ".join(map(str, document.notes))
    for words in (
        "1 record ECCA not read",
        "orientations and image points contradict each other",
        "1 record PARA not read",
        "1 check point in no image",
        "σ = 0.003 mm",
    ):
        assert words in notes, words


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        (
            "geoin.dat",
            "CAPA RMK 0 50.0 0.05 -0.02",
            "CAPA RMK 0 50.0",
            "geoin.dat:2: found 4 words, expected CAPA",
        ),
        ("geoin.dat", " 50.0 ", " -50.0 ", "geoin.dat:2: found the camera constant -50.0"),
        ("geoin.dat", "CAPA", "CAPX", "geoin.dat:1: found no CAPA"),
        ("geoin.dat", "CONT 100 ", "CONT 100 x", "geoin.dat:4: found 'x"),
        ("image.dat", "  101 ", "  101 x", "image.dat:3: found 'x"),
        ("itera.dat", "ORIA 1 0", "ORIA 1 x", "itera.dat:1: found 'x', expected a number"),
        (
            "itera.dat",
            "ORIA 1 0 0 0",
            "ORIA 1",
            "itera.dat:1: found 6 words, expected ORIA, a name and 6 numbers",
        ),
        ("image.dat", "2  RMK", "1  RMK", "image.dat:23: image '1' is there already"),
    ],
)
def test_mistakes_have_their_lines(tmp_path: Path, file: str, old: str, new: str, words: str) -> None:
    files, _ = block()
    assert old in files[file]
    files[file] = files[file].replace(old, new, 1)
    with pytest.raises(InputError) as error:
        read_foreign(written(tmp_path, files))
    assert words in str(error.value)


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"found no geoin\.dat in this folder"):
        read_foreign(written(tmp_path, {"image.dat": ""}), "bingo")


def _turn(axis: int, angle: float) -> np.ndarray:
    """The textbook's matrix of one rotation: what turns a vector by an angle about an axis."""
    a, b = [k for k in range(3) if k != axis]
    sign = -1.0 if axis == 1 else 1.0
    R = np.eye(3)
    R[a, a] = R[b, b] = np.cos(angle)
    R[a, b], R[b, a] = -sign * np.sin(angle), sign * np.sin(angle)
    return R


def test_the_rotation_has_phi_as_its_first_angle() -> None:
    """Against single rotations multiplied: from image to object φ about Y, then ω about X, then κ about Z."""
    rng = np.random.default_rng(1)
    angles = rng.uniform(-1.4, 1.4, (50, 3))
    D = rotation_from_bingo(angles)
    for (phi, omega, kappa), given in zip(angles, D, strict=True):
        np.testing.assert_allclose(given, (_turn(1, phi) @ _turn(0, omega) @ _turn(2, kappa)).T, atol=1e-14)
    np.testing.assert_allclose(bingo_angles(D), angles, atol=1e-13)
    locked = rotation_from_bingo(np.array([[0.3, np.pi / 2, 0.7]]))
    np.testing.assert_allclose(rotation_from_bingo(bingo_angles(locked)), locked, atol=1e-12)


def _adjusted(folder: Path) -> tuple[dict[str, np.ndarray], float]:
    solved = solve_network(network_of(read_foreign(folder), folder))
    return {name: found[0] for name, found in point_results(solved).items()}, solved.quality.sigma0


def test_written_and_read_again_it_adjusts_to_the_same(tmp_path: Path) -> None:
    files, _ = block()
    rng = np.random.default_rng(3)
    lines = [
        f"  {w[0]} {float(w[1]) + rng.normal(0, 0.003):.6f} {float(w[2]) + rng.normal(0, 0.003):.6f}"
        if len(w := line.split()) == 3
        else line
        for line in files["image.dat"].splitlines()
    ]
    first = tmp_path / "first"
    first.mkdir()
    written(first, {**files, "image.dat": "\n".join(lines), "itera.dat": ""})
    document = read_foreign(first)
    second = tmp_path / "second"
    second.mkdir()
    made = write_foreign(document, first, second, "bingo")
    for path, content in made.files.items():
        path.write_bytes(content)
    before, after = _adjusted(first), _adjusted(second)
    assert before[1] == pytest.approx(after[1], rel=1e-9)
    for name, place in before[0].items():
        np.testing.assert_allclose(after[0][name], place, atol=1e-9)
    assert "have no σ" in " ".join(map(str, made.notes))


def test_orientations_are_start_values(tmp_path: Path) -> None:
    """What the writer says of an adjusted block is where the reader begins: poses, points, control."""

    files, places = block()
    folder = written(tmp_path, files)

    (tmp_path / "out").mkdir()
    mor.adjust(str(folder)).write(str(tmp_path / "out"))
    adjusted = next((tmp_path / "out").rglob("adjusted.yaml"))
    again = tmp_path / "again"
    again.mkdir()
    made = write_foreign(read_document(adjusted), adjusted.parent, again, "bingo")
    for path, content in made.files.items():
        path.write_bytes(content)
    document = read_foreign(again)
    assert "contradict" not in " ".join(map(str, document.notes))
    images, points = document.data["images"][0], document.data["points"][-1]
    assert len(images["columns"]) == 8
    start = {row[0]: [float(v) for v in row[1:4]] for row in points["rows"]}
    for name, place in start.items():
        np.testing.assert_allclose(place, places[name], atol=1e-3)
    pose = [float(v) for v in images["rows"][0][2:]]
    np.testing.assert_allclose(pose[:3], [10.0, 25.0, 70.0], atol=1e-3)


def test_distortion_is_taken_away(tmp_path: Path) -> None:
    """Image points of a distorted camera, written: where the same rays meet an ideal one."""
    from mor.model.cameras import CAMERA_MODELS

    rng = np.random.default_rng(9)
    star = np.column_stack([rng.uniform(-0.4, 0.4, (30, 2)), -np.ones(30)])
    interior = {"c": 24.0, "xh": 0.1, "yh": -0.05, "A1": -1e-4, "A2": 1e-7, "B1": 1e-5, "C1": 2e-4}
    model = CAMERA_MODELS["mor"]
    values = np.tile([interior.get(c.name, 0.0) for c in model.components], (30, 1))
    xy = model.project(star, values, np.full((30, 1), 8.0), np.zeros((30, 2))).xy
    rows = "\n".join(f"  - [a, p{k}, {x!r}, {y!r}]" for k, (x, y) in enumerate(xy.tolist()))
    fixed = ", ".join(f"{name}: {{fixed: {value!r}}}" for name, value in interior.items())
    (tmp_path / "p.yaml").write_text(
        f"mor: '1'\nunits: {{length: m, angle: gon}}\ncameras:\n  k: {{unit: mm, r0: 8, interior: {{{fixed}}}}}\n"
        "images:\n- columns: [id, camera, x, y, z, omega, phi, kappa]\n  rows:\n  - [a, k, 0, 0, 10, 0, 0, 0]\n"
        "points:\n- columns: [id]\n  rows:\n"
        + "".join(f"  - [p{k}]\n" for k in range(30))
        + "observations:\n"
        f"- type: image\n  values: {{sigma: 0.001}}\n  columns: [image, point, x, y]\n  rows:\n{rows}\n"
    )
    made = write_foreign(read_document(tmp_path / "p.yaml"), tmp_path, tmp_path / "b", "bingo")
    lines = made.files[tmp_path / "b" / "image.dat"].decode().splitlines()[1:-1]
    found = np.array([[float(word) for word in line.split()[1:]] for line in lines])
    ideal = -24.0 * star[:, :2] / star[:, 2:] + [0.1, -0.05]
    np.testing.assert_allclose(found, ideal, atol=1e-7)
    assert "without their distortion" in " ".join(map(str, made.notes))
