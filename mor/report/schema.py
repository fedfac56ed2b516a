"""What ``results.toml`` says of results: JSON Schema of results.json, units and types of the columns of tables."""

from __future__ import annotations

import json
import tomllib
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import polars as pl


class Key(NamedTuple):
    """A key of results, or a column of a table; ``results.toml`` describes its types and units."""

    type: str
    meaning: str
    unit: str = ""


@cache
def _parts() -> dict[str, dict[str, Any]]:
    return tomllib.loads(files("mor.report").joinpath("results.toml").read_text(encoding="utf-8"))


def keys_of(part: str) -> dict[str, Key]:
    """Keys of a part of the results by name: those of the part that it is like, then its own."""
    own = {name: Key(*said) for name, said in _parts()[part].items() if name not in ("about", "like")}
    like = _parts()[part].get("like")
    return {**keys_of(like), **own} if like else own


def missing(data: dict[str, Any]) -> list[str]:
    """Keys that every ``results.json`` has, and this one has not."""
    return [
        name for name, key in keys_of("Results").items() if not key.type.startswith("optional ") and name not in data
    ]


def units_of(part: str, length: str, angle: str) -> dict[str, str]:
    """Unit of each column of a table that has one; ``unit`` where each row has its own."""
    units = {"length": length, "angle": angle, "unit": "unit"}
    return {name: units[key.unit] for name, key in keys_of(part).items() if key.unit}


def data_types(part: str) -> dict[str, type[pl.DataType]]:
    """Type of each column of a table."""
    known: dict[str, type[pl.DataType]] = {"number": pl.Float64, "integer": pl.Int64, "boolean": pl.Boolean}
    return {name: known.get(key.type.rstrip("?"), pl.String) for name, key in keys_of(part).items()}


# ---- JSON Schema of ``results.json``. Keys may be added in later versions; those that are there keep their meaning.


def results_schema() -> str:
    """JSON Schema (2020-12) of ``results.json`` as text."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": "urn:mor:schema:results:2"}
    parts = {part: _schema_of_part(part) for part in _parts()}
    whole = {**head, "title": "Results", **parts.pop("Results"), "$defs": parts}
    return json.dumps(whole, indent=2, ensure_ascii=False) + "\n"


def _schema_of_part(part: str) -> dict[str, Any]:
    keys = keys_of(part)
    return {
        "description": _parts()[part]["about"],
        "type": "object",
        "properties": {
            name: {**_schema_of_type(key.type.removeprefix("optional ")), "description": key.meaning}
            for name, key in keys.items()
        },
        "required": [name for name, key in keys.items() if not key.type.startswith("optional ")],
        "additionalProperties": True,
    }


def _schema_of_type(said: str) -> dict[str, Any]:
    container, _, of = said.partition(" of ")
    if container.rstrip("?") == "list":
        found: dict[str, Any] = {"type": "array", "items": _schema_of_type(of)}
    elif container.rstrip("?") == "map":
        found = {"type": "object", "additionalProperties": _schema_of_type(of)}
    elif said.startswith("only "):
        value = said.removeprefix("only ")
        return {"const": int(value) if value.isdecimal() else value}
    elif " | " in said:
        return {"enum": [text.strip('"') for text in said.split(" | ")]}
    elif (kind := said.rstrip("?")) in _parts():
        found = {"$ref": f"#/$defs/{kind}"}
    elif kind == "correlation":
        found = {"type": "number", "minimum": -1, "maximum": 1}
    else:
        found = {"type": kind}
    return {"anyOf": [found, {"type": "null"}]} if container.endswith("?") else found
