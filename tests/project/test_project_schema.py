"""The published schema of project files: what the program writes fits it, what is wrong does not, all is described."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from mor.project.document import yaml_text
from mor.project.schema import project_schema
from mor.report.schema import results_schema
from tests.published_schemas import mistakes
from tests.scenarios.small_projects import BLOCK, LEVELLING, mor, write

SAMPLES = Path(__file__).parents[2] / "sample_projects"
GKF = """<?xml version="1.0"?>
<gama-local xmlns="http://www.gnu.org/software/gama/gama-local">
<network axes-xy="ne" angles="left-handed">
<parameters sigma-apr="1" conf-pr="0.95" tol-abs="1000" sigma-act="aposteriori"/>
<points-observations distance-stdev="5" direction-stdev="10">
<point id="010" x="1000" y="1000" fix="xy"/>
<point id="no" x="1100" y="1000" fix="xy"/>
<point id="3" x="1050" y="1080" adj="xy"/>
<obs from="010"><direction to="no" val="0"/><direction to="3" val="64.4"/><distance to="3" val="94.34"/></obs>
<obs from="no"><direction to="010" val="0"/><direction to="3" val="335.6"/><distance to="3" val="94.335"/></obs>
</points-observations></network></gama-local>
"""


@pytest.mark.parametrize("name", sorted(path.parent.name for path in SAMPLES.glob("*/project.yaml")))
def test_samples_fit(name: str) -> None:
    assert mistakes(SAMPLES / name / "project.yaml") == []


def test_a_converted_project_fits_and_has_numbers(tmp_path: Path) -> None:
    source, target = tmp_path / "net.gkf", tmp_path / "net.yaml"
    source.write_text(GKF)
    assert mor("convert", source, "-o", target, "--quiet").code == 0
    assert mistakes(target) == []
    data = yaml.safe_load(target.read_text())
    rows = [row for table in data["points"] for row in table["rows"]]
    assert {row[0] for row in rows} == {"010", "no", "3"}
    assert all(isinstance(cell, float | int) for row in rows for cell in row[1:])


def test_a_new_project_fits_and_tells_editors_its_schema(tmp_path: Path) -> None:
    shutil.copy(SAMPLES / "facade" / "image_points.csv", tmp_path)
    project = tmp_path / "p.yaml"
    (tmp_path / "mor.schema.json").write_text('{"title": "of an older version"}')
    assert mor("new", project, tmp_path / "image_points.csv", "-c", "28").code == 2
    assert mor("new", project, tmp_path / "image_points.csv", "-c", "28", "--force").code == 0
    first = project.read_text().splitlines()[0]
    assert first == "# yaml-language-server: $schema=mor.schema.json"
    assert (tmp_path / "mor.schema.json").read_text() == project_schema()
    assert mistakes(project) == []


@pytest.mark.parametrize(
    "wrong",
    [
        LEVELLING.replace("length: m", "length: yards"),
        LEVELLING.replace("fixed: [x, y, z]", "fixd: [x, y, z]"),
        BLOCK.replace("c: 20", "c: {free: 20, colour: 1}"),
        BLOCK.replace("datum: free", "settings: {max_iterations: many}"),
    ],
)
def test_mistakes_do_not_fit(wrong: str, tmp_path: Path) -> None:
    assert mistakes(write(tmp_path, wrong)) != []


@pytest.mark.parametrize("schema", [project_schema(), results_schema()], ids=["project", "results"])
def test_every_key_is_described_and_the_schema_has_a_name(schema: str) -> None:
    data: dict[str, Any] = json.loads(schema)
    assert data["$id"].startswith("urn:mor:schema:")
    lacking = [
        (name, key)
        for name, part in (("", data), *data["$defs"].items())
        for key, value in part.get("properties", {}).items()
        if not value.get("description")
    ]
    assert lacking == []


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("28.8", 28.8),
        ("-1e-05", -1e-05),
        ("2E3", 2000.0),
        ("1.5e+10", 1.5e10),
        ("7", 7),
        ("0.1000000000000000056", 0.1),
    ],
)
def test_numbers_are_written_without_quotes(text: str, number: float) -> None:
    written = yaml_text({"settings": {"sigma0": text}}, 100)
    assert yaml.safe_load(written) == {"settings": {"sigma0": number}}
    assert "'" not in written


@pytest.mark.parametrize("text", ["12:30", "0x10", "010", "1_000", "no", "2001-01-01", "~", "5 um", "nan", ".5"])
def test_other_texts_stay_texts(text: str) -> None:
    assert yaml.safe_load(yaml_text({"settings": {"sigma0": text}}, 100)) == {"settings": {"sigma0": text}}


def test_names_stay_texts_whatever_they_look_like() -> None:
    table = {"columns": ["id", "x"], "rows": [["7", "7"], ["1e3", "1e3"]], "name": "12", "group": "3"}
    written = yaml.safe_load(yaml_text({"points": [table], "datum": {"free": ["7"]}}, 100))
    assert written["points"][0]["rows"] == [["7", 7], ["1e3", 1000.0]]
    assert (written["points"][0]["name"], written["points"][0]["group"]) == ("12", "3")
    assert written["datum"] == {"free": ["7"]}
