"""Metashape's XML: round trips, the chunk's transform, markers, what is refused."""

from __future__ import annotations

import io
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import Transformer

from mor.api.pipeline import read_document, solve_network
from mor.errors import InputError
from mor.formats import format_of, read_foreign, read_together, write_foreign
from mor.model.cameras import CAMERA_MODELS
from mor.model.rotations import rotation_from_angles
from mor.project.network import Network
from mor.solve.problem import misclosures
from tests.reference_data import network_of, point_results

from .blocks import MODELS, block, written

OWN = {"f": 3705.47, "cx": 11.67, "cy": -27.75, "b1": 0.526, "b2": -0.306, "k1": -0.0919, "k2": -0.0763,
       "k3": 0.1163, "k4": -0.0761, "p1": -3.1e-4, "p2": 1.2e-4}  # fmt: skip


def _write(source: Path) -> Path:
    out = write_foreign(read_document(source), source.parent, source.parent / "cameras.xml", "metashape")
    for path, content in out.files.items():
        path.write_bytes(content)
    return source.parent / "cameras.xml"


@pytest.mark.parametrize(
    "model", [name for name in MODELS if name not in ("FULL_OPENCV", "FOV") and "FISHEYE" not in name]
)
def test_round_trips_have_the_same_rays(tmp_path: Path, model: str) -> None:
    """Poses and image points come back, and the camera, which has another model, sees every point where it did."""
    source = written(tmp_path, block(3, model))
    xml = _write(source)
    assert format_of(xml) == "metashape"
    before, after = (network_of(d, tmp_path) for d in (read_document(source), read_foreign(xml)))
    for kind in ("point", "rotation"):
        np.testing.assert_allclose(after.start[kind], before.start[kind], rtol=1e-12, atol=1e-12)
    seen = [_pixels(network, from_centre) for network, from_centre in ((before, "c" in MODELS[model]), (after, True))]
    for ours, theirs in zip(*seen, strict=True):
        np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-9)


def _pixels(network: Network, from_centre: bool) -> tuple[np.ndarray, np.ndarray]:
    """Observed and computed px from the upper left corner, sorted."""
    (group,) = network.groups
    image, point = network.things["image"], network.things["point"]
    computed = []
    for a, b in zip(*group.references, strict=True):
        D = network.start["rotation"][image.part(a, "rotation")]
        star = D @ (
            network.start["point"][point.part(b, "position")] - network.start["point"][image.part(a, "position")]
        )
        model = CAMERA_MODELS[list(CAMERA_MODELS)[image.part(a, "model")]]
        interior = network.start[f"interior/{model.key}"][image.part(a, "interior")]
        computed.append(
            model.project(star[None], interior[None], np.zeros((1, len(model.constants))), np.zeros((1, 2))).xy[0]
        )
    centre = [800, 600] if from_centre else [0, 0]
    return tuple(np.sort(xy * [1, -1] + centre, axis=0) for xy in (group.observed, np.array(computed)))  # type: ignore[return-value]


def test_its_own_model_and_adjusted_results_come_back(tmp_path: Path) -> None:
    data = block(4, "PINHOLE", noise=0.2)
    interior = {
        **{k: {"fixed": repr(v)} for k, v in OWN.items()},
        "f": {"free": "1200.0"},
        "cx": {"fixed": "12.0"},
    }
    data["cameras"]["7"].update(model="metashape", interior=interior)
    data["points"][0]["rows"][0] += ["0.001", "0.001", "0.001"]
    for row in data["points"][0]["rows"][1:]:
        row += [None, None, None]
    data["points"][0]["columns"] += ["sigma_x", "sigma_y", "sigma_z"]
    source = written(tmp_path, data)
    again = read_foreign(_write(source))
    assert again.data["cameras"]["0"]["interior"] == interior
    assert again.data["points"][0]["rows"][0][4:] == ["0.001", "0.001", "0.001"]
    data["points"][0]["rows"] = [row[:4] for row in data["points"][0]["rows"]]
    data["points"][0]["columns"] = data["points"][0]["columns"][:4]
    data["observations"][0]["values"] = {"sigma": "0.5"}
    source = written(tmp_path, data)
    solved = [solve_network(network_of(d, tmp_path)) for d in (read_document(source), read_foreign(_write(source)))]
    costs = [sum(float((q.v**2).sum()) for q in one.quality.groups) for one in solved]
    assert costs[1] == pytest.approx(costs[0], rel=1e-9)
    distances = []
    for one in solved:
        xyz = np.array([place for place, _ in point_results(one).values()])
        distances.append(np.linalg.norm(xyz[:, None] - xyz, axis=2))
    np.testing.assert_allclose(distances[1] / distances[1].max(), distances[0] / distances[0].max(), atol=1e-9)


XML = """<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true">
<sensors next_id="2"><sensor id="0" label="M3M (12.29mm)" type="frame"><resolution width="5280" height="3956"/>
<property name="pixel_width" value="0.0033582"/><property name="focal_length" value="12.29"/>
<calibration type="frame" class="adjusted"><resolution width="5280" height="3956"/><f>3705.47</f><cx>11.67</cx>
<cy>-27.75</cy><b1>0.52</b1><k1>-0.09</k1>
<covariance><params>f cx cy b1 k1 k2</params></covariance></calibration></sensor>
<sensor id="1" label="bare" type="frame"><resolution width="4000" height="3000"/>
<property name="pixel_width" value="0.003"/><property name="focal_length" value="12"/>
<property name="fixed" value="true"/></sensor></sensors>
<cameras next_id="3"><camera id="0" sensor_id="0" label="a.jpg">
<transform>1 0 0 1 0 -1 0 2 0 0 -1 3 0 0 0 1</transform></camera>
<group id="0" label="g"><camera id="1" sensor_id="1" label="a.jpg"/></group>
<camera id="2" sensor_id="0" label="off.jpg" enabled="false"/></cameras>
<markers><marker id="0" label="P1"><reference x="1" y="2" z="3" sx="0.01" sy="0.01" sz="0.02" enabled="true"/></marker>
<marker id="1" label="P2"/></markers>
<frames><frame id="0"><markers><marker marker_id="0"><location camera_id="0" pinned="true" x="10.5" y="20.25"/>
<location camera_id="2" x="1" y="1"/></marker></markers></frame></frames>
<transform><rotation>0 -1 0 1 0 0 0 0 1</rotation><translation>10 20 30</translation><scale>2</scale></transform>
<settings><property name="accuracy_projections" value="0.1"/></settings>
<reference>LOCAL_CS["Local Coordinates (m)"]</reference>
</chunk></document>"""


def test_a_chunk_with_its_transform(tmp_path: Path) -> None:
    path = tmp_path / "markers.xml"
    path.write_bytes(b"\xef\xbb\xbf" + XML.replace("\n", "\r\n").encode())
    document = read_foreign(path)
    data = document.data
    rows = data["images"][0]["rows"]
    assert [row[:2] for row in rows] == [["a.jpg", "0"]]
    notes = " ".join(map(str, document.notes))
    assert "1 image in which no marker is measured" in notes
    assert "sensors 1 have no image here" in notes
    # camera centre (1, 2, 3), turned by 90° about z, doubled and shifted
    assert [float(v) for v in rows[0][2:5]] == pytest.approx([10 - 4, 20 + 2, 30 + 6])
    # its axes right, down, forward are x, −y, −z of the chunk: it looks straight down, turned by 90°
    assert [float(v) for v in rows[0][5:]] == pytest.approx([0, 0, np.pi / 2])
    assert data["points"][0]["rows"][0] == ["P1", "1", "2", "3", "0.01", "0.01", "0.02"]
    assert data["observations"][0]["rows"] == [["a.jpg", "P1", "10.5", "20.25"]]
    assert data["observations"][0]["values"] == {"sigma": "0.1"}
    free = [name for name, value in data["cameras"]["0"]["interior"].items() if "free" in value]
    assert free == ["f", "cx", "cy", "b1", "k1", "k2"]
    assert "1 image switched off" in notes
    assert "1 projection in images switched off or without a sensor" in notes


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('type="frame"><res', 'type="spherical"><res', r"markers\.xml:3: sensor 0: type 'spherical'"),
        ("<f>3705.47</f>", "<f>x</f>", "sensor 0: f: found 'x', expected a number"),
        ("1 0 0 1 0 -1", "1 0 0 1 0 -1 7", "transform of camera 'a.jpg': found 17 numbers"),
        ('x="10.5"', 'x="nan"', "found 'nan'"),
        ("</markers></frame>", "</frame>", "not well-formed XML"),
    ],
)
def test_mistakes_are_told(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = tmp_path / "markers.xml"
    path.write_text(XML.replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        read_foreign(path)


def test_sensors_without_a_calibration_and_images_without_markers(tmp_path: Path) -> None:
    """A cameras.xml alone keeps all its images."""
    path = tmp_path / "cameras.xml"
    path.write_text(XML[: XML.index("<markers>")] + XML[XML.index("<transform><rotation>") :])
    data = read_foreign(path).data
    assert [row[:2] for row in data["images"][0]["rows"]] == [["a.jpg", "0"], ["a.jpg (1)", "1"]]
    assert data["cameras"]["1"]["interior"]["f"] == {"fixed": "4000.0"}


def test_other_sensors_of_a_rig_are_not_read(tmp_path: Path) -> None:
    path = tmp_path / "cameras.xml"
    alone = XML[: XML.index("<markers>")] + XML[XML.index("<transform><rotation>") :]
    path.write_text(alone.replace('<camera id="1"', '<camera id="1" master_id="0"'))
    document = read_foreign(path)
    assert [row[:2] for row in document.data["images"][0]["rows"]] == [["a.jpg", "0"]]
    assert "1 image of the other sensors of a rig: not read" in " ".join(map(str, document.notes))


def test_reference_positions_of_cameras_are_observed(tmp_path: Path) -> None:
    """With σ of the file or Metashape's 10 m; yaw, pitch, roll start where there is no transform."""
    given = '<reference x="1.5" y="2" z="3" sx="0.1" sy="0.2" sz="0.3" yaw="90" pitch="30" roll="0"/>'
    path = tmp_path / "markers.xml"
    camera = '<camera id="0" sensor_id="0" label="a.jpg">'
    path.write_text(XML.replace(camera, camera + given))
    (row,) = read_foreign(path).data["images"][0]["rows"]
    assert row[2:5] == ["1.5", "2", "3"]
    assert row[8:11] == ["0.1", "0.2", "0.3"]
    assert [float(v) for v in row[11:]] == pytest.approx([10 - 4, 20 + 2, 30 + 6])
    bare = XML.replace(camera, camera + given.replace('sx="0.1" sy="0.2" sz="0.3" ', ""))
    path.write_text(bare.replace("<transform>1 0 0 1 0 -1 0 2 0 0 -1 3 0 0 0 1</transform>", ""))
    document = read_foreign(path)
    (row,) = document.data["images"][0]["rows"]
    assert row[8:11] == ["10.0"] * 3
    assert "positions of 1 image are observed" in " ".join(map(str, document.notes))
    D = rotation_from_angles(np.array([[float(v) for v in row[5:8]]]))[0]
    # heading east, 30° above the nadir: looks down and ahead; image top ahead and up, its right to the south
    np.testing.assert_allclose(-D[2], [0.5, 0, -np.sqrt(0.75)], atol=1e-12)
    np.testing.assert_allclose(D[1], [np.sqrt(0.75), 0, 0.5], atol=1e-12)
    np.testing.assert_allclose(D[0], [0, -1, 0], atol=1e-12)


def test_attitudes_with_an_accuracy_are_observed(tmp_path: Path) -> None:
    """σ of a turn about any axis: ω and κ take it with 1/cos φ; not if switched off, or in a projection."""
    turn = 'yaw="90" pitch="30" roll="0"'  # looks 30° off the nadir to the east: φ = ∓30°
    camera = '<camera id="0" sensor_id="0" label="a.jpg">'
    settings = '<settings><property name="accuracy_cameras_ypr" value="0.5"/>'
    text = XML.replace("<settings>", settings).replace(camera, f'{camera}<reference x="1" y="2" z="3" {turn}/>')
    path = tmp_path / "markers.xml"
    path.write_text(text)
    document = read_foreign(path)
    images = document.data["images"][0]
    found = dict(zip(images["columns"], images["rows"][0], strict=True))
    sigma = np.radians(0.5)
    expected = [sigma / np.cos(np.radians(30.0)), sigma, sigma / np.cos(np.radians(30.0))]
    assert [float(found[f"sigma_{name}"]) for name in ("omega", "phi", "kappa")] == pytest.approx(expected)
    assert abs(float(found["phi"])) == pytest.approx(np.radians(30.0))
    assert "attitudes of 1 image are observed, σ = 0.5° as the file says" in " ".join(map(str, document.notes))
    projected = '<reference>PROJCS["U",GEOGCS["E"]]</reference>'
    local = '<reference>LOCAL_CS["Local Coordinates (m)"]</reference>'
    for other in (
        text.replace(turn, f'{turn} rotation_enabled="false"'),
        text.replace(settings, "<settings>"),
        text.replace(local, projected),
    ):
        path.write_text(other)
        assert "sigma_omega" not in read_foreign(path).data["images"][0]["columns"]


def test_cameras_and_markers_may_have_systems_of_their_own(tmp_path: Path) -> None:
    """Longitude and latitude of cameras are no lengths beside markers in a projection; σ in plan and in height."""
    geographic = 'GEOGCS["E",DATUM["D"]]'
    plane = f'COMPD_CS["U + h",PROJCS["U",{geographic}]]'
    settings = "".join(f'<property name="accuracy_cameras{k}" value="{v}"/>' for k, v in (("_xy", 0.1), ("_z", 0.2)))
    camera = '<camera id="0" sensor_id="0" label="a.jpg">'
    text = XML.replace(camera, f'{camera}<reference x="8.5" y="50" z="3"/>').replace(
        "<settings>", f"<settings>{settings}"
    )
    systems = f"<reference>{plane}</reference><camera_reference>{{}}</camera_reference>"
    local = '<reference>LOCAL_CS["Local Coordinates (m)"]</reference>'
    path = tmp_path / "markers.xml"
    for own, sigma in ((f'COMPD_CS["E + h",{geographic}]', []), (plane, ["0.1", "0.1", "0.2"])):
        path.write_text(text.replace(local, systems.format(own)))
        document = read_foreign(path)
        images = document.data["images"][0]
        found = dict(zip(images["columns"], images["rows"][0], strict=True))
        assert [found[name] for name in ("sigma_x", "sigma_y", "sigma_z") if name in found] == sigma
        notes = " ".join(map(str, document.notes))
        assert ("positions of 1 image are longitude and latitude: not read" in notes) == (not sigma)
        assert document.data["points"][0]["rows"][0][1:4] == ["1", "2", "3"]


def test_longitude_and_latitude_become_east_north_up(tmp_path: Path) -> None:
    """Markers, positions of cameras and poses, whose chunk is geocentric; the truth by proj's topocentric axes."""
    place = "+lat_0=50 +lon_0=8.5 +h_0=100 +ellps=WGS84"
    topocentric = Transformer.from_pipeline(f"+proj=pipeline +step +inv +proj=topocentric {place}")
    geodetic = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
    local = np.array([[0.0, 0.0, 0.0], [40.0, -30.0, 5.0], [1.0, 2.0, 80.0]])
    space = np.stack(topocentric.transform(*local.T), axis=1)
    degrees = np.stack(geodetic.transform(*space.T), axis=1)
    given = [f'<reference x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in degrees.tolist()]
    axes = np.stack(topocentric.transform(*np.eye(3)), axis=1) - space[0]  # rows: east, north, up
    matrix = np.vstack([np.column_stack([axes.T, space[2] - space[0]]), [0, 0, 0, 1]])
    text = re.sub(r'<marker id="0".*?</marker>', f'<marker id="0" label="P1">{given[0]}</marker>', XML)
    text = text.replace('<marker id="1" label="P2"/>', f'<marker id="1" label="P2">{given[1]}</marker>')
    text = text.replace("1 0 0 1 0 -1 0 2 0 0 -1 3 0 0 0 1", " ".join(map(repr, matrix.ravel().tolist())))
    text = text.replace("<transform>1 0", f"{given[2]}<transform>1 0")
    moved = f"<rotation>1 0 0 0 1 0 0 0 1</rotation><translation>{' '.join(map(repr, space[0].tolist()))}</translation>"
    text = re.sub(r"<transform><rotation>.*?</transform>", f"<transform>{moved}</transform>", text)
    path = tmp_path / "markers.xml"
    path.write_text(text.replace('LOCAL_CS["Local Coordinates (m)"]', 'GEOGCS["WGS 84",DATUM["D"]]'))
    document = read_foreign(path)
    assert (
        "coordinates are east, north, up of the reference point: latitude 50, longitude 8.5, altitude 100"
        in " ".join(map(str, document.notes))
    )
    found = {row[0]: [float(v) for v in row[1:4]] for row in document.data["points"][0]["rows"]}
    np.testing.assert_allclose([found["P1"], found["P2"]], local[:2], atol=1e-6)
    (row,) = document.data["images"][0]["rows"]
    np.testing.assert_allclose([float(v) for v in row[2:5]], local[2], atol=1e-6)
    D = rotation_from_angles(np.array([[float(v) for v in row[5:8]]]))[0]
    np.testing.assert_allclose(D, np.diag([1.0, -1.0, -1.0]), atol=1e-9)


CENTRES = np.array([[600010.0, 5000020.0, 180.0], [600040.0, 5000030.0, 185.0]])
"""Projection centres of ``projected``."""


def projected() -> str:
    """A chunk in a system of its own, with four markers in a projection and an image that has no pose."""
    turn = rotation_from_angles(np.array([[0.3, -0.5, 1.1]]))[0]
    flip, scale, f = np.diag([1.0, -1.0, -1.0]), 2.5, 4000.0
    markers = np.array([[0, 0, 0], [60, 5, 3], [10, 50, -2], [55, 60, 4]]) + np.array([6e5, 5e6, 100.0])
    references = "".join(
        f'<marker id="{k}" label="M{k}"><reference x="{x}" y="{y}" z="{z}"/></marker>'
        for k, (x, y, z) in enumerate(markers)
    )
    cameras, seen = "", dict.fromkeys(range(4), "")
    for k, centre in enumerate(CENTRES):
        matrix = np.vstack([np.column_stack([turn.T @ flip, turn.T @ (centre - markers[0]) / scale]), [0, 0, 0, 1]])
        numbers = " ".join(map(repr, matrix.ravel().tolist()))
        cameras += f'<camera id="{k}" sensor_id="0" label="{k}.jpg"><transform>{numbers}</transform></camera>\n'
        for m, marker in enumerate(markers):
            x, y, z = flip.T @ (marker - centre)
            seen[m] += f'<location camera_id="{k}" x="{3000 + f * x / z}" y="{2000 + f * y / z}"/>'
    cameras += '<camera id="2" sensor_id="0" label="2.jpg"/>'
    seen[0] += '<location camera_id="2" x="5" y="6"/>'
    rays = "".join(f'<marker marker_id="{m}">{locations}</marker>\n' for m, locations in seen.items())
    return (
        '<document version="2.0.0"><chunk label="c"><sensors><sensor id="0" type="frame">\n'
        '<property name="fixed" value="true"/><resolution width="6000" height="4000"/>\n'
        f'<calibration type="frame"><resolution width="6000" height="4000"/><f>{f}</f></calibration>\n'
        f"</sensor></sensors><cameras>{cameras}</cameras><markers>{references}</markers>\n"
        f'<frames><frame id="0"><markers>{rays}</markers></frame></frames>\n'
        "<transform><rotation>1 0 0 0 1 0 0 0 1</rotation><translation>4e6 5e5 4e6</translation></transform>\n"
        '<reference>PROJCS["UTM",GEOGCS["E",DATUM["D"]]]</reference></chunk></document>'
    )


def test_poses_are_fitted_to_references_in_a_projection(tmp_path: Path) -> None:
    path = tmp_path / "markers.xml"
    path.write_text(projected())
    document = read_foreign(path)
    assert "the poses are fitted to them as start values" in " ".join(map(str, document.notes))
    rows = [row for row in document.data["images"][0]["rows"] if row[0] != "2.jpg"]
    np.testing.assert_allclose([[float(v) for v in row[2:5]] for row in rows], CENTRES, atol=1e-4)
    solved = solve_network(network_of(document, tmp_path))
    assert solved.quality.sigma0 < 1e-3
    assert [thing.name for thing in solved.network.undeterminable] == ["2.jpg"]


def test_a_chunk_without_projections_has_no_observations(tmp_path: Path) -> None:
    """Observed positions of its cameras alone are nothing to adjust."""
    camera = '<camera id="0" sensor_id="0" label="a.jpg">'
    text = XML.replace(camera, f'{camera}<reference x="1.5" y="2" z="3"/>')
    path = tmp_path / "cameras.xml"
    path.write_text(re.sub(r"<frames>.*</frames>", "", text, flags=re.DOTALL))
    with pytest.raises(InputError) as caught:
        network_of(read_foreign(path), tmp_path)
    assert [message.message.partition(";")[0] for message in caught.value.problems] == ["there are no observations"]


PANE = """# CoordinateSystem: LOCAL_CS["Local Coordinates (m)"]
#Label,X/Easting,Y/Northing,Z/Altitude,Accuracy_X_(m),Accuracy_Y_(m),Accuracy_Z_(m),Error_(m),X_error,Enable
P1,1.5,2,3,0.01,0.02,0.03,0.1,0.05,1
"P, 2",4,5,6,,,,,,0
P3,7,8,,0.01,0.01,,,,1
# Total error,,,
,,,,1
#Markers
P1,1,1,1
"""


def test_markers_of_the_reference_pane(tmp_path: Path) -> None:
    path = tmp_path / "markers.csv"
    path.write_bytes(b"\xef\xbb\xbf" + PANE.replace("\n", "\r\n").encode())
    assert format_of(path) == "metashape-reference"
    document = read_foreign(path)
    assert document.data["points"][0]["rows"] == [
        ["P1", "1.5", "2", "3", "0.01", "0.02", "0.03"],
        ["P, 2", "4", "5", "6", None, None, None],
        ["P3", "7", "8", None, "0.01", "0.01", None],
    ]
    assert document.lines["points", 0, "rows", 2] == 5
    notes = " ".join(map(str, document.notes))
    for words in (
        "switched off",
        "error_(m), x_error",
        "another table begins here",
        "this reader follows the manual",
    ):
        assert words in notes


def test_cameras_of_the_reference_pane_join_a_block(tmp_path: Path) -> None:
    """Decimal commas, one accuracy in two parts, names without their suffix."""
    write = _write(written(tmp_path, block(5, "SIMPLE_RADIAL")))
    lines = ["#Label;X/Easting;Y/Northing;Z/Altitude;Yaw;Pitch;Roll;Accuracy_(m)"]
    lines += [f"{k};{k},5;2,25;8;0;0;0;0,02/0,05" for k in range(1, 7)]
    path = tmp_path / "cameras.csv"
    path.write_text("\n".join([*lines, "gone;1;1;1;0;0;0;1"]))
    whole = read_together([write, path], [])
    (table,) = whole.data["images"]
    rows = [dict(zip(table["columns"], row, strict=True)) for row in table["rows"]]
    keys = ("x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
    assert [rows[0][key] for key in keys] == ["1.5", "2.25", "8", "0.02", "0.02", "0.05"]
    assert "datum" not in whole.data
    notes = " ".join(map(str, whole.notes))
    for words in ("1 image not in", "decimal commas", "computed again"):
        assert words in notes
    network_of(whole, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("1.5,2,3", "1.5,x,3", r"m\.csv:3: found 'x', expected a number"),
        ("P3,", "P1,", r"m\.csv:5: label 'P1' is there twice"),
        ("P1,", ",", r"m\.csv:3: the label is missing"),
        ("0.01,0.02", "-1,0.02", r"m\.csv:3: found the accuracy -1"),
        ("X/Easting,Y/Northing", "X/Longitude,Y/Latitude", r"m\.csv:2: the coordinates are longitude"),
    ],
)
def test_mistakes_of_the_reference_pane(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = tmp_path / "m.csv"
    path.write_text(PANE.replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        read_foreign(path)


def _zipped(text: str, files: dict[str, bytes] | None = None) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.xml", text)
        for name, inside in (files or {}).items():
            archive.writestr(name, inside)
    return content.getvalue()


def _project(folder: Path, kind: str) -> Path:
    """The test's document as a project of Metashape."""
    path = folder / f"hall.{kind}"
    if kind == "psz":
        path.write_bytes(_zipped(XML))
        return path
    start, end = XML.index("<chunk"), XML.index("</chunk>") + len("</chunk>")
    chunk = XML[start:end]
    a, b = chunk.index("<frames"), chunk.index("</frames>") + len("</frames>")
    inside = chunk[a:b]
    frame = inside[inside.index(">", inside.index("<frame ")) + 1 : inside.index("</frame>")]
    files = {
        "hall.psx": b'<document version="1.2.0" path="{projectname}.files/project.zip"/>',
        "hall.files/project.zip": _zipped('<document><chunks><chunk id="0" path="0/chunk.zip"/></chunks></document>'),
        "hall.files/0/chunk.zip": _zipped(
            chunk[:a] + '<frames><frame id="0" path="0/frame.zip"/></frames>' + chunk[b:]
        ),
        "hall.files/0/0/frame.zip": _zipped(f"<frame>{frame}</frame>"),
    }
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return path


@pytest.mark.parametrize("kind", ["psz", "psx"])
def test_projects_are_read_as_their_documents(tmp_path: Path, kind: str) -> None:
    plain = tmp_path / "doc.xml"
    plain.write_text(XML)
    path = _project(tmp_path, kind)
    assert format_of(path) == "metashape"
    found, expected = read_foreign(path), read_foreign(plain)
    assert {**found.data, "title": ""} == {**expected.data, "title": ""}
    assert any("the project has no tie points" in note.message for note in found.notes)


def test_projects_that_are_none_are_told(tmp_path: Path) -> None:
    path = _project(tmp_path, "psx")
    (tmp_path / "hall.files/0/0/frame.zip").write_bytes(b"PK nothing")
    with pytest.raises(InputError, match=r"frame.zip: this archive cannot be read"):
        read_foreign(path)
    (tmp_path / "hall.files/0/0/frame.zip").unlink()
    with pytest.raises(InputError, match=r"frame.zip: this file does not exist"):
        read_foreign(path)
    path.write_text("<document/>")
    with pytest.raises(InputError, match="without path="):
        read_foreign(path)


def test_accuracies_of_markers_in_one_number(tmp_path: Path) -> None:
    path = tmp_path / "m.xml"
    marker = '<reference x="1" y="2" z="3" {} enabled="true"/>'
    rows = {}
    for given in ('sxyz="0"', 'sxy="0.1" sz="0.2"', 'sxyz="0.3" sx="0.1"'):
        found = re.search(r"<reference [^>]*enabled=\"true\"/>", XML)
        assert found is not None
        path.write_text(XML.replace(found[0], marker.format(given)))
        rows[given] = next(
            row[4:7] for row in read_foreign(path).data["points"][0]["rows"] if row[1:4] == ["1", "2", "3"]
        )
    assert list(rows.values()) == [["0"] * 3, ["0.1", "0.1", "0.2"], ["0.1", "0.3", "0.3"]]


_POINT = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("id", "<i4")]
_PROJECTION = [("x", "<f4"), ("y", "<f4"), ("size", "<f4"), ("id", "<u4"), ("z", "<f4"), ("keypoint", "<u8")]
_SAID = {"<f4": "float", "<i4": "int", "<u4": "uint", "<u8": "uint64"}


def _ply(form: list[tuple[str, str]], **columns: object) -> bytes:
    first = np.asarray(next(iter(columns.values())))
    rows = np.zeros(len(first), np.dtype(form))
    for name, values in columns.items():
        rows[name] = values
    said = "".join(f"property {_SAID[type_]} {name}\n" for name, type_ in form)
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n{said}end_header\n"
    return head.encode() + rows.tobytes()


def _cloud(data: dict[str, Any], path: str = "") -> tuple[str, dict[str, bytes]]:
    """The element of a point cloud and its files: point 7 in one image only, a projection of no point."""
    X = np.array([row[1:4] for row in data["points"][0]["rows"]], dtype=float)
    rays = [row for row in data["observations"][0]["rows"] if row[1] != "7" or row[0] == "1"]
    files = {"points0.ply": _ply(_POINT, x=X[:, 0], y=X[:, 1], z=X[:, 2], id=np.arange(1, len(X) + 1))}
    named = '<tracks path="tracks.ply" count="9"/><points path="points0.ply" count="9"/>'
    for k in range(6):
        own = [row for row in rays if row[0] == str(k + 1)]
        x, y = (np.array([float(row[c]) for row in own] + [9.0]) for c in (2, 3))
        files[f"p{k}.ply"] = _ply(_PROJECTION, x=x, y=y, id=[*(int(row[1]) for row in own), 4000])
        named += f'<projections camera_id="{k}" path="p{k}.ply" count="9"/>'
    return named, files


def tied(folder: Path, kind: str, transform: str = "") -> tuple[dict[str, Any], Path]:
    """A block whose points are tie points of a project; the block, the file."""
    data = block(5, "PINHOLE")
    folder.mkdir(exist_ok=True)
    xml = re.sub("<markers.*?</markers>", "", _write(written(folder, data)).read_text(), flags=re.DOTALL)
    xml = xml.replace("</cameras>", f"</cameras>{transform}", 1)
    named, files = _cloud(data)
    path = folder / f"hall.{kind}"
    assert xml.count("</frame>") == 1
    if kind == "psz":
        xml = xml.replace("</frame>", f"<point_cloud>{named}</point_cloud></frame>")
        path.write_bytes(_zipped(xml, files))
        return data, path
    start, a, b = (xml.index(word) for word in ("<chunk", "<frames", "</frames>"))
    end, frame = (
        xml.index("</chunk>"),
        xml[xml.index(">", xml.index("<frame ", a)) + 1 : xml.index("</frame>")],
    )
    archives = {
        "project": _zipped('<document><chunks><chunk id="0" path="0/chunk.zip"/></chunks></document>'),
        "0/chunk": _zipped(xml[start:a] + '<frames><frame id="0" path="0/frame.zip"/>' + xml[b:end] + "</chunk>"),
        "0/0/frame": _zipped(f'<frame>{frame}<point_cloud path="point_cloud/point_cloud.zip"/></frame>'),
        "0/0/point_cloud/point_cloud": _zipped(f'<point_cloud version="1.7.0">{named}</point_cloud>', files),
    }
    path.write_text('<document version="1.2.0" path="{projectname}.files/project.zip"/>')
    for name, content in archives.items():
        place = folder / "hall.files" / f"{name}.zip"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)
    return data, path


@pytest.mark.parametrize("kind", ["psz", "psx"])
@pytest.mark.parametrize("moved", [False, True])
def test_tie_points_of_projects(tmp_path: Path, kind: str, moved: bool) -> None:
    """The block comes back, as far as the 32 bits of its numbers go, in the system of the chunk's transform."""
    turn = "0 -1 0 1 0 0 0 0 1"
    transform = f"<transform><rotation>{turn}</rotation><translation>5 6 7</translation><scale>2</scale></transform>"
    _, path = tied(tmp_path, kind, transform if moved else "")
    assert format_of(path) == "metashape"
    document = read_foreign(path)
    notes = " / ".join(note.message for note in document.notes)
    assert "29 tie points, σ = 1.0 px for their projections" in notes
    assert "7 projections of tie points without coordinates, or in one image only: not read" in notes
    found, expected = (
        network_of(document, tmp_path),
        network_of(read_document(tmp_path / "block.yaml"), tmp_path),
    )
    R, t, s = np.reshape([float(v) for v in turn.split()], (3, 3)), np.array([5.0, 6.0, 7.0]), 2.0
    for ours, theirs in zip(
        [f"tie{k}" for k in range(1, 31) if k != 7], [str(k) for k in range(1, 31) if k != 7], strict=True
    ):
        there, here = (
            network.start["point"][network.things["point"].part(name, "position")]
            for network, name in ((found, ours), (expected, theirs))
        )
        np.testing.assert_allclose(there, s * R @ here + t if moved else here, atol=2e-6)
    (group,) = found.groups
    assert group.mask.all()
    assert len(group.lines) == 29 * 6
    residuals = misclosures(group, found.start)
    assert np.sqrt((residuals**2).mean()) == pytest.approx(0.3, abs=0.05)


def test_tie_points_where_poses_are_worked_out_anew(tmp_path: Path) -> None:
    """References are projected, poses and tie points are not: neither has start values."""
    _, path = tied(tmp_path, "psz", '<reference>PROJCS["grid"]</reference>')
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    xml = files.pop("doc.xml").decode()
    xml = xml.replace("</transform>", '</transform><reference x="1" y="2" z="3" enabled="true"/>', 1)
    path.write_bytes(_zipped(xml, files))
    document = read_foreign(path)
    assert document.frames["tie points"].columns == ["id"]
    assert len(document.frames["projections of tie points"]) == 29 * 6


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b"format binary_little_endian", b"format ascii", "points0.ply: found the format 'ascii'"),
        (
            b"element vertex 30",
            b"element vertex 31",
            r"points0.ply: found \d+ bytes of vertices, expected 31",
        ),
        (b"property int id", b"property int no", "points0.ply: found no property id"),
        (b"property float z", b"property list z", "points0.ply: found a property that is not a plain number"),
        (b"end_header", b"end_headex", "points0.ply: found no head of a PLY file"),
    ],
)
def test_tie_points_with_mistakes_are_told(tmp_path: Path, old: bytes, new: bytes, said: str) -> None:
    data, path = tied(tmp_path, "psz")
    _, files = _cloud(data)
    with zipfile.ZipFile(path) as archive:
        xml = archive.read("doc.xml").decode()
    assert old in files["points0.ply"]
    path.write_bytes(_zipped(xml, {**files, "points0.ply": files["points0.ply"].replace(old, new, 1)}))
    with pytest.raises(InputError, match=said):
        read_foreign(path)
    start = files["points0.ply"].index(b"end_header\n") + len(b"end_header\n")
    content = files["points0.ply"][:start] + b"\x01\x00\xa0\x7f" + files["points0.ply"][start + 4 :]
    path.write_bytes(_zipped(xml, {**files, "points0.ply": content}))
    with pytest.raises(InputError, match="a coordinate of a tie point is not a number"):
        read_foreign(path)
    path.write_bytes(_zipped(xml, {}))
    with pytest.raises(InputError, match=r"found no file 'points0.ply' in this archive"):
        read_foreign(path)


def test_a_bad_number_of_a_marker_is_told(tmp_path: Path) -> None:
    path = tmp_path / "m.xml"
    path.write_text(XML.replace('sy="0.01"', 'sy="0.SF=01"'))
    with pytest.raises(InputError, match=r"found '0\.SF=01', expected a number"):
        read_foreign(path)


def test_markers_that_other_sensors_of_a_rig_measure_alone(tmp_path: Path) -> None:
    """Two of three projections are in an image of the second sensor: the other one orients no image."""
    rig = XML.replace('<camera id="1"', '<camera id="1" master_id="0"').replace(
        '<location camera_id="2" x="1" y="1"/></marker>',
        '<location camera_id="1" x="1" y="1"/><location camera_id="2" x="1" y="1"/></marker>'
        '<marker marker_id="1"><location camera_id="1" x="7" y="9"/><location camera_id="9" x="7" y="9"/></marker>',
    )
    path = tmp_path / "markers.xml"
    path.write_text(rig)
    words = "none can be oriented; 2 projections are in images of the other sensors of a rig, which are not read"
    with pytest.raises(InputError, match=words):
        read_foreign(path)
    known = '<camera id="0" sensor_id="0" label="a.jpg"><reference x="1" y="2" z="3"/>'
    path.write_text(rig.replace('<camera id="0" sensor_id="0" label="a.jpg">', known))
    notes = " ".join(map(str, read_foreign(path).notes))
    for count, why in (
        ("2 projections", "in images of the other sensors of a rig"),
        ("1 projection", "in images switched off or without a sensor"),
        ("1 projection", "of markers or images that are not there"),
    ):
        assert f"{count} {why}: not read" in notes
