"""``mor new`` with tables as people keep them: sections, forms, both faces, no header, Chinese texts."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from mor.errors import InputError
from mor.input_files import decoded
from mor.project.headerless import HeaderlessError
from mor.project.level_books import levelled
from mor.project.recognition import Found, read_tables, told_apart
from tests.scenarios.small_projects import mor


def recognise(path: Path, text: str, encoding: str = "utf-8") -> list[Found]:
    path.write_text(text, encoding=encoding)
    return told_apart(levelled(read_tables(path)))


def test_tables_below_each_other_are_each_read(tmp_path: Path) -> None:
    """Parameters above the first header hide nothing, and adjusted values below are no observations."""
    distances = "from,to,distance\nA,C,100.01\nB,C,99.98\nC,D,50.02\n"
    text = f"focal length,152.7\npoints,2\n\nDistances\n{distances}\nKnown points\nname,x,y\nA,0,0\nB,200,0\n"
    text += f"\nAdjusted distances\n{distances.replace('.0', '.1')}\nResiduals\nline,residual,w\nA-C,0.1,1.2\n"
    distance, points = recognise(tmp_path / "t.csv", text)
    assert (distance.kind, distance.numbers("distance")) == ("distance", [100.01, 99.98, 50.02])
    assert (points.texts("id"), points.is_control) == (["A", "B"], True)
    assert "t.csv Adjusted distances has the same readings: not used once more" in distance.notes
    assert any("another table begins below (columns line, residual, w): 1 row" in note for note in distance.notes)


def test_reduced_directions_are_no_observations(tmp_path: Path) -> None:
    rows = [("A", 10.0012), ("B", 60.5004), ("C", 120.25)]
    measured = "".join(f"S,{name},{value}\n" for name, value in rows)
    reduced = "".join(f"S,{name},{value - 10.0012:.4f}\n" for name, value in rows)
    text = f"station,target,hz\n{measured}\nreduced directions\nstation,target,hz\n{reduced}"
    (table,) = recognise(tmp_path / "t.csv", text)
    assert table.numbers("horizontal") == [10.0012, 60.5004, 120.25]
    measured_again = measured.replace("10.0012", "10.0014").replace("60.5004", "60.5001")
    for name, own in (("one", measured), ("two", measured_again)):
        (tmp_path / f"{name}.csv").write_text(f"station,target,hz\n{own}")
    both = told_apart([table for name in ("one", "two") for table in read_tables(tmp_path / f"{name}.csv")])
    assert len(both) == 2, "a second set is measured"


@pytest.mark.parametrize(
    "header",
    [
        "Station,Target,Lage I,Lage II,Mittel\n",
        "测站,目标,水平度盘读数,,平均读数\n,,盘左,盘右,\n",
        "Estación,Punto visado,Lectura,,Promedio\n,,Directa,Inversa,\n",
    ],
)
def test_both_faces_beside_each_other(tmp_path: Path, header: str) -> None:
    rows = "S,A,0-00-10,180-00-16,0-00-13\n,B,95-10-10,275-10-18,95-10-14\n,C,120-00-00,,120-00-00\n"
    (table,) = recognise(tmp_path / "t.csv", header + rows)
    found = list(zip(*map(table.texts, ("station", "to", "horizontal", "face")), strict=True))
    assert found == [
        *(("S", "A", "0-00-10", "1"), ("S", "A", "180-00-16", "2")),
        *(("S", "B", "95-10-10", "1"), ("S", "B", "275-10-18", "2"), ("S", "C", "120-00-00", "1")),
    ]


def test_a_face_holds_for_the_rows_below(tmp_path: Path) -> None:
    rows = "S,左,A,0-00-10,95-10-00\n,,B,95-10-10,\n,右,A,180-00-16,95-10-02\n,,B,275-10-18,\n"
    (table,) = recognise(tmp_path / "t.csv", f"测站,盘位,目标,水平度盘读数,半测回角值\n{rows}")
    assert (table.texts("face"), table.texts("station")) == (["1", "1", "2", "2"], ["S"] * 4)


def test_a_form_with_both_faces_of_the_staffs(tmp_path: Path) -> None:
    """Red readings are 4687 and 4787 mm above the black ones; checks below the last set-up are no readings."""
    lines = [
        *("测站,点号,后尺上丝,前尺上丝,方向及尺号,标尺读数,,K+黑-红", ",,后尺下丝,前尺下丝,,黑面,红面,"),
        *(",,后视距,前视距,,,,", ",,视距差,累积差,,,,"),
        *("1,BM-1,1584,0752,后1,1384,6071,0", ",T1,1184,0350,前2,0551,5338,0"),
        *(",,40.0,40.2,后-前,833,733,", ",,-0.2,-0.2,,,,"),
        *("2,T1,1621,1696,后2,1534,6322,-1", ",BM-2,1447,1521,前1,1608,6295,0"),
        *(",,17.4,17.5,后-前,-74,27,", ",,-0.1,-0.3,,,,", "校核,Σ,57.4,57.7,,,,"),
    ]
    (table,) = recognise(tmp_path / "t.csv", "\n".join(["仪器,DS3,,,,,,", "Form of the line,,,,,,,", *lines]))
    assert table.rows == (
        *(("BM-1", "T1", "833", "80.2"), ("T1", "BM-2", "-74", "34.9")),
        *(("BM-1", "T1", "833", "80.2"), ("T1", "BM-2", "-73", "34.9")),
    )
    assert table.units["dz"] == "mm"


def test_a_form_with_a_heading_for_each_of_its_rows(tmp_path: Path) -> None:
    lines = [
        *(
            "测站,视准点,视距读数,视距读数,标尺读数,标尺读数,高差(m)",
            "测站,后视,后距1,后距2,后尺读数1,后尺读数2,高差(m)",
        ),
        *("测站,前视,前距1,前距2,前尺读数1,前尺读数2,高差(m)", "测站,,视距差(m),累积差(m),高差(m),高差(m),高差(m)"),
        *("1,X1,7.5,7.6,1.43,1.431,", ",X2,6.5,6.6,1.33,1.332,", ",,1,1,0.1,0.099,0.0995"),
        *("2,X2,8.5,8.6,1.2,1.2,", ",X3,8.5,8.6,1.5,1.501,", ",,0,1,-0.3,-0.301,-0.3005"),
        *("测段\t起点,X1,,,,,", "测段\t终点,X3,0.03,km,,,"),
    ]
    (table,) = recognise(tmp_path / "t.csv", "\n".join(lines))
    assert [row[:3] for row in table.rows] == [
        *(("X1", "X2", "0.1"), ("X2", "X3", "-0.3")),
        *(("X1", "X2", "0.099"), ("X2", "X3", "-0.301")),
    ]


def test_a_form_that_is_not_filled_in_has_no_observations(tmp_path: Path) -> None:
    (table,) = recognise(tmp_path / "t.csv", "from,to,dh,length\nName,Name,(m),(km)\n,,,\nobserver:,,date:,\n")
    assert table.rows == ()


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        ("序\t起\t终\t ΔX\nP1\n", "gb18030"),
        ("测站,目标,水平角\n一号,二号,0.1\n", "gb18030"),
        ("点ID,X,Y\n", "gb18030"),
        ("точка,X\nпункт,1\n", "cp1251"),
        ("ПУНКТЫ,ВЫСОТА\nА1,1\n", "cp1251"),
        ("Größe,GRÖßE,Höhe\n", "cp1252"),
        ("Nº;LEITURA RÉ;ÂNGULO\n", "cp1252"),
        ("İstasyon;Bakılan Nokta;Yatay Açı\n", "cp1254"),
        ("Çıkış\n", "cp1254"),
    ],
)
def test_texts_that_are_not_utf_8(text: str, encoding: str) -> None:
    assert decoded(text.encode(encoding)) == (text, encoding)


@pytest.mark.parametrize(
    ("name", "text", "shown", "likely"),
    [
        ("t", "A B 100.1 1.2\nB C 99.9 0.3\nC D 50.2 -2.1\n", "3: 100.1, 99.9, 50.2; 4: 1.2", "from,to,distance,dz"),
        ("t", "1 2 0 0 0\n1 3 45 12 33.2\n", "1: 1; 2: 2, 3", "station,to,horizontal_d,horizontal_m,horizontal_s"),
        ("t", "1 P1 10.2 20.3\n1 P2 11.2 -20.3\n", "2: P1, P2", "image,point,x,y"),
        ("t", "P1 10.25 20.5\nP2 30.5 20.5\n", "1: P1, P2", "id,x,y"),
        ("t", "1,A,B,20.4,73.7\n2,A,D,18.8,14.0\n3,D,B,9.8,1.5\n", "1: 1, 2, 3; 2: A, D", "-,from,to,distance,sigma"),
        ("t", "2,1,3,319.51\n2,1,4,348.66\n", "4: 319.51, 348.66", "from,at,to,angle"),
        ("dirs", "1,2,100.34\n2,1,66.55\n", "3: 100.34, 66.55", "station,to,horizontal"),
        ("t", "1,4,0.05,1\n4,2,1.05,2\n", "3: 0.05, 1.05", "from,to,dz,length"),
        ("t", "S1 LEN A B 61.5\nS2 LEN B C 59.6\n", "1: S1, S2; 2: LEN", "-,-,from,to,distance"),
        ("t", "S1 ANG A P B 5.56\nS2 ANG P Q C 0.82\n", "1: S1, S2; 2: ANG", "-,-,from,at,to,angle"),
    ],
)
def test_a_table_without_a_header_is_asked_about(tmp_path: Path, name: str, text: str, shown: str, likely: str) -> None:
    with pytest.raises(HeaderlessError) as raised:
        recognise(tmp_path / f"{name}.txt", text)
    message = raised.value.problems[0].message
    assert shown in message
    assert message.endswith(f"mor new PROJECT {name}.txt --columns {name}.txt {likely}")
    assert mor("new", tmp_path / "p.yaml", tmp_path / f"{name}.txt", "--columns", f"{name}.txt", likely).code == 0


def test_targets_in_images(tmp_path: Path) -> None:
    header = "camera_name,image_name,target_id,x_image,y_image"
    (table,) = recognise(tmp_path / "t.csv", f"{header}\nc,a.jpg,135,1221.35,437.85\n")
    assert (table.kind, table.texts("point"), table.numbers("x")) == ("image", ["135"], [1221.35])


def test_points_that_no_column_names(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none of them names points"):
        recognise(tmp_path / "t.txt", "10.25 20.5\n30.5 20.5\n")


def test_rows_of_several_lengths_without_headers(tmp_path: Path) -> None:
    """Numbers of rows, known heights, and lines whose lengths can only be kilometres: they rise by more."""
    (tmp_path / "t.txt").write_text("2 3\n100 5.000\n101 15.000\n100 4 5.4 5.0\n4 101 4.6 1.0\n100 101 10.0 2.0\n")
    begun = mor("new", tmp_path / "p.yaml", tmp_path / "t.txt")
    likely = ("--columns", "t.txt", "id,z", "--columns", "t.txt", "from,to,dz,length")
    assert begun.code == 2
    assert " ".join(likely) in begun.err
    assert mor("new", tmp_path / "p.yaml", tmp_path / "t.txt", *likely).code == 0
    assert "units: {length: km}  # CHECK: the lengths" in (tmp_path / "p.yaml").read_text()
    done = mor("adjust", tmp_path / "p.yaml", "--no-html")
    assert "n = 3, u = 1" in done.err
    assert "Global test REJECTED at the level 0.05: residuals are smaller" in done.err


@pytest.mark.parametrize(
    ("text", "likely"),
    [
        (
            "7 3 2 0.005\nA 35.4\nB 45.7\n1 A C 8.22 4.0\n2 C B 2.06 2.0\n3 A B 10.28 2.0\n",
            "id,z|-,from,to,dz,length",
        ),
        ("0 0 675.0 242.5\n0 1 1209.0 586.0\n1 0 354.0 447.5\n1 1 767.0 239.0\n1 2 90.0 77.0\n", "image,point,x,y"),
        ("A1 101 391.3 99.5\nB8 101 408.0 296.3\nC1 101 451.2 76.7\nA1 102 371.3 93.5\n", "point,image,x,y"),
        ("1 A B A.obs-B.obs -366.6 -252.4 72.1\n2 A C A.obs-C.obs -509.2 22.3 -426.4\n", "-,from,to,-,dx,dy,dz"),
    ],
)
def test_proposed_columns_are_those_of_tables(tmp_path: Path, text: str, likely: str) -> None:
    (tmp_path / "t.txt").write_text(text)
    options = [word for names in likely.split("|") for word in ("--columns", "t.txt", names)]
    assert mor("new", tmp_path / "p.yaml", tmp_path / "t.txt").err.rstrip().endswith(" ".join(options))
    assert mor("new", tmp_path / "p.yaml", tmp_path / "t.txt", *options).code == 0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "2 3\nA 5597.9 1948.0\nB 5621.5 1984.7\nA 2\nB 0.0\n6 115.02\n1 4 15534.6\n1 C 15360.9\n",
            "rows of 3 cells hold",
        ),
        (
            "[STATION]\nA,10,5597.9,1948.0\nB,10,5621.5,1984.7\n[OBSER]\nA,B,0.0\nA,6,115.02\n",
            r"\[OBSER\]",
        ),
        (
            "CONTROL POINT\n1 50.2 246.1\n2 79.9 113.4\nDISTANCES\n15 164.2\n24 188.7\nANGLES\n521 93 15 5.4\n",
            "DISTANCES",
        ),
        ("a 1.5 2.5\nb 7.5 4.5\na b 1.5 2.5\nc d e 4.5 2\na b c d 7.2 5\n1\n", "more than three lengths"),
    ],
)
def test_several_tables_without_a_header_are_told_apart_by_the_user(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as error:
        recognise(tmp_path / "t.txt", text)
    assert "write each table to a file of its own" in str(error.value)


def test_a_known_height_is_no_count_of_rows(tmp_path: Path) -> None:
    """Its name is the number of levelled lines below."""
    (tmp_path / "t.txt").write_text("2 100.0\n5 101.0\n2 5 1.0 1\n2 3 2.0 1\n")
    options = ("--columns", "t.txt", "id,z", "--columns", "t.txt", "from,to,dz,length")
    done = mor("new", tmp_path / "p.yaml", tmp_path / "t.txt", *options)
    assert "t.txt: points, 2 rows" in done.err
    assert "not used" not in done.err


def test_image_coordinates_of_a_pair_go_to_the_relative_orientation(tmp_path: Path) -> None:
    rows = "".join(
        f"{100 + k} {k * 7 % 11 - 5.5} {k * 5 % 13 - 6} {k * 7 % 11 - 9.3} {k * 5 % 13 - 6.1 + k / 90}\n"
        for k in range(9)
    )
    with pytest.raises(InputError, match="mor orient relative"):
        recognise(tmp_path / "t.txt", rows)


def test_sights_below_rows_of_their_stations(tmp_path: Path) -> None:
    """In two faces, the last one of a station with a star; the known points tell that x leads north."""
    places = {"1": (1000.0, 5000.0), "2": (1080.0, 5060.0), "3": (1010.0, 5100.0), "4": (940.0, 5030.0)}
    rows = []
    for at, (north, east) in places.items():
        rows.append(f"{at} 1.6")
        for to in places.keys() - {at}:
            d = places[to][0] - north, places[to][1] - east
            turn = math.atan2(d[1], d[0]) * 200.0 / math.pi % 400.0
            rows += [f"{to} 1.6 {turn:.4f} 100.0000 {math.hypot(*d):.3f}"]
            rows += [f"{to} 1.6 {(turn + 200.0) % 400.0:.4f} 300.0000 {math.hypot(*d):.3f}"]
        rows[-1] += "*"
    (tmp_path / "t.dpi").write_text("\n".join(rows))
    (tmp_path / "t.kor").write_text("".join(f"{name} {x} {y} 10.0\n" for name, (x, y) in places.items()))
    likely = (
        "--columns",
        "t.dpi",
        "station,from_height",
        "--columns",
        "t.dpi",
        "to,to_height,horizontal,zenith,distance",
    )
    files = tmp_path / "p.yaml", tmp_path / "t.dpi", tmp_path / "t.kor", "--columns", "t.kor", "id,x,y,z"
    assert " ".join(likely) in mor("new", *files).err
    assert mor("new", *files, *likely, "--datum", "free").code == 0
    assert "axes: {xy: ne}" in (tmp_path / "p.yaml").read_text()
    done = mor("adjust", tmp_path / "p.yaml", "--no-html")
    assert "n = 72" in done.err
    assert "Converged" in done.err


def test_image_points_below_rows_of_their_images(tmp_path: Path) -> None:
    rows = "".join(f"{k} 0\n11 {k}.5 -7.25\n12 -3.5 {k}.75\n13 2.5 {k}.25\n-99 0.0 0.0\n" for k in (321, 322, 323))
    (tmp_path / "t.dat").write_text(rows)
    likely = ("--columns", "t.dat", "image,-", "--columns", "t.dat", "point,x,y")
    assert " ".join(likely) in mor("new", tmp_path / "p.yaml", tmp_path / "t.dat").err
    done = mor("new", tmp_path / "p.yaml", tmp_path / "t.dat", *likely)
    assert "t.dat: image, 9 rows" in done.err
    assert "-99 and zeros end a list: 3 rows not used" in done.err


def test_names_tell_image_points_from_coordinates(tmp_path: Path) -> None:
    (tmp_path / "p.txt").write_text("1 -20.5 13.25\n2 18.25 -10.75\n3 4.5 6.25\n4 -9.5 -8.75\n")
    (tmp_path / "c.txt").write_text("4\n1 490.1 56.0 -12.3\n2 491.2 57.5 -8.1\n3 490.7 54.2 -4.3\n4 492.3 55.1 1.2\n")
    begun = mor("new", tmp_path / "q.yaml", tmp_path / "p.txt", tmp_path / "c.txt")
    assert "p.txt: no header: read as id, x, y, as names of points agree" in begun.err
    assert "p.txt: image, 4 rows" in begun.err


def test_coordinates_tell_the_columns_of_distances(tmp_path: Path) -> None:
    (tmp_path / "c.txt").write_text("A 0.00 0.00\nB 100.01 0.02\nC 100.00 99.97\n")
    (tmp_path / "d.txt").write_text("A B 100.012 0.003\nB C 99.951 0.003\nA C 141.401 0.004\n")
    begun = mor("new", tmp_path / "p.yaml", tmp_path / "c.txt", tmp_path / "d.txt")
    assert "d.txt: no header: read as from, to, distance, -, as coordinates and distances agree" in begun.err
    assert "c.txt: no header: read as id, x, y" in begun.err
    (tmp_path / "d.txt").write_text("A B 100.012 0.003\nB C 98.951 0.003\nA C 141.401 0.004\n")
    assert mor("new", tmp_path / "q.yaml", tmp_path / "c.txt", tmp_path / "d.txt").code == 2


def test_names_that_one_cell_joins(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text("T7-T5-T6 84.45\nT4-T5-T6 104.11\nT6-T7 77.315\n")
    columns = ("--columns", "t.txt", "from,to,distance", "--columns", "t.txt", "from,at,to,angle")
    assert " ".join(columns) in mor("new", tmp_path / "p.yaml", tmp_path / "t.txt").err
    assert mor("new", tmp_path / "p.yaml", tmp_path / "t.txt", *columns).code == 0
    assert (tmp_path / "p_t_angle_2.csv").read_text() == "from,at,to,angle\nT7,T5,T6,84.45\nT4,T5,T6,104.11\n"


@pytest.mark.parametrize(("size", "kind"), [(40.0, "horizontal_distance"), (50.0, "distance")])
def test_coordinates_tell_whether_distances_are_horizontal(tmp_path: Path, size: float, kind: str) -> None:
    (tmp_path / "p.csv").write_text("id,x,y,z\nA,0,0,0\nB,40,0,30\nC,0,40,30\nD,-40,0,30\n")
    distances = recognise(tmp_path / "t.csv", f"from,to,distance\nA,B,{size}\nA,C,{size + 0.002}\nA,D,{size - 0.003}\n")
    found, _ = told_apart([*distances, *read_tables(tmp_path / "p.csv")])
    assert found.kind == kind


def test_a_list_that_lacks_points_is_of_known_ones(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("point;Y;X\nP1;100;200\n")
    distances = recognise(tmp_path / "t.csv", "from,to,distance\nP1,P2,10.5\nP2,P3,11.5\n")
    tables = [*distances, *read_tables(tmp_path / "p.csv")]
    assert told_apart(tables)[1].is_control
    assert not told_apart(tables, is_free=True)[1].is_control


def test_computed_columns_of_a_traverse_are_left_out(tmp_path: Path) -> None:
    """Bearings are computed from the angles; distances stand beside the point that they reach, checks below."""
    lines = ["点名,角度,距离,方位角,坐标X,坐标Y", "B0,,,,,", "B,100,,50,0,0", "J,110,82.1,130,5,6", "C,120,77.2,60,8,9"]
    angle, distance, points = recognise(tmp_path / "t.csv", "\n".join([*lines, "C0,,,,,", "精度,,,,,", "差,-10,x,,,"]))
    assert [row[:3] for row in angle.rows] == [("B", "B0", "J"), ("J", "B", "C"), ("C", "J", "C0")]
    assert distance.rows == (("B", "J", "82.1"), ("J", "C", "77.2"))
    assert (points.texts("id"), points.is_control) == (["B", "J", "C"], False)


def test_sights_of_a_station_that_is_not_named_beside_computed_coordinates(tmp_path: Path) -> None:
    lines = ["PUNTO;ANGULO HORIZONTAL;ANGULO VERTICAL;DISTANCIA HORIZONTAL;este;norte", "PTO;H.;V.;Di;E;N"]
    rows = ["1;345.05.45;100.14.55;4.60;1.5;2.5", "2;293.55.15;82.35.45;5.00;3.5;4.5"]
    sights, distances = recognise(tmp_path / "t.csv", "\n".join([*lines, *rows]))
    assert (sights.kind, sights.texts("horizontal")) == ("zenith_directions", ["345-05-45", "293-55-15"])
    assert distances.numbers("distance") == [4.6, 5.0]


def test_a_point_that_a_list_has_twice_is_told(tmp_path: Path) -> None:
    (table,) = recognise(tmp_path / "t.txt", "P1,1000.1,2000.2,50.1\nP2,1001.1,2000.2,50.1\nP2,1002.1,2000.2,50.1\n")
    assert table.texts("id") == ["P1", "P2", "P2"]


def test_the_unit_of_a_length_does_not_fit_an_angle(tmp_path: Path) -> None:
    (table, _) = recognise(tmp_path / "t.csv", "from,to,HA (m),HD (m),HA Error (m)\nA,B,0,10.5,0.1\nA,C,1.1,9.5,0.1\n")
    assert (table.kind, table.units) == ("directions", {})


def test_xml_is_no_table(tmp_path: Path) -> None:
    (tmp_path / "t.xml").write_text("<?xml version='1.0'?>\n<survey><a>1</a></survey>\n")
    assert "XML with the root element <survey>" in mor("new", tmp_path / "p.yaml", tmp_path / "t.xml").err


@pytest.mark.parametrize("columns", ["ID,X(m),Y(m),Z(m),x(mm),y(mm)", "ID,X,Y,Z,x [mm],y [mm]", "ID,X,Y,Z,x_mm,y_mm"])
def test_points_of_one_image_beside_their_coordinates_with_units(tmp_path: Path, columns: str) -> None:
    rows = "1,1000.0,2000.0,50.0,10.5,20.1\n2,1100.0,2050.0,51.0,-30.5,25.1\n3,1050.0,2100.0,55.0,15.5,-40.1\n"
    image, points = recognise(tmp_path / "t.csv", f"{columns}\n{rows}")
    assert (image.kind, image.numbers("x"), image.units["x"]) == ("image", [10.5, -30.5, 15.5], "mm")
    assert (points.numbers("x"), points.is_control) == ([1000.0, 1100.0, 1050.0], True)


@pytest.mark.parametrize("is_elsewhere", [True, False])
def test_a_list_of_points_elsewhere_is_one_of_image_points(tmp_path: Path, is_elsewhere: bool) -> None:
    (tmp_path / "c.csv").write_text("id,x,y,z\nA,100,200,5\nB,110,220,5\nC,150,250,9\nD,170,210,9\n")
    rows = "A,1.5,2.5\nB,-3.5,4.5\nC,2.5,8.5\n" if is_elsewhere else "A,100.5,200.0\nB,109.9,220\nC,150,250.0\n"
    image, control = told_apart(
        [*recognise(tmp_path / "i.csv", f"point,x,y\n{rows}"), *read_tables(tmp_path / "c.csv")]
    )
    assert (image.kind == "image", control.is_control) == (is_elsewhere, is_elsewhere)


def test_tabs_and_blanks_in_one_row(tmp_path: Path) -> None:
    text = "1\t100.1 200.1\t5.2\n2\t110.2  220.3\t6.1\n3\t 150.2 250.1\t7.3\n"
    (tmp_path / "t.txt").write_text(text)
    (table,) = read_tables(tmp_path / "t.txt", ("id", "x", "y", "z"))
    assert [table.numbers(axis) for axis in "xyz"] == [[100.1, 110.2, 150.2], [200.1, 220.3, 250.1], [5.2, 6.1, 7.3]]
    (tmp_path / "a.txt").write_text("A\tB\t10 20 30.5\t5\nA\tC\t20 30 40.5\t6\n")
    directions, _ = read_tables(tmp_path / "a.txt", ("station", "to", "horizontal", "distance"))
    assert len(directions.header) == 4, "degrees, minutes and seconds stay together"


def test_a_number_above_a_table_without_a_header(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text("152.7\n1 100.1 200.1\n2 110.2 220.3\n3 150.2 250.1\n")
    (table,) = read_tables(tmp_path / "t.txt", ("id", "x", "y"))
    assert table.numbers("x") == [100.1, 110.2, 150.2]
    assert "rows with numbers stand above the header: 1 row not read" in table.notes


def test_axes_of_a_traverse_between_known_points(tmp_path: Path) -> None:
    """Only its ends have coordinates: y leads east, x north, and the angles between them close in that sense alone."""
    places = {"A": (0.0, 500.0), "B": (180.0, 350.0), "P": (215.0, 500.0), "C": (460.0, 790.0), "D": (220.0, 915.0)}
    rows = ["id,beta,s_vor,y,x", "A,,,0,500"]
    for before, at, after in zip("ABP", "BPC", "PCD", strict=True):
        back, ahead = (
            math.atan2(places[other][0] - places[at][0], places[other][1] - places[at][1]) for other in (before, after)
        )
        distance = f"{math.dist(places[at], places[after]):.3f}" if after != "D" else ""
        known = ",".join(map(str, places[at])) if at != "P" else ","
        rows.append(f"{at},{(ahead - back) % math.tau * 200.0 / math.pi:.4f},{distance},{known}")
    (tmp_path / "t.csv").write_text("\n".join([*rows, "D,,,220,915"]) + "\n")
    assert mor("new", tmp_path / "p.yaml", tmp_path / "t.csv").code == 0
    assert mor("adjust", tmp_path / "p.yaml", "-q").code == 0
    text = (tmp_path / "p.yaml").read_text(encoding="utf-8")
    assert "axes: {xy: ne}" in text
    assert "fixed: [x, y]" in text
    (found,) = [line for line in (tmp_path / "p.results" / "points.csv").read_text().splitlines() if line[:2] == "P,"]
    assert [float(cell) for cell in found.split(",")[1:3]] == pytest.approx([500.0, 215.0], abs=2e-3)


def test_faces_below_two_headings(tmp_path: Path) -> None:
    text = "测站,目标点,观测角读数,,水平距离（m）,\n,,盘左,盘右,盘左,盘右\n"
    text += "A,B,10 20 30,190 20 36,100.001,100.002\nA,C,95 10 10,275 10 18,60.456,60.458\n"
    directions, distances = recognise(tmp_path / "t.csv", text)
    assert directions.texts("horizontal") == ["10 20 30", "190 20 36", "95 10 10", "275 10 18"]
    assert (distances.kind, distances.numbers("distance")) == (
        "horizontal_distance",
        [100.001, 100.002, 60.456, 60.458],
    )
