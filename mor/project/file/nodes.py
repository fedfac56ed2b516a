"""YAML text to plain data in which every scalar is still text and every value knows its line.

PyYAML's own constructors lose a key given twice, read point 010 as 8 and point no as False. Here nodes are composed and
walked instead; what a text means is decided by the model that asks for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import yaml

from mor.errors import InputError, Problem

Path: TypeAlias = tuple[str | int, ...]

_NULLS = {"", "~", "null", "Null", "NULL"}
_DEEPEST = 20
"""Levels of nesting; no project needs half of them."""


@dataclass(frozen=True)
class Document:
    """Plain data (dicts, lists, texts, None), and the line of every value by its path."""

    data: dict[str, Any]
    lines: Mapping[Path, int]
    file: str
    files: Mapping[Path, str] = field(default_factory=dict)
    """Files of the parts that come from another file than ``file``."""
    notes: tuple[Problem, ...] = ()
    """What a reader left out or decided on its own, to be told to the user."""
    problems: tuple[Problem, ...] = ()
    """Mistakes that leave something to go on with (a key given twice): told together with those of the content."""

    def line(self, path: Path) -> int:
        """Line of the value at a path, or of the nearest value above it."""
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path, 1)

    def table_files(self) -> list[str]:
        """Files that the sections refer to, as written: tables and covariance matrices."""
        entries = [e for section in self.data.values() if isinstance(section, list) for e in section]
        named = [e.get(key) for e in entries if isinstance(e, dict) for key in ("file", "covariance")]
        return [name for name in named if isinstance(name, str)]

    def file_of(self, path: Path) -> str:
        """File that the value at a path comes from."""
        while path and path not in self.files:
            path = path[:-1]
        return self.files.get(path, self.file)


def read_yaml(text: str, file: str) -> Document:
    """Plain data of a YAML document with a mapping at its top.

    Keys given twice are among its ``problems``. Raises :class:`InputError` for broken YAML or another kind of document.
    """
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        node = yaml.compose(text, Loader=loader)
    except yaml.MarkedYAMLError as error:
        raise InputError([_broken(error, file)]) from None
    except yaml.YAMLError as error:
        words = str(error).splitlines()[0]
        raise InputError([Problem(f"this is not a text file of YAML: {words}", file)]) from None
    if not isinstance(node, yaml.MappingNode):
        raise InputError([Problem("expected a mapping of keys and values (mor: 1, title: …)", file, 1)])
    lines: dict[Path, int] = {}
    problems: list[Problem] = []
    data = _walk(node, (), lines, problems, file)
    return Document(data, lines, file, problems=tuple(problems))


_BROKEN = (
    ("plain scalar", "a blank is missing after a colon, or this text needs quotes"),
    ("quoted scalar", "the quote that opens here is not closed"),
    ("flow", "the bracket that opens here is not closed, or a comma is missing in it"),
    ("simple key", "expected key: value, found no colon"),
    (
        "cannot start any token",
        "this cannot stand here: indent with blanks, not with tabs; quote texts that begin with @, ` or %",
    ),
    ("undefined alias", "texts that begin with * need quotes"),
    ("block", "the indentation does not fit the lines above"),
    (
        "mapping values are not allowed",
        "a second colon in one line, or the indentation does not fit: texts with ': ' need quotes",
    ),
    ("single document", "a second document begins here (---); a project file has one"),
)
"""What YAML complains of, in plain words."""


def _broken(error: yaml.MarkedYAMLError, file: str) -> Problem:
    """Broken YAML in plain words, where they are known; what is left open is told where it began."""
    said = " ".join(part for part in (error.context, error.problem) if part)
    plain = next((words for part, words in _BROKEN if part in said), said)
    begun = "opens here" in plain or "no colon" in plain
    mark = (error.context_mark if begun else None) or error.problem_mark
    return Problem(f"this is not valid YAML: {plain}", file, mark.line + 1 if mark else 0)


def _walk(node: yaml.Node, path: Path, lines: dict[Path, int], problems: list[Problem], file: str) -> Any:
    lines[path] = node.start_mark.line + 1
    if len(path) > _DEEPEST:
        raise InputError([Problem("this is nested too deeply, or refers to itself", file, lines[path])])
    if isinstance(node, yaml.MappingNode):
        return _mapping(node, path, lines, problems, file)
    if isinstance(node, yaml.SequenceNode):
        return [_walk(item, (*path, i), lines, problems, file) for i, item in enumerate(node.value)]
    assert isinstance(node, yaml.ScalarNode)
    plain = node.style not in ("'", '"', "|", ">")
    return None if plain and node.value in _NULLS else node.value


def _mapping(
    node: yaml.MappingNode, path: Path, lines: dict[Path, int], problems: list[Problem], file: str
) -> dict[str, Any]:
    data: dict[str, Any] = {}
    first: dict[str, int] = {}
    for key_node, value_node in node.value:
        line = key_node.start_mark.line + 1
        if not isinstance(key_node, yaml.ScalarNode):
            problems.append(Problem("a key must be a plain text", file, line))
            continue
        key = key_node.value
        if key in first:
            problems.append(Problem(f"key {key!r} is given twice (first in line {first[key]})", file, line))
            continue
        first[key] = line
        data[key] = _walk(value_node, (*path, key), lines, problems, file)
        lines[(*path, key)] = line
    return data
