"""``mor convert``: the written project is the same project."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from mor.api.pipeline import read_document, read_network
from mor.cli import run
from mor.formats import read_foreign
from mor.project.document import LONGEST, project_files

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


def test_converted_project_adjusts_to_the_same(tmp_path: Path) -> None:
    source, target = tmp_path / "net.gkf", tmp_path / "elsewhere" / "net.yaml"
    source.write_text(GKF)
    assert run(["convert", str(source), "-o", str(target), "--quiet"]) == 0
    for path, name in ((source, "a"), (target, "b")):
        assert run(["adjust", str(path), "-o", str(tmp_path / name), "--quiet", "--no-html"]) == 0
    first, second = (pl.read_csv(tmp_path / name / "points.csv", infer_schema=False) for name in "ab")
    assert first.equals(second)
    assert first["id"].to_list() == ["010", "no", "3"]


def test_long_tables_stand_beside_the_project(tmp_path: Path) -> None:
    rows = [[f"0{k}", None, f"{k}.5", 'a "name", quoted'] for k in range(LONGEST + 1)]
    data = {"mor": "1", "points": [{"columns": ["id", None, "x", "y"], "rows": rows, "fixed": ["x"]}]}
    texts = project_files(data, tmp_path, tmp_path / "p.yaml")
    table = texts[tmp_path / "p_points_1.csv"].splitlines()
    assert table[:2] == ["id,x,y", '00,0.5,"a ""name"", quoted"']
    assert len(table) == LONGEST + 2
    assert "file: p_points_1.csv" in texts[tmp_path / "p.yaml"]


def test_short_rows_stay_and_identifiers_stay_texts(tmp_path: Path) -> None:
    source, target = tmp_path / "net.gkf", tmp_path / "net.yaml"
    source.write_text(GKF)
    assert run(["convert", str(source), "-o", str(target)]) == 0
    assert list(tmp_path.glob("*.csv")) == []
    assert read_document(target).data == read_foreign(source).data
    assert read_network(read_document(target), tmp_path).things["point"].ids == ("010", "no", "3")


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, target = tmp_path / "net.gkf", tmp_path / "net.yaml"
    source.write_text(GKF)
    target.write_text("mine")
    assert run(["convert", str(source), "-o", str(target)]) == 2
    assert target.read_text() == "mine"
    assert "--force" in capsys.readouterr().err
    assert run(["convert", str(source), "-o", str(target), "--force"]) == 0


def test_unknown_format(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["convert", str(tmp_path / "x.gkg"), "-o", str(tmp_path / "x.yaml")]) == 2
    assert "did you mean '.gkf'" in capsys.readouterr().err
