"""JSON Schema of the project file."""

from __future__ import annotations

import json

from mor.project.file.model import Project


def project_schema() -> str:
    """JSON Schema (2020-12) of the project file as text.

    Numbers may be written as numbers or as texts, as YAML has them.
    """
    lenient = _lenient(Project.model_json_schema())
    assert isinstance(lenient, dict)
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": "urn:mor:schema:project:1",
        **lenient,
    }
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def _lenient(node: object) -> object:
    """Let numbers stand where texts are expected: YAML editors see 28.8 as a number, and version 1 as one."""
    if isinstance(node, list):
        return [_lenient(item) for item in node]
    if not isinstance(node, dict):
        return node
    node = {key: _lenient(value) for key, value in node.items()}
    if node.get("type") == "string":
        node["type"] = ["string", "number"]
    if node.get("const") == "1":
        node = {key: value for key, value in node.items() if key not in ("const", "type")} | {
            "enum": ["1", 1]
        }
    return node
