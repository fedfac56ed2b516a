"""BINGO: a block that comes out as it was, records, mistakes with their lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reference_data import network_of, point_results

from mor.errors import InputError
from mor.formats import format_of, read_foreign
from mor.geometry.rotations import rotation_from_angles
from mor.pipeline import solve_network


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
        "itera.dat": "ORIA 1 0 0 0 0 0 0 RMK\n",
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
        "itera.dat is not read",
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
