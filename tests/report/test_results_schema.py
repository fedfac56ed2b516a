"""The published schema of results.json: every result there is fits it, and nothing is in a result that it lacks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from mor.cli import run
from mor.report.schema import results_schema
from tests.selection import slow_but

SAMPLES = Path(__file__).parents[2] / "sample_projects"
NAMES = sorted(path.parent.name for path in SAMPLES.glob("*/project.yaml"))

PLACE = ("type", "group", "at", "from", "to", "component", "unit")


def closed(part: Any) -> Any:
    """The schema without further keys."""
    if isinstance(part, list):
        return [closed(item) for item in part]
    if not isinstance(part, dict):
        return part
    return {
        key: False if item is True and key == "additionalProperties" else closed(item) for key, item in part.items()
    }


STRICT = jsonschema.Draft202012Validator(closed(json.loads(results_schema())))


def mistakes(data: dict[str, Any]) -> list[str]:
    """Paths and words of everything that does not fit, keys that the schema does not name among them."""
    return [f"{error.json_path}: {error.message[:200]}" for error in STRICT.iter_errors(data)]


def results_of(project: Path, capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, Any]:
    run(["adjust", str(project), "--json", "--quiet", *options])
    data: dict[str, Any] = json.loads(capsys.readouterr().out)
    return data


@pytest.mark.parametrize("name", slow_but(("aerial_strip", "bridge", "building"), NAMES))
def test_every_sample_fits(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    data = results_of(SAMPLES / name / "project.yaml", capsys, "--snoop")
    assert mistakes(data) == []
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
    assert mistakes(data) == []


def test_schema_is_printed_and_names_every_key(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["schema", "results"]) == 0
    schema = json.loads(capsys.readouterr().out)
    data = results_of(SAMPLES / "facade" / "project.yaml", capsys)
    assert set(data) <= set(schema["properties"])
    assert set(schema["required"]) <= set(data)
    assert "from" in schema["$defs"]["Residual"]["properties"]


def test_a_wrong_type_does_not_fit(capsys: pytest.CaptureFixture[str]) -> None:
    data = results_of(SAMPLES / "stereo_rig" / "project.yaml", capsys)
    (found,) = mistakes({**data, "points": [{**data["points"][0], "rays": "3"}]})
    assert found.startswith("$.points")


def test_results_without_a_key_are_not_complete(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "results"
    run(["adjust", str(SAMPLES / "bridge" / "project.yaml"), "-o", str(folder), "--quiet", "--no-html"])
    whole = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    for key in ("axes", "sigma0", "solution", "critical_w", "iteration_log"):
        (folder / "results.json").write_text(json.dumps({name: whole[name] for name in whole if name != key}))
        assert run(["report", str(folder), "-o", str(tmp_path / "page.html"), "-f"]) == 2
        assert "these results are not complete" in capsys.readouterr().err
