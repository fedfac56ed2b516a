"""DBAT scripts: tables by their formats, cameras with DBAT's signs, what is estimated, mistakes with their lines."""

from __future__ import annotations

from pathlib import Path

import pytest

from mor.errors import InputError
from mor.formats import format_of, read_foreign
from tests.reference_data import missing, network_of, reference_folder

SCRIPT = """<document dbat_script_version="1.0"><meta><name>A wall</name></meta>
<input base_dir="$HERE">
<c>a comment</c>
<ctrl_pts><file format="id,label,x,y,z,sx,sy,sz">control.txt</file><filter id="4">remove</filter></ctrl_pts>
<check_pts><file format="id,label,x,y,z,sx,sy,sz">control.txt</file><filter id="4">keep</filter></check_pts>
<images image_base_dir="$DBAT"><file format="id,path">images.txt</file></images>
<prior_eo><file format="id,x,y,z,omega,phi,kappa" units="degrees">eo.txt</file></prior_eo>
<image_pts><file format="id,im,x,y" sxy="0.5">marks.txt</file><file format="im,id,x,y,sxy">more.txt</file></image_pts>
<cameras><camera><id>1</id><unit>mm</unit><sensor>auto,24</sensor><image>6000,4000</image><aspect>0.999</aspect>
<focal>28</focal><model>3</model><nK>2</nK><nP>2</nP><cc>28.3</cc><pp>18.05,-11.98</pp><skew>0.0002</skew>
<K>-1e-4,2e-7</K><P>3e-5,-4e-5</P></camera></cameras>
</input>
<operations><operation min_rays="2">check_ray_count</operation>
<operation><set_initial_values><io>loaded</io></set_initial_values></operation>
<operation><set_bundle_estimate_params><io><all>true</all><skew>false</skew><K2>false</K2></io><eo><all>true</all></eo>
</set_bundle_estimate_params></operation></operations></document>
"""
TABLES = {
    "control.txt": "# points\n1,A,0,0,0,0,0,0\n2,B,10,0,0,0,0,0.01\n3,C,10,8,0,0,0,0\n4,D,0,8,1,0,0,0\n",
    "images.txt": " 1, photos/left.jpg\n 2, photos/right.jpg\n",
    "eo.txt": "1, 3, 4, 12, 0.5, -0.5, 1\n2, 7, 4, 12, 0.5, -0.5, 91\n",
    "marks.txt": "1, 1, 1500.25, 3000.4\n2,1,4000,3010.3\n4,1,1500,1200\n5, 1, 2100.7, 1500.9\n5, 2, 1700.7, 1502.9\n",
    "more.txt": "\n2, 3, 4000, 1000, 2\n9, 3, 1, 1, 1\n",
}


def files(folder: Path, **changed: str) -> Path:
    """A project in a folder, with other texts of some files."""
    for name, text in TABLES.items():
        (folder / name).write_text(changed.get(name.removesuffix(".txt"), text))
    (folder / "wall.xml").write_text(changed.get("script", SCRIPT))
    return folder / "wall.xml"


def test_the_project_of_a_script(tmp_path: Path) -> None:
    path = files(tmp_path)
    assert format_of(path) == "dbat"
    data = read_foreign(path).data
    assert data["title"] == "A wall"
    assert data["images"][0]["rows"][1] == ["right.jpg", "1", "7", "4", "12", "0.5", "-0.5", "91"]
    control, others = data["points"]
    assert [row[0] for row in control["rows"]] == ["1", "2", "3"]
    assert control["rows"][1] == ["2", "10", "0", "0", "0", "0", "0.01"]
    assert others["rows"] == [["4"], ["5"]]
    assert data["checks"][0]["rows"] == [["4", "0", "8", "1", *["0.001"] * 3]]
    first, second = data["observations"]
    assert first["rows"][0] == ["left.jpg", "1", "1500.25", "3000.4", "0.5", "0.5"]
    assert second["rows"] == [["right.jpg", "3", "4000", "1000", "2", "2"]]
    assert "datum" not in data
    network_of(read_foreign(path), tmp_path)


def test_a_camera_has_other_signs_and_another_origin(tmp_path: Path) -> None:
    camera = read_foreign(files(tmp_path)).data["cameras"]["1"]
    assert camera["model"] == "brown"
    assert camera["image"] == {"width": "6000", "height": "4000", "pixel": "0.006 mm"}
    found = {key: next(iter(value.items())) for key, value in camera["interior"].items()}
    assert {key for key, (status, _) in found.items() if status == "free"} == {
        "c",
        "xh",
        "yh",
        "b1",
        "K1",
        "P1",
        "P2",
    }
    expected = {"c": 28.3, "xh": 0.05, "yh": 0.02, "b1": 0.001, "b2": 0.0002, "K1": 1e-4, "K2": -2e-7,
                "P1": -3e-5, "P2": 4e-5}  # fmt: skip
    assert {key: float(text) for key, (_, text) in found.items()} == pytest.approx(expected)


def test_defaults_and_values_of_the_script(tmp_path: Path) -> None:
    script = SCRIPT.replace("<io>loaded</io>", "<io><all>default</all><K>1e-5,0</K></io>")
    interior = read_foreign(files(tmp_path, script=script)).data["cameras"]["1"]["interior"]
    assert {key: float(*value.values()) for key, value in interior.items()} == pytest.approx(
        {"c": 28, "xh": 0, "yh": 0, "b1": 0, "b2": 0, "K1": -1e-5, "K2": 0, "P1": 0, "P2": 0}
    )


def test_cameras_in_a_file_of_their_own(tmp_path: Path) -> None:
    start, end = SCRIPT.index("<camera>"), SCRIPT.index("</cameras>")
    expected = read_foreign(files(tmp_path)).data["cameras"]
    path = files(tmp_path, script=SCRIPT[:start] + "<file>camera.xml</file>" + SCRIPT[end:])
    camera = tmp_path / "camera.xml"
    camera.write_text(f'<document dbat_camera_version="1.0">\n<cameras>{SCRIPT[start:end]}</cameras></document>')
    assert read_foreign(path).data["cameras"] == expected
    camera.write_text(camera.read_text().replace("<model>3", "<model>9"))
    with pytest.raises(InputError, match=r"camera\.xml:3: camera 1: found the model '9'"):
        read_foreign(path)
    camera.write_text("<document/>")
    with pytest.raises(InputError, match=r"camera\.xml:1: found no <camera>"):
        read_foreign(path)


def test_poses_that_are_not_estimated_are_fixed(tmp_path: Path) -> None:
    script = SCRIPT.replace("<eo><all>true</all></eo>", "<eo><pos>false</pos></eo>")
    assert read_foreign(files(tmp_path, script=script)).data["images"][0]["fixed"] == ["x", "y", "z"]


def test_without_control_the_network_is_free(tmp_path: Path) -> None:
    lines = [line for line in SCRIPT.split("\n") if '_pts><file format="id,label' not in line]
    script = "\n".join(lines).replace(
        "</operations>", '<operation><set_datum ref_cam="1">depend</set_datum></operation></operations>'
    )
    document = read_foreign(files(tmp_path, script=script))
    assert document.data["datum"] == "free"
    assert any("all points carry it" in note.message for note in document.notes)


def test_what_is_left_out_is_told(tmp_path: Path) -> None:
    notes = [note.message for note in read_foreign(files(tmp_path)).notes]
    for words in ("labels of control", "1 image point of no image not used: the first is in 9"):
        assert any(words in note for note in notes), words


def test_y_of_the_principal_point_may_count_downwards(tmp_path: Path) -> None:
    up = read_foreign(files(tmp_path))
    down = read_foreign(files(tmp_path, script=SCRIPT.replace("18.05,-11.98", "18.05,11.98")))
    assert down.data["cameras"] == up.data["cameras"]
    assert "y of pp is above 0" in str([note.message for note in down.notes])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<model>3</model>", "<model>7</model>", "wall.xml:10: camera 1: found the model '7'"),
        ("<sensor>auto,24</sensor>", "", "wall.xml:9: camera 1: found no <sensor>"),
        ("-1e-4,2e-7", "1,2,3,4", "wall.xml:11: camera 1: found 4 coefficients K"),
        ('"id,im,x,y"', '"id,im,x"', "wall.xml:8: found the format 'id,im,x': expected y in it"),
        ('"id,im,x,y"', '"id,img,x,y"', "'img' is not a column"),
        (">marks.txt<", ">mark.txt<", "wall.xml:8: the file mark.txt does not exist"),
        ("<skew>false", "<skew>perhaps", "wall.xml:15: found 'perhaps' in <skew>"),
        (">remove<", ">drop<", "wall.xml:4: found the filter 'drop'"),
        ("degrees", "miles", "wall.xml:7: found units='miles'"),
    ],
)  # fmt: skip
def test_mistakes_of_a_script(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in SCRIPT
    with pytest.raises(InputError) as error:
        read_foreign(files(tmp_path, script=SCRIPT.replace(old, new)))
    assert words in str(error.value)


def test_mistakes_of_tables_have_their_lines(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read_foreign(files(tmp_path, marks="1,1,5\n1,1,x,7\n,1,2,3\n", control="1,A,0,0,0,-1,0,0\n"))
    for words in (
        "marks.txt:1: found 3 columns",
        "marks.txt:2: found 'x'",
        "marks.txt:3: found no id",
        "σ -1",
    ):
        assert words in str(error.value)


@pytest.mark.skipif(reference_folder("camcal") is None, reason=missing("camcal"))
def test_a_real_calibration_has_the_unknowns_of_the_published_report(tmp_path: Path) -> None:
    """DBAT's report: 4148 observations, 423 unknowns, 9 of the camera, 126 of poses, 288 of points."""
    folder = reference_folder("camcal")
    assert folder is not None
    rows = [line.split(",") for line in (folder / "observations.csv").read_text().split("\n")[1:] if line]
    images = sorted({int(row[0]) for row in rows})
    poses = [line.split(",") for line in (folder / "images.csv").read_text().split("\n")[1:] if line]
    texts = {
        "eo": "".join(f"{row[0]}, {', '.join(row[3:9])}\n" for row in poses),
        "control": "1001,A,0,1,0,0,0,0\n1002,B,1,1,0,0,0,0\n1003,C,0,0,0,0,0,0\n1004,D,1,0,0,0,0,0\n",
        "images": "".join(f"{k:2d}, a/P{k}.JPG\n" for k in images),
        "marks": "".join(f"{point}, {image}, {x}, {y}\n" for image, point, x, y, *_ in rows),
        "more": "",
        "script": SCRIPT.replace("auto,24", "auto,5.43764").replace("6000,4000", "2272,1704")
        .replace("<focal>28<", "<focal>7.5<").replace("<io>loaded</io>", "<io>default</io>")
        .replace("<nK>2<", "<nK>3<").replace("-1e-4,2e-7", "0,0,0").replace("<K2>false</K2>", "")
        .replace('sxy="0.5"', 'sxy="0.1"').replace('<filter id="4">remove</filter>', ""),
    }  # fmt: skip
    network = network_of(read_foreign(files(tmp_path, **texts)), tmp_path)
    assert sum(len(group.observed) * 2 for group in network.groups) == 4148
    free = {kind: int(block.free.sum()) for kind, block in network.blocks.items()}
    assert free["interior/brown"] == 9
    assert free["rotation"] == 63
    assert free["point"] == 288 + 63
