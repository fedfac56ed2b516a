"""PhotoModeler text exports: sections, cameras, control, mistakes."""

from __future__ import annotations

import pytest

from mor.errors import InputError
from mor.formats import read_foreign
from tests.reference_data import missing, network_of, reference_folder

HEAD = """A wall
 0.0005 20 4000 3000
 1 0.1 10 100 100 100 20 20 20
 25.5 18.1 12.2 36.0 24.0 0.0001 -0.00002 0 0.00003 -0.00004
 0 0 0 0 0 0 0 0 0 0
"""
PHOTO = """  {n} folder/photo {n}.jpg
  {n} {n}.5 2 3 10 20 30
  {n} 0 0 0 0 0 0

  {n} {c} 18.1 12.2 36.0 24.0 0.0001 -0.00002 0 0.00003 -0.00004
  {n} 0 0 0 0 0 0 0 0 0 0
"""
POINTS = """
{control}
  1 0.1 0.2 0.3 0 0 0
  2 1.1 0.2 0.3 0 0 0

  0 1 100.5 200.5 0.1 0.2
  1 1 101.5 201.5 0.1 0.2
  1 2 300 400 0.1 0.1

  0 1 2

"""


def _read(tmp_path, cameras=("25.5", "25.5"), control="", old="", new=""):
    text = HEAD + "".join(PHOTO.format(n=n, c=c) for n, c in enumerate(cameras)) + POINTS.format(control=control)
    path = tmp_path / "export.txt"
    path.write_text(text.replace(old, new) if old else text)
    return read_foreign(path)


def test_an_export_without_control(tmp_path):
    document = _read(tmp_path)
    data = document.data
    assert data["title"] == "A wall"
    assert data["images"][0]["rows"][1] == ["1", "1", "1.5", "2.0", "3.0", "30.0", "20.0", "10.0"]
    assert data["images"][0]["columns"][5:] == ["omega", "phi", "kappa"]
    assert data["points"][0]["rows"] == [["1", "0.1", "0.2", "0.3"], ["2", "1.1", "0.2", "0.3"]]
    assert data["observations"][0]["rows"][0] == ["0", "1", "100.5", "200.5", "0.1", "0.2"]
    assert len(data["observations"][0]["rows"]) == 3
    assert data["datum"] == "free"
    assert document.line(("observations", 0, "rows", 2)) == 25
    assert network_of(document, tmp_path).things["image"].ids == ("0", "1")


def test_the_image_coordinates_mean_the_same_place_on_the_sensor(tmp_path):
    """Pixel width 9 um, height 8 um: x' = 0.009 x_px − 18.1 and y' = 12.2 − 0.008 y_px, whatever the pixel of b1."""
    network = network_of(_read(tmp_path), tmp_path)
    (group,) = (group for group in network.groups if group.type.key.startswith("image"))
    interior = dict(zip(network.blocks["interior/brown"].kind.names, network.start["interior/brown"][0], strict=True))
    reduced = group.observed[0] - [interior["xh"], interior["yh"]]
    assert (1.0 + interior["b1"]) * reduced[0] == pytest.approx(0.009 * 100.5 - 18.1, abs=1e-9)
    assert reduced[1] == pytest.approx(12.2 - 0.008 * 200.5, abs=1e-12)


def test_control_points_are_observed_and_fix_the_datum(tmp_path):
    document = _read(tmp_path, control=" 2 1.0 0.2 0.3 0.01 0.01 0\n 9 5 5 5 0 0 0\n")
    control, objects = document.data["points"]
    assert [row[0] for row in control["rows"]] == ["2", "9"]
    assert [row[0] for row in objects["rows"]] == ["1"]
    assert "datum" not in document.data
    assert len(document.data["observations"][0]["rows"]) == 3


def test_photos_with_different_values_have_different_cameras(tmp_path):
    data = _read(tmp_path, cameras=("25.5", "35.5", "25.5")).data
    assert [row[1] for row in data["images"][0]["rows"]] == ["1", "2"]  # the third has no image points
    assert data["cameras"]["2"]["interior"]["c"] == {"fixed": "35.5"}


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        (
            " 4000 3000",
            "",
            2,
            "found no image width and height (px) here, and the solution in the file does not give them; "
            "put them behind tolerance and iterations",
        ),
        ("1.5 2 3 10", "1.5 2 x 10", 13, "found 'x', expected a number"),
        ("101.5 201.5 0.1 0.2", "101.5", 24, "found 3 columns, expected photo id x y sx sy"),
        ("1.1 0.2 0.3 0", "1.1 0.2 # 0", 21, "found '#', expected a number"),
    ],
)
def test_mistakes_have_their_line(tmp_path, old, new, line, words):
    with pytest.raises(InputError) as error:
        _read(tmp_path, old=old, new=new)
    found = [(problem.line, problem.message) for problem in error.value.problems]
    assert (line, words) in found


def test_other_texts_are_refused(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("one\ntwo\nthree\nfour\nfive\nsix\n")
    with pytest.raises(InputError) as error:
        read_foreign(path, "photomodeler")
    assert {problem.line for problem in error.value.problems} == {2, 3, 4, 6}
    path.write_text("short")
    with pytest.raises(InputError, match="not a PhotoModeler text export"):
        read_foreign(path, "photomodeler")


def test_a_calibration_project_has_its_camera_free(tmp_path):
    data = _read(tmp_path, old="A wall", new="Bundle Soln PhotoModeler Calibration Project").data
    assert data["cameras"]["1"]["interior"]["c"] == {"free": "25.5"}
    assert data["cameras"]["1"]["interior"]["b1"] == {"fixed": "0.125"}


def test_marks_without_a_point_and_without_a_sigma(tmp_path):
    """Marks of no point are left out, marks by hand and smart points (σ 0) have the default of the file."""
    document = _read(tmp_path, old="1 2 300 400 0.1 0.1", new="1 2 300 400 0.0 0.0\n  1 77 10 10 0.1 0.1\n 5 2 1 1 1 1")
    rows = document.data["observations"][0]["rows"]
    assert rows[-1] == ["1", "2", "300", "400", "1.0", "1.0"]
    assert len(rows) == 3
    notes = " ".join(note.message for note in document.notes)
    assert "1 image point of no point in the file not used: the first is 77" in notes
    assert "1 image point of no photo in the file not used: the first is in 5" in notes
    assert "1 image point without σ: σ = 1 px" in notes


def test_fixed_control_has_a_negative_sigma_and_stands_among_the_points_again(tmp_path):
    document = _read(
        tmp_path,
        control="  2 1.1 0.2 0.3 -49.45 -49.45 -49.45\n  2 1.1 0.2 0.3 -49.45 -49.45 -49.45\n",
        old="  1 0.1 0.2 0.3 0 0 0\n",
        new="  1 0.1 0.2 0.3\n  1 0.1 0.2 0.4 0 0 0\n",
    )
    control, objects = document.data["points"]
    assert control["rows"] == [["2", "1.1", "0.2", "0.3", "0", "0", "0"]]
    assert objects["rows"] == [["1", "0.1", "0.2", "0.3"]]
    notes = " ".join(note.message for note in document.notes)
    assert "control point '2' is there already (line 19) and says the same" in notes
    assert "point '1' is there already (line 22) with other coordinates, which are not taken" in notes


@pytest.mark.skipif(reference_folder("camcal") is None, reason=missing("camcal"))
def test_a_missing_image_size_is_worked_out(tmp_path):
    """The size was appended by hand to this file (README of the set): without it the solution gives it back."""
    text = (reference_folder("camcal") / "camcal-pmexport.txt").read_text()
    path = tmp_path / "export.txt"
    path.write_text(text.replace(" 0.000500 20 2272 1704", " 0.000500 20", 1))
    document = read_foreign(path)
    image = document.data["cameras"]["1"]["image"]
    assert (image["width"], image["height"]) == ("2272", "1704")
    assert "2272 x 1704 px is worked out" in " ".join(note.message for note in document.notes)


def test_a_format_of_no_size_is_told(tmp_path):
    with pytest.raises(InputError, match=r"export\.txt:4: found the format 0 x 24 mm, expected numbers above 0"):
        _read(tmp_path, old="25.5 18.1 12.2 36.0 24.0", new="25.5 18.1 12.2 0 24.0")
