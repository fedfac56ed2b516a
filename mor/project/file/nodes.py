"""YAML text to plain data in which every scalar is still text and every value knows its line.

PyYAML's own constructors lose a key given twice, read point 010 as 8 and point no as False. Here its events are taken
instead; what a text means is decided by the model that asks for it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import yaml

from mor.errors import InputError, Problem
from mor.input_files import limit, raise_it

if TYPE_CHECKING:
    import polars as pl

Path: TypeAlias = tuple[str | int, ...]

_NULLS = {"", "~", "null", "Null", "NULL"}
_DEEPEST = 20
"""Levels of nesting; no project needs half of them."""
_TOO_DEEP = "this is nested too deeply, or refers to itself"
_VALUES = "MOR_MAX_VALUES"
_REPEATED = 10
"""Share of the values that aliases may repeat, as its denominator."""
_LETTERS = 100
"""Letters that a repeated value may have, on average at that limit."""


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

    frames: Mapping[str, pl.DataFrame] = field(default_factory=dict)
    """Data frames by the names that stand for them where a file of a table is named."""

    def line(self, path: Path) -> int:
        """Line of the value at a path, or of the nearest value above it."""
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path, 1)

    def table_files(self) -> list[str]:
        """Files that the sections refer to, as written: tables and covariance matrices."""
        entries = [e for section in self.data.values() if isinstance(section, list) for e in section]
        named = [e.get(key) for e in entries if isinstance(e, dict) for key in ("file", "covariance")]
        return [name for name in named if isinstance(name, str) and "\0" not in name]

    def frame(self, name: str) -> pl.DataFrame | None:
        """A data frame that stands in place of the file of this name, where there is one."""
        return self.frames.get(name)

    def file_of(self, path: Path) -> str:
        """File that the value at a path comes from."""
        while path and path not in self.files:
            path = path[:-1]
        return self.files.get(path, self.file)


def read_yaml(text: str, file: str) -> Document:
    """Plain data of a YAML document with a mapping at its top.

    Keys given twice are among its ``problems``. Raises :class:`InputError` for broken YAML, another kind of
    document, and one that is deeper or larger than the limits.
    """
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        return _Reader(file).read(yaml.parse(text, Loader=loader))
    except yaml.MarkedYAMLError as error:
        raise InputError([_broken(error, file)]) from None
    except yaml.YAMLError as error:
        words = str(error).splitlines()[0]
        raise InputError([Problem(f"this is not a text file of YAML: {words}", file)]) from None


_BROKEN = (
    ("plain scalar", "a blank is missing after a colon, or this text needs quotes"),
    ("quoted scalar", "the quote that opens here is not closed"),
    ("flow", "the bracket that opens here is not closed, or a comma is missing in it"),
    ("simple key", "expected key: value, found no colon"),
    (
        "cannot start any token",
        "this cannot stand here: indent with blanks, not with tabs; quote texts that begin with @, ` or %",
    ),
    ("block", "the indentation does not fit the lines above"),
    (
        "mapping values are not allowed",
        "a second colon in one line, or the indentation does not fit: texts with ': ' need quotes",
    ),
)
"""What YAML complains of, in plain words."""


def _broken(error: yaml.MarkedYAMLError, file: str) -> Problem:
    """Broken YAML in plain words, where they are known; what is left open is told where it began."""
    said = " ".join(part for part in (error.context, error.problem) if part)
    plain = next((words for part, words in _BROKEN if part in said), said)
    begun = "opens here" in plain or "no colon" in plain
    mark = (error.context_mark if begun else None) or error.problem_mark
    return Problem(f"this is not valid YAML: {plain}", file, mark.line + 1 if mark else 0)


class _Reader:
    """Plain data from the events of a YAML text, one after the other.

    Nodes are never composed as a whole: a text of a few kB may unfold, by anchors that hold aliases, to more than any
    memory, and one with very many levels is more than the recursion of a composer bears.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self.lines: dict[Path, int] = {}
        self.problems: list[Problem] = []
        self.anchored: dict[str, list[yaml.Event]] = {}
        """Events behind each anchor; none as long as its node is not complete."""
        self.values, self.most = 0, limit(_VALUES)
        self.repeated, self.letters = 0, 0
        """Keys and values that aliases repeat, and their letters."""
        self.unfolding = 0
        """Line of the alias that is being unfolded, 0 for none."""

    def read(self, events: Iterator[yaml.Event]) -> Document:
        """The only document of a text."""
        first = [next(events) for _ in range(2)][1]
        event = first if isinstance(first, yaml.StreamEndEvent) else next(events)
        if not isinstance(event, yaml.MappingStartEvent):
            raise self._error("expected a mapping of keys and values (mor: 1, title: …)", 1)
        data = self._node(event, events, ())
        next(events)
        after = next(events)
        if not isinstance(after, yaml.StreamEndEvent):
            words = "this is not valid YAML: a second document begins here (---); a project file has one"
            raise self._error(words, _line(after))
        return Document(data, self.lines, self.file, problems=tuple(self.problems))

    def _node(self, event: Any, events: Iterator[yaml.Event], path: Path) -> Any:
        self.lines[path] = _line(event)
        self.values += 1
        if self.values > self.most:
            words = f"found more than {self.most} values, with all that is repeated by aliases; put long tables into"
            raise self._error(
                f"{words} files of their own, or {raise_it(_VALUES)}", self.unfolding or _line(event)
            )
        if len(path) > _DEEPEST:
            raise self._error(_TOO_DEEP, _line(event))
        if isinstance(event, yaml.AliasEvent):
            return self._unfolded(event, path)
        if event.anchor is None:
            return self._content(event, events, path)
        self.anchored[event.anchor] = []
        recorded = [event]
        content = self._content(event, _recording(events, recorded), path)
        self.anchored[event.anchor] = recorded
        return content

    def _unfolded(self, alias: yaml.AliasEvent, path: Path) -> Any:
        outer = self.unfolding
        self.unfolding = outer or _line(alias)
        found = self._behind(alias)
        self._count(found)
        again = iter(found)
        content = self._node(next(again), again, path)
        self.unfolding = outer
        return content

    def _count(self, events: list[yaml.Event]) -> None:
        """Count what an alias repeats; what takes microseconds to read may take hours to make a network of."""
        self.repeated += len(events)
        self.letters += sum(len(event.value) for event in events if isinstance(event, yaml.ScalarEvent))
        most = self.most // _REPEATED
        if self.repeated > 2 * most or self.letters > _LETTERS * most:
            words = (
                f"aliases (*name) repeat more than {most} values, or {_LETTERS * most} letters; "
                f"put long tables into files of their own, or {raise_it(_VALUES)}"
            )
            raise self._error(words, self.unfolding)

    def _behind(self, alias: yaml.AliasEvent) -> list[yaml.Event]:
        found = self.anchored.get(str(alias.anchor))
        if found is None:
            words = "this is not valid YAML: texts that begin with * need quotes"
            raise self._error(words, _line(alias))
        if not found:
            raise self._error(_TOO_DEEP, _line(alias))
        return found

    def _content(self, event: Any, events: Iterator[yaml.Event], path: Path) -> Any:
        if isinstance(event, yaml.MappingStartEvent):
            return self._mapping(events, path)
        if isinstance(event, yaml.SequenceStartEvent):
            items: list[Any] = []
            while not isinstance(inside := next(events), yaml.SequenceEndEvent):
                items.append(self._node(inside, events, (*path, len(items))))
            return items
        plain = event.style not in ("'", '"', "|", ">")
        return None if plain and event.value in _NULLS else event.value

    def _mapping(self, events: Iterator[yaml.Event], path: Path) -> dict[str, Any]:
        data: dict[str, Any] = {}
        first: dict[str, int] = {}
        while not isinstance(key_event := next(events), yaml.MappingEndEvent):
            line = _line(key_event)
            if not isinstance(key_event, yaml.ScalarEvent):
                self.problems.append(Problem("a key must be a plain text", self.file, line))
                _skip(key_event, events)
                _skip(next(events), events)
                continue
            key = key_event.value
            if key in first:
                words = f"key {key!r} is given twice (first in line {first[key]})"
                self.problems.append(Problem(words, self.file, line))
                _skip(next(events), events)
                continue
            first[key] = line
            data[key] = self._node(next(events), events, (*path, key))
            self.lines[(*path, key)] = line
        return data

    def _error(self, words: str, line: int) -> InputError:
        return InputError([Problem(words, self.file, line)])


def _line(event: yaml.Event) -> int:
    return event.start_mark.line + 1 if event.start_mark else 0


def _recording(events: Iterator[yaml.Event], recorded: list[yaml.Event]) -> Iterator[yaml.Event]:
    for event in events:
        recorded.append(event)
        yield event


def _skip(event: yaml.Event, events: Iterator[yaml.Event]) -> None:
    """Go past a node that is not wanted."""
    depth = int(isinstance(event, yaml.CollectionStartEvent))
    while depth:
        event = next(events)
        depth += int(isinstance(event, yaml.CollectionStartEvent))
        depth -= int(isinstance(event, yaml.CollectionEndEvent))
