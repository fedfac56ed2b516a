"""AICON flat files: found by folder, stem or file; what is switched off; mistakes with file and line."""

from __future__ import annotations

import gzip

import pytest

from mor.errors import InputError
from mor.formats import is_foreign, read_foreign
from tests.reference_data import network_of

FILES = {
    ".ior": """# id ? c xh yh A1 A2 r0
 7 -999 -30.5 0.01 -0.02 -1.5e-004 1.5e-007 12.5
 0.0
 1e-006 -2e-006
 -7e-005 -3e-005
 36.0 24.0 6000 4000
""",
    ".eor": """ 1 7 0 0 1000 0.1 0.2 0.3 0 307 3
 2 7 500 0 1000 0 0 0 0 307 1
 3 7 500 9 1000 0 0 0 0 0 3
""",
    ".obc": """ A 0 0 0 0.1 0.1 0.1 2 1 1 0
 B 100 0 0 0.1 0.2 0 2 1 0 0
 C 0 100 0 0.1 0.1 0.1 2 0 1 0
 D 0 100 5 0.1 0.1 0.1 2 1 1 1
""",
    ".phc": """ 1 A 1.5 2.5 0.0001 0.0002 0 0 1 1 1
 1 B 1.5 2.5 0.0001 0.0002 0 0 1 0 1
 1 C 1.5 2.5 0.0001 0.0002 0 0 1 1 1
 2 D 1.5 2.5 0.0001 0.0002 0 0 1 1 1
 3 A 1.5 2.5 0.0001 0.0002 0 0 1 1 1
 3 D 1.5 2.5 0.0001 0.0002 0 0 1 1 1
""",
    ".scale": ' 0 "A bar" A B 100.01 0.05 1\n 1 "off" A B 100.01 0.05 0\n 2 "lost" A C 1 0.05 1\n',
}


@pytest.fixture
def folder(tmp_path):
    for suffix, text in FILES.items():
        content = text.encode()
        name = tmp_path / f"wall{suffix}"
        if suffix == ".phc":
            name, content = tmp_path / "wall.phc.gz", gzip.compress(content)
        name.write_bytes(content)
    return tmp_path


@pytest.mark.parametrize("name", ["", "wall", "wall.ior", "wall.obc", "wall.phc.gz", "wall.scale"])
def test_the_files_are_found(folder, name):
    assert is_foreign(folder / name)
    data = read_foreign(folder / name).data
    assert data["title"] == "wall"
    assert [row[:2] for row in data["observations"][0]["rows"]] == [["1", "A"], ["2", "D"]]


def test_what_the_files_say(folder):
    document = read_foreign(folder)
    data = document.data
    interior = data["cameras"]["7"]["interior"]
    assert interior["c"] == {"free": "30.5"}
    assert interior["C2"] == {"fixed": "-3e-005"}
    assert data["cameras"]["7"]["r0"] == "12.5"
    (images,) = data["images"]
    assert images["rows"] == [["1", "7", "0", "0", "1000", "0.1", "0.2", "0.3"], ["2", "7", *[None] * 6]]
    new, known = data["points"]
    assert [row[0] for row in new["rows"]] == ["A", "D"]
    assert known["rows"] == [["B", "100", "0", "0", "0.1", "0.2", "0"]]
    assert data["observations"][1]["rows"] == [["A", "B", "100.01", "0.05"]]
    assert data["datum"] == "free"


def test_what_is_left_out_is_told(folder):
    notes = [note.message for note in read_foreign(folder).notes]
    for words in (
        "image '3' is switched off",
        "1 ray not used: point 'C'",
        "2 rays not used: image '3'",
        "A-C not used",
    ):
        assert any(words in note for note in notes), words


def test_known_components_are_fixed_or_observed(folder):
    network = network_of(read_foreign(folder), folder)
    points = network.blocks["point"]
    free = dict(zip(points.ids, points.free.tolist(), strict=True))
    assert free["B"] == [True, True, False]
    (prior,) = (group for group in network.groups if group.type.key == "observed/point")
    assert prior.sigma[0, :2].tolist() == [0.1, 0.2]


def test_lines_lead_to_the_file_they_are_in(folder):
    path = folder / "wall.obc"
    path.write_text(path.read_text().replace("D 0 100 5", "A 0 100 5"))
    with pytest.raises(InputError) as error:
        network_of(read_foreign(folder), folder)
    (problem, *_) = error.value.problems
    assert (problem.file, problem.line) == (str(path), 4)


def test_mistakes_come_at_once_with_file_and_line(folder):
    (folder / "wall.eor").write_text(
        " 1 7 0 0 1000 0.1 0.2 0.3 1 307 3\n 2 8 0 0 x 0 0 0 0 307 3\n 3 8 0 0 1 0 0 0 0 1 3\n"
    )
    (folder / "wall.obc").write_text(" A 0 0\n")
    with pytest.raises(InputError) as error:
        read_foreign(folder)
    found = {(problem.file.rpartition("/")[2], problem.line): problem.message for problem in error.value.problems}
    assert "rotation order 1" in found["wall.eor", 1]
    assert "found 'x', expected a number" in found["wall.eor", 2]
    assert "camera '8'" in found["wall.eor", 3]
    assert "found 3 columns" in found["wall.obc", 1]


def test_missing_files_and_folders(folder, tmp_path):
    (folder / "wall.obc").unlink()
    with pytest.raises(InputError, match=r"wall\.obc: this file does not exist"):
        read_foreign(folder)
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(InputError, match="or a folder in one of the formats"):
        read_foreign(empty)
    with pytest.raises(InputError, match=r"wall\.xyz: this file does not exist"):
        read_foreign(tmp_path / "wall.xyz")
    with pytest.raises(InputError, match="does not exist"):
        read_foreign(tmp_path / "wall.gkf")
