"""The published schema of results.json: every result there is fits it, and nothing is in a result that it lacks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel, ValidationError

from mor.cli import run
from mor.report.schema import Results
from tests.selection import slow_but

SAMPLES = Path(__file__).parents[2] / "sample_projects"
NAMES = sorted(path.parent.name for path in SAMPLES.glob("*/project.yaml"))

PLACE = ("type", "group", "at", "from", "to", "component", "unit")


def unknown_keys(part: Any, path: str = "") -> list[str]:
    """Paths of keys that the model does not name."""
    if isinstance(part, list):
        return sorted({key for item in part for key in unknown_keys(item, f"{path}[]")})
    if isinstance(part, dict):
        return [key for name, item in part.items() for key in unknown_keys(item, f"{path}.{name}")]
    if not isinstance(part, BaseModel):
        return []
    extra = [f"{path}.{key}" for key in part.__pydantic_extra__ or {}]
    return extra + [
        key for name in type(part).model_fields for key in unknown_keys(getattr(part, name), f"{path}.{name}")
    ]


def results_of(project: Path, capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, Any]:
    run(["adjust", str(project), "--json", "--quiet", *options])
    data: dict[str, Any] = json.loads(capsys.readouterr().out)
    return data


@pytest.mark.parametrize("name", slow_but(("aerial_strip", "bridge", "building"), NAMES))
def test_every_sample_fits(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    data = results_of(SAMPLES / name / "project.yaml", capsys, "--snoop")
    assert unknown_keys(Results.model_validate(data)) == []
    places = [tuple(row[key] for key in PLACE) for row in data["residuals"]]
    found = [tuple(row[key] for key in PLACE) for row in data["gross_errors"]["suspicious"]]
    assert found
    assert set(found) <= set(places)


def test_no_solution_fits_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    project = tmp_path / "p.yaml"
    project.write_text(
        "mor: 1\npoints: [{columns: [id, x, y, z], rows: [[A, 0, 0, 0]], fixed: [x, y, z]},"
        " {columns: [id, x, y, z], rows: [[B, 1, 1, 1]]}]\n"
        "observations: [{type: distance, columns: [from, to, distance, sigma], rows: [[A, B, 2, 0.1]]}]\n"
    )
    data = results_of(project, capsys)
    assert data["outcome"] == "singular"
    assert unknown_keys(Results.model_validate(data)) == []


def test_schema_is_printed_and_names_every_key(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["schema", "results"]) == 0
    schema = json.loads(capsys.readouterr().out)
    data = results_of(SAMPLES / "facade" / "project.yaml", capsys)
    assert set(data) <= set(schema["properties"])
    assert set(schema["required"]) <= set(data)
    assert "from" in schema["$defs"]["Residual"]["properties"]


def test_a_wrong_type_does_not_fit(capsys: pytest.CaptureFixture[str]) -> None:
    data = results_of(SAMPLES / "stereo_rig" / "project.yaml", capsys)
    with pytest.raises(ValidationError, match="points"):
        Results.model_validate({**data, "points": [{**data["points"][0], "rays": "3"}]})
