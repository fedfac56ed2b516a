"""Field books as instruments and people write them: small mistakes, presets, copies, stations that hang loose."""

from __future__ import annotations

from math import atan2, hypot, pi
from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import solve_network
from mor.errors import InputError
from mor.formats import format_of, read_foreign
from mor.formats.combination import combined
from mor.project.document import Document
from mor.quality.assessment import median_distance
from mor.quality.determinability import HANGS_ON, ONE_TIE
from tests.reference_data import network_of

PLACES = {
    "S1": (0.0, 0.0, 10.0),
    "S2": (80.0, 10.0, 12.0),
    "S3": (150.0, 60.0, 11.0),
    "P": (40.0, 50.0, 9.0),
    "Q": (30.0, -40.0, 13.0),
    "R": (110.0, 70.0, 14.0),
    "T": (190.0, 20.0, 8.0),
}


def _read(tmp_path: Path, name: str, text: str) -> Document:
    (tmp_path / name).write_text(text)
    return read_foreign(tmp_path / name)


def _rows(document: Document, type_: str) -> list[dict[str, str]]:
    return [
        dict(zip(table["columns"], row, strict=True))
        for table in document.data.get("observations", [])
        if table["type"] == type_
        for row in table["rows"]
    ]


def _points(document: Document) -> list[tuple[list[str], list[list[str]]]]:
    return [(table["columns"], table["rows"]) for table in document.data["points"]]


def _notes(document: Document) -> str:
    return " ".join(map(str, document.notes))


def _gsi(station: str, *targets: str, place: tuple[float, ...] = (), turn: float = 0.0) -> str:
    """A station with an instrument height of 1.5 m and its sights in gon, targets 1.5 m high."""
    words = [f"{index}..10{round(value * 1e3):+09d}" for index, value in zip((84, 85, 86), place, strict=False)]
    lines = [f"110001+{station:0>8} {' '.join(words)} 88..10+00001500"]
    for target in targets:
        east, north, up = np.subtract(PLACES[target], PLACES[station])
        circle = (atan2(east, north) * 200 / pi + turn) % 400
        zenith = atan2(hypot(east, north), up) * 200 / pi
        slope = hypot(east, north, up)
        lines.append(
            f"110002+{target:0>8} 21.322+{round(circle * 1e5):08d} 22.322+{round(zenith * 1e5):08d} "
            f"31..00+{round(slope * 1e3):08d} 87..10+00001500"
        )
    return "\n".join(lines) + "\n"


def test_words_of_gsi_without_a_unit_with_a_point_and_names_with_blanks(tmp_path: Path) -> None:
    text = (
        "*110001+000000000000000A 84..10+0000000000100000 85..10+0000000000200000 86..+0000000000010000 "
        "88..10+0000000000001500\n*110002+00000000000P (1) 21.324+00000001160515.70 22.324+0000000008959600 "
        "31..06+000000000004670.2 87..10+0000000000001500\n"
    )
    document = _read(tmp_path, "a.gsi", text)
    (columns, rows), _ = _points(document)
    assert dict(zip(columns, rows[0], strict=True)) == {"id": "A", "x": "100.0", "y": "200.0", "z": "10.0"}
    (row,) = _rows(document, "zenith_directions")
    assert row["to"] == "P (1)"
    assert float(row["horizontal"]) == pytest.approx(116 + 5 / 60 + 15.7 / 3600)
    assert float(row["zenith"]) == pytest.approx(90.0), "89°59'60.0\""
    assert float(_rows(document, "distance")[0]["distance"]) == pytest.approx(4.6702)


def test_coordinates_that_stations_share_are_presets(tmp_path: Path) -> None:
    preset = (1000.0, 5000.0, 200.0)
    text = _gsi("S1", "P", "Q", place=preset) + _gsi("S2", "P", "Q", place=preset, turn=30)
    document = _read(tmp_path, "a.gsi", text)
    assert "not read: coordinates that an instrument presets" in _notes(document)
    assert document.data["datum"] == "free"
    assert solve_network(network_of(document, tmp_path)).quality.sigma0 < 1.5


def test_whole_metres_far_from_others_are_presets(tmp_path: Path) -> None:
    real = "110009+000000S2 81..10+64280000 82..10+53410000 83..10+00012000\n"
    text = _gsi("S1", "P", "Q", "S2", place=(1003.0, 5000.0, 200.0)) + _gsi("S2", "P", "Q", turn=30)
    for control, kept in (("", ["S1"]), (real.replace("+64280000", "+642800008"), ["S2"])):
        document = _read(tmp_path, "a.gsi", control + text)
        assert [row[0] for row in _points(document)[0][1]] == kept


def test_heights_of_given_points_that_are_all_0_are_none(tmp_path: Path) -> None:
    given = (
        "110009+0000000P 81..10+00040000 82..10+00050000 83..10+00000000\n"
        "110009+000000S2 81..10+00080000 82..10+00010000 83..10+00000000\n"
    )
    document = _read(tmp_path, "a.gsi", given + _gsi("S1", "P", "Q", "S2") + _gsi("S2", "P", "Q", "S1"))
    assert "not read: heights of given points that are all 0" in _notes(document)
    assert document.data["datum"] == "free", "nothing tells the height of the network"
    solved = solve_network(network_of(document, tmp_path))
    points = solved.network.things["point"]
    heights = {name: solved.adjustment.values["point"][points.part(name, "position")][2] for name in points.ids}
    assert heights["Q"] - heights["P"] == pytest.approx(4.0, abs=2e-3)
    assert solved.quality.sigma0 < 1.5


def test_one_station_with_an_azimuth_has_a_datum(tmp_path: Path) -> None:
    text = (
        "MO,AD0,UN1,SF1.0,EC0,EO0.0,AU0\nOC,OP1,N 200.0,E 100.0,EL10.0\nLS,HI1.5,HR1.5\n"
        "BK,OP1,BP2,BS90.0000,BC0.0000\nSS,OP1,FP3,AR0.0000,ZE90.0000,SD20.0\n"
    )
    document = _read(tmp_path, "a.rw5", text)
    assert "datum" not in document.data
    solved = solve_network(network_of(document, tmp_path))
    place = solved.adjustment.values["point"][solved.network.things["point"].part("3", "position")]
    assert place == pytest.approx([120.0, 200.0, 10.0], abs=1e-3)


def test_points_alone_are_not_adjusted(tmp_path: Path) -> None:
    document = _read(tmp_path, "a.are", "5=A\n37=100.0\n38=200.0\n5=B\n37=130.0\n38=200.0\n")
    with pytest.raises(InputError, match="there are no observations, only points"):
        network_of(document, tmp_path)


def test_circles_of_rw5_are_azimuths_where_nothing_else_tells_the_direction(tmp_path: Path) -> None:
    """Station 1 sights no known point, station 2 does; BS is the azimuth of the backsight where the circle reads BC."""
    text = (
        "MO,AD0,UN1,SF1.0,EC0,EO0.0,AU0\nOC,OP1,N 100.0,E 50.0,EL10.0\nLS,HI1.5,HR1.5\n"
        "BK,OP1,BP9,BS30.0000,BC10.0000\nSS,OP1,FP3,AR70.0000,ZE90.0000,SD20.0\n"
        "SS,OP1,FP4,AR250.0000,ZE270.0000,SD10.0\nOC,OP2,N 0.0,E 50.0,EL10.0\n"
        "BK,OP2,BP1,BS0.0000,BC5.0000\nSS,OP2,FP1,AR5.0000,ZE90.0000,SD100.0\nSS,OP2,FP5,AR95.0000,ZE90.0000,SD30.0\n"
    )
    document = _read(tmp_path, "a.rw5", text)
    bearings = [(row["from"], row["to"], float(row["bearing"])) for row in _rows(document, "bearing")]
    assert bearings == [("1", "9", 30.0), ("1", "3", 90.0), ("1", "4", 90.0)]
    solved = solve_network(network_of(document, tmp_path))
    values = dict(zip(solved.network.blocks["point"].ids, solved.adjustment.values["point"], strict=True))
    np.testing.assert_allclose(values["3"][:2], (70.0, 100.0), atol=0.01)
    np.testing.assert_allclose(values["4"][:2], (60.0, 100.0), atol=0.01)
    np.testing.assert_allclose(values["5"][:2], (80.0, 0.0), atol=0.01)


def test_a_station_at_computed_coordinates_is_computed(tmp_path: Path) -> None:
    """Instruments offer the coordinates of the last sight for the next station."""
    east, north, up = PLACES["P"]
    words = f" 81..10{round(east * 1e3):+09d} 82..10{round(north * 1e3):+09d} 83..10{round(up * 1e3):+09d}"
    first = _gsi("S1", "Q", "R", "P", place=PLACES["S1"]).rstrip() + words
    document = _read(tmp_path, "a.gsi", f"{first}\n" + _gsi("S3", "Q", "R", "P", place=PLACES["P"]))
    assert [row[0] for row in _points(document)[0][1]] == ["S1"]


def test_computed_coordinates_are_start_values_beside_control(tmp_path: Path) -> None:
    first = _gsi("S1", "S2", place=PLACES["S1"])
    words = " 81..10+00040000 82..10+00050000 83..10+00009000"
    second = _gsi("S2", "S1", "P", place=PLACES["S2"]).rstrip() + words
    document = _read(
        tmp_path,
        "a.gsi",
        f"110009+000000S2 81..10+00080000 82..10+00010000 83..10+00012000\n{first}{second}\n",
    )
    (given, _), (started, rows) = _points(document)
    assert "sigma_x" in given
    assert "sigma_x" not in started
    assert rows == [["P", "40.0", "50.0", "9.0"]]


@pytest.mark.parametrize("control", [False, True])
def test_stations_that_share_one_point_are_left_out_by_name(tmp_path: Path, control: bool) -> None:
    """S3 and its R hang on P alone, so S3 can turn about P; the rest is adjusted."""
    places = PLACES if control else {}
    text = (
        _gsi("S1", "S2", "P", "Q", place=places.get("S1", ()))
        + _gsi("S2", "S1", "P", "Q", place=(), turn=30)
        + _gsi("S3", "P", "R", turn=70)
    )
    if control:
        text = "110009+000000S2 81..10+00080000 82..10+00010000 83..10+00012000\n" + text
    solved = solve_network(network_of(_read(tmp_path, "a.gsi", text), tmp_path))
    assert solved.quality.sigma0 < 1.5
    left = {(thing.kind, thing.name): thing.reason for thing in solved.network.undeterminable}
    assert left == {("station", "S3"): ONE_TIE, ("point", "S3"): HANGS_ON, ("point", "R"): HANGS_ON}


def test_a_point_sighted_twice_without_a_distance_is_no_second_tie(tmp_path: Path) -> None:
    """S3 shares P with the others, and the directions to a target that only S2 and S3 sight, without distances."""
    far = "110099+00000001 21.102+{} 22.102+10000000\n"
    text = (
        _gsi("S1", "S2", "P", "Q")
        + _gsi("S2", "S1", "P", "Q", turn=30)
        + far.format("01200000")
        + _gsi("S3", "P", "R", turn=70)
        + far.format("34500000")
    )
    solved = solve_network(network_of(_read(tmp_path, "a.gsi", text), tmp_path))
    left = {(thing.kind, thing.name): thing.reason for thing in solved.network.undeterminable}
    assert left["station", "S3"] == ONE_TIE
    assert left["point", "R"] == HANGS_ON
    assert left.keys().isdisjoint({("station", "S1"), ("station", "S2"), ("point", "Q")})
    assert solved.quality.sigma0 < 1.5


def test_a_chain_of_stations_that_share_one_point_keeps_the_oriented_one(tmp_path: Path) -> None:
    """The azimuths of S1 come from the coordinates that its instrument computed; S2 and S3 can turn about P and R."""
    lines = ["*110001+000000000000000A 84..10+0000000000100000 85..10+0000000000200000 86..10+0000000000010000"]
    lines += [
        "*110002+000000000000000P 21.102+0000000010000000 22.102+0000000010000000 31..00+0000000000030000 "
        "81..00+0000000000130000 82..00+0000000000200000 83..00+0000000000010000",
        "*110003+000000000000000Q 21.102+0000000020000000 22.102+0000000010000000 31..00+0000000000040000 "
        "81..00+0000000000100000 82..00+0000000000160000 83..00+0000000000010000",
    ]
    text = _gsi("S2", "P", "R", turn=30) + _gsi("S3", "R", "T", turn=70)
    solved = solve_network(network_of(_read(tmp_path, "a.gsi", "\n".join([*lines, text])), tmp_path))
    left = {thing.name for thing in solved.network.undeterminable}
    assert left == {"S2", "S3", "R", "T"}
    values = dict(zip(solved.network.blocks["point"].ids, solved.adjustment.values["point"], strict=True))
    np.testing.assert_allclose(values["Q"], (100.0, 160.0, 10.0), atol=0.01)


def test_points_left_out_say_nothing_of_the_size_of_the_network(tmp_path: Path) -> None:
    """Half of the targets are sighted without a distance; the station and the others are determined."""
    far = "".join(f"1101{k:02d}+0000000{k % 10} 21.102+{k:02d}200000 22.102+09{k:02d}0000\n" for k in range(10, 13))
    solved = solve_network(network_of(_read(tmp_path, "a.gsi", _gsi("S1", "P", "Q", "R") + far), tmp_path))
    assert len(solved.network.undeterminable) == 3
    assert median_distance(solved.adjustment) == pytest.approx(50.0, rel=0.5)


def test_stations_that_share_two_points_are_kept(tmp_path: Path) -> None:
    text = _gsi("S1", "S2", "P", "Q") + _gsi("S2", "S1", "P", "Q", "R") + _gsi("S3", "P", "R", "T", turn=70)
    solved = solve_network(network_of(_read(tmp_path, "a.gsi", text), tmp_path))
    assert not solved.network.undeterminable
    assert solved.quality.sigma0 < 1.5


def test_one_side_may_have_the_datum(tmp_path: Path) -> None:
    """Two parts that nothing connects are adjusted together if each has given points."""
    text = "".join(
        f"110009+{name:0>8} 81..10{round(x * 1e3):+09d} 82..10{round(y * 1e3):+09d} 83..10{round(z * 1e3):+09d}\n"
        for name, (x, y, z) in PLACES.items()
        if name in ("S1", "P", "S3", "T")
    )
    text += _gsi("S1", "P", "Q") + _gsi("S3", "T", "R", turn=70)
    solved = solve_network(network_of(_read(tmp_path, "a.gsi", text), tmp_path))
    assert not solved.network.undeterminable
    values = dict(zip(solved.network.blocks["point"].ids, solved.adjustment.values["point"], strict=True))
    np.testing.assert_allclose(values["R"], PLACES["R"], atol=0.01)
    np.testing.assert_allclose(values["Q"], PLACES["Q"], atol=0.01)


def _nikon(*records: str) -> str:
    return "\n".join(["CO,Nikon RAW data format V2.00", "CO,Angle Units: DDDMMSS", *records])


def test_nikon_codes_name_the_stations_of_a_book_with_running_numbers(tmp_path: Path) -> None:
    text = _nikon(
        "ST,3,,9,,1.5,0.0000,0.0000",
        "SS,1,1.5,100.0,90.0000,90.0000,10:00:00,T4",
        "SS,2,1.5,50.0,10.0000,90.0000,10:01:00,7",
        "ST,4,,3,,1.5,0.0000,0.0000",
        "SS,3,1.5,100.0,270.0000,90.0000,10:02:00,T3",
        "SS,4,1.5,20.0,200.0000,90.0000,10:03:00,7",
    )
    document = _read(tmp_path, "a.raw", text)
    sights = [(row["station"], row["to"]) for row in _rows(document, "zenith_directions")]
    assert sights == [("3", "4"), ("3", "2"), ("4", "3"), ("4", "4 (2)")]
    assert "2 sights to stations" in _notes(document)
    again = text.replace("SS,4,", "SS,2,")
    sights = [(row["station"], row["to"]) for row in _rows(_read(tmp_path, "b.raw", again), "zenith_directions")]
    assert sights == [("3", "1"), ("3", "2"), ("4", "3"), ("4", "2")], "a number that comes again names a point"


def test_faulty_sights_copies_and_corrected_target_heights(tmp_path: Path) -> None:
    run = [f"SS,P{k},1.5,20.{k}00,{10 + k}.0000,90.0000, 09:00:00," for k in range(4)]
    text = _nikon(
        "ST,A,,,,1.5,,",
        *run,
        *run[1:],
        "SS,X,1.5,20.000,10.0000,-61.5811, 09:00:00,",
        "SS,H,0.1,30.000,40.0000,89.3000, 09:00:00,",
        "SS,H,1.6,30.001,40.0002,89.3001, 09:00:00,",
    )
    document = _read(tmp_path, "a.raw", text)
    rows = _rows(document, "zenith_directions")
    assert [row["to"] for row in rows] == ["P0", "P1", "P2", "P3", "H", "H"]
    assert [row["to_height"] for row in rows][-2:] == ["1.6", "1.6"]
    for words in (
        "impossible zenith angle (1 record, lines 11)",
        "(3 records, lines 8–10)",
        "target heights that differ",
    ):
        assert words in _notes(document)


@pytest.mark.parametrize(("zero", "faces"), [("Horizon", ("5.3000", "174.3000")), ("Compass", ("5.3000", "5.3000"))])
def test_the_zero_of_the_vertical_circle(tmp_path: Path, zero: str, faces: tuple[str, str]) -> None:
    """An elevation of 5° 30' in both faces is the zenith angle 84.5°."""
    text = _nikon(
        f"CO,Zero VA: {zero}",
        "ST,A,,,,1.5,,",
        f"F1,B,1.5,20.000,30.0000,{faces[0]}, 09:00:00,",
        f"F2,B,1.5,20.000,210.0000,{faces[1]}, 09:00:00,",
        "SS,C,1.5,20.000,40.0000,-10.0000, 09:00:00,",
    )
    rows = _rows(_read(tmp_path, "a.raw", text), "zenith_directions")
    assert [float(str(row["zenith"])) for row in rows] == pytest.approx([84.5, 275.5, 100.0])


def test_points_in_plan_alone_without_readings(tmp_path: Path) -> None:
    """A list of points, some of them without a height, is a project: their heights are fixed at 0."""
    document = _read(tmp_path, "a.raw", _nikon("MP,A,,200.0,100.0,,", "MP,B,,210.0,100.0,5.0,"))
    assert "1 point without a height: no reading tells it, so it is fixed at 0: A" in _notes(document)
    high, flat = document.data["points"]
    assert (high["rows"][0][0], flat["rows"][0][0]) == ("B", "A")
    assert (high.get("fixed"), flat["fixed"], flat["values"]) == (None, ["z"], {"z": "0"})


def test_heights_and_comments_of_m5(tmp_path: Path) -> None:
    """Comments begin with an exclamation mark; a record of a point may have its target height alone."""
    text = (
        "! made by an office program\nFor M5|Adr 1|PI1 P|th 1.6 m|PC 0.035 m||\n"
        "For M5|Adr 2|PI1 P|Hz 34.9 gon|V1 106.3 gon|D 89.8 m|\n"
        "For M5|Adr 3|PI1 Q|Hz 44.9 gon|V1 106.3 gon|D 89.8 m|"
    )
    document = _read(tmp_path, "a.m5", text)
    assert [row["to_height"] for row in _rows(document, "zenith_directions")] == ["1.6", "1.6"]
    assert "comments (1 record, lines 1)" in _notes(document)
    assert "value PC (1 record, lines 2)" in _notes(document)


def test_a_first_sight_before_the_circle_was_set_is_a_set_of_its_own(tmp_path: Path) -> None:
    """The circle is set to the azimuth in face two, so that later readings in face two differ by 180°."""
    text = _nikon(
        "ST,A,,,,1.5,,",
        "F2,B,1.5,20.000,30.0000,270.0000, 09:00:00,",
        "F1,B,1.5,20.000,30.0100,90.0000, 09:00:00,",
        "F2,B,1.5,20.000,210.0100,270.0000, 09:00:00,",
        "F1,C,1.5,25.000,70.0000,90.0000, 09:00:00,",
    )
    rows = _rows(_read(tmp_path, "a.raw", text), "zenith_directions")
    assert [row["set"] for row in rows] == [None, "2", "2", "2"]


def test_names_used_again_beside_each_other(tmp_path: Path) -> None:
    """Directions to three names changed by different angles, so the circle was not turned and the points differ."""
    text = _nikon(
        "ST,A,,,,1.5,,",
        *(
            f"SS,{name},1.5,20.000,{circle}.0000,90.0000, 09:00:00,"
            for name, circle in zip("PQR", (10, 20, 30), strict=True)
        ),
        *(
            f"SS,{name},1.5,20.100,{circle}.0000,90.0000, 09:00:00,"
            for name, circle in zip("PQR", (12, 25, 30), strict=True)
        ),
    )
    rows = _rows(_read(tmp_path, "a.raw", text), "zenith_directions")
    assert [row["to"] for row in rows] == ["P", "Q", "R", "P (2)", "Q (2)", "R"]


def test_unnamed_stations_change_with_the_instrument_height(tmp_path: Path) -> None:
    text = "".join(
        f"110001+0000000{name} 21.324+0{k}000000 22.324+09000000 31...0+00010000 88...0+0000{height}\n"
        for k, (name, height) in enumerate([("A", 1531), ("B", 1531), ("A", 1536), ("C", 1536)])
    )
    document = _read(tmp_path, "a.gsi", text)
    stations = [row for table in document.data["stations"] for row in table["rows"]]
    assert stations == [["station 1", "station 1", "1.531"], ["station 2", "station 2", "1.536"]]


def test_reference_objects_of_geodimeter(tmp_path: Path) -> None:
    """Label 21 is the circle reading at the reference object, unless that was measured."""
    labels = "2=A 3=1.5 62=B 21=10.0000 5=C 6=1.5 7=40.0060 8=90.0000 9=20 2=D 62=B 21=50.0000 5=B 7=50.0001 8=90.0000"
    text = labels.replace(" ", "\n")
    document = _read(tmp_path, "a.job", text)
    horizontal = [(row["station"], row["to"], float(row["horizontal"])) for row in _rows(document, "directions")]
    assert horizontal == [("A", "B", 10.0)]
    both = [(row["station"], row["to"], float(row["horizontal"])) for row in _rows(document, "zenith_directions")]
    assert both == [("A", "C", pytest.approx(40 + 1 / 60)), ("D", "B", pytest.approx(50 + 1 / 3600))]


JOB = """23=2111
2=A
3=0
5=B
7=0.0000
8=90.0000
9=30.000
5=C
7=90.0000
8=90.0000
9=40.000
5=F
7=45.0000
11=50.000
2=B
3=0
5=A
7=0.0000
8=90.0000
9=30.000
5=F
7=261.231240
"""


def test_points_that_no_reading_tells_the_height_of_are_kept_in_plan(tmp_path: Path) -> None:
    document = _read(tmp_path, "a.job", JOB)
    held = [table for table in document.data["points"] if table.get("fixed")]
    assert [(table["fixed"], table["values"], table["rows"]) for table in held] == [(["z"], {"z": "0"}, [["F"]])]
    assert "1 point without a height: no reading tells it, so it is fixed at 0: F" in _notes(document)
    assert solve_network(network_of(document, tmp_path)).quality.sigma0 < 1.0


@pytest.mark.parametrize("third", ["", "5=C\n37=100.000\n38=240.000\n"])
@pytest.mark.parametrize("names", [("a.job", "a.are"), ("a.are", "a.job")])
@pytest.mark.parametrize("height", ["", "39=10.000\n"])
def test_coordinates_in_a_file_of_their_own_are_control(
    tmp_path: Path, height: str, names: tuple[str, str], third: str
) -> None:
    """Without heights in it those of the book stay free, whatever the order of the files."""
    (tmp_path / "a.job").write_text(JOB)
    (tmp_path / "a.are").write_text(f"5=A\n37=100.000\n38=200.000\n{height}5=B\n37=130.000\n38=200.000\n{third}")
    whole = combined([read_foreign(tmp_path / name) for name in names])
    assert whole.data.get("datum") == (None if height else "free")
    solved = solve_network(network_of(whole, tmp_path))
    points = solved.network.things["point"]
    place = solved.adjustment.values["point"][points.part("F", "position")]
    assert place[:2] == pytest.approx([200 + 50 * np.sin(np.pi / 4), 100 + 50 * np.cos(np.pi / 4)], abs=1e-3)
    assert solved.quality.sigma0 < 1.0


def test_a_height_is_held_if_neither_of_two_files_tells_it(tmp_path: Path) -> None:
    (tmp_path / "a.job").write_text(JOB)
    (tmp_path / "b.job").write_text("23=2111\n2=C\n3=0\n5=F\n7=0.0000\n8=90.0000\n9=10.000\n")
    (tmp_path / "c.are").write_text("5=F\n37=100.000\n38=200.000\n5=A\n37=130.000\n38=200.000\n39=5.0\n")
    for names, held in (("ab", []), ("ba", []), ("ac", ["F"]), ("ca", ["F"])):
        files = [read_foreign(path) for name in names for path in tmp_path.glob(f"{name}.*")]
        tables = combined(files).data["points"]
        assert [row[0] for table in tables if table.get("fixed") for row in table["rows"]] == held
        assert sorted(str(row[table["columns"].index("id")]) for table in tables for row in table["rows"]) == list(
            "ABCF"
        )


def test_lines_of_gts6_may_have_numbers_and_checksums(tmp_path: Path) -> None:
    stream = (
        "_'_(_)1.500_+A_ ?+00012345m0903015+3595930d+00012344***+00+00000_*_,1.400_+B_ ?+00020000m0900000+0450000d"
        "+00020000***_*_,1.300"
    )
    lines = [stream[k : k + 40] + f"{n % 10}{n * 37 % 1000:03d}" for n, k in enumerate(range(0, len(stream), 40))]
    whole = _rows(_read(tmp_path, "a.raw", stream), "zenith_directions")
    same = [line[:-4] + "1234" for line in lines]  # as software writes that has no checksums
    for text in ("\n".join([*lines[:-1], lines[-1][:-4]]), "\n".join(same)):
        assert _rows(_read(tmp_path, "b.raw", text), "zenith_directions") == whole
    assert [row["station"] for row in whole] == ["station 1", "station 1"]


def test_a_backsight_of_rw5_that_was_not_measured(tmp_path: Path) -> None:
    text = (
        "MO,AD0,UN1,SF1.0,EC0,EO0.0,AU0\nOC,OP1,N 0.0,E 0.0,EL0.0\nLS,HI1.5,HR1.5\nBK,OP1,BP2,BS0.0000,BC0.0000\n"
        "BD,OP1,FP2,AR0.0000,ZE90.0000,SD0.000\nSS,OP1,FP3,AR10.0000,ZE91.0000,SD20.0\n"
    )
    document = _read(tmp_path, "a.rw5", text)
    assert [(row["to"], float(row["bearing"])) for row in _rows(document, "bearing")] == [("2", 0.0), ("3", 10.0)]
    assert _points(document)[0][1] == [["1", "0.0", "0.0", "0", *["0.01"] * 3]], "the origin"


FBK = """HORIZ ANGLE RIGHT
VERT ANGLE ZENITH
UNIT METER DMS
NEZ 1 200.0 100.0 10.0 "control"
NEZ 2 250.0 100.0 10.0
PRISM 1.6
STN 1 1.5
BS 2 10.0000
F1 VA 2 10.0000 50.000 90.0000 "BS"
F2 VA 3 220.0000 20.000 270.0000
AD 4 30.0000 25.000 "tree"
AD VD 5 30.0000 25.000 1.0
STN 3
BS 1
AD VA 6 90.0000 10.000 80.0000
"""


def test_fbk(tmp_path: Path) -> None:
    document = _read(tmp_path, "a.fbk", FBK)
    assert format_of(tmp_path / "a.fbk") == "fbk"
    (_, rows), _, _ = _points(document)
    assert [row[:4] for row in rows] == [["1", "100.0", "200.0", "10.0"], ["2", "100.0", "250.0", "10.0"]]
    both = [
        (row["station"], row["to"], float(row["horizontal"]), float(row["zenith"]), row["face"])
        for row in _rows(document, "zenith_directions")
    ]
    assert both == [("1", "2", 10, 90, "1"), ("1", "3", 220, 270, "2"), ("3", "6", 90, 80, "1")]
    circle = [(row["station"], row["to"], float(row["horizontal"])) for row in _rows(document, "directions")]
    assert circle == [("1", "4", 30.0), ("3", "1", 0.0)], "the backsight that was not measured is read at 0"
    lengths = [(row["from"], row["to"], row["distance"]) for row in _rows(document, "horizontal_distance")]
    assert lengths == [("1", "4", "25.0")]
    assert "not read: commands AD VD (1 record, lines 12)" in _notes(document)


def test_fbk_may_have_names_in_quotes_and_us_feet(tmp_path: Path) -> None:
    text = FBK.replace("UNIT METER DMS", "UNITS USFOOT DMS !survey feet").replace(" 3 2", ' "3 b" 2')
    document = _read(tmp_path, "a.fbk", text)
    (row,) = [row for row in _rows(document, "distance") if row["to"] == "3 b"]
    assert float(row["distance"]) == pytest.approx(20 * 1200 / 3937)


def test_coordinates_of_gts7_belong_to_the_point_named_before(tmp_path: Path) -> None:
    """East, north, height: B is 30 m east of A, as its azimuth of 90° says; HD is a distance in plan."""
    text = (
        "JOB     G,\nUNITS   M,D\nSTN     A,1.5,\nXYZ     100.000,200.000,10.000\nBKB     B,90.00000,0.00000\n"
        "XYZ     130.000,200.000,10.000\nBS      B,1.500\nHV      0.00000,90.00000\nSS      C,1.500,x\n"
        "SD      10.00000,90.00000,20.0\nXYZ     119.696,196.527,10.000\nSS      D,1.500,x\nHD      20.00000,10.0,1.0\n"
    )
    document = _read(tmp_path, "a.gts7", text)
    given, *_ = _points(document)
    assert [row[:4] for row in given[1]] == [["A", "100.0", "200.0", "10.0"], ["B", "130.0", "200.0", "10.0"]]
    assert [row["distance"] for row in _rows(document, "horizontal_distance")] == ["10.0"]
    points = solve_network(network_of(document, tmp_path))
    values = points.adjustment.values["point"]
    place = values[points.network.things["point"].part("C", "position")]
    assert place[:2] == pytest.approx([100 + 20 * np.cos(np.radians(10)), 200 - 20 * np.sin(np.radians(10))], abs=1e-3)
    assert "not read: differences of height (HD)" in _notes(document)


def test_gts7_without_a_head_has_the_unit_that_its_angles_allow(tmp_path: Path) -> None:
    document = _read(tmp_path, "a.txt", "SS      C,1.500,x\nSD      10.7000,99.8000,20.0\nSS      D,1.500,x\n")
    assert document.data["units"]["angle"] == "gon"
    assert [row["to"] for row in _rows(document, "zenith_directions")] == ["C"]


def test_scr_has_coordinates_before_readings(tmp_path: Path) -> None:
    text = (
        ",SET4C,1,2,3,E0\nA,SET4C,1,2,3,E0\nM,6.8.26,5,?,1.400,22,760,100.000,200.000,10.000,0,1,0,9C\n"
        "P,Eh,0000,?,1.500,7,120.000,200.000,9.900,20.000,90.0000,90.0000,D7\n"
    )
    document = _read(tmp_path, "a.scr", text)
    (row,), (zenith,) = _rows(document, "bearing"), _rows(document, "zenith_angle")
    assert (row["to"], float(row["bearing"]), float(zenith["zenith_angle"])) == ("P", 90.0, 90.0)
    assert _rows(document, "distance")[0]["distance"] == "20.0"
    assert _points(document)[0][1][0][1:4] == ["100.0", "200.0", "10.0"]


@pytest.mark.parametrize(
    ("old", "new", "circle", "zenith"),
    [
        ("VERT ANGLE ZENITH", "VERT ANGLE HORIZON", 90.0, 10.0),
        ("HORIZ ANGLE RIGHT", "HORIZ ANGLE LEFT", 270.0, 80.0),
        ("UNIT METER DMS", "UNIT METER GRADS", 90.0, 80.0),
    ],
)
def test_angles_of_fbk(tmp_path: Path, old: str, new: str, circle: float, zenith: float) -> None:
    document = _read(tmp_path, "a.fbk", FBK.replace(old, new))
    row = _rows(document, "zenith_directions")[-1]
    assert (float(row["horizontal"]), float(row["zenith"])) == (circle, zenith)
    assert document.data["units"]["angle"] == ("gon" if "GRADS" in new else "deg")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("F1 VA 9 10.0000 50.000", "expected an angle and a distance"),
        ("F1 VA 9 10.7000 50.000 90.0000", "expected less than 60 minutes"),
        ("UNIT ELL", "found the unit 'ELL', expected METER"),
    ],
)
def test_mistakes_of_fbk(tmp_path: Path, line: str, words: str) -> None:
    with pytest.raises(Exception, match=words):
        _read(tmp_path, "a.fbk", f"{FBK}{line}\n")


def _given(**places: tuple[float, ...]) -> str:
    return "".join(
        f"110001+{name:0>8} " + " ".join(f"8{k}..10{round(v * 1e3):+09d}" for k, v in enumerate(place, start=1)) + "\n"
        for name, place in places.items()
    )


def test_given_coordinates_that_most_distances_contradict_are_not_used(tmp_path: Path) -> None:
    """Stations were begun with small numbers; one point was computed from one of them, so that one distance agrees."""
    sights = _gsi("S1", "P", "Q", "S2", "R") + _gsi("S2", "P", "Q", "R", "S3") + _gsi("S3", "P", "Q", "R", "S2")
    begun = _given(S1=(1.2, 1.1, 1.0), S2=(3.2, 3.1, 3.0), S3=(5.2, 5.1, 5.0), P=(-43.2, 5.0, 2.0))
    document = _read(tmp_path, "a.gsi", begun + sights)
    assert "coordinates that the measured distances contradict (4 records" in _notes(document)
    assert document.data["datum"] == "free"
    assert solve_network(network_of(document, tmp_path)).quality.sigma0 < 1.5
    right = {name: PLACES[name] for name in ("S1", "S2", "S3", "P")}
    moved = {**right, "P": (PLACES["P"][0] + 50.0, *PLACES["P"][1:])}
    document = _read(tmp_path, "b.gsi", _given(**moved) + sights)
    assert "or nearer, than the sights between them allow (1 record" in _notes(document)
    assert "datum" not in document.data
    solved = solve_network(network_of(document, tmp_path))
    values = dict(zip(solved.network.blocks["point"].ids, solved.adjustment.values["point"], strict=True))
    np.testing.assert_allclose(values["P"], PLACES["P"], atol=0.01)


def test_a_zenith_angle_without_a_distance_may_be_to_another_height(tmp_path: Path) -> None:
    """The foot of a pole is sighted for its direction, then the prism on it."""
    foot = "110002+0000000P 21.322+{:08d} 22.322+11500000 87..10+00001500\n"
    text = _gsi("S1", "P", "Q")
    circle = round((atan2(*PLACES["P"][:2]) * 200 / pi) * 1e5)
    head, first, second = text.splitlines(keepends=True)
    document = _read(tmp_path, "a.gsi", head + second + foot.format(circle) + first)
    assert [row["to"] for row in _rows(document, "zenith_directions")] == ["Q", "P"]
    assert [row["to"] for row in _rows(document, "directions")] == ["P"]
    assert "zenith angles of sights without a distance to another height than those with one" in _notes(document)
