"""STAR*NET input: every code, options, a network that comes out as it was, mistakes."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from pyproj import Transformer

import mor
from mor.errors import InputError
from mor.formats import format_of, read_foreign
from mor.formats.starnet import degrees
from mor.project.document import Document
from tests.reference_data import network_of
from tests.scenarios.small_projects import mor as run

PLACES = {
    "1": (1000.0, 500.0, 100.0),
    "2": (1080.0, 520.0, 103.0),
    "3": (1050.0, 590.0, 98.0),
    "4": (990.0, 570.0, 101.0),
}


def _dms(angle: float) -> str:
    seconds = round(angle % 360.0 * 3600.0, 4)
    return f"{int(seconds // 3600)}-{int(seconds % 3600 // 60):02d}-{seconds % 60:07.4f}"


def _between(a: str, b: str, own: float = 0.0, target: float = 0.0) -> tuple[float, float, float]:
    """Bearing and zenith angle (degrees), slope distance."""
    dx, dy, dz = np.array(PLACES[b]) - PLACES[a] + [0.0, 0.0, target - own]
    zenith = np.degrees(np.arctan2(np.hypot(dx, dy), dz))
    return float(np.degrees(np.arctan2(dx, dy))), float(zenith), float(np.sqrt(dx * dx + dy * dy + dz * dz))


def _measured(at: str, back: str, to: str) -> str:
    angle = _between(at, to)[0] - _between(at, back)[0]
    _, zenith, slope = _between(at, to, 1.5, 1.3)
    return f"{_dms(angle)} {slope:.5f} {_dms(zenith)}"


def _space() -> str:
    """A network in space by every kind of line; coordinates are north, east."""
    x, y, z = zip(*(PLACES[k] for k in "1234"), strict=True)
    _, zenith, slope = _between("2", "4", 1.6, 1.2)
    lines = [
        "# a comment", ".UNITS METERS DMS", ".ORDER NE ATFROMTO", ".3D", "'a description",
        f"C 1 {y[0]} {x[0]} {z[0]} ! ! !", f"C 2 {y[1]} {x[1]} {z[1]} 0.002 0.002 0.003 'pillar",
        f"C 3 {y[2]} {x[2]} {z[2]} * * *",
        f"B 1-2 {_dms(_between('1', '2')[0])} 2",
        f"M 1-2-3 {_measured('1', '2', '3')} 3 0.002 5 1.5/1.3",
        f"M 2-1-3 {_measured('2', '1', '3')} & & & 1.5/1.3",
        f"DV 2-4 {slope:.5f} {_dms(zenith)} 0.002 &",
        "    & 1.6/1.2",
        f"V 3-4 {_dms(_between('3', '4')[1])} !",
        f"D 3-4 {_between('3', '4')[2]:.5f}",
        "D 1-4 999.0 *",
        f"A 1-2-4 {_dms(_between('1', '4')[0] - _between('1', '2')[0])} 3",
        f"L 1-3 {z[2] - z[0]} 250",
        f"L 3-4 {z[3] - z[2]} & 0.001",
        "DB 3", *(f"DN {k} {_dms(_between('3', k)[0] + 17)} 3" for k in "124"), "DE",
        "TB 1", f"T 2 {_measured('2', '1', '3')} & & & 1.5/1.3",
        f"T 3 {_measured('3', '2', '4')} & & & 1.5/1.3", "TE 4",
        ".REFRACTION 0.07", "G1 1-2 1 2 3",
    ]  # fmt: skip
    return "\r\n".join(lines)


def test_a_network_in_space_comes_out_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "net.dat"
    path.write_text(_space(), newline="")
    assert format_of(path) == "starnet"
    result = mor.adjust(str(path))
    network, solved = result.project.network, result.solved
    assert sum(len(table["rows"]) for table in result.project.document.data["observations"]) == 23
    assert not result.observations.frame["flag"].str.contains("gross|excluded").any()
    for name, place in PLACES.items():
        ours = solved.adjustment.values["point"][network.things["point"].part(name, "position")]
        np.testing.assert_allclose(ours, place, rtol=0, atol=2e-4)
    notes = " ".join(result.project.notes)
    for words in (
        "free observations (*)",
        ".REFRACTION",
        "vectors (G1)",
        "without σ",
    ):
        assert words in notes


def test_a_plane_network_in_feet_and_gons(tmp_path: Path) -> None:
    path = tmp_path / "net.dat"
    path.write_text(
        ".UNITS FEET GONS\n.ORDER EN FROMATTO\nC A 0 0 ! !\nC B 1000 0 ! !\nC P 500 500\n"
        "A B-A-P 350 10\nD A-P 707.1068 0.01\nD B-P 707.1068\nTB N50.0E\n"
    )
    document = read_foreign(path)
    data = document.data
    assert data["settings"]["dimensions"] == "xy"
    assert data["points"][0]["rows"][1][:3] == ["B", "304.8", "0.0"]
    angle, distance = data["observations"]
    assert angle["rows"][0][:3] == ["A", "B", "P"]
    assert float(angle["rows"][0][3]) == pytest.approx(315.0)
    assert float(angle["rows"][0][4]) == pytest.approx(10 * 9e-5)
    assert distance["type"] == "horizontal_distance"
    network_of(document, tmp_path)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("44-15-35.5", 44.259861111),
        ("44.15355", 44.259861111),
        ("N45-30-00W", 314.5),
        ("S10-00E", 170.0),
        ("12@30", 12.5),
    ],
)
def test_angles(text: str, value: float) -> None:
    assert degrees(text) == pytest.approx(value)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("D 1-2 x", r"net\.dat:3: D: found 'x', expected a number"),
        ("D 1 10", r"net\.dat:3: D: found '1', expected 2 names with - between them"),
        ("A 1-2-3 45-61-00", "A: found '45-61-00', expected less than 60"),
        ("M 1-2-3 45-00-00 10", "M: found 3 words, expected at-from-to"),
        ("DN 1 45-00-00", "DN: expected DB with the station"),
        ("D 1-2 10 -0.1", "D: found the σ -0.1"),
        ("XX 1", "XX: unknown code"),
        ("C 5 10", "C: found 2 words"),
    ],
)
def test_mistakes_have_their_line(tmp_path: Path, line: str, words: str) -> None:
    path = tmp_path / "net.dat"
    path.write_text(f"C 1 0 0 0 ! ! !\nV 1-2 90-00-00\n{line}\n")
    with pytest.raises(InputError, match=words):
        read_foreign(path, "starnet")


GIVEN = {"A": (-122.5, 48.5, 100.0), "B": (-122.498, 48.502, 120.0), "C": (-122.501, 48.501, 90.0)}
"""Longitude, latitude and height."""
GEOCENTRIC = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)


def _vectors(*pairs: str, weights: str = "G2 1e-6 2e-6 3e-6\nG3 1e-7 2e-7 -3e-7") -> str:
    places = {name: np.array(GEOCENTRIC.transform(*place)) for name, place in GIVEN.items()}
    lines = []
    for pair in pairs:
        one, other = pair.split("-")
        dx, dy, dz = places[other] - places[one]
        lines.append(f"G0 'session 1\nG1 {pair} {dx:.4f} {dy:.4f} {dz:.4f} --rover\n{weights}")
    return "\n".join(lines) + "\n"


def _on_earth() -> str:
    """Vectors between points of every kind, and an angle."""
    x, y, z = GEOCENTRIC.transform(*GIVEN["C"])
    held = f"PH A 48-30-00.0 W122-30-00.0 100.0 0.01 0.02 0.03\nC C {x} {y} {z} 0.1 0.1 0.2 --MON\n"
    return held + ".GPS FACTOR 2 VERT 3\nA A-B-C 10-00-00 5\n" + _vectors("A-B", "B-C")


@pytest.mark.parametrize(
    "held",
    [
        "PH A 48-30-00.0 -122-30-00.0 100.0 ! ! !",
        "P A N48-30-00.0 W122-30-00.0 100.0 ! ! ! 'monument",
        ".LONG POS\nP A 48-30-00.0 122-30-00.0 100.0 ! ! !",
        "C A {:.4f} {:.4f} {:.4f} ! ! ! --MON",
    ],
)
def test_gnss_vectors_from_a_point_on_the_earth(tmp_path: Path, held: str) -> None:
    """B and C are where pyproj has them, whatever form the position of A has."""
    path = tmp_path / "gps.dat"
    path.write_text(held.format(*GEOCENTRIC.transform(*GIVEN["A"])) + "\n" + _vectors("A-B", "B-C", "C-A"))
    assert format_of(path) == "starnet"
    assert run("adjust", path, "-o", tmp_path / "out", "--no-html").code == 0
    with (tmp_path / "out" / "places.csv").open(newline="") as file:
        places = {row["id"]: row for row in csv.DictReader(file)}
    for name in "BC":
        found = [float(places[name][axis]) for axis in "xyz"]
        assert found == pytest.approx(GEOCENTRIC.transform(*GIVEN[name]), abs=3e-4)


def test_weights_of_gnss_vectors(tmp_path: Path) -> None:
    """σ with correlations; factors of σ in the horizon of the point, which is that of the equator here."""
    path = tmp_path / "gps.dat"
    weights = "G2 0.001 0.002 0.003\nG3 0.5 0.0 -0.2"
    held = "PH A 0-00-00.0 0-00-00.0 0.0 ! ! !\n.GPS WEIGHT STDERRCORRELATIONS\n.GPS FACTOR 2 VERT 3\n"
    path.write_text(held + _vectors("A-B", weights=weights))
    (vectors,) = read_foreign(path, "starnet").data["observations"]
    # x is up there, y east and z north.
    expected = np.array([[9e-6, 6e-6, 0.0], [6e-6, 16e-6, -4.8e-6], [0.0, -4.8e-6, 36e-6]])
    np.testing.assert_allclose(vectors["covariance"], expected, atol=1e-15)


def test_observed_positions_on_the_earth(tmp_path: Path) -> None:
    path = tmp_path / "gps.dat"
    x, y, z = GEOCENTRIC.transform(*GIVEN["C"])
    observed = f"PH A 48-30-00.0 -122-30-00.0 100.0 0.01 0.02 0.03\nC C {x} {y} {z} 0.1 0.1 0.2\n"
    path.write_text(observed + "B A-B 10-00-00 5\n" + _vectors("A-B", "B-C"))
    document = read_foreign(path)
    (points,) = document.data["points"]
    row = dict(zip(points["columns"], points["rows"][0], strict=True))
    assert [row[f"sigma_{name}"] for name in ("north", "east", "up")] == ["0.01", "0.02", "0.03"]
    positions, vectors = document.data["observations"]
    assert (positions["type"], vectors["type"]) == ("gnss_position", "gnss_vector")
    assert [float(value) for value in positions["rows"][0][1:]] == pytest.approx([x, y, z, 0.1, 0.1, 0.2])
    assert "B, BM: bearings in an unknown projection (1 line)" in " ".join(map(str, document.notes))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (_vectors("A-B"), "GNSS vectors need a point with geocentric"),
        ("PH A 48-30-00 -122-30-00 100 ! ! !\nG1 A-B 1 2 3\n", "G1: vector A-B has no G2"),
        ("PH A 48-30-00 -122-30-00\n" + _vectors("A-B"), "P: point A has no height"),
        ("G2 1 2 3\n" + _vectors("A-B"), "G2: expected G1 before it"),
    ],
)
def test_mistakes_of_gnss_vectors(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "gps.dat"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_foreign(path, "starnet")


def test_vectors_between_points_in_a_projection_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "n.dat"
    path.write_text(_space() + "\n" + _vectors("A-B"))
    document = read_foreign(path)
    assert "vector" not in " ".join(table["type"] for table in document.data["observations"])
    assert "the projection of the other points is unknown (" in " ".join(map(str, document.notes))


@pytest.mark.parametrize(("order", "names"), [("ATFROMTO", "1-2-2"), ("FROMATTO", "2-1-2")])
def test_an_angle_to_the_backsight_itself_says_nothing(tmp_path: Path, order: str, names: str) -> None:
    """The distance and the zenith angle behind it count."""
    path = tmp_path / "n.dat"
    path.write_text(f"{_space()}\n.ORDER NE {order}\nM {names} 0-00-00 82.5 88-00-00 4 0.01 20\n")
    before = _rows_of(read_foreign(_written(tmp_path / "m.dat", _space())))
    after = _rows_of(document := read_foreign(path))
    assert {kind: after[kind] - before[kind] for kind in after if after[kind] != before[kind]} == {
        "distance": 1,
        "zenith_angle": 1,
    }
    assert "angles of M from a backsight to itself (1 line)" in " ".join(map(str, document.notes))


def test_two_coordinates_leave_the_elevation_of_a_point(tmp_path: Path) -> None:
    text = "E A 10.0 !\nC A 5 6\nE B 12.0\nL A-B 2.0 0.3\nL B-A -2.01 0.3\n"
    (table,) = read_foreign(_written(tmp_path / "n.dat", text)).data["points"][:1]
    row = dict(zip(table["columns"], table["rows"][0], strict=True))
    assert (row["id"], float(row["z"])) == ("A", 10.0)
    assert mor.adjust(str(tmp_path / "n.dat")).points["z"][1] == pytest.approx(12.005)


def test_lines_m_of_a_plane_network_may_have_two_sigmas(tmp_path: Path) -> None:
    text = "C 1 0 0 ! !\nC 2 0 50 ! !\nM 1-2-3 90-00-00 40.0\nM 2-1-3 321-20-25 64.03 4.0 .03\n"
    assert _rows_of(read_foreign(_written(tmp_path / "n.dat", text))) == {"angle": 2, "horizontal_distance": 2}


def _written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def _rows_of(document: Document) -> dict[str, int]:
    return {table["type"]: len(table["rows"]) for table in document.data["observations"]}


PROJECT = """*STAR*NET 3
#
[Adjustment]
adjustment_type                2D
linear_units                   Meters
coordinate_order               EN
angle_station_order            From-At-To
local_or_grid_adjustment       0
index_of_refraction            0.0700000000
[Instrument]
distance_std_err               0.0030000000
edm_ppm                        2.0000000000
angle_std_err                  5.0000000000
instrument_centering_error     0.0010000000
target_centering_error         0.0020000000
vertical_centering_error       0.0005000000
level_std_err                  0.000031622776602
[InstrumentLibrary]
instrument_name                S9
distance_std_err               0.0010000000
angle_std_err                  1.5000000000
[DataFileList]
3 "one.dat"
2 "off.dat"
1 "sub\\two.dat"
"""


def _project(folder: Path, text: str, **files: str) -> Path:
    (folder / "sub").mkdir(exist_ok=True)
    for name, content in files.items():
        (folder / ("sub/two.dat" if name == "two" else f"{name}.dat")).write_text(content)
    (folder / "p.snproj").write_text(text)
    return folder / "p.snproj"


def test_a_project_file_gives_instruments_options_and_data_files(tmp_path: Path) -> None:
    """σ = a + b s; centring adds to σ of the instrument; every data file begins with the options of the project."""
    one = "C 1 0 0 !!\nC 2 1000 0 ! !\nD 1-2 1000\nD 1-3 500 0.004\n.INST s9\n.ORDER ATFROMTO\nD 1-3 500\nA 1-2-3 80\n"
    path = _project(tmp_path, PROJECT, one=one, two="A 2-1-3 80\nD 2-3 600 *\n", off="nonsense\n")
    assert format_of(path) == "starnet"
    document = read_foreign(path)
    tables = document.data["observations"]
    assert [(table["type"], [row[:2] for row in table["rows"]]) for table in tables] == [
        ("horizontal_distance", [["1", "2"]]),
        ("horizontal_distance", [["1", "3"], ["1", "3"]]),
        ("angle", [["1", "2"]]),
        ("angle", [["1", "2"]]),
    ]
    assert [float(row[3]) for table in tables[:2] for row in table["rows"]] == [0.005, 0.004, 0.001]
    assert [float(table["rows"][0][4]) * 3600.0 for table in tables[2:]] == pytest.approx([1.5, 5.0])
    centring = {"instrument": "0.001 m", "target": "0.002 m"}
    assert [table.get("centring") for table in tables] == [centring, None, None, centring]
    assert document.data["points"][0]["rows"][0][1:] == ["0.0", "0.0", "0", "0"]
    assert not [note for note in document.notes if "without σ" in note.message]
    grid = PROJECT.replace("grid_adjustment       0", "grid_adjustment 1\ncoordinate_system_name OR83-NF")
    with pytest.raises(InputError, match="found the coordinate system 'OR83-NF', expected a zone of UTM83"):
        read_foreign(_project(tmp_path, grid))
    with pytest.raises(InputError, match="no data files that are switched on"):
        read_foreign(_project(tmp_path, PROJECT.replace('3 "', '2 "').replace('1 "', '0 "')))


def test_a_project_in_a_grid_is_on_the_earth(tmp_path: Path) -> None:
    """A vector, a level, a grid bearing and a zenith angle from a fixed point lead to the place they come from."""
    grid = Transformer.from_crs("EPSG:26919", "EPSG:4955", always_xy=True)
    to_xyz = Transformer.from_crs("EPSG:4955", "EPSG:4954", always_xy=True)
    places = np.array([[680000.0, 5090000.0, 100.0], [680400.0, 5090300.0, 130.0], [680300.0, 5089600.0, 90.0]])
    geodetic = np.stack([*grid.transform(*places.T[:2]), places[:, 2] - 25.0], axis=1)
    a, b, c = np.stack(to_xyz.transform(*geodetic.T), axis=1)
    axes = np.radians(geodetic[0, 1]), np.radians(geodetic[0, 0])
    up = np.array([np.cos(axes[0]) * np.cos(axes[1]), np.cos(axes[0]) * np.sin(axes[1]), np.sin(axes[0])])
    s = float(np.linalg.norm(c - a))
    k = 0.14 * s / (2.0 * 6371000.0)
    zenith = float(np.degrees(np.arccos((c - a) @ up / s) - k))
    bearing = float(np.degrees(np.arctan2(*(places[2] - places[0])[:2])) % 360.0)
    dx, dy, dz = (b - a).tolist()
    text = PROJECT.replace("adjustment_type                2D", "adjustment_type 3D\ngeoid_height -25").replace(
        "local_or_grid_adjustment       0", "local_or_grid_adjustment 1\ncoordinate_system_name UTM83/CSRS-19N"
    )
    data = (
        "C A 680000 5090000 100 ! ! !\n.GPS WEIGHT COVARIANCE\nG0 'one\n"
        f"G1 A-B {dx!r} {dy!r} {dz!r}\nG2 1e-6 1e-6 1e-6\nG3 0 0 0\nL A-B 30 1000\n"
        f"B A-C {_dms(bearing)}\nDV A-C {s!r} {_dms(zenith)}\n"
    )
    path = _project(tmp_path, text.replace('1 "sub', '0 "sub'), one=data)
    document = read_foreign(path)
    assert document.data["world"] == {"crs": "EPSG:26919", "heights": "orthometric"}
    level = next(table for table in document.data["observations"] if table["type"] == "height_difference")
    assert float(level["rows"][0][3]) == pytest.approx(0.001)
    run("adjust", str(path), "-o", str(tmp_path / "r"))
    with (tmp_path / "r/places.csv").open() as stream:
        found = {row["id"]: row for row in csv.DictReader(stream)}
    for name, place in zip("ABC", places, strict=True):
        own = [float(found[name][key]) for key in ("east", "north", "orthometric_height")]
        np.testing.assert_allclose(own, place, atol=2e-4)


def test_a_side_shot_has_no_influence_on_a_point_with_other_observations(tmp_path: Path) -> None:
    text = (
        "C 1 0 0 ! !\nC 2 1000 0 ! !\nC 3 500 500\nSS 1-2-3 44-00-00 700\nSS 1-2-4 10-00-00 90\nSS 2-1-4 9-00-00 90\n"
    )
    text += "D 1-3 707.1\nA 1-2-3 45-00-00\n"
    document = read_foreign(_written(tmp_path / "n.dat", text))
    assert _rows_of(document) == {"horizontal_distance": 2, "angle": 2}
    assert "side shots (SS) to points that have other observations (2 lines)" in " ".join(map(str, document.notes))


@pytest.mark.parametrize(
    ("line", "words"),
    [("D 1-2 100 0.01.5/1.2", "D: found '0.01.5/1.2', expected a number"), ("D 1-2", "D: found no measured values")],
)
def test_wrong_words_have_their_line(tmp_path: Path, line: str, words: str) -> None:
    with pytest.raises(InputError, match=r"n\.dat:3: " + words):
        read_foreign(_written(tmp_path / "n.dat", f"C 1 0 0 !!\nC 2 100 0 **\n{line}\nA 1-2-3 50\nC 3 1 1\n"))


def test_unknown_units_of_a_project_are_named(tmp_path: Path) -> None:
    path = _written(tmp_path / "n.snproj", PROJECT.replace("Meters", "Yards"))
    with pytest.raises(InputError, match="found the linear units 'Yards', expected one of METERS, FEET"):
        read_foreign(path)


def test_sights_in_face_two_are_read_as_in_face_one(tmp_path: Path) -> None:
    text = (
        ".3D\nC 1 0 0 0 !!!\nC 2 0 100 0 !!!\nDB 1\nDM 2 10 100 90\nDM 2 190 100 270\nDM 3 235 50 280\nDE\nV 2-3 280\n"
    )
    tables = {
        table["type"]: table["rows"] for table in read_foreign(_written(tmp_path / "n.dat", text)).data["observations"]
    }
    assert [float(row[2]) for row in tables["directions"]] == [10.0, 10.0, 55.0]
    assert [float(row[2]) for row in tables["zenith_angle"]] == [90.0, 90.0, 80.0, 80.0]


def test_a_known_height_in_a_grid_is_observed(tmp_path: Path) -> None:
    grid = "local_or_grid_adjustment 1\ncoordinate_system_name UTM83-19"
    text = PROJECT.replace("adjustment_type                2D", "adjustment_type 3D")
    text = text.replace("local_or_grid_adjustment       0", grid).replace('1 "sub', '0 "sub')
    data = "C 1 680000 5090000 100 !!!\nE 2 99.5 !\nE 3 98 0.02\nE 4 97\nDV 1-2 30 90\n"
    document = read_foreign(_project(tmp_path, text, one=data))
    tables = {table["type"]: table["rows"] for table in document.data["observations"]}
    assert tables["orthometric_height"] == [["2", "99.5", "1e-05"], ["3", "98.0", "0.02"]]
    with pytest.raises(InputError, match=r"one\.dat:2: E: found 'x', expected a number"):
        read_foreign(_project(tmp_path, text, one=data.replace("99.5", "x")))
    assert {Path(file).name for file in document.files.values()} == {"one.dat"}


def _polar(at: str, back: str, to: str, plane: bool = False) -> str:
    (turned, zenith, slope), (zero, *_) = _between(at, to), _between(at, back)
    flat = f"{slope * np.sin(np.radians(zenith)):.5f}"
    return f"M {at}-{back}-{to} {_dms(turned - zero)} " + (flat if plane else f"{slope:.5f} {_dms(zenith)}")


MIXED = (
    *(f"C {name} {PLACES[name][0]} {PLACES[name][1]} {PLACES[name][2]} ! ! !" for name in "12"),
    *(_polar(at, back, "3") for at, back in ("12", "21")),
    ".2D",
    *(_polar(at, back, "4", plane=True) for at, back in ("12", "32")),
    ".3REDUCE",
    _polar("2", "1", "4"),
    "D 1-4 100.0",
)
"""A network in space; 4 is observed in the plane alone."""


def test_lines_in_the_plane_do_not_flatten_those_before(tmp_path: Path) -> None:
    """``.2D`` and ``.3REDUCE`` hold for the lines behind them (STAR*NET V6, chapter 5, inline options)."""
    path = tmp_path / "m.dat"
    path.write_text(".ORDER EN\n" + "\n".join(MIXED) + "\n")
    notes = " ".join(map(str, read_foreign(path).notes))
    for words in (
        "1 point without an observation of the height: their heights are held",
        "zenith angles and height differences in the plane (1 line)",
        "distances along the slope without a zenith angle in the plane (1 line)",
    ):
        assert words in notes
    assert run("adjust", path, "-o", tmp_path / "out", "--no-html").code == 0
    with (tmp_path / "out" / "points.csv").open(newline="") as file:
        found = {row["id"]: [float(row[axis]) for axis in "xyz"] for row in csv.DictReader(file)}
    np.testing.assert_allclose(found["3"], PLACES["3"], atol=1e-4)
    np.testing.assert_allclose(found["4"], [*PLACES["4"][:2], 0.0], atol=1e-4)


def test_lines_in_space_are_reduced_in_a_project_in_the_plane(tmp_path: Path) -> None:
    fixed = (f"C {name} {PLACES[name][0]} {PLACES[name][1]} ! !" for name in "12")
    data = "\n".join([*fixed, ".3D", ".ORDER ATFROMTO", *MIXED[2:4]])
    path = _project(tmp_path, PROJECT.replace('3 "one.dat"\n', ""), two=data)
    assert run("adjust", path, "-o", tmp_path / "out", "--no-html").code == 0
    with (tmp_path / "out" / "points.csv").open(newline="") as file:
        found = {row["id"]: [float(row[axis]) for axis in "xy"] for row in csv.DictReader(file)}
    np.testing.assert_allclose(found["3"], PLACES["3"][:2], atol=1e-4)
