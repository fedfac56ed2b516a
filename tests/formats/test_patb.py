"""PAT-B: a block that comes out as it was in µm and in mm, written and read again, mistakes with their lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import solve_network
from mor.errors import InputError
from mor.formats import format_of, read_foreign, write_foreign
from tests.reference_data import network_of, point_results

from .test_bingo import block as bingo


def block(scale: float = 1e3, noise: float = 0.0) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """Files of a block (c = 50 mm), image coordinates in 1/scale mm, and the places of its points."""
    files, places = bingo()
    rng = np.random.default_rng(3)
    lines = []
    for line in files["image.dat"].splitlines():
        words = line.split()
        if len(words) == 2:
            lines.append(f"{words[0]:>8} {50 * scale!r} 0")
        elif len(words) == 3:
            x, y = float(words[1]) - 0.05, float(words[2]) + 0.02
            x, y = ((v + rng.normal(0.0, noise) if noise else v) * scale for v in (x, y))
            lines.append(f"{words[0]:>8} {x:.6f} {y:.6f} 1")
        else:
            lines.append(line)
    control = [
        f"{name} {' '.join(map(repr, places[name].tolist()))} 1 1" for name in ("100", "101", "102", "103")
    ]
    return {"b.im": "\r\n".join(lines), "b.con": "\n".join([*control, "-99", ""])}, places


def written(folder: Path, files: dict[str, str]) -> Path:
    """The files in a folder; returns the image file."""
    for name, text in files.items():
        (folder / name).write_text(text, newline="")
    return folder / "b.im"


@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_a_block_comes_out_as_it_was(tmp_path: Path, scale: float) -> None:
    files, places = block(scale)
    path = written(tmp_path, files)
    assert format_of(path) == "pat-b"
    path = path.rename(tmp_path / "b.txt")
    assert format_of(path) == "pat-b"
    document = read_foreign(path)
    assert document.data["cameras"]["camera 1"]["interior"] == {"c": {"fixed": "50.0"}}
    found = point_results(solve_network(network_of(document, tmp_path)))
    for name, place in places.items():
        np.testing.assert_allclose(found[name][0], place, atol=1e-4)
    notes = " ".join(map(str, document.notes))
    for words in ("σ = 0.003 mm", "further numbers in 126 lines not read", "further numbers in 4 lines"):
        assert words in notes, words


def _adjusted(path: Path) -> tuple[dict[str, np.ndarray], float]:
    solved = solve_network(network_of(read_foreign(path), path.parent))
    return {name: found[0] for name, found in point_results(solved).items()}, solved.quality.sigma0


def test_written_and_read_again_it_adjusts_to_the_same(tmp_path: Path) -> None:
    path = written(tmp_path, block(1e3, 0.003)[0])
    (tmp_path / "again").mkdir()
    made = write_foreign(read_foreign(path), tmp_path, tmp_path / "again" / "b.im", "pat-b")
    assert {file.name for file in made.files} == {"b.im", "b.con"}
    for file, content in made.files.items():
        file.write_bytes(content)
    before, after = _adjusted(path), _adjusted(tmp_path / "again" / "b.im")
    assert before[1] == pytest.approx(after[1], rel=1e-9)
    for name, place in before[0].items():
        np.testing.assert_allclose(after[0][name], place, atol=1e-9)


def test_bingo_and_patb_of_a_block_adjust_to_the_same(tmp_path: Path) -> None:
    """The principal point is a number of BINGO's camera, and in PAT-B taken off the coordinates."""
    files, _ = bingo()
    (tmp_path / "bingo").mkdir()
    for name, text in files.items():
        (tmp_path / "bingo" / name).write_text(text)
    made = write_foreign(read_foreign(tmp_path / "bingo"), tmp_path, tmp_path / "b.im", "pat-b")
    for file, content in made.files.items():
        file.write_bytes(content)
    first, second = _adjusted(tmp_path / "bingo"), _adjusted(tmp_path / "b.im")
    for name, place in first[0].items():
        np.testing.assert_allclose(second[0][name], place, atol=1e-9)
    assert "no names of cameras" in " ".join(map(str, made.notes))


def test_without_control_it_is_a_free_network(tmp_path: Path) -> None:
    files, _ = block()
    path = written(tmp_path, {"b.im": files["b.im"]})
    document = read_foreign(path)
    assert document.data["datum"] == "free"
    assert "there is no .con beside it" in " ".join(map(str, document.notes))


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("b.im", "       1 50000.0 0", "       1", r"b\.im:1: found '1', expected a photo and its camera"),
        ("b.im", "50000.0", "-50000.0", r"b\.im:1: found the camera constant -50000\.0"),
        ("b.im", "     101 ", "     101 x", r"b\.im:3: found 'x"),
        ("b.im", "       2 50000", "       1 50000", r"b\.im:23: image '1' is there already"),
        ("b.con", "101 ", "100 ", r"b\.con:2: point '100' is there already"),
        ("b.con", " 1 1\n", "\n102 1 2\n", r"b\.con:2: found 3 words, expected point X Y Z"),
    ],
)
def test_mistakes_have_their_lines(tmp_path: Path, file: str, old: str, new: str, words: str) -> None:
    files, _ = block()
    assert old in files[file]
    files[file] = files[file].replace(old, new, 1)
    with pytest.raises(InputError, match=words):
        read_foreign(written(tmp_path, files), "pat-b")
