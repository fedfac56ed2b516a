"""Read and write project files, with the line of every entry."""

from __future__ import annotations

import csv
import io
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from itertools import groupby
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any, TypeAlias

import numpy as np
import polars as pl
import yaml

from mor.errors import InputError, Message, escaped
from mor.input_files import limit, raise_it

# ---- Names in CSV files, written so that no spreadsheet runs them as a formula and no reader takes them for a comment.
#
# A name that begins with =, +, -, @ or a tab (and is no number) would be run when the table is opened in a
# spreadsheet; one that begins with # would be a comment. An apostrophe is put before them, and taken away on
# reading. What begins with apostrophes before one of these signs gets another one, so that every name comes
# back as it was.

_SIGNS = "[=+@\t#-]"
_UNSAFE = re.compile(f"'*{_SIGNS}")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_COMMENT = r"\s#"
_AFTER_A_BLANK = re.compile(_COMMENT)


def is_unsafe(name: str) -> bool:
    """True for a name that needs an apostrophe, or quotes around it, in a CSV file."""
    begins = _UNSAFE.match(name) is not None and _NUMBER.fullmatch(name) is None
    return begins or _AFTER_A_BLANK.search(name) is not None


def any_unsafe(names: Iterable[str]) -> bool:
    """Return True if one of the names needs to be guarded."""
    return any(map(is_unsafe, names))


def guarded(name: str) -> str:
    """A name as it is written."""
    return f"'{name}" if _UNSAFE.match(name) and not _NUMBER.fullmatch(name) else name


def plain(name: str) -> str:
    """A name behind what is written."""
    return name[1:] if re.match(f"'+{_SIGNS}", name) else name


def plain_column(cells: pl.Series) -> pl.Series:
    """Names behind a column of texts."""
    return cells.str.replace(f"^'('*{_SIGNS})", "$1")


def csv_lines(frame: pl.DataFrame, header: bool = True) -> memoryview:
    """A table as CSV, as :func:`write_csv` writes it."""
    lines = BytesIO()
    write_csv(frame, lines, header)
    return lines.getbuffer()


def write_csv(frame: pl.DataFrame, file: IO[bytes], header: bool = True) -> None:
    """Write a table, names guarded; all texts in quotes where one of them would look like a comment otherwise."""
    texts, hidden = pl.col(pl.String), False
    if _any(frame.select(texts.str.contains(rf"^'*{_SIGNS}|{_COMMENT}").any())):
        begins = texts.str.contains(f"^'*{_SIGNS}") & ~texts.str.contains(f"^(?:{_NUMBER.pattern})$")
        frame = frame.with_columns(pl.when(begins).then(texts.str.replace("^", "'")).otherwise(texts))
        hidden = _any(frame.select(texts.str.contains(_COMMENT).any()))
    frame.write_csv(file, include_header=header, quote_style="non_numeric" if hidden else "necessary")


def _any(told: pl.DataFrame) -> bool:
    return any(map(any, told.rows()))


# ---- YAML text to plain data in which every scalar is still text and every value knows its line.
#
# PyYAML's own constructors lose a key given twice, read point 010 as 8 and point no as False. Here its events
# are taken instead; what a text means is decided by the model that asks for it.

KeyPath: TypeAlias = tuple[str | int, ...]

_TOO_DEEP = "this is nested too deeply, or refers to itself"
_VALUES = "MOR_MAX_VALUES"


@dataclass(frozen=True)
class Document:
    """Plain data (dicts, lists, texts, None), and the line of every value by its path."""

    data: dict[str, Any]
    lines: Mapping[KeyPath, int]
    file: str
    files: Mapping[KeyPath, str] = field(default_factory=dict)
    """Files of the parts that come from another file than ``file``."""
    notes: tuple[Message, ...] = ()
    """What a reader left out or decided on its own, to be told to the user."""
    problems: tuple[Message, ...] = ()
    """Mistakes that leave something to go on with (a key given twice): told together with those of the content."""

    frames: Mapping[str, pl.DataFrame] = field(default_factory=dict)
    """Data frames by the names that stand for them where a file of a table is named."""

    def line(self, path: KeyPath) -> int:
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
        """Data frame that replaces the file of this name, if there is one."""
        return self.frames.get(name)

    def file_of(self, path: KeyPath) -> str:
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
    # What YAML complains of, in plain words.
    broken = (
        ("plain scalar", "a blank is missing after a colon, or this text needs quotes"),
        ("quoted scalar", "the quote that opens here is not closed"),
        ("flow", "the bracket that opens here is not closed, or a comma is missing inside it"),
        ("simple key", "expected key: value, found no colon"),
        (
            "cannot start any token",
            "this is not allowed here: indent with blanks, not with tabs, and quote texts that begin with @, ` or %",
        ),
        ("block", "the indentation does not fit the lines above"),
        (
            "mapping values are not allowed",
            "a second colon in one line, or the indentation does not fit: texts with ': ' need quotes",
        ),
    )
    try:
        return _YamlReader(file).read(yaml.parse(text, Loader=loader))
    except yaml.MarkedYAMLError as error:
        said = " ".join(part for part in (error.context, error.problem) if part)
        plain = next((words for part, words in broken if part in said), said)
        begun = "opens here" in plain or "no colon" in plain
        mark = (error.context_mark if begun else None) or error.problem_mark
        raise InputError([Message(f"this is not valid YAML: {plain}", file, mark.line + 1 if mark else 0)]) from None
    except yaml.YAMLError as error:
        words = str(error).splitlines()[0]
        raise InputError([Message(f"this is not a text file of YAML: {words}", file)]) from None


class _YamlReader:
    """Plain data from the events of a YAML text, one after the other.

    Nodes are never composed as a whole: a text of a few kB may unfold, by anchors that hold aliases, to more than any
    memory, and one with very many levels is more than the recursion of a composer bears.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self.lines: dict[KeyPath, int] = {}
        self.problems: list[Message] = []
        self.anchored: dict[str, list[yaml.Event]] = {}
        """Events behind each anchor; none as long as its node is not complete."""
        self.values, self.most = 0, limit(_VALUES)
        self.repeated, self.letters = 0, 0
        """Keys and values that aliases repeat, and their letters."""
        self.unfolding = 0
        """Line of the alias that is being unfolded, 0 for none."""

    def read(self, events: Iterator[yaml.Event]) -> Document:
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

    def _node(self, event: Any, events: Iterator[yaml.Event], path: KeyPath) -> Any:
        self.lines[path] = _line(event)
        self.values += 1
        if self.values > self.most:
            words = f"found more than {self.most} values, with all that is repeated by aliases; put long tables into"
            raise self._error(f"{words} files of their own, or {raise_it(_VALUES)}", self.unfolding or _line(event))
        # Levels of nesting; no project needs half of them.
        if len(path) > 20:
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

    def _unfolded(self, alias: yaml.AliasEvent, path: KeyPath) -> Any:
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
        # Share of the values that aliases may repeat, as its denominator.
        most = self.most // 10
        # Letters that a repeated value may have, on average at that limit.
        letters = 100
        if self.repeated > 2 * most or self.letters > letters * most:
            words = (
                f"aliases (*name) repeat more than {most} values, or {letters * most} letters; "
                f"put long tables into files of their own, or {raise_it(_VALUES)}"
            )
            raise self._error(words, self.unfolding)

    def _behind(self, alias: yaml.AliasEvent) -> list[yaml.Event]:
        found = self.anchored.get(str(alias.anchor))
        if found is None:
            raise self._error("this is not valid YAML: texts that begin with * need quotes", _line(alias))
        if not found:
            raise self._error(_TOO_DEEP, _line(alias))
        return found

    def _content(self, event: Any, events: Iterator[yaml.Event], path: KeyPath) -> Any:
        if isinstance(event, yaml.MappingStartEvent):
            return self._mapping(events, path)
        if isinstance(event, yaml.SequenceStartEvent):
            items: list[Any] = []
            while not isinstance(inside := next(events), yaml.SequenceEndEvent):
                items.append(self._node(inside, events, (*path, len(items))))
            return items
        plain = event.style not in ("'", '"', "|", ">")
        return None if plain and event.value in {"", "~", "null", "Null", "NULL"} else event.value

    def _mapping(self, events: Iterator[yaml.Event], path: KeyPath) -> dict[str, Any]:
        data: dict[str, Any] = {}
        first: dict[str, int] = {}
        while not isinstance(key_event := next(events), yaml.MappingEndEvent):
            line = _line(key_event)
            if not isinstance(key_event, yaml.ScalarEvent):
                self.problems.append(Message("a key must be a plain text", self.file, line))
                _skip(key_event, events)
                _skip(next(events), events)
                continue
            key = key_event.value
            if key in first:
                words = f"key {key!r} is given twice (first in line {first[key]})"
                self.problems.append(Message(words, self.file, line))
                _skip(next(events), events)
                continue
            first[key] = line
            data[key] = self._node(next(events), events, (*path, key))
            self.lines[(*path, key)] = line
        return data

    def _error(self, words: str, line: int) -> InputError:
        return InputError([Message(words, self.file, line)])


def _line(event: yaml.Event) -> int:
    return event.start_mark.line + 1 if event.start_mark else 0


def _recording(events: Iterator[yaml.Event], recorded: list[yaml.Event]) -> Iterator[yaml.Event]:
    for event in events:
        recorded.append(event)
        yield event


def _skip(event: yaml.Event, events: Iterator[yaml.Event]) -> None:
    depth = int(isinstance(event, yaml.CollectionStartEvent))
    while depth:
        event = next(events)
        depth += int(isinstance(event, yaml.CollectionStartEvent))
        depth -= int(isinstance(event, yaml.CollectionEndEvent))


# ---- Plain data of a project as YAML text: numbers as numbers, identifiers as texts, short lists in one line.

# Columns of names, which stay texts whatever they look like.
_TEXTS = frozenset(
    (
        *("id", "camera", "position", "point", "leader", "pair", "set", "of", "from", "to", "at", "station", "image"),
        *("system", "frame", "component", "shared_height", "shared_eccentricity"),
    )
) | {"title", "name", "group", "file", "columns", "instrument", "cluster", "points", "other"}
_YAML_NUMBER = re.compile(r"[-+]?(0|[1-9]\d*)(\.\d+)?([eE][-+]?\d+)?")


def yaml_text(data: dict[str, Any], width: int) -> str:
    """YAML of a project. Texts that are numbers are written without quotes, with all their digits."""
    tables: list[list[str]] = []
    plain = _plain(data, "", tables, width)
    text: str = yaml.dump(plain, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=width)
    stands = re.compile(rf"^( *)(- )?rows: {_ROWS} (\d+)$", re.MULTILINE)
    return stands.sub(lambda found: _rows_text(tables[int(found[3])], found), text) if tables else text


_ROWS = "\ue000"
"""Stands for the rows of a table until they are put in its place: a letter that means nothing."""
_SIMPLE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_WHOLE = re.compile(r"0|[1-9][0-9]*")
_WORDS = frozenset(("y", "n", "yes", "no", "on", "off", "true", "false", "null"))
"""Texts, in small letters, that YAML takes for something else."""


def _simple_rows(rows: list[list[Any]], width: int) -> list[str] | None:
    """Long tables of numbers and plain names as lines, the same that YAML's writer makes; ``None`` for all others."""
    # Rows up to which a table is written as everything else.
    if len(rows) <= 20:
        return None
    lines = []
    for row in rows:
        cells = [_simple(cell) for cell in row]
        if not cells or None in cells:
            return None
        lines.append(f"- [{', '.join(cells)}]")  # type: ignore[arg-type]
    return lines if max(map(len, lines)) < width - 40 else None


def _simple(cell: Any) -> str | None:
    if cell is None:
        return "null"
    if isinstance(cell, _Plain):
        return str(cell)
    if not isinstance(cell, str):
        return None
    if _WHOLE.fullmatch(cell):
        return f"'{cell}'"
    return cell if _SIMPLE.fullmatch(cell) and cell.lower() not in _WORDS else None


def _rows_text(lines: list[str], found: re.Match[str]) -> str:
    """The key ``rows`` with its lines, indented as it is."""
    blanks = found[1] + "  " * (found[2] is not None)
    return f"{found[1]}{found[2] or ''}rows:\n" + "\n".join(f"{blanks}{line}" for line in lines)


class _Plain(str):
    """A number or truth value, as its text."""

    __slots__ = ()


def _plain(value: Any, key: str, tables: list[list[str]], width: int) -> Any:
    """Data in which the texts that are numbers know it; ``key`` is the one they stand at.

    The rows of long simple tables are added to ``tables``: the writer of YAML takes a millisecond for ten of them.
    """
    if key == "datum":
        return value
    if isinstance(value, dict):
        if isinstance(value.get("rows"), list) and isinstance(value.get("columns"), list):
            columns = [name or "" for name in value["columns"]]
            rows = [[_cell(cell, name) for cell, name in zip(row, columns, strict=False)] for row in value["rows"]]
            lines = _simple_rows(rows, width)
            if lines is not None:
                tables.append(lines)
            value = {**value, "rows": rows if lines is None else f"{_ROWS} {len(tables) - 1}"}
            return {k: v if k == "rows" else _plain(v, k, tables, width) for k, v in value.items()}
        return {k: _plain(v, k, tables, width) for k, v in value.items()}
    if isinstance(value, list):
        return [_plain(item, key, tables, width) for item in value]
    return _cell(value, key)


def _cell(value: Any, key: str) -> Any:
    """A scalar: as a number where its text is one and names nothing."""
    if not isinstance(value, str) or key in _TEXTS:
        return value
    if key == "snooping" and value.lower() in ("true", "false"):
        return _Plain(value.lower())
    if not _YAML_NUMBER.fullmatch(value):
        return value
    mantissa, exponent, power = value.lower().partition("e")
    if exponent:  # YAML wants a point in the mantissa and the sign of the exponent
        mantissa = mantissa if "." in mantissa else f"{mantissa}.0"
        power = power if power[0] in "+-" else f"+{power}"
    return _Plain(mantissa + exponent + power)


class _Dumper(yaml.SafeDumper):
    """Short lists and mappings without lists stand in one line, as a person writes them."""

    def represent_sequence(self, tag: str, sequence: Any, flow_style: bool | None = None) -> yaml.SequenceNode:
        simple = all(not isinstance(item, list | dict) for item in sequence)
        return super().represent_sequence(tag, sequence, flow_style=simple)

    def represent_text(self, value: str) -> yaml.ScalarNode:
        """A text; with what breaks lines or is not seen spelled out, for single quotes fold it."""
        return self.represent_scalar("tag:yaml.org,2002:str", value, '"' if escaped(value) != value else None)

    def represent_plain(self, value: _Plain) -> yaml.ScalarNode:
        tag: str = self.resolve(yaml.ScalarNode, str(value), (True, False))  # type: ignore[no-untyped-call]
        return self.represent_scalar(tag, str(value))


_Dumper.add_representer(str, _Dumper.represent_text)
_Dumper.add_representer(_Plain, _Dumper.represent_plain)


# ---- Plain data of a project as a project file: what a person reads as YAML, long tables as CSV beside it.

LONGEST = 20
"""Rows of a table, or of a covariance matrix, that stay in the project file."""


def matrix_text(rows: Sequence[Sequence[float | str]]) -> str:
    """The file of a covariance matrix, or of those of clusters."""
    alike = (np.array(list(some), dtype=float) for _, some in groupby(rows, len))
    return "".join(pl.DataFrame(matrix).write_csv(include_header=False) for matrix in alike)


def project_files(
    data: dict[str, Any], source: Path, target: Path, frames: Mapping[str, pl.DataFrame] = MappingProxyType({})
) -> dict[Path, str]:
    """Texts by path: the project file ``target``, and its tables.

    ``source`` is the folder its files are found from; ``frames`` replace files of these names.
    """
    texts: dict[Path, str] = {}
    written: dict[str, Any] = {}
    for section, content in data.items():
        if not isinstance(content, list):
            written[section] = content
            continue
        entries = []
        for number, entry in enumerate(content, start=1):
            table = target.with_name(f"{target.stem}_{section}_{number}.csv")
            frame = frames.get(str(entry.get("file")))
            if frame is not None:
                texts[table] = bytes(csv_lines(frame)).decode()
                entries.append({**entry, "file": table.name})
            else:
                entries.append(_entry(dict(entry), source, target, table, texts))
        written[section] = entries
    return {target: yaml_text(written, width=120), **texts}


def _entry(entry: dict[str, Any], source: Path, target: Path, table: Path, texts: dict[Path, str]) -> dict[str, Any]:
    """An entry of a section, its rows moved into a table where they are many, its files found from the new place."""
    for key in ("file", "covariance"):
        if isinstance(entry.get(key), str):
            entry[key] = Path(os.path.relpath(source / entry[key], target.parent)).as_posix()
    if len(entry.get("covariance") or []) > LONGEST and not isinstance(entry["covariance"], str):
        matrix = table.with_stem(f"{table.stem}_covariance")
        texts[matrix] = matrix_text(entry["covariance"])
        entry["covariance"] = matrix.name
    rows, columns = entry.get("rows"), entry.get("columns")
    if not isinstance(rows, list) or len(rows) <= LONGEST or not isinstance(columns, list):
        return entry
    chosen = [k for k, name in enumerate(columns) if name is not None]
    text = io.StringIO()
    cells = [["" if k >= len(row) else row[k] or "" for k in chosen] for row in rows]
    unsafe = any_unsafe(cell for row in cells for cell in row)
    writer = csv.writer(text, lineterminator="\n", quoting=csv.QUOTE_ALL if unsafe else csv.QUOTE_MINIMAL)
    writer.writerow([columns[k] for k in chosen])
    writer.writerows([[guarded(cell) for cell in row] for row in cells])
    texts[table] = text.getvalue()
    name = entry.get("name") or entry.get("type")
    kept = {key: value for key, value in entry.items() if key not in ("rows", "columns")}
    return {**kept, **({"name": name} if name else {}), "file": table.name}
