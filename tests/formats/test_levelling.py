"""Books of digital levels: the values are computed by hand from the staff readings."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from mor.api.pipeline import solve_network
from mor.errors import InputError
from mor.formats import read_foreign
from mor.project.document import Document
from mor.project.levelling import Levelling, StaffReading
from tests.reference_data import network_of

M5 = """\
For M5|Adr     1|TO  LOOP.DAT                   |                      |                      |                      |
For M5|Adr     2|TO  Start-Line         BF     1|                      |                      |                      |
For M5|Adr     3|KD1       B1                  1|                      |                      |Z        50.00000 m   |
For M5|Adr     4|KD1       B1       08:00:001  1|Rb        1.50000 m   |HD         30.000 m   |                      |
For M5|Adr     5|KD1 ########       08:00:201  1|Rf        2.50000 m   |HD         20.000 m   |                      |
For M5|Adr     6|TO  Measurement repeated       |                      |                      |                      |
For M5|Adr     7|KD1        1       08:00:401  1|Rf        1.20000 m   |HD         20.000 m   |                      |
For M5|Adr     8|KD1        1                  1|                      |                      |Z        50.30000 m   |
For M5|Adr     9|KD1        1       08:01:001  1|Rb        1.70000 m   |HD         25.000 m   |                      |
For M5|Adr    10|KD1        7       08:01:101  1|Rz        0.40000 m   |HD         11.000 m   |Z        51.60000 m   |
For M5|Adr    11|KD1       B2       08:01:401  1|Rf        1.60000 m   |HD         25.000 m   |                      |
For M5|Adr    12|KD1       B2                  1|                      |                      |Z        50.40000 m   |
For M5|Adr    13|KD2       B2              2   1|Sh        0.40000 m   |Db          55.00 m   |Df          45.00 m   |
For M5|Adr    14|TO  End-Line                  1|                      |                      |                      |
For M5|Adr    15|TO  Start-Line         BF     2|                      |                      |                      |
For M5|Adr    16|KD1       B2                  2|                      |                      |Z        50.40000 m   |
For M5|Adr    17|KD1       B2       08:02:001  2|Lr        1.10000 m   |E          15.000 m   |                      |
For M5|Adr    18|KD1        1       08:02:401  2|Lv        0.90000 m   |E          15.000 m   |                      |
For M5|Adr    19|KD1        1                  2|                      |                      |Z        50.60000 m   |
For M5|Adr    20|KD1        1       08:03:001  2|Lr        0.80000 m   |E          10.000 m   |                      |
For M5|Adr    21|KD1       B1       08:03:401  2|Lv        1.90000 m   |E          10.000 m   |                      |
For M5|Adr    22|TO  Station repeated          2|                      |                      |                      |
For M5|Adr    23|KD1        1       08:04:001  2|Lr        1.00000 m   |E          10.000 m   |                      |
For M5|Adr    24|KD1       B1       08:04:401  2|Lv        1.60060 m   |E          10.000 m   |                      |
For M5|Adr    25|KD1       B1                  2|                      |                      |Z        49.99940 m   |
"""


def _read(tmp_path: Path, name: str, text: str) -> Document:
    path = tmp_path / name
    path.write_text(text)
    return read_foreign(path)


def _rows(document: Document) -> list[tuple[Any, ...]]:
    """From, to, height difference, and length."""
    return [
        (row[0], row[1], round(float(row[2]), 6), *(round(float(cell), 4) for cell in row[3:]))
        for table in document.data["observations"]
        for row in table["rows"]
    ]


def _notes(document: Document) -> str:
    return " ".join(map(str, document.notes))


def test_a_level_of_zeiss(tmp_path: Path) -> None:
    document = _read(tmp_path, "loop.dat", M5)
    assert _rows(document) == [
        ("B1", "1", 0.3, 50.0),
        ("1", "B2", 0.1, 50.0),
        ("1", "7", 1.3, 36.0),
        ("B2", "1 (2)", 0.2, 30.0),
        ("1 (2)", "B1", -0.6006, 20.0),
    ]
    assert document.data["points"][0]["rows"] == [["B1", "50.0", "0.01"]]
    assert "not read: coordinates that the instrument computed" in _notes(document)
    assert document.data["settings"] == {"undetermined": "leave_out", "dimensions": "z"}
    notes = _notes(document)
    assert "not read: staff readings that were repeated (3 records, lines 5, 20–21)" in notes
    assert "1 name of turning points in several lines at different heights" in notes
    assert "5 height differences in 2 levelling lines; σ = 1 mm for 1 km" in notes


def test_a_levelling_loop_is_adjusted(tmp_path: Path) -> None:
    """The misclosure of 0.6 mm is spread by the lengths of the sights: 0.4 mm over 100 of 150 m."""
    solved = solve_network(network_of(_read(tmp_path, "loop.dat", M5), tmp_path))
    points = solved.network.things["point"]
    values = solved.adjustment.values["point"]
    heights = {name: float(values[points.part(name, "position")][2]) for name in points.ids}
    assert heights["B2"] - heights["B1"] == pytest.approx(0.4 + 0.0006 * 100.0 / 150.0, abs=1e-9)
    assert heights["7"] - heights["1"] == pytest.approx(1.3, abs=1e-9)


def test_a_level_of_leica_in_both_orders(tmp_path: Path) -> None:
    text = """\
*410001+?..............4
*110002+0000000000000100 83..58+0000000001000000
*110003+0000000000000100 32...8+0000000001000000 331.08+0000000000150000 390...+0000000000000002 391.08+0000000000000001
*110004+00000000000000T1 32...8+0000000001100000 332.08+0000000000120000
*110005+00000000000000T1 32...8+0000000001100000 336.08+0000000000120010
*110006+0000000000000100 32...8+0000000001000000 335.08+0000000000150020
*110007+00000000000000T1 574.08+0000000000000010 83..08+0000000001030005
*110008+00000000000000B2 32...8+0000000001200000 332.08+0000000000140000
*110009+00000000000000T1 32...8+0000000001300000 331.08+0000000000110000
*110010+00000000000000T1 32...8+0000000001300000 335.08+0000000000110000
*110011+00000000000000B2 32...8+0000000001200000 336.08+0000000000140000
*110012+00000000000000B2 571.08+0000000000000000 572.08+0000000000000010 83..08+0000000001000005
"""
    document = _read(tmp_path, "a.gsi", text)
    assert _rows(document) == [("100", "T1", 0.30005, 21.0), ("T1", "B2", -0.3, 25.0)]
    assert [row[:2] for row in document.data["points"][0]["rows"]] == [["100", "10.0"]]
    assert "datum" not in document.data, "one given height is the datum"


GSI = """\
410001+?......1
110002+000000B1 83..58+00100000
110003+000000B1 32...8+01000000 331.08+00150000
110004+00000P1 32...8+00500000 333.08+00100000
110005+00000P1 83..08+00100500
110006+00000001 32...8+01000000 332.08+00130000
110007+00000001 573.08+00000000 574.08+02000000 83..08+00100200
110008+00000001 32...8+01000000 331.08+00120000
110009+00000P2 32...8+00500000 333.08+00110000
110010+00000P2 83..08+00100300
110011+00000002 32...8+01000000 332.08+00140010
110012+00000002 573.08+00000000 574.08+04000000 83..08+00099999
505.08+00000001 508...+quick end 509...+000000B1 510.08+00100000 512...+00000002 513.08+00099999
410013+?......1
110014+000000B2 83..58+00200000
110015+000000B2 32...8+01000000 331.08+00150000
110016+00000002 32...8+01000000 332.08+00100000
110017+00000002 573.08+00000000 574.08+02000000 83..08+00200500
110018+00000002 32...8+01000000 331.08+00120000
110019+00000003 32...8+01000000 332.08+00140000
110020+00000003 573.08+00000000 574.08+04000000 83..08+00200300
"""


@pytest.mark.parametrize(("name", "again"), [("BM 3", "BM 3"), ("TBM-A", "TBM-A"), ("bmb", "bmb"), ("TP1", "TP1 (2)")])
def test_a_benchmark_inside_two_lines_is_one_point_and_a_turning_point_is_not(name: str, again: str) -> None:
    levelling = Levelling()
    for points in (("A", name, "B"), ("B", name, "A")):
        levelling.begin()
        for k, (back, fore) in enumerate(pairwise(points)):
            levelling.sight_back(StaffReading(back, 1.5, None, 2 * k))
            levelling.sight_forward(StaffReading(fore, 1.0, None, 2 * k + 1))
    rows, _ = levelling.finish()
    assert [row[:2] for row in rows] == [("A", name), (name, "B"), ("B", again), (again, "A")]


def test_lines_that_begin_at_0_do_not_share_turning_points(tmp_path: Path) -> None:
    """Both have turning point 1 at 0.2 m, above B1 and above B2; the first one ends at E, not where it began."""
    text = (
        "410001+?......1\n110002+000000B1 83..58+00000000\n110003+000000B1 32...8+01000000 331.08+00150000\n"
        "110004+00000001 32...8+01000000 332.08+00130000\n110005+00000001 573.08+0 574.08+02000000 83..08+00020000\n"
        "110006+00000001 32...8+01000000 331.08+00120000\n110007+0000000E 32...8+01000000 332.08+00170000\n"
        "110008+0000000E 573.08+0 574.08+04000000 83..08-00030000\n"
        "505.08+00000001 508...+quick end 509...+000000B1 510.08+00000000 512...+0000000E 513.08-00030000\n"
        "410009+?......1\n110010+000000B2 83..58+00000000\n110011+000000B2 32...8+01000000 331.08+00150000\n"
        "110012+00000001 32...8+01000000 332.08+00130000\n110013+00000001 573.08+0 574.08+02000000 83..08+00020000\n"
        "110014+00000001 32...8+01000000 331.08+00120000\n110015+0000000E 32...8+01000000 332.08+00140000\n"
        "110016+0000000E 573.08+0 574.08+04000000 83..08+00000000\n"
    )
    assert [row[:3] for row in _rows(_read(tmp_path, "a.gsi", text))] == [
        ("B1", "1", 0.2),
        ("1", "E", -0.5),
        ("B2", "1 (2)", 0.2),
        ("1 (2)", "E", -0.2),
    ]


def test_intermediate_sights_do_not_end_a_set_up_and_a_last_point_may_be_a_benchmark(tmp_path: Path) -> None:
    """Readings in 0.01 mm: B1 to 1 rises 0.2 m, 1 to the last point, which is B1, falls 0.2001 m."""
    document = _read(tmp_path, "a.gsi", GSI)
    assert _rows(document) == [
        ("B1", "1", 0.2, 20.0),
        ("1", "B1", -0.2001, 20.0),
        ("B1", "P1", 0.5, 15.0),
        ("1", "P2", 0.1, 15.0),
        ("B2", "2", 0.5, 20.0),
        ("2", "3", -0.2, 20.0),
    ]
    assert [row[0] for row in document.data["points"][0]["rows"]] == ["B1", "B2"]


def test_a_number_that_ends_a_line_is_another_point_at_another_height(tmp_path: Path) -> None:
    without = "\n".join(line for line in GSI.split("\n") if not line.startswith("505"))
    assert ("B2", "2 (2)", 0.5, 20.0) in _rows(_read(tmp_path, "a.gsi", without))


def test_a_book_of_the_form_rec_500(tmp_path: Path) -> None:
    text = """\
     1 Start-Line       BFFB      7
     2       B1    0              7                                   Z     100.000
     3       B1    0              7 Rb        1.500 HD        20.00
     4        1    0              7 Rf        1.300 HD        22.00
     5        1    0              7                                   Z     100.200
     6 Intermediate sight.        7
     7       P1    0              7 Rz        1.000 HD        10.00 Z       100.500
     8        1    0  4           7 Sr        20.00 Sv        22.00 Z       100.200
     9 End-Line                   7
"""
    document = _read(tmp_path, "a.rec", text)
    assert _rows(document) == [("B1", "1", 0.2, 42.0), ("B1", "P1", 0.5, 30.0)]
    assert "lengths of the form REC 500 are taken as metres" in _notes(document)


def test_set_ups_without_heights_between_them(tmp_path: Path) -> None:
    """A reading to another point ends a set-up; a reading back that follows the last one forward begins the next."""
    text = """\
110001+0000000A 32...6+00200000 331.06+00015000
110002+0000000P 32...6+00100000 332.06+00010000
110003+0000000A 32...6+00200000 331.06+00016000
110004+0000000Q 32...6+00300000 332.06+00010000
110005+0000000Q 32...6+00300000 331.06+00012000
110006+0000000R 332.06+00010500
110007+0000000S 32...6+00100000 330.06+00010500
"""
    document = _read(tmp_path, "a.gsi", text)
    assert _rows(document) == [("A", "P", 0.5, 30.0), ("A", "Q", 0.6, 50.0), ("Q", "R", 0.15)]
    sigmas = [table["values"]["sigma"] for table in document.data["observations"]]
    assert sigmas == ["1 mm", "0.3 mm"]
    assert "not read: staff readings outside a line (1 record, lines 7)" in _notes(document)


def test_points_without_names_and_feet(tmp_path: Path) -> None:
    text = (
        "For M5|Adr 1|KD1       B1                  1|      |    |Z  100.0 ft |\n"
        "For M5|Adr 2|KD1       B1       08:00:001  1|Rb 5.0 ft |HD 100.0 ft |  |\n"
        "For M5|Adr 3|KD1                08:00:001  1|Rf 4.0 ft |HD 100.0 ft |  |\n"
        "For M5|Adr 4|KD1                08:00:001  1|          |           |Z 101.0 ft|\n"
        "For M5|Adr 5|KD1                08:00:001  1|Rb 3.0 ft |HD 100.0 ft |  |\n"
        "For M5|Adr 6|KD1       B2       08:00:001  1|Rf 5.0 ft |HD 100.0 ft |  |\n"
        "For M5|Adr 7|KD1       B3       08:00:001  1|Rb 5.0 ft |HD 100.0 ft |  |\n"
    )
    document = _read(tmp_path, "a.dat", text)
    assert _rows(document) == [
        ("B1", "turning point 3", 0.3048, 60.96),
        ("turning point 3", "B2", -0.6096, 60.96),
    ]
    assert "not read: staff readings without a counterpart (1 record, lines 7)" in _notes(document)


def test_given_heights_of_points_that_no_reading_refers_to_are_not_used(tmp_path: Path) -> None:
    """The given height stands alone: the line is a free network of its own."""
    path = tmp_path / "b.gsi"
    path.write_text(
        "110001+00000B01 83...6+01000000\n"
        "110002+00000001 32...6+00100000 331.06+00015000\n"
        "110003+00000002 32...6+00100000 332.06+00012000\n"
    )
    document = read_foreign(path)
    assert [row[0] for table in document.data["points"] for row in table["rows"]] == ["1", "2"]
    assert "1 given point not used: no reading refers to them" in " ".join(map(str, document.notes))
    adjustment = solve_network(network_of(document, tmp_path)).adjustment
    values = adjustment.values["point"]
    assert float(values[1][2] - values[0][2]) == pytest.approx(0.3)


def test_a_book_of_an_sdl_level(tmp_path: Path) -> None:
    """1.5 - 1.2 to 2, 1.7 - 0.4 to 3 between, 1.7 - 1.6 to 4, which is called 5 at the next set-up; a new line at 6."""
    rows = [
        "SDL30,1,2,JOB,0,8,,,",
        "0001,0001,1,1,1,30.00,1.5000,50.0000,",
        "0002,0002,1,1,2,20.00,1.2000,50.3000,",
        "0003,0002,1,1,1,25.00,1.7000,50.3000,",
        "0004,0003,1,1,2,11.00,0.4000,51.6000,",
        "0005,0004,1,1,2,25.00,1.6000,50.4000,",
        "0006,0005,1,1,1,15.00,1.1000,50.4000,",
        "0007,0001,1,1,2,15.00,1.5002,49.9998,",
        "0008,0001,1,1,1,10.00,1.0000,50.0000,",
        "0009,0006,1,1,2,12.00,1.3000,49.7000,",
    ]
    document = _read(tmp_path, "job.csv", "\r\n".join(rows) + "\r\n")
    assert sorted(_rows(document)) == [
        ("0001", "0002", 0.3, 50.0),
        ("0001", "0006", -0.3, 22.0),
        ("0002", "0003", 1.3, 36.0),
        ("0002", "0004", 0.1, 50.0),
        ("0004", "0001", -0.4002, 30.0),
    ]
    assert next(row for table in document.data["points"] for row in table["rows"] if "50.0" in row)[0] == "0001"
    assert "coordinates that the instrument computed" in _notes(document)
    with pytest.raises(InputError, match="expected number, point, 0, 0, 1 or 2") as error:
        _read(tmp_path, "bad.csv", "\n".join([*rows[:2], "0002,0002,1,1,7,20.00,1.2000,50.3000,"]))
    assert error.value.problems[0].line == 3


@pytest.mark.parametrize(
    ("turning", "reading", "names"),
    [("T4", 1.4796, ("T4", "T4")), ("T4", 1.4, ("T4", "T4 (2)")), ("4", 1.4796, ("4", "4 (2)"))],
    ids=["same", "other", "number"],
)
def test_a_turning_point_of_lines_that_begin_at_different_heights(
    tmp_path: Path, turning: str, reading: float, names: tuple[str, str]
) -> None:
    """T4 is 20 mm above T3 in the line from T1, and 20.4 mm above it in the line from T3: both begin at 0.

    A number may be another point in each line, and 100 mm above T3 is another point of the same name.
    """
    lines = []
    for number, (begin, sights) in enumerate(
        [
            ("T1", [("T1", 1.5, "T3", 1.4), ("T3", 1.5, turning, 1.48), (turning, 1.5, "T1", 1.6202)]),
            ("T3", [("T3", 1.5, turning, reading), (turning, 1.5, "T3", 3.0 - reading)]),
        ],
        start=1,
    ):
        lines += [f"For M5|Adr 1|TO  Start-Line         BF     {number}| | | |"]
        lines += [f"For M5|Adr 1|KD1       {begin}                  {number}|    |    |Z 0.00000 m |"]
        height = 0.0
        for back, high, fore, low in sights:
            height += high - low
            for name, kind, value in ((back, "Rb", high), (fore, "Rf", low)):
                row = f"For M5|Adr 1|KD1 {name:>8}       08:00:001  {number}|{kind} {value:.5f} m |HD 10.000 m | |"
                lines.append(row)
            lines.append(f"For M5|Adr 1|KD1 {fore:>8}                  {number}|    |    |Z {height:.5f} m |")
    document = _read(tmp_path, "a.dat", "\n".join(lines))
    ends = [row[1] for row in _rows(document)]
    assert [ends[1], ends[3]] == list(names)
