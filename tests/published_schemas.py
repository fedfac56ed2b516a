"""What the program writes, against the schemas it publishes, by a validator that knows nothing of the program."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import jsonschema
import yaml

from mor.project.schema import project_schema
from mor.report.schema import results_schema


@cache
def _validator(results: bool) -> jsonschema.Draft202012Validator:
    schema = json.loads(results_schema() if results else project_schema())
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def mistakes(path: Path) -> list[str]:
    """What the published schema has against a results.json, or a project file as any YAML reader has it."""
    results = path.suffix == ".json"
    text = path.read_text(encoding="utf-8")
    data = json.loads(text) if results else yaml.safe_load(text)
    return [f"{list(error.absolute_path)}: {error.message[:200]}" for error in _validator(results).iter_errors(data)]
