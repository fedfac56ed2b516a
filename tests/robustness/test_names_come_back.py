"""Names that spreadsheets, readers of CSV or terminals would take for something else come back as they were."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from tests.scenarios.small_projects import LEVELLING, mor, write

NAMES = (
    "#x",
    "=1+1",
    "'=y",
    "@a",
    "+b",
    "-c",
    "-5",
    "'#d",
    "d #e",
    "''-f",
    "'g",
    'h"i',
    "j,k",
    "\x1b[31m",
    "ü #",
    "k\x85   l",
    "m\u2028n",
)


def project(folder: Path, name: str) -> Path:
    """The levelling loop with another name for point B."""
    quoted = json.dumps(name)
    rows = LEVELLING.replace("[B,", f"[{quoted},").replace(", B,", f", {quoted},")
    return write(folder, rows)


def names_in(folder: Path) -> set[str]:
    return {row["id"] for row in json.loads((folder / "results.json").read_text())["points"]}


@pytest.mark.parametrize("name", NAMES)
def test_a_name_survives_results_and_the_adjusted_project(tmp_path: Path, name: str) -> None:
    assert mor("adjust", project(tmp_path, name), "--no-html").code == 0
    results = tmp_path / "project.results"
    assert names_in(results) == {"A", name, "C"}
    again = mor("adjust", results / "adjusted.yaml", "-o", tmp_path / "again", "--no-html")
    assert (again.code, names_in(tmp_path / "again")) == (0, {"A", name, "C"})
    carried = mor("datum", results, "--to", "{free: all}", "-o", tmp_path / "datum")
    assert carried.code in (0, 2)


@pytest.mark.parametrize("name", NAMES)
def test_no_cell_of_a_table_is_run_by_a_spreadsheet(tmp_path: Path, name: str) -> None:
    mor("adjust", project(tmp_path, name), "--no-html")
    for path in (tmp_path / "project.results").glob("*.csv"):
        with path.open(newline="", encoding="utf-8") as file:
            cells = {cell for row in csv.reader(file) for cell in row}
        assert not any(cell[:1] in "=+@\t" for cell in cells if cell and not is_number(cell)), path.name
        assert "-c" not in cells


def is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


@pytest.mark.parametrize("name", ["a\x1b[2Jb", "a\x07b", "a\u202eb", "a\u2028b", "a\x85b"])
def test_control_characters_are_spelled_out(tmp_path: Path, name: str) -> None:
    run = mor("adjust", project(tmp_path, name), "--no-html")
    report = (tmp_path / "project.results" / "report.txt").read_text(encoding="utf-8")
    unknown = mor("check", write(tmp_path / "x", LEVELLING.replace("[C, A,", f"[{json.dumps(name)}, A,")))
    sign = name[1]
    for text in (run.err, report, unknown.err):
        assert sign not in text
        assert (f"\\x{ord(sign):02x}" if ord(sign) < 0x100 else f"\\u{ord(sign):04x}") in text


@pytest.mark.parametrize("name", ["a\nb", "a\rb", "a\0b"])
def test_a_name_is_one_line(tmp_path: Path, name: str) -> None:
    run = mor("check", project(tmp_path, name))
    assert run.code == 2
    assert "expected a name without line breaks" in run.err


def test_comments_end_where_quotes_begin(tmp_path: Path) -> None:
    rows = "columns: [id, x, y, z], rows: [[A, 0, 0, 10]]"
    text = LEVELLING.replace(rows, "file: points.csv").replace("[A, B", '["A #1", B').replace(", A,", ', "A #1",')
    points = 'id,x,y,z # the only "fixed" one\n"A #1",0,0,10 # a comment\n# all of it\n'
    run = mor("adjust", write(tmp_path, text, points=points), "--no-html")
    assert (run.code, names_in(tmp_path / "project.results")) == (0, {"A #1", "B", "C"})


@pytest.mark.parametrize("name", ["a\x1b[31m", "<b>&", "$x^{", "$a$ $b", "点", "a\u202eb"])
def test_pictures_of_odd_names(tmp_path: Path, name: str) -> None:
    pytest.importorskip("matplotlib", reason="pictures need matplotlib")
    from xml.etree import ElementTree

    assert mor("adjust", project(tmp_path, name), "--no-html").code == 0
    run = mor("plot", "network", tmp_path / "project.results", "-o", tmp_path / "network.svg")
    assert (run.code, run.err) == (0, "")
    ElementTree.parse(tmp_path / "network.svg")
