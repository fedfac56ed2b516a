"""From plain data to the model: all mistakes of a file at once, each with its line and the nearest known name."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from mor.errors import InputError, Problem, nearest
from mor.project.file.model import Project
from mor.project.file.nodes import Document, Path

_OTHER_KIND = {"string_type", "dict_type", "list_type", "model_type", "model_attributes_type"}


def validate(document: Document) -> Project:
    """The model of a document. Raises :class:`InputError` with every mistake found."""
    try:
        project = Project.model_validate(document.data)
    except ValidationError as error:
        details = _telling(document, error.errors(include_url=False))
        problems = dict.fromkeys([*document.problems, *_problems(document, details)])
        raise InputError(sorted(problems, key=lambda problem: problem.line)) from None
    if document.problems:
        raise InputError(document.problems)
    return project


def without_empty_keys(document: Document) -> Document:
    """The document without keys that have nothing behind them (``settings:``), where they are keys of the model.

    What is empty elsewhere has a meaning, as in ``columns``, or is a mistake, as a camera without any word.
    """
    return replace(document, data=_without_empty(document.data, ()))


def _without_empty(data: Any, path: Path) -> Any:
    if isinstance(data, list):
        return [
            _without_empty(entry, (*path, k)) if isinstance(entry, dict) else entry
            for k, entry in enumerate(data)
        ]
    if not isinstance(data, dict):
        return data
    known = set(_known_keys(path))
    kept = {key: value for key, value in data.items() if value is not None or key not in known}
    return {key: _without_empty(value, (*path, key)) for key, value in kept.items()}


def _telling(document: Document, details: list[ErrorDetails]) -> list[ErrorDetails]:
    """Of a value that is none of several things it may be, only what it fails as what it looks like."""
    paths = [_data_path(document.data, detail) for detail in details]
    return [
        detail
        for detail, path in zip(details, paths, strict=True)
        if not _of_another_kind(detail)
        or not any(
            other is not detail
            and beneath[: len(path)] == path
            and (len(beneath) > len(path) or not _of_another_kind(other))
            for other, beneath in zip(details, paths, strict=True)
        )
    ]


def _of_another_kind(detail: ErrorDetails) -> bool:
    """Return True if an error says only that this is another kind of thing."""
    structured = isinstance(detail.get("input"), (dict, list))
    return detail["type"] in _OTHER_KIND or (detail["type"] == "literal_error" and structured)


def _problems(document: Document, details: list[ErrorDetails]) -> list[Problem]:
    """One problem for every place; what a value may be instead is told together."""
    by_path: dict[Path, list[ErrorDetails]] = {}
    for detail in details:
        by_path.setdefault(_data_path(document.data, detail), []).append(detail)
    problems = []
    for path, found in by_path.items():
        where = " → ".join(str(part + 1) if isinstance(part, int) else part for part in path)
        words = dict.fromkeys(_words(detail, path, where) for detail in found)
        opening = f"{where}: found {_short(found[0].get('input'))}, expected "
        if len(words) > 1 and all(text.startswith(opening) for text in words):
            words = {opening + ", or ".join(text.removeprefix(opening) for text in words): None}
        problems += [Problem(text, document.file_of(path), document.line(path)) for text in words]
    return problems


def _words(detail: ErrorDetails, path: Path, where: str) -> str:
    kind, given = detail["type"], detail.get("input")
    if kind == "extra_forbidden":
        known = _known_keys(path[:-1])
        return f"unknown key {path[-1]!r}{nearest(str(path[-1]), known)} (known here: {', '.join(known)})"
    if kind == "missing":
        return f"{where or 'the project'}: this key is required"
    if kind == "value_error":
        return f"{where}: {detail['ctx']['error']}"
    context = detail.get("ctx", {})
    if kind == "literal_error":
        expected = context["expected"]
        choices = [choice.strip("' ") for choice in expected.replace(" or ", ", ").split(",")]
        return f"{where}: found {_short(given)}, expected {expected}{nearest(str(given), choices)}"
    message = detail["msg"]
    expected = _EXPECTED[kind].format(**context) if kind in _EXPECTED else message[0].lower() + message[1:]
    return f"{where}: found {_short(given)}, expected {expected}"


_EXPECTED = {
    "bool_parsing": "true or false",
    "bool_type": "true or false",
    "dict_type": "keys and values",
    "finite_number": "a finite number",
    "float_parsing": "a number",
    "float_type": "a number",
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "int_from_float": "a whole number",
    "int_parsing": "a whole number",
    "int_type": "a whole number",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "{le:g} or less",
    "list_type": "a list",
    "model_attributes_type": "keys and values",
    "model_type": "keys and values",
    "string_pattern_mismatch": "a number, with or without a unit",
    "string_too_long": "a single character",
    "string_too_short": "a text that is not empty",
    "string_type": "a single value",
}
"""What was expected where pydantic complains, in the words of a project file."""


def _short(given: Any) -> str:
    if given is None:
        return "nothing"
    if isinstance(given, (dict, list)):
        return "keys and values" if isinstance(given, dict) else "a list"
    text = repr(given)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _data_path(data: Any, detail: ErrorDetails) -> Path:
    """The part of pydantic's location that is a path in the data: names of union members are dropped."""
    path: list[str | int] = []
    for number, part in enumerate(detail["loc"]):
        missing = detail["type"] == "missing" and number == len(detail["loc"]) - 1
        if isinstance(data, dict) and (part in data or missing):
            data = data.get(part)
            path.append(part)
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            data = data[part]
            path.append(part)
    return tuple(path)


def _known_keys(path: Path) -> list[str]:
    """Keys the model knows at a path."""
    model: Any = Project
    for part in path:
        if isinstance(model, type) and issubclass(model, BaseModel) and part in model.model_fields:
            model = model.model_fields[str(part)].annotation
        model = _model_within(model)
        if model is None:
            return []
    return list(model.model_fields) if isinstance(model, type) and issubclass(model, BaseModel) else []


def _model_within(annotation: Any) -> Any:
    """The model an annotation such as ``list[Points]`` or ``str | Datum`` leads to."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in get_args(annotation):
        found = _model_within(argument)
        if found is not None:
            return found
    return None
