"""The reference pages of the project file: every example runs, every key is there."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any, get_args

import pytest
import yaml
from pydantic import BaseModel

from mor.model.observation_types import PLAIN_TYPES
from mor.project.document import read_yaml
from mor.project.schema import ProjectFile
from tests.scenarios.small_projects import mor

ROOT = Path(__file__).parents[2]
PAGE = "\n".join(
    (ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("project-file.md", "project-sections.md")
)
EPOCHS = (ROOT / "docs" / "epochs.md").read_text(encoding="utf-8")
EXAMPLES = [
    *re.findall(r"^```yaml\n(.*?)^```$", PAGE, re.M | re.S),
    *re.findall(r"^```yaml\n(mor:.*?)^```$", EPOCHS, re.M | re.S),
]
OBSERVATION_TYPES = (ROOT / "docs" / "observation-types.md").read_text(encoding="utf-8")
FRAGMENTS = [
    *(example for example in EXAMPLES if not example.startswith("mor:")),
    *re.findall(r"^```yaml\n(.*?)^```$", OBSERVATION_TYPES, re.M | re.S),
]
BASE = ROOT / "sample_projects" / "building"


def first_line(example: str) -> str:
    return example.splitlines()[0]


def into(base: dict[str, Any], fragment: dict[str, Any]) -> dict[str, Any]:
    """The base project with a fragment in it: lists grow, mappings of names too, all else is replaced.

    A file of the fragment takes the place of the same file in the base: no file may be read twice.
    """
    merged = dict(base)
    for key, value in fragment.items():
        if isinstance(value, list):
            files = {entry["file"] for entry in value if isinstance(entry, dict) and "file" in entry}
            kept = [e for e in base.get(key, []) if not (isinstance(e, dict) and e.get("file") in files)]
            merged[key] = [*kept, *value]
        elif key in ("cameras", "instruments"):
            merged[key] = {**base.get(key, {}), **value}
        else:
            merged[key] = value
    return merged


@pytest.mark.parametrize("example", [e for e in EXAMPLES if e.startswith("mor:")], ids=first_line)
def test_whole_project_is_adjusted(tmp_path: Path, example: str) -> None:
    project = tmp_path / "project.yaml"
    project.write_text(example, encoding="utf-8")
    run = mor("adjust", project)
    assert run.code == 0, run.err


@pytest.mark.parametrize("example", FRAGMENTS)
def test_fragment_is_understood(tmp_path: Path, example: str) -> None:
    shutil.copytree(BASE, tmp_path / "building")
    project = tmp_path / "building" / "project.yaml"
    base = read_yaml(project.read_text(encoding="utf-8"), "base").data
    merged = into(base, read_yaml(example, "example").data)
    project.write_text(yaml.safe_dump(merged, allow_unicode=True), encoding="utf-8")
    run = mor("check", project)
    assert run.code == 0, run.err


def test_every_observation_type_has_an_example() -> None:
    shown = {
        group["type"] for example in FRAGMENTS for group in read_yaml(example, "example").data.get("observations", [])
    }
    assert shown >= {"image", *PLAIN_TYPES, "parameter", "difference"}


def test_there_are_examples_of_most_sections() -> None:
    shown = {key for example in EXAMPLES for key in read_yaml(example, "example").data}
    assert set(ProjectFile.model_fields) - shown <= {"units", "pairs", "line_times"}


def models(annotation: Any) -> set[type[BaseModel]]:
    """All models an annotation leads to."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        inner = [models(field.annotation) for field in annotation.model_fields.values()]
        return {annotation}.union(*inner)
    return set().union(*(models(argument) for argument in get_args(annotation)))


def keys() -> list[tuple[str, str]]:
    return sorted(
        (model.__name__, field.alias or key)
        for model in models(ProjectFile)
        for key, field in model.model_fields.items()
    )


@pytest.mark.parametrize(("model", "key"), keys())
def test_every_key_is_described(model: str, key: str) -> None:
    assert re.search(rf"[`{{ ]{key}\b", PAGE), f"{model}.{key}"


def test_links_lead_somewhere() -> None:
    anchors = {re.sub(r"[^\w\- ]", "", line).strip().replace(" ", "-") for line in re.findall(r"^#+ (.*)$", PAGE, re.M)}
    for target in re.findall(r"\]\(([^)]+)\)", PAGE):
        if target.startswith("#"):
            assert target[1:].lower() in {anchor.lower() for anchor in anchors}, target
