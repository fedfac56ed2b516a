"""``mor new``: a project begun from tables is a project, and adjusts when the control is said."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from mor.api.pipeline import read_document
from mor.cli import run
from mor.errors import InputError
from mor.project.level_books import levelled
from mor.project.recognition import Found, read_tables
from mor.project.tables import _text, read_spreadsheet
from tests.scenarios.small_projects import mor
from tests.scenarios.tables import as_spreadsheet, trial

SAMPLES = Path(__file__).parents[2] / "sample_projects"


def recognise(path: Path) -> list[Found]:
    """Tables of a file, with height differences for levelling books."""
    return levelled(read_tables(path))


def test_begun_from_image_points_and_control_alone(tmp_path: Path) -> None:
    """No start values, no list of images, no tie points: it adjusts to the sample's own result."""
    for name in ("image_points.csv", "control.csv"):
        shutil.copy(SAMPLES / "facade" / name, tmp_path)
    project = tmp_path / "p.yaml"
    tables = [str(tmp_path / name) for name in ("image_points.csv", "control.csv")]
    options = ["-c", "28", "--size", "6000", "4000", "--pixel", "0.006 mm", "--title", "A house: mine"]
    assert run(["new", str(project), *tables, *options]) == 0
    assert run(["check", str(project), "--quiet"]) == 0
    text = project.read_text()
    project.write_text(text.replace("fixed: [x, y, z]  # CHECK", "values: {sigma: 5 mm}"))
    assert run(["adjust", str(project), "-o", str(tmp_path / "r"), "--quiet", "--no-html"]) == 0
    truth = pl.read_csv(SAMPLES / "facade" / "truth" / "points.csv", schema_overrides={"id": pl.String})
    found = pl.read_csv(tmp_path / "r" / "points.csv", schema_overrides={"id": pl.String})
    both = found.join(truth, on="id", suffix="_true")
    off = both.select("x", "y", "z").to_numpy() - both.select("x_true", "y_true", "z_true").to_numpy()
    assert both.height > 100
    assert np.sqrt(np.mean(off**2)) < 0.01


def test_begun_from_terrestrial_tables(tmp_path: Path) -> None:
    names = ("directions_plates.csv", "distances_plates.csv", "levelling.csv", "building.csv")
    project = tmp_path / "net.yaml"
    assert run(["new", str(project), *(str(SAMPLES / "building" / name) for name in names)]) == 0
    data = read_document(project).data
    assert [entry["type"] for entry in data["observations"]] == [
        "zenith_directions",
        "distance",
        "height_difference",
    ]
    assert [entry.get("values") is None for entry in data["observations"]] == [False, False, True]
    assert run(["check", str(project), "--quiet"]) == 0


def test_stations_over_points_and_both_heights(tmp_path: Path) -> None:
    names = ("directions.csv", "distances.csv", "stations.csv", "pillars.csv")
    project = tmp_path / "net.yaml"
    assert run(["new", str(project), "--datum", "free", *(str(SAMPLES / "bridge" / name) for name in names)]) == 0
    data = read_document(project).data
    assert data["stations"] == [{"file": os.path.relpath(SAMPLES / "bridge" / "stations.csv", tmp_path)}]
    assert all("columns" not in entry for entry in data["observations"])
    assert run(["adjust", str(project), "-o", str(tmp_path / "r"), "--quiet", "--no-html", "--strict"]) in (
        0,
        1,
    )


def test_empty_beginning_is_a_project_with_nothing_in_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    project = tmp_path / "p.yaml"
    assert run(["new", str(project)]) == 0
    assert run(["check", str(project)]) == 2
    assert "there are no observations" in capsys.readouterr().err


def test_columns_in_other_words_and_units(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("Photo;Point ID;x_mm;y [mm];quality\n1;010;1.5;-2;9\n".replace("Point ID", "point_id"))
    (found,) = recognise(path)
    assert found.kind == "image"
    assert found.columns == {"image": "Photo", "point": "point_id", "x": "x_mm", "y": "y [mm]"}
    assert found.units == {"x": "mm", "y": "mm"}
    assert found.delimiter == ";"
    assert found.unused == ("quality",)
    assert found.texts("point") == ["010"]


@pytest.mark.parametrize(
    ("header", "kind"),
    [
        ("id,x,y,z,omega,phi,kappa", "images"),
        ("image,X0,Y0,Z0,omega,phi,kappa", "images"),
        ("Name,X,Y,Z", "points"),
        ("Photo,X,Y,Z", "images"),
        ("image,point,x,y,z", "image"),
        ("von,nach,Strecke", "distance"),
        ("at,from,to,angle", "angle"),
        ("from,to,dx,dy,dz", "vector"),
        ("From,To,dX,dY,dZ,cxx,cxy,cxz,cyy,cyz,czz", "vector"),
        ("Point,Easting,Northing,Elevation", "points"),
        ("id,E,N,H", "points"),
        ("Punktnummer;Rechtswert;Hochwert;Höhe", "points"),
        ("target x y z", "points"),
        ("image,id,u,v", "image"),
        ("photo,target,col,row", "image"),
        ("Station,Target,Hz,V", "zenith_directions"),
        ("Standpunkt;Ziel;Hz;V;Schrägstrecke", "zenith_directions"),
        ("from,to,zenith angle", "zenith_angle"),
        ("from,to,slope distance", "distance"),
        ("Δx,id,to,from", None),
        ("from,to,dh", "height_difference"),
        ("station,to,horizontal,vertical", "directions"),
        ("PtNo,Easting,Northing,Elevation,Remark", "points"),
        ("GCP_Name,X_GCP,Y_GCP,Z_GCP,ErrorX", "points"),
        ("image_name,gcp_id,col,row", "image"),
        ("Image,Marker,X (px),Y (px)", "image"),
        ("SETUP,TARGET,HAR,VA,SD,TH,IH", "zenith_directions"),
        ("Std;Ziel;Hz [gon];V [gon];SD [m]", "zenith_directions"),
        ("Occupied,Backsight,Foresight,Angle Right,Distance", "angle"),
        ("Occupied,Backsight,Foresight,Horizontal Angle,Distance", "angle"),
        ("from,to,height_diff,distance_km", "height_difference"),
        ("PktNr;E-Koord;N-Koord;H-Koord", "points"),
        ("from_pillar,to_pillar,slope_distance", "distance"),
        ("from,to,dh,distance", "height_difference"),
        ("from,to,dh,slope distance", "distance"),
        ("Station,BS,Foresight,Hz", "directions"),
        ("Station;PunktNr;Hz-Winkel;V-Winkel;Schrägdistanz;Instrumentenhöhe;Reflektorhöhe", "zenith_directions"),
        ("Station,Pt visé,Hz,Vz,Di,hi,hp", "zenith_directions"),
        ("Estación,Punto visado,Ángulo horizontal,Ángulo cenital,Distancia inclinada", "zenith_directions"),
        ("Stazione,Punto battuto,Angolo orizzontale,Angolo zenitale,Distanza inclinata", "zenith_directions"),
        ("Point,BS,IS,FS,Rise,Fall,RL,Distance", "height_difference"),
    ],
)
def test_what_a_table_is(tmp_path: Path, header: str, kind: str | None) -> None:
    path = tmp_path / "t.csv"
    path.write_text(f"{header}\n", encoding="utf-8")
    if kind is None:
        with pytest.raises(InputError, match="unknown kind of table"):
            recognise(path)
    else:
        assert recognise(path)[0].kind == kind


def _recognised(tmp_path: Path, text: str) -> list[tuple[str, dict[str, str]]]:
    path = tmp_path / "t.csv"
    path.write_text(text, encoding="utf-8")
    return [(found.kind, dict(found.columns)) for found in recognise(path)]


@pytest.mark.parametrize(
    ("values", "kinds"),
    [
        (("89.5", "91.25"), [("zenith_directions", "zenith")]),
        (("-0.5", "1.25"), [("directions", "vertical")]),
        (("2-30-15", "-12-01-00"), [("directions", "vertical")]),
        (("270.5", "268.75"), [("zenith_directions", "zenith")]),
    ],
)
def test_vertical_angles_are_zenith_angles_or_elevations_by_their_values(
    tmp_path: Path, values: tuple[str, str], kinds: list[tuple[str, str]]
) -> None:
    rows = "".join(f"A,P{k},{10 * k}.5,{value}\n" for k, value in enumerate(values))
    found = _recognised(tmp_path, f"Station,Target,Horizontal Angle,Vertical Angle\n{rows}")
    assert [(kind, next(c for c in columns if columns[c] == "Vertical Angle")) for kind, columns in found] == kinds


def test_elevations_between_points(tmp_path: Path) -> None:
    ((kind, columns),) = _recognised(tmp_path, "from,to,Vertical Angle\nA,B,3.5\nA,C,-4.5\n")
    assert (kind, columns["vertical_direction"]) == ("vertical_direction", "Vertical Angle")


def test_an_angle_from_a_backsight_has_its_distance_to_the_foresight(tmp_path: Path) -> None:
    head = "Occupied,Backsight,Foresight,Angle Right,Distance"
    found = _recognised(tmp_path, f"{head}\nS1,A,B,90.5,100.1\nB,S1,C,180.2,50.0\n")
    assert found == [
        ("angle", {"at": "Occupied", "from": "Backsight", "to": "Foresight", "angle": "Angle Right"}),
        ("distance", {"from": "Occupied", "to": "Foresight", "distance": "Distance"}),
    ]


def test_the_distance_of_a_levelling_line_is_its_length(tmp_path: Path) -> None:
    table, project = tmp_path / "lines.csv", tmp_path / "p.yaml"
    table.write_text("from,to,height_diff,distance_km\nA,B,1.234,0.5\nB,C,-0.5,0.4\nC,A,-0.733,0.3\n")
    assert run(["new", str(project), str(table), "--datum", "free"]) == 0
    (entry,) = read_document(project).data["observations"]
    assert (entry["type"], entry["columns"]) == (
        "height_difference",
        {"height_diff": "dz", "distance_km": "length"},
    )
    assert entry["units"] == {"length": "km"}


def test_a_list_of_points_with_codes_needs_no_head(tmp_path: Path) -> None:
    table, project = tmp_path / "points.txt", tmp_path / "p.yaml"
    table.write_text("1,5000.00,4000.00,100.0,TBM\n2,5010.00,4010.00,101.0,\n")
    assert run(["new", str(project), str(table)]) == 0
    (entry,) = read_document(project).data["points"]
    assert entry["columns"] == ["id", "x", "y", "z", None]


def test_standard_deviations_by_axis(tmp_path: Path) -> None:
    ((_, columns),) = _recognised(tmp_path, "NAME,NORTHING,EASTING,HEIGHT,SD_N,SD_E,SD_H\nA,1,2,3,1,2,3\n")
    assert columns == {
        "id": "NAME",
        "x": "EASTING",
        "y": "NORTHING",
        "z": "HEIGHT",
        "sigma_x": "SD_E",
        "sigma_y": "SD_N",
        "sigma_z": "SD_H",
    }


FIELD_BOOK = """Station;Ziel;Hz;V;Strecke;ih;th;Bemerkung
1;2;0,0000;100,0000;50,000;1,5;1,5;Pfeiler
1;3;50,0000;100,0000;70,7107;1,5;1,5;
2;1;200,0000;100,0000;50,000;1,5;1,5;
2;3;100,0000;100,0000;50,000;1,5;1,5;
"""
CONTROL = "Name;X;Y;Z\n1;0,0;0,0;0,0\n2;0,0;50,0;0,0\n"


def _in_utf_16(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-16")
    return path


@pytest.mark.parametrize("written", [_in_utf_16, as_spreadsheet])
def test_a_field_book_in_german_becomes_two_groups_that_adjust(
    tmp_path: Path, written: Callable[[Path, str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """Decimal commas, German names, a remark that is not used: the third corner of a square of 50 m is found."""
    book, control = written(tmp_path / "book.csv", FIELD_BOOK), written(tmp_path / "control.csv", CONTROL)
    project = tmp_path / "p.yaml"
    assert run(["new", str(project), str(book), str(control)]) == 0
    assert "columns not used: Bemerkung" in capsys.readouterr().err
    data = read_document(project).data
    assert [entry["type"] for entry in data["observations"]] == ["zenith_directions", "distance"]
    name = f"file: {control.name}\n"
    project.write_text(project.read_text().replace(name, f"{name}    values: {{sigma: 1 mm}}\n"))
    assert run(["adjust", str(project), "-o", str(tmp_path / "r"), "--quiet", "--no-html"]) == 0
    found = pl.read_csv(tmp_path / "r" / "points.csv", schema_overrides={"id": pl.String})
    corner = found.filter(pl.col("id") == "3").select("x", "y").row(0)
    assert corner == pytest.approx((50.0, 50.0), abs=1e-3)


def test_covariances_of_vectors_are_used_and_their_unit_is_asked_for(tmp_path: Path) -> None:
    table = tmp_path / "gnss.csv"
    table.write_text(
        "from,to,dX,dY,dZ,cxx,cxy,cxz,cyy,cyz,czz\nA,B,1,2,3,5.3,0.5,3.3,2.3,0.5,5.9\nB,C,1,2,3,5.3,0.5,3.3,2.3,0.5,5.9\n"
    )
    project = tmp_path / "p.yaml"
    assert run(["new", str(project), str(table), "--datum", "free"]) == 0
    assert "cov_dx_dx: mm" in project.read_text()
    assert "# CHECK: the standard deviations are no usual ones" in project.read_text()
    assert run(["check", str(project), "--quiet"]) == 0


def test_a_list_of_points_without_header(tmp_path: Path) -> None:
    table = tmp_path / "points.txt"
    table.write_text("A 1 2 3\nB 2 3 4\n")
    (found,) = recognise(table)
    assert (found.kind, found.has_header, found.texts("id")) == ("points", False, ["A", "B"])


def test_every_sheet_that_holds_something_known_is_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = as_spreadsheet(
        tmp_path / "p.csv",
        "name;x;y\nA;0;0\nB;100;0\nC;0;100\nP;40;30",
        "from;to;distance\nA;P;50\nB;P;67.082\nC;P;80.623",
        "remark;by\nnone;me",
    )
    project = tmp_path / "p.yaml"
    assert run(["new", str(project), str(table)]) == 0
    assert "sheets not used: U" in capsys.readouterr().err
    data = read_document(project).data
    assert [entry["sheet"] for entry in (data["points"][0], data["observations"][0])] == ["S", "T"]
    assert data["settings"]["dimensions"] == "xy", "the points have no heights"
    assert run(["check", str(project), "--quiet"]) == 0


def test_the_degree_sign_of_windows(tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    table.write_bytes('station,to,hz\nA,B,"037° 02\' 59"""\n'.encode("cp1252"))
    (found,) = recognise(table)
    assert found.texts("horizontal") == ["037° 02' 59\""]
    table.write_bytes("station,to,hz\nA,Bä,1\n".encode("cp1252"))
    assert recognise(table)[0].texts("to") == ["Bä"]
    table.write_bytes(b"station,to,hz\nA,B\xff\x00,1\n")
    with pytest.raises(InputError, match="not UTF-8"):
        recognise(table)


def test_a_table_of_windows_is_copied(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, project = tmp_path / "t.csv", tmp_path / "p.yaml"
    table.write_bytes("Station;Ziel;Hz;Schrägdistanz\nA;Tür;0,5;12,25\n".encode("cp1252"))
    assert run(["new", str(project), str(table)]) == 0
    assert capsys.readouterr().err.count("read as cp1252 (Windows, Western European): check the names") == 1
    assert "A;Tür;0,5;12,25" in (tmp_path / "p_t.csv").read_text(encoding="utf-8")
    assert run(["check", str(project), "--quiet"]) == 0


@pytest.mark.parametrize(
    "text",
    [
        "Road\nPoint,B.S.,I.S.,F.S.,RL\nM,1.5,,,100\nP,,1.25,,100.25\nT,.8,,2.1,99.4\nM,,,0.201,99.999\nSum,2.3,,2.301,\n",
        "No.,Station,BS,FS\n1,M,1.5,\n2,P,,1.25\n3,T,.8,2.1\n4,M,,0.201\n\nΣBS,2.3,ΣFS,2.301\n",
        "Punkt;Rückblick;Zwischenblick;Vorblick\nM;1,500;;\nP;;1,250;\nT;;;2,100\nT;0,800;;\nM;;;0,201\n",
        "Matricule;AR;Inter;AV\nM;1500;;\nP;;1250;\nT;800;;2100\nM;;;201\n",
        "Punto\tAtrás\tIntermedia\tAdelante\nM\t1.5\t-\t-\nP\t-\t1.25\t-\nT\t0.8\t-\t2.1\nM\t-\t-\t0.201\n",
    ],
)
def test_a_levelling_book_becomes_height_differences(
    tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """M, T, M: 1.5 - 2.1 and 0.8 - 0.201; P is 1.5 - 1.25 above M. Sums and computed heights are no readings."""
    table, project = tmp_path / "t.csv", tmp_path / "p.yaml"
    table.write_text(text, encoding="utf-8")
    assert run(["new", str(project), str(table), "--datum", "free"]) == 0
    told = capsys.readouterr().err
    assert "3 height differences from the staff readings" in told
    assert ("sums of the readings: 1 row" in told) is ("Sum" in text)
    assert ("rows without readings: 1 row" in told) is ("Σ" in text)
    assert ("the height of M is taken over; 3 heights below not used" in told) is ("RL" in text)
    assert run(["adjust", str(project), "-o", str(tmp_path / "r"), "--quiet", "--no-html"]) == 0
    data = json.loads((tmp_path / "r" / "results.json").read_text())
    assert sorted(row["v"] for row in data["residuals"]) == pytest.approx([0.0, 0.0005, 0.0005], abs=1e-9)
    heights = dict(pl.read_csv(tmp_path / "r" / "points.csv").select("id", "z").iter_rows())
    assert heights["P"] - heights["M"] == pytest.approx(0.25)
    assert heights["T"] - heights["M"] == pytest.approx(-0.5995)


def test_two_lines_with_sums_in_one_levelling_book(tmp_path: Path) -> None:
    """There and back: the sums of the first line are no readings, and readings without a name are of other points."""
    text = (
        "Estación;PV;Vista (+);Cota;Vista (-)\nE1;M;1,5;100;\n;A;;;1,25\n;T;;;1,0\nE2;T;1,25;;\n;N;;;0,75\n"
        ";;2,75;;1,75\nVUELTA;;;;\nEstación;PV;Vista (+);Cota;Vista (-)\nE3;N;1,0;;\n;;;;1,25\n;;;;1,5\n;M;;;2,0\n"
    )
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    table, benchmark = recognise(tmp_path / "t.csv")
    assert set(table.rows) == {
        ("M", "A", "0.25"),
        ("M", "T", "0.5"),
        ("T", "N", "0.5"),
        ("N", "M", "-1"),
        ("N", "line 11", "-0.25"),
        ("N", "line 12", "-0.5"),
    }
    assert "sums of the readings: 1 row" in table.notes
    assert (benchmark.kind, benchmark.rows) == ("points", (("M", "100"),))


def test_a_levelling_book_of_two_instruments(tmp_path: Path) -> None:
    """Each instrument has columns of its own; a reading of 0 is none."""
    (tmp_path / "t.csv").write_text("Matricule,AR 1,AV 1,AR 2,AV 2\nA,1.5,0,1.6,0\nT,1.2,1.0,1.3,1.1\nB,0,0.9,0,1.0\n")
    (table,) = recognise(tmp_path / "t.csv")
    assert table.rows == (("A", "T", "0.5"), ("T", "B", "0.3"), ("A", "T", "0.5"), ("T", "B", "0.3"))


def test_rows_without_readings_are_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Programs write dashes into empty cells, and known points into the table of the sights."""
    rows = "---;A;100;---;---;---\nA;B;---;10;100;50\nA;C;---;20;99;---\n"
    (tmp_path / "t.csv").write_text(f"Station;Ziel;X;Hz;V;SD\n{rows}")
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "t.csv")]) == 0
    assert "rows without readings: 1 row" in capsys.readouterr().err
    assert (tmp_path / "p_t_zenith_directions.csv").read_text().split()[1:] == ["A;B;;10;100;50", "A;C;;20;99;"]
    assert (tmp_path / "p_t_distance.csv").read_text().split()[1:] == ["A;B;;10;100;50"]
    assert run(["check", str(tmp_path / "p.yaml"), "--quiet"]) == 0


@pytest.mark.parametrize(
    "head",
    [
        "Degrees,Minutes,Seconds",
        '°,\',""""',
        "GRADO,MIN,SEG",
        "Angle D,Angle M,Angle S",
        "ANGLE_DEG,ANGLE_MIN,ANGLE_SEC",
    ],
)
def test_degrees_minutes_and_seconds_in_three_columns(tmp_path: Path, head: str) -> None:
    (tmp_path / "t.csv").write_text(f"At,From,To,{head},Remark\nA,B,C,120,5.0,30.5,x\nB,C,A,-30,,0,\nC,A,B,,,,\n")
    (table,) = recognise(tmp_path / "t.csv")
    assert (table.kind, table.texts("angle")) == ("angle", ["120-5-30.5", "-30-0-0"])
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "t.csv"), "--angle", "deg"]) == 0
    (entry,) = read_document(tmp_path / "p.yaml").data["observations"]
    assert entry["units"] == {"angle": "dms"}
    assert run(["check", str(tmp_path / "p.yaml"), "--quiet"]) == 0


def test_a_field_book_is_no_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "book.txt").write_text("*110001+00000000000000A1 21.322+0000000010000000 22.322+0000000010000000\n" * 2)
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "book.txt")]) == 2
    assert (
        "this is no table but a file of Leica GSI-8, GSI-16; mor convert or mor adjust reads" in capsys.readouterr().err
    )


def test_staff_readings_whose_side_a_code_says(tmp_path: Path) -> None:
    """Each reading has a row, results have codes of their own, and each part of the list begins with its header."""
    head = "No\tPtNo\tHeight\tDistance\tMeas_Type\tElevation\n\t\t[m]\t[m]\t\t[m]\n"
    text = (
        f"Levelling list\n\nBFFB\n{head}"
        "1\tA\t1.5000\t20\tB\t10.0000\n2\tP\t1.2000\t22\tF\t0.0000\n3\tP\t1.2010\t24\tF\t0.0000\n"
        "4\tA\t1.4990\t22\tB\t0.0000\n5\tP\t1.2005\t23\tBFFB-mean\t10.2990\n\n"
        f"BF\n{head}6\tP\t1.1000\t30\tB\t10.2990\n7\tK\t1.3000\t12\tI\t10.0990\n8\tQ\t1.6000\t31\tF\t9.7990\n"
    )
    (tmp_path / "t.txt").write_bytes(text.encode("utf-16"))
    differences, benchmark = recognise(tmp_path / "t.txt")
    assert differences.rows == (("A", "P", "0.299", "44"), ("P", "Q", "-0.5", "61"), ("P", "K", "-0.2", "42"))
    assert (benchmark.rows, benchmark.is_control) == ((("A", "10.0000"),), True)
    assert "points that several books have are the same points: P" in differences.notes
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "t.txt")]) == 0
    assert run(["adjust", str(tmp_path / "p.yaml"), "-o", str(tmp_path / "r"), "--quiet", "--no-html"]) == 0
    assert pl.read_csv(tmp_path / "r" / "points.csv").filter(id="Q")["z"][0] == pytest.approx(9.799, abs=1e-6)


def test_set_ups_that_were_read_twice_have_two_rows(tmp_path: Path) -> None:
    """The first row of a set-up names the point behind, the second one that ahead; a row with the mean follows."""
    text = (
        "Fieldbook\nUnits;[m]\nBFFB\nPtID;BS_Height;IS_Height;FS_Height;dH;Mean_dH;Elevation;BS_Dist;IS_Dist;FS_Dist\n"
        "A;1.500;;1.200;0.300;;10.5;20;;22\nP;1.499;;1.201;0.298;;;22;;24\nP;;;;;0.299;10.799;;;\n"
        "P;1.100;;1.600;-0.500;;10.799;30;;31\nA;1.102;;1.600;-0.498;;;30;;31\nA;;;;;-0.499;10.3;;;\n"
    )
    differences, benchmark = recognise(as_spreadsheet(tmp_path / "t.csv", text))
    assert differences.rows == (("A", "P", "0.299", "44"), ("P", "A", "-0.499", "61"))
    assert benchmark.rows == (("A", "10.5"),)


def test_files_of_one_name_get_copies_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text("from,to,distance\n,,m\nA,B,10.001\nB,C,12.002\n")
    (tmp_path / "d.txt").write_text("from\tto\tdz\n\t\tm\nA\tB\t0.5\nA\tC\t0.7\nB\tC\t0.2\n")
    said = mor("new", tmp_path / "p.yaml", tmp_path / "d.csv", tmp_path / "d.txt").err
    assert "p_d.csv in UTF-8" in said
    assert "p_d_2.csv in UTF-8" in said
    assert len((tmp_path / "p_d.csv").read_text().splitlines()) == 3
    assert len((tmp_path / "p_d_2.csv").read_text().splitlines()) == 4


def test_levelling_books_below_each_other(tmp_path: Path) -> None:
    """A turning point of the same name is another point, a benchmark is not; a page goes on with its last point."""
    head = "Start elevation,Point,FS,BS\n"
    text = f"Book 1\n{head}100,A,,1.5\n,T,1.0,\n{head},T,,1.2\n,B,1.4,\nBook 2\n{head}90,C,,1.0\n,T,0.5,2.0\n,B,0.7,\n"
    (tmp_path / "t.csv").write_text(text)
    differences, benchmark = recognise(tmp_path / "t.csv")
    assert [row[:3] for row in differences.rows] == [
        ("A", "T", "0.5"),
        ("T", "B", "-0.2"),
        ("C", "T (2)", "0.5"),
        ("T (2)", "B", "1.3"),
    ]
    assert benchmark.rows == (("A", "100"), ("C", "90"))
    assert "points of the same name in other books are other points: T" in differences.notes
    (tmp_path / "t.csv").write_text(text.replace("90,C", "90,A"))
    with pytest.raises(
        InputError, match=r"t.csv:10: the books that begin here and in t.csv:3 give point A the heights"
    ):
        recognise(tmp_path / "t.csv")


def test_three_wires_with_their_mean_and_intervals_in_two_sheets(tmp_path: Path) -> None:
    """Turning points of both runs are different ones; a third sheet has the first run again; one wire is wrong."""
    there = (
        "Point;BS;INT;FS;INT\nBM A;1,5;;;\n;1,4;0,1;;\n;1,3;0,1;;\n;1,4;20;;\n;;20;;\nT1;1,6;;1,2;\n;1,5;0,1;1,1;0,1\n"
        ";1,4;0,1;1,0;0,1\n;1,5;20;1,1;20\nB;;;1,9;\n;;;1,8;0,1\n;;;1,6;0,2\nSum;2,9;;2,9;\n"
    )
    back = (
        "Point;BS;INT;FS;INT\nB;1,9;;;\n;1,8;;;\n;1,7;;;\nT1;1,5;;1,3;\n;1,4;;1,2;\n;1,3;;1,1;\n"
        "BM A;1,5;;1,8;\n;1,4;;1,7;\n;1,3;;1,6;\nC;;;1,4;\n;;;1,3;\n;;;1,2;\n"
    )
    first, second = recognise(as_spreadsheet(tmp_path / "t.csv", there, back, there))
    assert first.rows == (("BM A", "T1", "0.3", "40"), ("T1", "B", "-0.3", "50"))
    assert second.rows == (("B", "T1 (2)", "0.6", "40"), ("T1 (2)", "BM A", "-0.3", "40"), ("BM A", "C", "0.1", "40"))
    assert "wires that contradict each other, of which the middle one is read, with rows: B (11)" in first.notes
    assert "names without three wires left out: Sum" in first.notes
    assert "t.xlsx U has the same readings: not used once more" in first.notes


def test_a_levelling_book_there_and_back_beside_each_other(tmp_path: Path) -> None:
    """Each is read; the height that the second one begins with is a result of the first one."""
    text = (
        "PV;Vista (+);Vista (-);Cota;;PV;Vista (+);Vista (-);Cota\nBM1;1,5;;100;;BM2;1,0;;100,3\n"
        "P;1,4;1,1;100,4;;P;1,3;0,9;100,4\nBM2;;1,5;100,3;;BM1;;1,7;100\n"
    )
    there, benchmark, back = recognise(as_spreadsheet(tmp_path / "t.csv", text))
    assert there.rows == (("BM1", "P", "0.4"), ("P", "BM2", "-0.1"))
    assert back.rows == (("BM2", "P", "0.1"), ("P", "BM1", "-0.4"))
    assert benchmark.rows == (("BM1", "100"),)
    assert len({table.copy(tmp_path / "p.yaml") for table in (there, benchmark, back)}) == 3


def test_a_table_below_that_begins_alike_is_another_one(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text(
        "    Sta   bsU   bsM   bsL   fsU   fsM   fsL\n0     A 1.500 1.400 1.300   NaN   NaN   NaN\n"
        "1     T 1.600 1.500 1.400 1.200 1.100 1.000\n2     B   NaN   NaN   NaN 1.900 1.800 1.700\n"
        "    Sta  bsMean fsMean  Height\n0     A   1.400    NaN   0.000\n1     T   1.500  1.100   0.300\n"
    )
    (table,) = recognise(tmp_path / "t.txt")
    assert table.rows == (("A", "T", "0.3", "40"), ("T", "B", "-0.3", "40"))
    assert "another table begins below (columns Sta, bsMean, fsMean, Height): 2 rows not read" in table.notes


def test_angles_whose_digits_are_degrees_minutes_and_seconds(tmp_path: Path) -> None:
    """All have minutes and seconds below 60, as no column of decimal degrees has by chance; one is nearly 0."""
    text = "Base Point;HI;Tgt.Pt;HR;Hor.Angle;Zenith Ang;Slope Dist\n"
    rows = [(f"{20 * k}.{13 + k}{10 + k}{k % 10}", f"89.{20 + k}{30 + k}5") for k in range(1, 14)]
    rows.append(("0.00005", "90"))
    text += "".join(f"S;1.5;P{k};1.4;{hz};{v};100.{k}\n" for k, (hz, v) in enumerate(rows))
    directions, _ = recognise(as_spreadsheet(tmp_path / "t.csv", text))
    assert directions.texts("horizontal")[0] == "20-14-11.1"
    assert directions.texts("horizontal")[-1] == "0-00-00.5"
    assert directions.texts("zenith")[-2:] == ["89-33-43.5", "90-00-00"]
    assert "column 'Hor.Angle': degrees, minutes and seconds as d.mmss" in directions.notes
    (other,) = recognise(as_spreadsheet(tmp_path / "u.csv", text.replace("20.1411", "20.8411")))[:1]
    assert other.texts("horizontal")[0] == "20.84111"


def test_tables_beside_each_other(tmp_path: Path) -> None:
    """Titles above, and empty columns, part them: known and approximate coordinates, distances, a remark."""
    text = (
        "KNOWN COORDINATES;;;;START VALUES;;;DISTANCES;;;;So\nNN;Y (m);X (m);;NN;Y (m);X (m);DN;BN;KENAR (m);ms (mm);\n"
        "1;200;100;;3;260;180;1;3;100;2;1\n2;200;300;;;;;2;3;134.164;3;\n4;300;100;;;;;4;3;89.443;2;\n"
    )
    known, start, distances = recognise(as_spreadsheet(tmp_path / "t.csv", text))
    assert [(table.texts("id"), table.is_control) for table in (known, start)] == [
        (["1", "2", "4"], True),
        (["3"], False),
    ]
    assert distances.rows == (("1", "3", "100", "2"), ("2", "3", "134.164", "3"), ("4", "3", "89.443", "2"))
    assert distances.units == {"distance": "m", "sigma": "mm"}
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "t.xlsx")]) == 0
    points = read_document(tmp_path / "p.yaml").data["points"]
    assert [entry.get("fixed") for entry in points] == [["x", "y"], None]
    assert run(["adjust", str(tmp_path / "p.yaml"), "-o", str(tmp_path / "r"), "--quiet", "--no-html"]) == 0
    new = pl.read_csv(tmp_path / "r" / "points.csv").filter(id=3).select("x", "y").row(0)
    assert new == pytest.approx((180.0, 260.0), abs=2e-3)


def test_a_table_of_unknown_columns_is_named_by_those_that_are_known(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("Survey,of,June\nFrom,To,Weather\nA,B,dry\n")
    with pytest.raises(InputError, match=r"t.csv:2: unknown kind of table: found the columns From, To, Weather"):
        recognise(tmp_path / "t.csv")


def test_distances_and_both_points_of_a_levelling_book(tmp_path: Path) -> None:
    text = "From,To,Backsight (mm),Foresight (mm),BS Dist,FS Dist\nA,B,1500,1000,20,21\nB,A,1000,1501,22,20\n"
    (tmp_path / "t.csv").write_text(text)
    (table,) = recognise(tmp_path / "t.csv")
    assert table.header == ("from", "to", "dz", "length")
    assert table.rows == (("A", "B", "500", "41"), ("B", "A", "-501", "42"))
    assert table.units == {"dz": "mm"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("A,1.5,1.2\nB,1.0,0.9\n", "t.csv:2: found readings back and forward"),
        ("A,1.5,\nB,,1.2O\n", "t.csv:3: column FS: found '1.2O', expected a number"),
        ("A,1.5,\n", "no set-up has readings back and forward"),
    ],
)
def test_levelling_books_that_are_none(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "t.csv").write_text(f"Point,BS,FS\n{text}")
    with pytest.raises(InputError, match=words):
        recognise(tmp_path / "t.csv")


def test_sheets_of_a_spreadsheet_must_be_named_if_missing(tmp_path: Path) -> None:
    table = as_spreadsheet(tmp_path / "p.csv", CONTROL)
    assert read_spreadsheet(table, "S").rows() == [("1", "0", "0", "0"), ("2", "0", "50", "0")]
    with pytest.raises(InputError, match="found no sheet 'T'"):
        read_spreadsheet(table, "T")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("a,b,c\n1,2,3\n", "no line has the names of the columns of a known table"),
        ("n,dist\n1,2,9\nA,P1,P2\n31.1\nP1,A,0.893,15\nA,P2,9.125,20\n", "no line has the names of the columns"),
        (
            "point,x,y,X,Y,Z\nP1,-86,-68,365,252,21\nP1,-53,82,365,252,21\n",
            "need a column with the name of their image",
        ),
        ("1,2,3\n", "expected a header"),
        (
            "A;B;3,5;0.5\nB;C;3,4;0.5\n",
            "expected a header with the names of the columns, which are 1: A, B; 2: B, C; 3: 3,5, 3,4; 4: 0.5; or give "
            "their names, as in mor new PROJECT t.csv --columns t.csv from,to,distance,sigma",
        ),
        ("", "t.csv:1: this text has no rows"),
        ("# id,x,y\n# A,1,2\n", "t.csv:1: this text has no rows"),
    ],
)
def test_tables_nobody_knows(tmp_path: Path, content: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "t.csv"
    path.write_text(content)
    assert run(["new", str(tmp_path / "p.yaml"), str(path)]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "p.yaml").exists()


@pytest.mark.parametrize(
    ("content", "names", "kind", "written"),
    [
        ("A,B,10.02\nB,C,13.20\n", "from,to,distance", "distance", "from,to,distance\nA,B,10.02\nB,C,13.20\n"),
        ("Otsikko\nA,B,7,13.20\n", "from,to,-,dist", "distance", "from,to,column3,dist\nA,B,7,13.20\n"),
        ("mista;mihin;ero\nA;B;13,2\n", "from,to,dz", "height_difference", "from;to;dz\nA;B;13,2\n"),
        ("A B 13,2 0,5\n", "from,to,dz,length", "height_difference", "from;to;dz;length\nA;B;13,2;0,5\n"),
    ],
)
def test_columns_may_be_named(
    tmp_path: Path, content: str, names: str, kind: str, written: str, capsys: pytest.CaptureFixture[str]
) -> None:
    table, project = tmp_path / "t.csv", tmp_path / "p.yaml"
    table.write_text(content)
    assert run(["new", str(project), str(table), "--columns", "t.csv", names]) == 0
    assert f"t.csv: {kind}," in capsys.readouterr().err
    assert (tmp_path / "p_t.csv").read_text() == written


FORM = "from,to,HzD,HzM,HzS,HD,SD,dh,sd_Hz,sd_dist,sd_dh\n"


@pytest.mark.parametrize(
    ("tables", "said", "written"),
    [
        # columns of a form that are empty in all rows are those of other kinds of readings
        (
            {"o": FORM + "A,B,,,,,,1.5,,,\nB,C,,,,,,0.5,,,\n"},
            ["o.csv: height_difference, 2 rows"],
            ["values: {sigma: 1 mm}"],
        ),
        (
            {"o": FORM + "A,B,10,5,30,99.5,,,1,2,\nA,C,20,5,0,9.5,,,1,2,\n"},
            ["o.csv: directions, 2 rows", "o.csv: horizontal_distance, 2 rows"],
            ["sigma: arcsec", "sigma: mm"],
        ),
        # lists by numbers of their own, of points whose heights nothing measures
        (
            {
                "o": "from,to,hz,hd\nP1,P2,0,50\nP1,P3,40,60\nP2,P3,50,45\n",
                "p": "id,Name,x,y,h\n1,P1,0,0,9\n2,P2,50,0,8\n3,P3,40,40,7\n",
            },
            ["p.csv: columns not used: id"],
            ["Name: id", "fixed: [z]"],
        ),
        # heights without places
        (
            {"o": "from,to,dh\nA,B,1\n", "p": "id,x,y,h\nA,,,5\nB,,,6\n"},
            ["p.csv: points, 2 rows"],
            ["values: {x: 0, y: 0}"],
        ),
        # rows that are switched off, and what is fixed beside former standard deviations
        (
            {
                "o": "from,to,dh,ignore\nA,B,1,\nA,B,2,x\nB,C,1,\n",
                "p": "id,h,sigma,fixed\nA,5,0.5,x\nB,6,0.5,\nC,7,0.5,\n",
            },
            ["rows that the column ignore leaves out: 1 row", "beside a column that says what is fixed are not used"],
            ["column3: null"],
        ),
        # the length of a levelling line
        ({"o": "from,to,dh,s (Km)\nA,B,1,0.3\n"}, ["o.csv: height_difference, 1 row"], ["length: km"]),
        # σ in radians
        ({"o": "at,from,to,angle,sigma\nA,B,C,30.5,2.4e-05\n"}, ["angle, 1 row"], ["sigma: rad"]),
        # directions that begin anew near 360 are degrees
        ({"o": "station,to,hz\nA,B,0\nA,C,20\nA,B,359.99\nB,A,359.98\nB,C,3\n"}, [], ["angle: deg  # CHECK"]),
        # a first line with the number of rows; σ of vectors by their axes; Chinese names
        ({"p": "3\nA,1,2,3\nB,4,5,6\nC,7,8,9\n"}, ["p.csv: points, 3 rows"], []),
        ({"o": "from,to,dx,dy,dz,sx,sy,sz\nA,B,1,2,3,4,5,6\n"}, ["o.csv: vector, 1 row"], ["sx: sigma_dx"]),
        ({"o": "测站,目标,斜距(米)\nA,B,10.5\n"}, ["o.csv: distance, 1 row"], ["斜距(米): distance"]),
    ],
)
def test_tables_of_other_programs(
    tmp_path: Path,
    tables: dict[str, str],
    said: list[str],
    written: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name, text in tables.items():
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    project = tmp_path / "n.yaml"
    assert run(["new", str(project), *(str(tmp_path / f"{name}.csv") for name in tables)]) == 0
    told, text = capsys.readouterr().err, project.read_text(encoding="utf-8")
    assert [words for words in said if words not in told] == []
    assert [words for words in written if words not in text] == []


def test_lines_that_do_not_fit_the_named_columns_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "t.txt").write_text("1 3\nE D -2957.1 -3035.5 1836.3\n")
    given = ["new", str(tmp_path / "n.yaml"), str(tmp_path / "t.txt"), "--columns", "t.txt", "from,to,dx,dy,dz"]
    assert run(given) == 2
    assert "t.txt:1: found 2 columns, expected 5" in capsys.readouterr().err


def test_the_points_of_one_image_need_no_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "t.csv").write_text("x,y,X,Y,Z\n-1,2,10,20,3\n5,6,30,20,4\n7,-8,30,50,2\n-3,-7,10,50,4\n")
    assert run(["new", str(tmp_path / "n.yaml"), str(tmp_path / "t.csv")]) == 0
    assert "it is called 'image'" in capsys.readouterr().err
    assert (tmp_path / "n_t.csv").read_text().splitlines()[:2] == ["image,point,x,y,X,Y,Z", "image,1,-1,2,10,20,3"]


def test_a_matrix_of_image_points(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "t.csv").write_text('point_id,a.jpg,b.jpg\nP0,"293,235","(173.5, 69)"\nP1,,"206,22"\n')
    assert run(["new", str(tmp_path / "n.yaml"), str(tmp_path / "t.csv")]) == 0
    assert "t.csv: image, 3 rows" in capsys.readouterr().err
    rows = (tmp_path / "n_t.csv").read_text().splitlines()
    assert rows == ["image,point,x,y", "a.jpg,P0,293,235", "b.jpg,P0,173.5,69", "b.jpg,P1,206,22"]


def test_the_row_in_face_2_has_the_target_above_it(tmp_path: Path) -> None:
    rows = "S,T1,1,0.001,97\n,,2,199.999,303\n,T2,1,69.262,95\n,,2,269.26,305\n"
    (tmp_path / "t.csv").write_text(f"station,target,face,hz,v\n{rows}")
    assert run(["new", str(tmp_path / "n.yaml"), str(tmp_path / "t.csv")]) == 0
    targets = [line.split(",")[1] for line in (tmp_path / "n_t.csv").read_text().splitlines()]
    assert targets == ["target", "T1", "T1", "T2", "T2"]


@pytest.mark.parametrize(
    ("table", "names", "words"),
    [
        ("t.csv", "from,to,distance,sigma", "t.csv:2: found 3 columns, expected 4 as --columns names them"),
        ("t.csv", "a,b,c", "no line has the names of the columns of a known table"),
        ("u.csv", "from,to,distance", "u.csv: this is none of the tables"),
    ],
)
def test_columns_named_wrongly(
    tmp_path: Path, table: str, names: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("t.csv", "u.csv"):
        (tmp_path / name).write_text("\nA,B,10.02\n")
    given = ["--columns", str(tmp_path / table), names]
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "t.csv"), *given]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.slow
def test_a_list_whose_names_are_images_has_projection_centres(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """GNSS positions ``id, x, y, z`` of the strip: with their σ they carry the block, and no control is needed."""
    images = pl.read_csv(SAMPLES / "aerial_strip" / "images.csv", infer_schema=False)
    images.select("id", "x", "y", "z").write_csv(tmp_path / "gnss.csv")
    shutil.copy(SAMPLES / "aerial_strip" / "image_points.csv", tmp_path)
    project = tmp_path / "p.yaml"
    tables = [str(tmp_path / name) for name in ("image_points.csv", "gnss.csv")]
    assert run(["new", str(project), *tables, "-c", "120.0037", "--camera", "DMC"]) == 0
    assert "gnss.csv: images, 18 rows" in capsys.readouterr().err
    assert run(["check", str(project)]) == 0
    assert "      18 images" in capsys.readouterr().out
    text = project.read_text(encoding="utf-8").replace("free: 120.0037", "fixed: 120.0037")
    for name in ("xh", "yh", "A1", "A2", "B1", "B2"):
        text = text.replace(f"      {name}: {{free: 0}}\n", "")
    sigma = "values: {camera: DMC, sigma_x: 5 cm, sigma_y: 5 cm, sigma_z: 8 cm}"
    project.write_text(text.replace("values: {camera: DMC}", sigma), encoding="utf-8")
    assert run(["adjust", str(project), "-o", str(tmp_path / "r"), "--quiet", "--no-html"]) == 0
    truth = pl.read_csv(SAMPLES / "aerial_strip" / "truth" / "images.csv", schema_overrides={"id": pl.String})
    found = pl.read_csv(tmp_path / "r" / "images.csv", schema_overrides={"id": pl.String})
    both = found.join(truth, on="id", suffix="_true")
    assert both.height == 18
    assert np.abs((both["x"] - both["x_true"]).to_numpy()).max() < 0.5


def test_images_and_points_in_one_list(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "rays.csv").write_text("image,point,x,y\nI1,P1,1,2\n")
    (tmp_path / "mixed.csv").write_text("id,x,y,z\nI1,0,0,9\nP1,0,0,0\n")
    tables = [str(tmp_path / name) for name in ("rays.csv", "mixed.csv")]
    assert run(["new", str(tmp_path / "p.yaml"), *tables]) == 2
    said = capsys.readouterr().err
    assert "image 'I1' and point 'P1' are in one list; split it into two tables" in said
    assert not (tmp_path / "p.yaml").exists()


def test_names_that_are_both_are_points(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "rays.csv").write_text("image,point,x,y\n1,1,1,2\n1,2,1,2\n")
    (tmp_path / "control.csv").write_text("id,x,y,z\n1,0,0,9\n2,0,0,0\n")
    tables = [str(tmp_path / name) for name in ("rays.csv", "control.csv")]
    assert run(["new", str(tmp_path / "p.yaml"), *tables]) == 0
    assert "control.csv: points, 2 rows" in capsys.readouterr().err


def test_standard_deviations_of_vectors_in_chinese(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("起点,终点,DX(m),DY(m),DZ(m),中误差_DX(mm),中误差_DY(mm),中误差_DZ(mm)\nA,B,1,2,3,8.1,11,13.7\n")
    (table,) = recognise(path)
    assert (table.kind, table.columns["sigma_dy"], table.units["sigma_dy"]) == ("vector", "中误差_DY(mm)", "mm")


@pytest.mark.parametrize("names", ["imagem,ponto,coluna,linha", "image,point,colonne,ligne", "像片,点号,列,行"])
def test_columns_and_rows_of_pixels(tmp_path: Path, names: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(f"{names}\nI1,P1,3012.5,1999.1\n")
    (table,) = recognise(path)
    assert (table.kind, table.numbers("x"), table.numbers("y")) == ("image", [3012.5], [1999.1])


def test_rows_of_points_with_neither_name_nor_number(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("id,x,y,z\nA,1,2,3\nB,4,5,6\n,,,+\n,7,8,9\n")
    (table,) = recognise(path)
    assert (table.texts("id"), table.notes) == (["A", "B", ""], ("rows without readings: 1 row",))


RAYS = "image,point,x,y\nI1,P1,1,2\nI1,P2,3,1\nI2,P1,0,2\nI2,P2,2,1\n"


@pytest.mark.parametrize("name", ["control", "gcp_2024", "Passpunkte", "points_fixed", "puntos_de_apoyo", "像控点"])
def test_points_beside_images_that_are_called_control_are_held(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rays.csv").write_text(RAYS)
    (tmp_path / f"{name}.csv").write_text("id,x,y,z\nP1,0,0,9\n")
    project = tmp_path / "p.yaml"
    assert run(["new", str(project), str(tmp_path / "rays.csv"), str(tmp_path / f"{name}.csv")]) == 0
    assert f"{name}.csv: taken as control and held, as its name says" in capsys.readouterr().err
    assert read_document(project).data["points"][0]["fixed"] == ["x", "y", "z"]


def test_points_beside_images_are_start_values_unless_something_says_control(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rays, points = tmp_path / "rays.csv", tmp_path / "targets.csv"
    rays.write_text(RAYS)
    points.write_text("id,x,y,z\nP1,0,0,9\n")
    project = tmp_path / "p.yaml"
    assert run(["new", str(project), str(rays), str(points)]) == 0
    assert "targets.csv: taken as start values; for control points write fixed: [x, y, z]" in capsys.readouterr().err
    assert "fixed" not in read_document(project).data["points"][0]
    points.write_text("id,x,y,z,sx,sy,sz\nP1,0,0,9,1,1,1\n")
    assert run(["new", str(project), str(rays), str(points), "--force"]) == 0
    said = capsys.readouterr().err
    assert "targets.csv: coordinates with a σ are taken as control, with that σ" in said
    assert "taken as start values" not in said


@pytest.mark.parametrize(
    ("content", "code", "words"),
    [
        ("from,to,distance\n", 2, "t.csv: there are no rows below the header of this table (distance)"),
        ("id,x,y\nA,1,2\n", 0, "note: no table has measurements: give one, or add them under observations:"),
    ],
)
def test_tables_without_measurements(
    tmp_path: Path, content: str, code: int, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "t.csv").write_text(content)
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "t.csv")]) == code
    assert words in capsys.readouterr().err


def test_json_is_no_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A long line of JSON is not read as a header."""
    path = tmp_path / "t.json"
    path.write_text('[{"points": [' + ",".join(['"a", 1'] * 300_000) + "]}]")
    assert run(["new", str(tmp_path / "p.yaml"), str(path)]) == 2
    assert "t.json: this is JSON, in no format that is read" in capsys.readouterr().err


def test_german_messages_keep_the_names_of_columns(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Names that users type are the same in every language."""
    (tmp_path / "t.csv").write_text("a,image\n1,2\n")
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "t.csv"), "--lang", "de"]) == 2
    said = capsys.readouterr().err
    assert "gefunden die Spalten a, image; bekannt sind image: image, point, x, y;" in said
    assert "zenith_directions: station, to, horizontal, zenith;" in said
    assert "Bild," not in said
    assert "Standpunkt" not in said


def test_a_table_of_zenith_angles_gets_the_curvature(tmp_path: Path) -> None:
    """Total stations record zenith angles without a correction; a table of distances says nothing of it."""
    (tmp_path / "z.csv").write_text("station,to,horizontal,zenith\nA,B,0,100.1\n")
    (tmp_path / "d.csv").write_text("from,to,distance\nA,B,50.1\n")
    for table, wanted in (("z", True), ("d", False)):
        project = tmp_path / f"{table}.yaml"
        assert run(["new", str(project), str(tmp_path / f"{table}.csv")]) == 0
        assert (read_document(project).data.get("curvature") == "true") is wanted


def test_a_levelling_network_is_adjusted_as_it_is_begun(tmp_path: Path) -> None:
    """Heights alone: positions are held, σ of whole millimetres are read as such; heights of some points are known."""
    lines = ["A,B,1.001,0.8", "B,C,2.003,0.9", "C,A,-3.002,0.8", "C,D,1.5,0.8", "D,A,-4.503,1.1"]
    (tmp_path / "lines.csv").write_text("\n".join(["from,to,dh,sigma", *lines]) + "\n")
    project, tables = tmp_path / "net.yaml", [tmp_path / "marks.csv", tmp_path / "lines.csv"]
    (tmp_path / "marks.csv").write_text("id,height\nA,100\nB,101\nC,103\nD,104.5\n")
    assert mor("new", project, *tables).code == 0
    outcome = mor("adjust", project, "--no-html")
    assert outcome.code == 4, "heights of all points are start values"
    assert "1 movement of the whole network open: translation Z" in outcome.err
    (tmp_path / "marks.csv").write_text("id,height\nA,100\nB,101\n")
    outcome = mor("new", project, *tables, "--force")
    assert "marks.csv: taken as control: 2 points of the measurements are not in it" in outcome.err
    text = project.read_text()
    assert text.count("fixed: [x, y]\n") == 1
    assert text.count("fixed: [x, y, z]  # CHECK\n") == 1
    assert "units: {sigma: mm}  # CHECK" in text
    assert mor("adjust", project, "--no-html", "--force").code == 0
    data = json.loads((tmp_path / "net.results" / "results.json").read_text())
    assert data["redundancy"] == 3
    assert data["sigma0"]["aposteriori"] < 3.0


@pytest.mark.parametrize(
    ("points", "c"),
    [
        ("point_id,easting,northing,height,fixed_h\nA,0,0,100,true\nB,5,0,101.002,yes\nC,5,5,103,no\n", 103.0041),
        ("Punkt,Kote,fixed\nA,100,1\nB,101.002,1\nC,103,0\n", 103.0041),
        ("P,N,E,Z,D,var_z\nA,0,0,100,BM,0\nB,0,5,101.002,,0\nC,5,5,103,,\n", 103.0041),
    ],
)
def test_points_that_a_list_holds_fixed(tmp_path: Path, points: str, c: float) -> None:
    """C from B with σ = 1 mm and from A with σ = 3 mm: weights 9 and 1 of 103.004 and 103.005."""
    (tmp_path / "p.csv").write_text(points)
    (tmp_path / "l.csv").write_text("Fra,Til,ΔH,σ\nB,C,2.002,0.001\nA,C,3.005,0.003\n")
    project = tmp_path / "net.yaml"
    assert mor("new", project, tmp_path / "p.csv", tmp_path / "l.csv").code == 0
    assert mor("adjust", project, "--no-html").code == 0
    rows = pl.read_csv(tmp_path / "net.results" / "points.csv").sort("id")
    assert rows["z"].to_list() == pytest.approx([100.0, 101.002, c], abs=1e-6)


@pytest.mark.parametrize("text", ["dist,var\nA,B,30,-4e-6\n", "dist,sigma1,sigma2\nA,B,30,0.002,0.003\n"])
def test_no_variances_are_taken_from_negative_numbers_and_second_sigmas(tmp_path: Path, text: str) -> None:
    (tmp_path / "d.csv").write_text(f"from,to,{text}")
    (table,) = recognise(tmp_path / "d.csv")
    assert not any(ours.startswith("sigma") and theirs == "sigma" for ours, theirs in table.columns.items())


def test_heights_that_are_not_known_do_not_reduce_distances(tmp_path: Path) -> None:
    """Distances of 30 m and 40 m in the plane though heights are listed: P at (30, 0) from A, 50 m from B (0, 40)."""
    (tmp_path / "p.csv").write_text(
        "name,x,y,z,fixed_x,fixed_y,fixed_z\nA,0,0,7,1,1,0\nB,0,40,1,1,1,0\nP,29,1,3,0,0,0\n"
    )
    (tmp_path / "d.csv").write_text("from,to,distance,variance\nA,P,30,1e-6\nB,P,50,4e-6\n")
    project = tmp_path / "net.yaml"
    assert mor("new", project, tmp_path / "p.csv", tmp_path / "d.csv").code == 0
    assert mor("adjust", project, "--no-html").code == 0
    rows = pl.read_csv(tmp_path / "net.results" / "points.csv").sort("id")
    assert rows["x"].to_list() == pytest.approx([0.0, 0.0, 30.0], abs=1e-6)
    data = json.loads((tmp_path / "net.results" / "results.json").read_text())
    assert [row["sigma"] for row in data["residuals"]] == pytest.approx([0.001, 0.002])


def test_the_sigma_of_a_levelling_line_grows_with_the_root_of_its_length(tmp_path: Path) -> None:
    (tmp_path / "lines.csv").write_text("von,nach,dh,km\nA,B,1.001,0.36\nB,C,2.003,1.44\nC,A,-3.002,4\n")
    project = tmp_path / "net.yaml"
    assert mor("new", project, tmp_path / "lines.csv", "--datum", "free").code == 0
    assert "units: {length: km}\n    values: {sigma: 1 mm}  # CHECK the σ of 1 km\n" in project.read_text()
    assert mor("adjust", project, "--no-html").code == 0
    data = json.loads((tmp_path / "net.results" / "results.json").read_text())
    assert [row["sigma"] for row in data["residuals"]] == pytest.approx([0.0006, 0.0012, 0.002])
    # The misclosure of 2 mm is divided in proportion to the lengths.
    assert [row["v"] for row in data["residuals"]] == pytest.approx([-0.002 * km / 5.8 for km in (0.36, 1.44, 4.0)])
    (tmp_path / "lines.csv").write_text("von,nach,dh,km\nA,B,1.001,0\n")
    assert "found a length of 0 or less" in mor("check", project).err


def test_degrees_minutes_and_seconds_are_found_by_their_cells(tmp_path: Path) -> None:
    rows = [
        "From,To,HA (deg),VA (deg),SD (m)",
        "A,B,0-00-05,89-59-20,100.123",
        "A,C,45-12-33,90-10-11,88.321",
    ]
    (tmp_path / "book.csv").write_text("\n".join(rows) + "\n")
    project = tmp_path / "net.yaml"
    assert mor("new", project, tmp_path / "book.csv").code == 0
    assert "units: {horizontal: dms, zenith: dms}\n" in project.read_text()
    assert mor("check", project).code == 0


@pytest.mark.parametrize(
    ("first", "columns"),
    [
        ("#Label,X/Easting,Y/Northing,Z/Altitude,Error_(m)", "columns: [id, x, y, z, null]\n"),
        ("# a comment, not, a, header, at all", ""),
        ("# of the year 2026", ""),
    ],
)
def test_a_header_may_be_a_comment(tmp_path: Path, first: str, columns: str) -> None:
    more = ",0.01" if columns else ""
    (tmp_path / "marks.txt").write_text(f"{first}\nP1,10.5,20.5,3{more}\nP2,11.5,21.5,4{more}\n")
    (tmp_path / "lines.csv").write_text("from,to,distance\nP1,P2,1.7\n")
    project = tmp_path / "net.yaml"
    assert mor("new", project, tmp_path / "marks.txt", tmp_path / "lines.csv", "--datum", "free").code == 0
    wanted = columns or "columns: [id, x, y, z]  # CHECK the order: the file has no header"
    assert wanted in project.read_text()
    assert mor("check", project).code == 0


def test_baselines_by_east_and_north_and_angles_at_points(tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_text(
        "obs_id,from_point,to_point,dE,dN,dH,cov_EE,cov_EN,cov_EH,cov_NN,cov_NH,cov_HH\n"
        "1,A,B,10.0,20.0,1.0,1e-6,0,0,1e-6,0,4e-6\n"
    )
    (tmp_path / "a.csv").write_text("at_point,from_point,to_point,angle\nB,A,C,100.0\n")
    (tmp_path / "d.csv").write_text("from_point,to_point,direction,set_id\nA,B,1.0,S1\nA,C,2.0,S1\n")
    tables = {found.kind: found for name in "bad" for found in recognise(tmp_path / f"{name}.csv")}
    vector = tables["vector"].columns
    assert [vector[name] for name in ("dx", "dy", "dz")] == ["dE", "dN", "dH"]
    assert [vector[f"cov_d{a}_d{b}"] for a, b in ("xx", "xy", "xz", "yy", "yz", "zz")] == [
        f"cov_{name}" for name in ("EE", "EN", "EH", "NN", "NH", "HH")
    ]
    assert tables["vector"].unused == ("obs_id",)
    assert tables["angle"].columns["at"] == "at_point"
    assert tables["directions"].columns["set"] == "set_id"


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("Survey of May\nRidge\nPoint;East;North\nA;1;2", ["Point", "East", "North"]),
        ("Point\nA\nB", ["Point"]),
        ("Point\nA;1;2", ["Point", "column2", "column3"]),
    ],
)
def test_titles_above_the_header_of_a_spreadsheet(tmp_path: Path, text: str, names: list[str]) -> None:
    frame = read_spreadsheet(as_spreadsheet(tmp_path / "book.csv", text))
    assert frame.columns == names
    assert frame["Point"][0] == "A"


@pytest.mark.parametrize(
    "text",
    [
        "Book of the dam, 3 May\nObserver;N. N.\n\nStation;Target;Hz;V;SD;ih;th\n;;gon;[gon];m;m;m\n"
        "A;B;0,0000;100,0000;20,000;1,5;1,5\n;C;50,0000;99,0000;30,000;;1,5\nB;A;200,0000;100,0000;20,001;1,6;1,5\n",
        "Point,Hz,V,SD,ih,th\nA,,,,1.5,\nB,0.0,100.0,20.0,,1.5\nC,50.0,99.0,30.0,,1.5\nB,,,,1.6\n"
        "A,200.0,100.0,20.001,,1.5\n",
    ],
)
def test_titles_units_and_stations_in_rows_of_their_own(tmp_path: Path, text: str) -> None:
    """Both books hold the same sights; a copy has the station and the instrument height in every row."""
    (tmp_path / "book.csv").write_text(text)
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "book.csv")]) == 0
    assert run(["check", str(tmp_path / "p.yaml"), "--quiet"]) == 0
    sights, distances = read_document(tmp_path / "p.yaml").data["observations"]
    assert (sights["type"], distances["type"]) == ("zenith_directions", "distance")
    assert sights["file"] == distances["file"] == "p_book.csv"
    rows = [line.replace(",", ".").split(";") for line in (tmp_path / "p_book.csv").read_text().split("\n")[1:-1]]
    if ";" not in text:
        rows = [line.split(",") for line in (tmp_path / "p_book.csv").read_text().split("\n")[1:-1]]
    assert [row[:2] for row in rows] == [["A", "B"], ["A", "C"], ["B", "A"]]
    assert [[float(cell) for cell in row[2:6]] for row in rows] == [
        [0.0, 100.0, 20.0, 1.5],
        [50.0, 99.0, 30.0, 1.5],
        [200.0, 100.0, 20.001, 1.6],
    ]


def test_a_table_in_order_is_not_copied(tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text("Source;Target;Direction\nA;B;1.0\nA;C;2.0\n")
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "d.csv")]) == 0
    assert not (tmp_path / "p_d.csv").exists()
    assert read_document(tmp_path / "p.yaml").data["observations"][0]["file"] == "d.csv"


def test_a_short_row_is_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text("Title\nStation;Target;Hz;V\nA\n;C;50;99\n")
    (table,) = recognise(tmp_path / "d.csv")
    assert table.rows == (("A",), ("", "C", "50", "99"))


def test_units_in_brackets_between_blanks_belong_to_the_name_before(tmp_path: Path) -> None:
    """``X (M) Y (M)`` are two columns, as in lists of GNSS stations; a remark at the end may be missing."""
    rows = "1 AAAA 10101M001 4075580.311 931853.976 4801568.181 A\n2 BBBB 10102M001 4121948.325 652187.956 4803152.1\n"
    (tmp_path / "s.txt").write_text(f"Title\nNUM  STATION NAME   X (M)   Y (M)   Z (M)   FLAG\n\n{rows}")
    (table,) = recognise(tmp_path / "s.txt")
    assert table.columns == {"id": "NAME", "x": "X(M)", "y": "Y(M)", "z": "Z(M)"}
    assert table.rows[0][3:6] == ("4075580.311", "931853.976", "4801568.181")
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "s.txt")]) == 0
    (entry,) = read_document(tmp_path / "p.yaml").data["points"]
    text = (tmp_path / entry["file"]).read_text().splitlines()
    assert text[2] == "2,BBBB,10102M001,4121948.325,652187.956,4803152.1,"


@pytest.mark.parametrize(
    ("header", "row"),
    [("NUM STATION NAME X Y Z FLAG", "1 AAAA 4075580.3 931853.9 4801568.1 A"), ("Point Name X Y Z", "A 1 2 3")],
)
def test_rows_shorter_than_a_header_between_blanks_are_refused(
    tmp_path: Path, header: str, row: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing tells which column is empty. Without a refusal coordinates would move into other columns."""
    (tmp_path / "s.txt").write_text(f"{header}\n{row}\n{row.replace('A', 'B')}\n")
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "s.txt")]) == 2
    assert "names and no row more than" in capsys.readouterr().err


def test_a_sheet_with_titles_and_units_is_copied(tmp_path: Path) -> None:
    text = "Loop of May\nfrom;to;dh;length\n;;m;km\nA;B;1.0;0.5\nB;A;-1.001;0.5"
    path = as_spreadsheet(tmp_path / "book.csv", text)
    assert run(["new", str(tmp_path / "p.yaml"), str(path)]) == 0
    (table,) = read_document(tmp_path / "p.yaml").data["observations"]
    assert table["units"] == {"dz": "m", "length": "km"}
    assert (tmp_path / table["file"]).read_text().split("\n")[1].startswith("A,B,1")


_QUADRANT_LEGS = (
    "Line,Bearing,Distance (m)\nA-B,N 45-00-00 E,100\nB to C,S45°00'00\"E,50\nCD,S 45 W,100\nD-A,N45-00W,50\n"
)


@pytest.mark.parametrize(
    "text",
    [
        _QUADRANT_LEGS,
        "Line,N/S,Deg,Min,E/W,Distance\nA-B,N,45,00,E,100\nB-C,S,45,0,E,50\nC-D,S,45.0,0,W,100\nD-A,N,45,0,W,50\n,,,,,300\n",
        "Traverse of the yard\nStation,Azimuth (deg),Distance\nA,45,100\nB,135,50\nC,225,100\nD,315,50\nSum,,300\n",
        "Station,WCB (deg),HD,Easting,Northing\nA,,,0,0\nB,45,100,1,1\nC,135,50,1,1\nD,225,100,1,1\nA,315,50,0,0\n",
    ],
)
def test_legs_of_a_traverse(tmp_path: Path, text: str) -> None:
    """A rectangle of 100 m by 50 m, turned by 45°: legs by name, to the next row, or from the row above."""
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    (tmp_path / "c.csv").write_text("id,x,y\nA,0,0\n")
    project = tmp_path / "p.yaml"
    assert mor("new", project, tmp_path / "t.csv", tmp_path / "c.csv").code == 0
    assert "file: c.csv\n    fixed: [x, y]  # CHECK" in project.read_text(), "a list that lacks points is of known ones"
    assert mor("adjust", project, "--no-html").code == 0
    rows = pl.read_csv(tmp_path / "p.results" / "points.csv").sort("id")
    a, b = 100 / np.sqrt(2), 50 / np.sqrt(2)
    assert rows["x"].to_list() == pytest.approx([0, a, a + b, b], abs=1e-4)
    assert rows["y"].to_list() == pytest.approx([0, a, a - b, -b], abs=1e-4)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Line,Bearing,Distance\n7,45,100\n", "found the leg '7'"),
        ("type,value\nfoo,1\n", "a type is unknown, or no column"),
    ],
)
def test_traverses_and_types_that_are_none(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        recognise(tmp_path / "t.csv")


def test_a_column_with_the_type_of_each_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = ["A,B,dist,100,m", "A,B,dir,0,deg", "A,C,za,100,gon", "A,C,dir,90,deg", "A,C,temp,20,C", "A,B,LV,1,m"]
    (tmp_path / "t.csv").write_text("\n".join(["fromstn,tostn,obstype,Value,Unit", *rows]) + "\n")
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "t.csv")]) == 0
    assert "observations of the type 'temp' not used: 1 row" in capsys.readouterr().err
    assert run(["check", str(tmp_path / "p.yaml"), "--quiet"]) == 0
    entries = read_document(tmp_path / "p.yaml").data["observations"]
    assert [entry["type"] for entry in entries] == ["distance", "directions", "zenith_angle", "height_difference"]
    units = [{"distance": "m"}, {"horizontal": "deg"}, {"zenith_angle": "gon"}, {"dz": "m"}]
    assert [entry["units"] for entry in entries] == units


def test_a_sheet_of_trigonometric_levelling(tmp_path: Path) -> None:
    """Zenith angles and distances have the heights of instrument and target; B is s cos z + i - t above A."""
    (tmp_path / "t.csv").write_text("Stn,Point,Zenith,SD,HI,HT\nA,B,90,100,1.5,1.7\nA,C,80,100,1.5,1.5\n")
    zenith, distance = recognise(tmp_path / "t.csv")
    assert (zenith.kind, distance.kind) == ("zenith_angle", "distance")
    for table in (zenith, distance):
        assert (table.columns["from_height"], table.columns["to_height"]) == ("HI", "HT")


def test_the_benchmark_of_a_levelling_book_is_held(tmp_path: Path) -> None:
    """The first height is held, unless a list has the point; heights below are computed."""
    (tmp_path / "t.csv").write_text("Point,BS,FS,RL [m]\nM,1.5,,100\nP,1.0,0.8,100.7\nN,,0.5,101.2\n")
    project = tmp_path / "p.yaml"
    assert mor("new", project, tmp_path / "t.csv").code == 0
    assert mor("adjust", project, "--no-html").code == 0
    rows = pl.read_csv(tmp_path / "p.results" / "points.csv").sort("id")
    assert rows["z"].to_list() == pytest.approx([100.0, 101.2, 100.7])
    (tmp_path / "c.csv").write_text("id,z\nM,50\n")
    assert mor("new", project, tmp_path / "t.csv", tmp_path / "c.csv", "--force").code == 0
    assert [table.get("file") for table in read_document(project).data["points"]] == ["c.csv", None]


def test_the_distance_between_two_points_of_a_levelling_book_is_its_length(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("from,to,bs,fs,dist\nA,B,1.5,1.0,64\nB,A,1.0,1.501,60\n")
    (table,) = recognise(tmp_path / "t.csv")
    assert table.rows == (("A", "B", "0.5", "64"), ("B", "A", "-0.501", "60"))


@pytest.mark.parametrize(
    ("header", "kind", "columns"),
    [
        ("Point Name,Northing (Y),Easting (X),Elevation (Z)", "points", {"y": "Northing (Y)", "x": "Easting (X)"}),
        ("Name,E_GNSS,N_GNSS,H_GNSS", "points", {"x": "E_GNSS", "y": "N_GNSS", "z": "H_GNSS"}),
        ("from,to,dx-ecef(m),dy-ecef(m),dz-ecef(m)", "vector", {"dx": "dx-ecef(m)", "dz": "dz-ecef(m)"}),
        ("Label,X/East,Y/North,Z/Altitude", "points", {"x": "X/East", "y": "Y/North"}),
        ("Messpunkt,Zielpunkt,R,zeta", "zenith_directions", {"horizontal": "R", "zenith": "zeta"}),
        ("FROM,TO,DATE,HDIFF,CALCERR", "height_difference", {"dz": "HDIFF", "sigma": "CALCERR"}),
        ("id_gcp,id_img,x,y", "image", {"point": "id_gcp", "image": "id_img"}),
        ("From,To,Distance,Direction,Sig_dist,Sig_dir", "directions", {"horizontal": "Direction", "sigma": "Sig_dir"}),
    ],
)
def test_headings(tmp_path: Path, header: str, kind: str, columns: dict[str, str]) -> None:
    (tmp_path / "t.csv").write_text(f"{header}\nA,1.5,2.5,98.5,0.02,12\n")
    table = recognise(tmp_path / "t.csv")[0]
    assert table.kind == kind
    assert columns.items() <= table.columns.items()


def test_names_that_several_columns_share_are_no_readings(tmp_path: Path) -> None:
    text = "BS_point,BS_Reading,BS_Dist,FS_point,FS_Readings,FS_Dist\nA,1.5,38,B,1.2,40\n"
    (tmp_path / "t.csv").write_text(text)
    assert recognise(tmp_path / "t.csv")[0].rows == (("A", "B", "0.3", "78"),)
    (tmp_path / "t.csv").write_text(text.replace("Reading", "Value"))
    with pytest.raises(InputError, match="unknown kind of table"):
        recognise(tmp_path / "t.csv")


@pytest.mark.parametrize("header", ["Label,X/Longitude,Y/Latitude,Z/Altitude", "id,lon,lat,height"])
def test_latitudes_and_longitudes_are_no_coordinates_in_metres(tmp_path: Path, header: str) -> None:
    (tmp_path / "t.csv").write_text(f"{header}\nA,11.5,48.1,520\n")
    with pytest.raises(InputError, match=r"found latitudes and longitudes \(columns .*crs: EPSG:4326"):
        recognise(tmp_path / "t.csv")


def test_large_standard_deviations_of_angles_are_seconds(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("From,To,Distance,Direction,Sig_dist,Sig_dir\nA,B,35.5,100,0.004,16\n")
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "t.csv")]) == 0
    entries = read_document(tmp_path / "p.yaml").data["observations"]
    assert [entry.get("units") for entry in entries] == [{"sigma": "arcsec"}, None]


def test_the_middle_hair_is_the_reading(tmp_path: Path) -> None:
    """Headings for several columns stand above those of each: 1.5 - 1.2, not 1.7 - 1.3 of the upper hairs."""
    head = "Point,Backsight,,,Foresight,,\n,Upper Hair (m),Middle Hair (m),Lower Hair (m)" + ",Upper,Mid,Lower"
    (tmp_path / "t.csv").write_text(f"Book 7\n{head}\nA,1.7,1.5,1.3,,,\nB,,,,1.3,1.2,1.1\n")
    (table,) = recognise(tmp_path / "t.csv")
    assert table.rows == (("A", "B", "0.3", "60"),)
    (tmp_path / "t.csv").write_text(f"Book 7\n{head}\nA,1.7,1.5,1.34,,,\nB,,,,1.3,1.2,1.1\n")
    (table,) = recognise(tmp_path / "t.csv")
    assert table.rows == (("A", "B", "0.3"),)


@pytest.mark.parametrize(
    "head",
    [
        "point,bsU,bsM,bsL,isU,isM,isL,fsU,fsM,fsL,RL",
        "Point,BS,,,IS,,,FS,,,RL\n,U,M,L,U,M,L,U,M,L,",
        "Punkt,Rück o,Rück m,Rück u,Zwischen o,Zwischen m,Zwischen u,Vor o,Vor m,Vor u,Höhe",
        "Point,Back sight,,,Intermediate,,,Fore sight,,,RL\n,Top,Mid,Bottom,Top,Mid,Bottom,Top,Mid,Bottom,",
    ],
)
def test_three_hairs_beside_each_other_are_one_reading(tmp_path: Path, head: str) -> None:
    rows = [
        "A,1.602,1.502,1.402,,,,,,,100",
        "p,,,,1.311,1.250,1.189,,,,",
        "B,1.900,1.801,1.703,,,,1.300,1.200,1.100,",
        "A,,,,,,,2.199,2.104,2.009,",
    ]
    (tmp_path / "t.csv").write_text("\n".join([head, *rows]) + "\n")
    table, benchmark = recognise(tmp_path / "t.csv")
    assert benchmark.rows == (("A", "100"),)
    found = {row[:2]: [float(cell) for cell in row[2:]] for row in table.rows}
    assert found["A", "B"] == pytest.approx([1.502 - 1.2, 40.0])
    assert found["A", "p"] == pytest.approx([1.502 - 1.25, 32.2])
    assert found["B", "A"] == pytest.approx([(1.9 + 1.801 + 1.703) / 3 - 2.104, 38.7])


def test_a_printed_table_counts_its_rows(tmp_path: Path) -> None:
    """The numbers of rows have no heading; NaN is an empty cell, and Sta the station."""
    (tmp_path / "t.txt").write_text("  Sta   BS   FS\n0  A 1.5  NaN\n1  B 1.4  1.2\n2  A NaN  1.7\n")
    (table,) = recognise(tmp_path / "t.txt")
    assert table.rows == (("A", "B", "0.3"), ("B", "A", "-0.3"))


def test_a_traverse_by_angles_and_distances(tmp_path: Path) -> None:
    """A square of 100 m, turned through counterclockwise: its angles are 100 gon, clockwise from the point before."""
    rows = "".join(f"{name},100,100,\n" for name in "ABCD")
    (tmp_path / "t.csv").write_text(f"Station,Observed Angles,Distance,Bearing\n{rows}Sum,,,\n")
    project = tmp_path / "p.yaml"
    assert run(["new", str(project), str(tmp_path / "t.csv"), "--datum", "free"]) == 0
    assert (tmp_path / "p_t_angle.csv").read_text().split()[1:] == ["A,D,B,100", "B,A,C,100", "C,B,D,100", "D,C,A,100"]
    assert run(["adjust", str(project), "-o", str(tmp_path / "r"), "--quiet", "--no-html"]) == 0
    data = json.loads((tmp_path / "r" / "results.json").read_text())
    assert [row["v"] for row in data["residuals"]] == pytest.approx([0.0] * 8, abs=1e-6)
    (tmp_path / "t.csv").write_text("Station,Angle,Distance\nA,,100\nB,100,50\nC,,\n")
    angle, distance = recognise(tmp_path / "t.csv")
    assert (angle.rows, distance.rows) == ((("B", "A", "C", "100"),), (("A", "B", "100"), ("B", "C", "50")))


def test_empty_columns_behind_a_list_of_points(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text("A\t1.0\t2.0\t3.0\t\t\nB\t4.0\t5.0\t6.0\t\n")
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "t.txt")]) == 0
    assert (tmp_path / "p_t.csv").read_text() == "A\t1.0\t2.0\t3.0\nB\t4.0\t5.0\t6.0\n"


@pytest.mark.parametrize("head", ["GCP,X,Y,Z,Image,x,y", "GCP,X(m),Y(m),Z(m),Image,x(px),y(px)"])
def test_control_points_with_their_image_points(tmp_path: Path, head: str) -> None:
    rows = ["A,10,20,3,P1,1000,1500", "A,10,20,3,P2,900,1400", "B,11,25,4,P1,1200,700"]
    (tmp_path / "t.csv").write_text("\n".join([head, *rows]) + "\n")
    image, points = recognise(tmp_path / "t.csv")
    assert (image.kind, image.numbers("x"), image.numbers("y")) == ("image", [1000, 900, 1200], [1500, 1400, 700])
    assert (points.kind, points.texts("id"), points.numbers("z")) == ("points", ["A", "B"], [3, 4])
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "t.csv")]) == 0
    assert run(["check", str(tmp_path / "p.yaml"), "--quiet"]) == 0


def test_heights_that_a_list_of_points_lacks(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text("A 1.0 2.0 3.0\nB 4.0 5.0\n")
    (table,) = recognise(tmp_path / "t.txt")
    assert (table.kind, table.rows) == ("points", (("A", "1.0", "2.0", "3.0"), ("B", "4.0", "5.0", "")))


def test_image_points_without_header_are_no_list_of_points(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text("P1,101,10.5,20.5\nP1,102,30.5,20.5\n")
    with pytest.raises(InputError, match="expected a header"):
        recognise(tmp_path / "t.txt")


def test_angles_among_observations_by_type(tmp_path: Path) -> None:
    rows = "ang,S,A,B,100\ndist,S,,B,25.5\nother,S,,B,1\n"
    (tmp_path / "t.csv").write_text(f"obs,station,backsight,foresight,value\n{rows}")
    angle, distance = recognise(tmp_path / "t.csv")
    assert (angle.kind, angle.rows) == ("angle", (("S", "A", "B", "100"),))
    assert (distance.kind, distance.rows) == ("distance", (("S", "B", "25.5"),))
    assert angle.notes == ("observations of the type 'other' not used: 1 row",)


def test_a_column_that_is_read_is_given_once(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("id,x,y,z,x,Note,Note\nA,1,2,3,1.1,a,b\n")
    (table,) = recognise(tmp_path / "t.csv")
    assert table.texts("x") == ["1"]
    assert "column 'Note', 'x' is given twice: the first one is read" in table.notes


@pytest.mark.parametrize(
    ("scale", "unit", "options"), [(1.0, "deg", []), (400.0 / 360.0, "gon", []), (1.0, "gon", ["--angle", "gon"])]
)
def test_zenith_angles_tell_the_unit_of_angles(tmp_path: Path, scale: float, unit: str, options: list[str]) -> None:
    book, project = tmp_path / "book.csv", tmp_path / "p.yaml"
    rows = [("A", 72.0, 91.0), ("B", 245.0, 92.5), ("C", 100.0, 84.0), ("A", 252.0, 269.0)]
    lines = [f"S,{name},{hz * scale},{v * scale}" for name, hz, v in rows]
    book.write_text("\n".join(["station,to,Hz,Vz", *lines]) + "\n")
    assert run(["new", str(project), str(book), *options]) == 0
    assert read_document(project).data["units"]["angle"] == unit
    assert ("# CHECK the unit of angles" in project.read_text()) == (not options)


def test_steep_sights_do_not_tell_the_unit_of_angles(tmp_path: Path) -> None:
    """To a facade: 70 to 98 gon, whose middle is nearer to 90 than to 100."""
    book, project = tmp_path / "book.csv", tmp_path / "p.yaml"
    rows = [f"S,P{k},{20 * k},{zenith}" for k, zenith in enumerate((61.8, 71.0, 78.2, 83.4, 97.3, 98.8))]
    book.write_text("\n".join(["station,to,Hz,Vz", *rows]) + "\n")
    assert run(["new", str(project), str(book)]) == 0
    assert read_document(project).data["units"]["angle"] == "gon"


def test_an_asterisk_is_the_sigma_of_what_is_free(tmp_path: Path) -> None:
    """As STAR*NET has it."""
    table, distances, project = tmp_path / "points.csv", tmp_path / "distances.csv", tmp_path / "p.yaml"
    table.write_text("id,x,y,z,sx,sy,sz\nA,0,0,0,0.1,0.1,*\nB,10,0,0,0.1,0.1,0.1\n")
    distances.write_text("from,to,distance\nA,B,10\n")
    assert run(["new", str(project), str(table), str(distances)]) == 0
    assert run(["check", str(project), "--quiet"]) == 0


def test_three_wires_below_each_other_are_one_reading(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Millimetres, sums below the wires; the mean of the wires, and 100 times their interval."""
    rows = [
        *("A,1430,,,", ",1138,292,,", ",847,291,,", ",,583,,", ",,,,"),
        *("T,1456,,1125,", ",1256,200,840,285", ",1056,200,556,284", ",,400,,569", ",,,,"),
        *("B,,,1300,", ",,,1200,100", ",,,1100,100"),
    ]
    book, project = tmp_path / "book.csv", tmp_path / "p.yaml"
    book.write_text("\n".join(["Point,BS,BS_INT,FS,FS_INT", *rows]) + "\n")
    assert run(["new", str(project), str(book)]) == 0
    assert "three wires at 3 points" in capsys.readouterr().err
    found = pl.read_csv(tmp_path / "p_book.csv")
    assert found.select("from", "to").rows() == [("A", "T"), ("T", "B")]
    assert found["dz"].to_list() == pytest.approx([(3415 - 2521) / 3, 1256 - 1200], abs=1e-4)
    assert found["length"].to_list() == pytest.approx([100 * (583 + 569), 100 * (400 + 200)])
    assert read_document(project).data["observations"][0]["units"] == {"dz": "mm", "length": "mm"}


@pytest.mark.parametrize(("scale", "unit"), [(1.0, "deg"), (400.0 / 360.0, "gon")])
@pytest.mark.parametrize(
    ("header", "rows"),
    [
        ("at,from,to,angle", [("A", "B", "C", 90.0), ("B", "C", "A", 45.001), ("C", "A", "B", 45.001)]),
        ("at,from,to,angle", [("A", "C", "B", 270.0), ("B", "A", "C", 315.0), ("C", "B", "A", 315.0)]),
        ("from,to,direction", [("A", "B", 17.0), ("A", "C", 107.0), ("B", "C", 5.0), ("B", "A", 50.0)]),
        ("from,to,azimuth", [("A", "B", 0.0), ("B", "C", 135.0), ("C", "A", 270.0)]),
    ],
)
def test_coordinates_tell_the_unit_of_angles(
    tmp_path: Path, header: str, rows: list[tuple[str | float, ...]], scale: float, unit: str
) -> None:
    """A (0, 0), B 100 m north, C 100 m east of it."""
    points, angles, project = tmp_path / "points.csv", tmp_path / "angles.csv", tmp_path / "p.yaml"
    points.write_text("id,E,N\nA,0,0\nB,0,100\nC,100,0\n")
    lines = [",".join([*map(str, names), str(float(angle) * scale)]) for *names, angle in rows]
    angles.write_text("\n".join([header, *lines]) + "\n")
    assert run(["new", str(project), str(angles), str(points)]) == 0
    assert read_document(project).data["units"]["angle"] == unit


def test_the_header_may_be_the_last_of_the_comments_above(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    path.write_text("#cameras 2\n#name,x,y,z,omega,phi,kappa\na.jpg,1,2,3,0,0,0.1\nb.jpg,4,5,6,0,0,0.2\n")
    (found,) = recognise(path)
    assert (found.kind, found.columns["id"], found.texts("kappa")) == ("images", "name", ["0.1", "0.2"])


@pytest.mark.parametrize(("scale", "unit"), [(1.0, "deg"), (400.0 / 360.0, "gon")])
def test_a_closed_traverse_tells_the_unit_of_its_angles(tmp_path: Path, scale: float, unit: str) -> None:
    sheet, project = tmp_path / "sheet.csv", tmp_path / "p.yaml"
    angles = {"A": 81.197, "B": 120.431, "C": 149.564, "D": 95.697, "E": 93.097}
    rows = [f"{name},{angle * scale},{length}" for length, (name, angle) in enumerate(angles.items(), start=155)]
    sheet.write_text("\n".join(["Station,Observed Angles,Distance", *rows]) + "\n")
    assert run(["new", str(project), str(sheet)]) == 0
    assert read_document(project).data["units"]["angle"] == unit


def test_directions_with_distances_and_nothing_that_has_a_height_are_in_the_plane(tmp_path: Path) -> None:
    """Without heights in the list of points, or without a list."""
    sheet, points, project = tmp_path / "sheet.csv", tmp_path / "points.csv", tmp_path / "p.yaml"
    sheet.write_text("from,to,distance,direction\nA,B,50,10\nA,C,40,70\nB,C,45,33\n")
    points.write_text("id,E,N,H\nA,0,0,5\n")
    assert run(["new", str(project), str(sheet)]) == 0
    assert read_document(project).data["settings"]["dimensions"] == "xy"
    assert run(["new", str(project), str(sheet), str(points), "--force"]) == 0
    assert "dimensions" not in read_document(project).data["settings"]


def test_a_traverse_of_an_exercise(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """D, M, S in columns, distances of 0 where none was measured, x to the north, zeros for unknown points."""
    book, control, project = tmp_path / "book.csv", tmp_path / "control.csv", tmp_path / "p.yaml"
    sights = [
        *("P1,P2,0,90,0,0", "P1,P3,0,45,0,0", "P1,Q,50.000,36,52,11.6", "P1,R,0,33,41,24.2"),
        *("P2,P1,0,270,0,0", "P2,P3,0,9,27,44.4", "P2,Q,0,333,26,5.8", "P2,R,0,315,0,0"),
    ]
    book.write_text("\n".join(["source,target,distance,D,M,S", *sights]) + "\n")
    control.write_text("point,y,x,fixed=1/free=0\nP1,100,200,1\nP2,150,200,1\nP3,160,260,1\nQ,0,0,0\nR,0,0,0\n")
    assert run(["new", str(project), str(book), str(control)]) == 0
    assert "coordinates that are all 0 are none: 2 points" in capsys.readouterr().err
    data = read_document(project).data
    assert data["axes"] == {"xy": "ne"}
    assert run(["adjust", str(project), "-o", str(tmp_path / "r"), "--quiet", "--no-html"]) in (0, 1)
    found = pl.read_csv(tmp_path / "r" / "points.csv").filter(pl.col("id").is_in(["Q", "R"]))
    np.testing.assert_allclose(found.select("x", "y").to_numpy(), [[240, 130], [230, 120]], atol=1e-3)
    assert pl.read_csv(tmp_path / "r" / "residuals.csv").height == 9


def test_angles_to_the_left_beside_easting_and_northing(tmp_path: Path) -> None:
    points, angles, project = tmp_path / "points.csv", tmp_path / "angles.csv", tmp_path / "p.yaml"
    points.write_text("id,E,N\nA,0,0\nB,0,100\nC,100,0\nD,30,30\n")
    angles.write_text("at,from,to,angle\nA,C,B,100\nB,A,C,350\nA,D,B,50\n")
    assert run(["new", str(project), str(angles), str(points)]) == 0
    data = read_document(project).data
    assert (data["axes"], data["units"]["angle"]) == ({"angles": "counterclockwise"}, "gon")


def test_one_set_up_without_a_column_for_its_station(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    book, project = tmp_path / "book.csv", tmp_path / "p.yaml"
    book.write_text("Point_ID,Hz_gon,V_gon,Ds_m,Face_nr,Set_nr\n1,10,99,20,1,1\n2,50,98,30,1,1\n2,250,302,30,2,1\n")
    assert run(["new", str(project), str(book)]) == 0
    assert "no column names the station of the readings" in capsys.readouterr().err
    entries = read_document(project).data["observations"]
    assert [entry["type"] for entry in entries] == ["zenith_directions", "distance"]
    assert run(["check", str(project), "--quiet"]) == 0


def test_an_angle_book_as_a_spreadsheet_has_it(tmp_path: Path) -> None:
    """Degrees, minutes and seconds below one heading, a decimal copy, faces as letters, stations twice, headings again.

    The directions from S to A and B are 10 and 70 degrees, or 40 and 100 when S is set up once more.
    """
    heading = "Station,Set,Face,Obj.,Hor. Rdg,,,Dist,Hor. Rdg"
    rows = [
        "S,1,L,A,10,0,0,100,10.0",
        ",,L,B,70,0,30.5,200,70.008472",
        ",,R,B,250,,,200,250.0",
        ",,R,A,190,0,1,100,190.000278",
        ",,,,,,,150,",
        heading,
        "A,1,L,S,0,0,0,100,0.0",
        ",,L,B,300,30,0,173.205,300.5",
        "S,1,L,A,40,0,0,100,40.0",
        ",,L,B,100,0,29,200,100.008056",
        "Obj.,Northing,Easting,,,,,,",
        "S,100,200,,,,,,",
    ]
    (tmp_path / "t.csv").write_text("\n".join([heading, *rows]) + "\n")
    directions, distances, points = recognise(tmp_path / "t.csv")
    assert points.rows == (("S", "100", "200", *[""] * 6),)
    assert directions.texts("horizontal") == [
        *("10-0-0", "70-0-30.5", "250-0-0", "190-0-1"),
        *("0-0-0", "300-30-0", "40-0-0", "100-0-29"),
    ]
    assert directions.texts("station") == ["S"] * 4 + ["A"] * 2 + ["S"] * 2
    assert directions.texts("set") == ["1"] * 6 + ["1 (2)"] * 2
    assert directions.texts("face") == ["1", "1", "2", "2", "1", "1", "1", "1"]
    assert distances.numbers("distance") == [100.0, 200.0, 200.0, 100.0, 100.0, 173.205, 100.0, 200.0]
    assert "column 'Hor. Rdg' is given twice: the first one is read" in directions.notes
    assert run(["new", str(tmp_path / "p.yaml"), str(tmp_path / "t.csv")]) == 0
    assert run(["check", str(tmp_path / "p.yaml"), "--quiet"]) == 0


def test_a_closed_traverse_above_its_computation(tmp_path: Path) -> None:
    """The first point stands again at the end, with its bearing; sums, remarks and the computation are no legs."""
    (tmp_path / "t.csv").write_text(
        "Sta.,Azimuth,Hor.Dist\nA,90,100\nB,180,100\nC,315,141.421\nA,90,\nsum,,341.421\nClosure,,\n"
        "Sta.,Hor Dist,Azimuth\nA,100,90\nB,100,180\n"
    )
    bearings, distances = recognise(tmp_path / "t.csv")
    assert list(zip(*map(bearings.texts, ("from", "to", "bearing")), strict=True)) == [
        ("A", "B", "90"),
        ("B", "C", "180"),
        ("C", "A", "315"),
    ]
    assert distances.numbers("distance") == [100.0, 100.0, 141.421]
    assert "another table begins below (columns Sta., Hor Dist, Azimuth): 2 rows not read" in bearings.notes


def test_directions_of_a_station_in_two_sheets_are_two_set_ups(tmp_path: Path) -> None:
    texts = (f"station;to;Hz\nS;A;{hz}\nS;B;{hz + 50}\n" for hz in (10, 30))
    first, second = recognise(as_spreadsheet(tmp_path / "t.csv", *texts))
    assert (first.texts("set"), second.texts("set")) == ([], ["T", "T"])
    assert "stations that another sheet has too are set up once more: S" in second.notes


@pytest.mark.parametrize(
    ("heading", "cells", "sigma"),
    [("distance,error", "10,0.003", "0.003"), ("distance,distvar", "10,0.000009", "0.003"), ("dh,err", "1,2", "2")],
)
def test_errors_and_variances_beside_readings_are_their_sigma(
    tmp_path: Path, heading: str, cells: str, sigma: str
) -> None:
    (tmp_path / "t.csv").write_text(f"from,to,{heading}\nA,B,{cells}\n")
    (table,) = recognise(tmp_path / "t.csv")
    assert table.texts("sigma") == [sigma]


def test_a_point_given_twice_alike_is_one(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("id,x,y,z,Note\nA,1,2,3,new\nB,4,5,6,\nA,1,2,3,old\nA,1,2,4,\n")
    (table,) = recognise(tmp_path / "t.csv")
    assert table.texts("id") == ["A", "B", "A"]
    assert "points given twice alike: 1 row" in table.notes


@pytest.mark.parametrize(
    "heading",
    [
        "Stanowisko;Cel;Kierunek;Kąt zenitalny;Odległość skośna;Wysokość instrumentu;Wysokość celu",
        "Станция;Цель;Горизонтальный угол;Зенитное расстояние;Наклонное расстояние;Высота инструмента;Высота цели",
        "Durulan Nokta;Bakılan Nokta;Yatay Açı;Düşey Açı;Eğik Mesafe;Alet Yüksekliği;Hedef Yüksekliği",
        "Titik Alat;Titik Target;Sudut Horizontal;Sudut Vertikal;Jarak Miring;Tinggi Alat;Tinggi Target",
    ],
)
def test_sights_in_other_languages(tmp_path: Path, heading: str) -> None:
    (tmp_path / "t.csv").write_text(f"{heading}\n1;2;0,5;99,8;123,4;1,5;1,6\n1;3;101,2;100,1;98,7;1,5;1,6\n", "utf-8")
    directions, distances = recognise(tmp_path / "t.csv")
    assert directions.kind == "zenith_directions"
    assert [directions.numbers(name)[0] for name in ("horizontal", "zenith", "station_height", "to_height")] == [
        *(0.5, 99.8, 1.5, 1.6)
    ]
    assert distances.numbers("distance") == [123.4, 98.7]
    assert not directions.unused


@pytest.mark.parametrize(
    "heading",
    [
        *("De;Vers;Dénivelée;Distance", "De;Hacia;Desnivel;Distancia", "Od;Do;Przewyższenie;Długość"),
        *("От;До;Превышение;Расстояние", "Başlangıç;Bitiş;Yükseklik Farkı;Mesafe", "Dari;Ke;Beda Tinggi;Jarak"),
    ],
)
def test_levelling_in_other_languages(tmp_path: Path, heading: str) -> None:
    (tmp_path / "t.csv").write_text(f"{heading}\nR1;R2;1,25;0,5\nR2;R3;-0,25;0,7\n", "utf-8")
    (table,) = recognise(tmp_path / "t.csv")
    assert table.kind == "height_difference"
    assert (table.numbers("dz"), table.numbers("length")) == ([1.25, -0.25], [0.5, 0.7])


@pytest.mark.parametrize(
    ("points", "angles"),
    [
        (
            "Point X[m] Y[m] Known[n]/Unknown[u]\nA 0 0 n\nB 100 0 n\nP 49 51 u\n",
            "From At To Degrees Minutes Seconds StDev[sec]\nA P B 270 00 00 2\nB A P 315 0 0 2\n",
        ),
        (
            "Point,Type,X,Y\nA,C,0,0\nB,C,100,0\nP,U,49,51\n",
            "ID,Info,Type,Value,Std\n1,A_P_B,Angle,270 0 0,2\n2,B_A_P,Angle,315 0 0,2\n3,A_P,Dist,70.7107,0.003\n",
        ),
    ],
)
def test_known_points_by_a_legend_or_a_role_and_names_in_one_cell(tmp_path: Path, points: str, angles: str) -> None:
    """The top of a right-angled triangle: A and B are known, P is new."""
    (tmp_path / "points.txt").write_text(points)
    (tmp_path / "angles.txt").write_text(angles)
    project = tmp_path / "p.yaml"
    assert mor("new", project, tmp_path / "points.txt", tmp_path / "angles.txt").code == 0
    assert mor("adjust", project, "--no-html").code == 0
    found = pl.read_csv(tmp_path / "p.results" / "points.csv", schema_overrides={"id": pl.String})
    top = found.filter(pl.col("id") == "P").select("x", "y").row(0)
    assert top == pytest.approx((50.0, 50.0), abs=1e-3)


@pytest.mark.parametrize(
    ("text", "kind", "columns", "units"),
    [
        ("From\tTo\tHeight (Meter)\tHeight Error (Meter)\nA\tB\t1.5\t0.001\n", "height_difference", "dz", "m"),
        (
            "From,To,Easting (Feet),Northing (Feet),Height (Feet),Easting Error (Feet)\nA,B,5,-3,1,0.01\n",
            "vector",
            "dx",
            "ft",
        ),
        ("From,To,Dist,Direc,Sdist,Sdirec_in_seconds\nA,B,50,210,0.002,9\n", "directions", "sigma", "arcsec"),
        ("% readings\nFrom,To,HCR; Set-I,H. Distance\nA,B,210,50\n", "directions", "horizontal", None),
    ],
)
def test_columns_as_people_name_them(tmp_path: Path, text: str, kind: str, columns: str, units: str | None) -> None:
    (tmp_path / "t.csv").write_text(text)
    found = {table.kind: table for table in recognise(tmp_path / "t.csv")}
    assert kind in found
    assert columns in found[kind].columns
    assert found[kind].units.get(columns) == units


@pytest.mark.parametrize("header", ["from to dx(m) dy(m) dz(m)", "%from to dx(m) dy(m) dz(m)"])
def test_a_header_may_be_underlined(tmp_path: Path, header: str) -> None:
    (tmp_path / "t.txt").write_text(f"{header}\n---- -- ----- ----- -----\nA B 10.01 20.02 1.01\n")
    (found,) = recognise(tmp_path / "t.txt")
    assert found.kind == "vector"
    assert found.rows == (("A", "B", "10.01", "20.02", "1.01"),)
    (tmp_path / "t.txt").write_text(f"{header}\nA B 10.01 20.02 1.01\n{'-' * 200}x 0 0 0 0\n")
    assert len(recognise(tmp_path / "t.txt")[0].rows) == 2, "signs with a letter are a name, at once"


def test_points_of_two_images_without_headers(tmp_path: Path) -> None:
    for name, x in (("left", -93.87), ("right", -5.11)):
        lines = ["153.84 0.011 0.002 2500", *(f"{k} {x + 9 * k} {4 * k - 9}" for k in range(12, 16))]
        (tmp_path / f"{name}.txt").write_text("\n".join(lines))
    outcome = mor("new", tmp_path / "p.yaml", tmp_path / "left.txt", tmp_path / "right.txt")
    assert outcome.code == 2
    assert "right.txt: a list without a header is read as points" in outcome.err


def test_bars_between_columns(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text("|BS|INT|FS|PT ID|\n|-----|-----|-----|-----|\n|1.5|||1|\n||1.4||2|\n|||1.3|3|\n")
    (found,) = recognise(tmp_path / "t.txt")
    assert sorted(row[:3] for row in found.rows) == [("1", "2", "0.1"), ("1", "3", "0.2")]


def test_sigmas_of_heights_in_millimetres(tmp_path: Path) -> None:
    """Height of C from A, 10 m, and B, 11 m, both with 1 mm, by two lines with 0.7 mm."""
    (tmp_path / "points.csv").write_text("punkt;kote;σ\nA;10.000;1\nB;11.000;1\n")
    (tmp_path / "lines.csv").write_text("fra;til;dH;σ\nA;C;2.001;0.7\nB;C;1.003;0.7\n")
    project = tmp_path / "p.yaml"
    assert mor("new", project, tmp_path / "points.csv", tmp_path / "lines.csv").code == 0
    assert project.read_text().count("units: {sigma: mm}  # CHECK") == 2
    assert mor("adjust", project, "--no-html").code == 0
    heights = pl.read_csv(tmp_path / "p.results" / "points.csv").sort("id")
    assert heights["z"][2] == pytest.approx(12.002, abs=1e-6)
    assert heights["z"][0] == pytest.approx(10 + 0.002 / 2.98, abs=1e-6)  # variances 1, 0.49, 0.49, 1 share 2 mm


def test_rows_above_a_header_are_counted(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("Somebody,,\nP,100,200\nA,150,250\n,,\nfrom,to,distance\nP,A,58.4\nA,C,115.1\n")
    (found,) = recognise(tmp_path / "t.csv")
    assert "rows with numbers stand above the header: 2 rows not read" in found.notes


def test_zeros_of_what_was_not_measured(tmp_path: Path) -> None:
    """Each row has a direction or a distance; the other one is 0, its σ too."""
    rows = ["A;B;0;14.4;0;0.01", "A;C;0;88.9;0;0.02", "B;A;0;0;0;0.01", "A;B;229.6;0;5;0"]
    (tmp_path / "t.csv").write_text("\n".join(["Source;Target;Distance;Direction;Sigma Dist;Sigma Dir", *rows]))
    kinds = {table.kind: table for table in recognise(tmp_path / "t.csv")}
    assert len(kinds["directions"].rows) == 4, "a row with both 0 says that a direction may be 0"
    rows[2] = "B;A;0;194.4;0;0.01"
    (tmp_path / "t.csv").write_text("\n".join(["Source;Target;Distance;Direction;Sigma Dist;Sigma Dir", *rows]))
    kinds = {table.kind: table for table in recognise(tmp_path / "t.csv")}
    assert [row[:2] for row in kinds["directions"].rows] == [("A", "B"), ("A", "C"), ("B", "A")]
    assert [row[:2] for row in kinds["distance"].rows] == [("A", "B")]


def test_readings_without_a_header_are_not_taken_for_one(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text("A ANG B D 1.51\nB ANG A D 2.52\n")
    with pytest.raises(InputError, match="expected a header"):
        recognise(tmp_path / "t.txt")


def test_clocks_of_spreadsheets_are_degrees_minutes_and_seconds(tmp_path: Path) -> None:
    """201 h 27 min 5 s is shown as 201:27:05 in a sheet."""
    assert [_text(timedelta(hours=h, minutes=27, seconds=s)) for h, s in ((201, 5), (0, 0.25), (-7, 0))] == [
        "201:27:05",
        "0:27:00.25",
        "-6:33:00",
    ]


def test_benchmark_beside_grouped_headings_and_sums_below(tmp_path: Path) -> None:
    """Headings that one group has alone need no name of the group; sums below are no sights."""
    lines = [
        "Point;Backsight;;Foresight;;;",
        ";Staff (m);Distance (m);Staff (m);Distance (m);Reduced Level (m);Remarks",
        "BM;1.5;20;;;100;",
        "T;1.6;20;1.2;20;100.3;",
        "BM;;;1.9;20;100;",
        ";;;\u03a3BS (m);3.1;;",
    ]
    book = as_spreadsheet(tmp_path / "book.csv", "\n".join(lines).replace("Staff (m)", "Middle Hair (m)"))
    kinds = {table.kind: table for table in recognise(book)}
    assert kinds["points"].rows == (("BM", "100"),)
    assert [row[:3] for row in kinds["height_difference"].rows] == [("BM", "T", "0.3"), ("T", "BM", "-0.3")]


def test_control_and_tie_points_that_are_numbered_alike(tmp_path: Path) -> None:
    (tmp_path / "control.csv").write_text("pnt,x,y,z\n1,0,0,0\n2,5,0,0\n")
    (tmp_path / "cp.csv").write_text("img,pnt,x,y\n1,1,-8,-9\n1,2,7,-7\n")
    (tmp_path / "tp.csv").write_text("img,pnt,x,y\n1,1,0,0\n1,2,0,6\n1,3,4,4\n")
    tables = [str(tmp_path / f"{name}.csv") for name in ("control", "cp", "tp")]
    outcome = mor("new", tmp_path / "p.yaml", *tables)
    assert "tp.csv: points named as in cp.csv are elsewhere" in outcome.err
    assert "1,3 (tp),4,4" in (tmp_path / "p_tp.csv").read_text()
    outcome = mor("new", tmp_path / "q.yaml", *tables[1:])
    assert outcome.code == 2
    assert "is elsewhere than in cp.csv" in outcome.err


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4000, 4040))
def test_random_tables_lead_to_the_known_coordinates(seed: int, tmp_path: Path) -> None:
    assert trial(seed, tmp_path)[1] == ""
