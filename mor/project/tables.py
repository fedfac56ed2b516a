"""Tables of a project: files, columns, statuses."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date, datetime, time, timedelta
from itertools import chain
from pathlib import Path
from typing import NamedTuple, TypeVar, cast

import numpy as np
import numpy.typing as npt
import polars as pl

from mor.errors import InputError, Message, counted, nearest
from mor.input_files import TABLE, as_utf8, check_regular, check_size, is_folder, limit, note_file, raise_it, read_bytes
from mor.long_arrays import empty, kept
from mor.model.contract import Coded, Names, coded, places
from mor.project.axes import Edge, ImageScale, UnitError, beyond
from mor.project.document import Document, KeyPath, plain_column
from mor.project.schema import TableEntry, Value
from mor.types import LARGEST, BoolArray, FloatArray, IntArray, SmallIntArray
from mor.units import ANGLE, Component, Quantity

Part = TypeVar("Part", IntArray, SmallIntArray, FloatArray)

# ---- What a table may contain, what was read from it, and where it stands.


class Column(NamedTuple):
    """A column a table may have. ``parse`` turns one text into an internal number; ``None`` for identifiers."""

    name: str
    parse: Callable[[str, str], float] | None = None
    factor: Callable[[str], float] | None = None
    """Internal units per given unit, for columns of plain numbers; raises ``ValueError``."""
    required: bool = False


MOST_TOLD = 100
"""Mistakes of one kind in one table that are told one by one; the rest is counted."""


def tell_rows(problems: list[Message], wrong: BoolArray, lines: Lines, words: Callable[[int], str] | str) -> None:
    """Tell what is wrong with rows (n,): each with its line, of very many the first and how many more there are."""
    found = np.flatnonzero(wrong)
    for row in found[:MOST_TOLD].tolist():
        problems.append(lines.problem(row, words if isinstance(words, str) else words(row)))
    if len(found) > MOST_TOLD:
        row = int(found[MOST_TOLD])
        first = words if isinstance(words, str) else words(row)
        problems.append(lines.problem(row, f"{len(found) - MOST_TOLD} more rows like these, the next one: {first}"))


@dataclass(frozen=True)
class Lines:
    """Lines (n,) of a file that rows stand in, and the list that mistakes in them are added to."""

    lines: SmallIntArray
    file: str
    problems: list[Message]

    def problem(self, row: int, words: str) -> Message:
        """A message about a row."""
        return Message(words, self.file, int(self.lines[row]))

    def tell(self, row: int, words: str) -> None:
        """Add a mistake in a row."""
        self.problems.append(self.problem(row, words))

    def tell_where(self, wrong: BoolArray, words: Callable[[int], str] | str) -> None:
        """Add what is wrong with rows (n,)."""
        tell_rows(self.problems, wrong, self, words)


@dataclass(frozen=True)
class Source(Lines):
    """Named columns as they were found, each all texts or already numbers in the unit of the column; null is empty."""

    names: list[str]
    """Names of the columns in their order; one may be given twice."""
    columns: dict[str, pl.Series]


@dataclass(frozen=True)
class Rows(Lines):
    """Columns read: identifiers, each different one kept once, and numbers in internal units, NaN if empty."""

    count: int
    texts: dict[str, Coded]
    numbers: dict[str, FloatArray]

    def text(self, name: str) -> list[str]:
        """Identifiers of a column, for tables of few rows; empty if the column is missing."""
        column: list[str] = self.series(name).to_list()
        return column

    def coded(self, name: str) -> Coded:
        """Identifiers of a column as they are kept, empty texts if it is missing."""
        return self.texts[name] if name in self.texts else _one_text("", self.count)

    def series(self, name: str) -> pl.Series:
        """Identifiers of a column."""
        return self.coded(name).texts()

    def names(self, name: str) -> Names:
        """Identifiers of a column, each different one kept once."""
        return self.coded(name).names()

    def number(self, name: str) -> FloatArray:
        """Numbers of a column, NaN if it is missing."""
        return self.numbers[name] if name in self.numbers else np.full(self.count, np.nan)

    def take(self, chosen: IntArray) -> Rows:
        """Some of the rows."""
        texts = {name: Coded(known, numbers[chosen]) for name, (known, numbers) in self.texts.items()}
        numbers = {name: cells[chosen] for name, cells in self.numbers.items()}
        return Rows(self.lines[chosen], self.file, self.problems, len(chosen), texts, numbers)


@dataclass(frozen=True)
class TableLocation:
    """Place of a table in the project: its path, the folder of the project, and the list of mistakes found."""

    document: Document
    path: KeyPath
    folder: Path
    problems: list[Message] = field(default_factory=list)

    def at(self, *path: str | int) -> TableLocation:
        """A place within this one."""
        return replace(self, path=(*self.path, *path))

    def problem(self, message: str, key: str | None = None) -> Message:
        """A message about this table, or one of its keys."""
        path = (*self.path, key) if key else self.path
        return Message(message, self.document.file_of(path), self.document.line(path))

    def tell(self, message: str, key: str | None = None) -> None:
        """Add a mistake in this table, or in one of its keys."""
        self.problems.append(self.problem(message, key))


# ---- Rows of a text file (CSV and its kin): typed columns in one go, whatever the number of rows.
#
# Comments (a # that stands first or after a blank: point A#1 is a point) and empty lines are taken out of the
# bytes first, and the lines of the rows are remembered. Where columns do not hold plain numbers only, they
# are read as texts. Rows are looked at one by one only where quotes hide separators.


class _Text(NamedTuple):
    """Bytes without comments and empty lines, and the line of every one that is left."""

    content: bytes
    lines: SmallIntArray


def our_name(table: TableEntry, name: str) -> str | None:
    """Name of a column of a file as the program knows it; ``None`` if it is left out."""
    return table.columns.get(name, name) if isinstance(table.columns, dict) else name


COLUMNS = "MOR_MAX_COLUMNS"


def too_many_columns(found: int) -> str:
    """Words for a table that has more columns than any table of measurements."""
    return f"found {found} columns, expected {limit(COLUMNS)} at most; {raise_it(COLUMNS)}"


def wrong_length(found: int, names: Sequence[str | None]) -> str:
    """Words for a row that has another number of columns than its table."""
    return f"found {counted(found, 'column')}, expected {len(names)} ({', '.join(name or '-' for name in names)})"


def from_text(
    text: bytes, table: TableEntry, known: dict[str, Column], file: str, problems: list[Message]
) -> Source | None:
    """Rows of a text file; ``None`` if ``problems`` were added instead."""
    text = as_utf8(text)
    line = _first_undecodable_line(text)
    if line:
        problems.append(Message("this is not UTF-8 text", file, line))
        return None
    cleaned = _cleaned(text, table.delimiter)
    del text
    width = _first_line(cleaned).count((table.delimiter or ",").encode()) + 1
    if width > limit(COLUMNS):
        problems.append(Message(too_many_columns(width), file, 1))
        return None
    header = _header(cleaned, table)
    names = [None if name.startswith("skip ") else our_name(table, name) for name in header]
    lines = cleaned.lines if isinstance(table.columns, list) else cleaned.lines[1:]
    if len(lines) == 0:
        problems.append(Message("the table is empty", file))
        return None
    kinds: dict[str, type[pl.DataType]] = {}
    for name, ours in zip(header, names, strict=True):
        column = known.get(ours or "")
        kinds[name] = pl.Float64 if column is not None and column.factor is not None else pl.String
    frame = _frame(cleaned, table, header, kinds)
    if frame is None:
        return _one_by_one(cleaned, names, table, file, problems)
    columns = {ours: frame[name] for name, ours in zip(header, names, strict=True) if ours is not None}
    return Source(lines, file, problems, [name for name in names if name], _plain(columns, cleaned))


def _plain(columns: dict[str, pl.Series], cleaned: _Text) -> dict[str, pl.Series]:
    if b"'" not in cleaned.content:
        return columns
    return {name: plain_column(cells) if cells.dtype == pl.String else cells for name, cells in columns.items()}


def _first_undecodable_line(text: bytes) -> int:
    if text.isascii():
        return 0
    try:
        text.decode("utf-8")
    except UnicodeDecodeError as error:
        return text[: error.start].count(b"\n") + 1
    return 0


def _cleaned(text: bytes, delimiter: str | None) -> _Text:
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"#" in text:
        text = _without_comments(text, quotes=delimiter != " ")
    if delimiter == " ":
        text = re.sub(rb"[ \t]+", b" ", text).replace(b" \n", b"\n").replace(b"\n ", b"\n").strip(b" ")
    data = np.frombuffer(text, dtype=np.uint8)
    ends = _line_ends(data)
    if text and not text.endswith(b"\n"):
        ends = np.append(ends, len(text))
    starts = np.concatenate([[0], ends[:-1] + 1])
    separator = ord(delimiter or ",")
    if len(ends) and not ((data[starts] <= ord(" ")) | (data[starts] == separator)).any():
        return _Text(text, np.arange(1, len(ends) + 1, dtype=np.int32))
    # A line of nothing but separators is one that a spreadsheet leaves empty.
    full = (
        np.logical_or.reduceat((data > ord(" ")) & (data != separator), starts)
        if len(ends)
        else np.zeros(0, dtype=bool)
    )
    kept = np.repeat(full, ends - starts + 1)[: len(data)]
    return _Text(data[kept].tobytes(), (np.flatnonzero(full) + 1).astype(np.int32))


def _line_ends(data: npt.NDArray[np.uint8]) -> IntArray:
    part = 1 << 24  # bytes that are looked at together
    found = [np.flatnonzero(data[start : start + part] == ord("\n")) + start for start in range(0, len(data), part)]
    return np.concatenate(found) if found else np.zeros(0, dtype=np.int64)


def _without_comments(text: bytes, quotes: bool) -> bytes:
    """The text without comments; with ``quotes`` a # inside of them begins none. Every byte is looked at once."""
    parts, start, seen, inside = [], 0, 0, False
    place = text.find(b"#")
    while place >= 0:
        if quotes:
            line = text.rfind(b"\n", seen, place) + 1
            inside = (inside and not line) ^ bool(text.count(b'"', line or seen, place) % 2)
            seen = place
        end = place + 1
        if not inside and (place == 0 or text[place - 1 : place].isspace()):
            end = text.find(b"\n", place)
            end = len(text) if end < 0 else end
            parts.append(text[start:place])
            start = seen = end
        place = text.find(b"#", end)
    return b"".join([*parts, text[start:]])


def _header(cleaned: _Text, table: TableEntry) -> list[str]:
    if isinstance(table.columns, list):
        return [name or f"skip {k}" for k, name in enumerate(table.columns)]  # without a name: a column to be left out
    return [cell.strip() for cell in _cells(_first_line(cleaned).decode("utf-8"), table.delimiter or ",")]


def _first_line(cleaned: _Text) -> bytes:
    end = cleaned.content.find(b"\n")
    return cleaned.content[: end if end >= 0 else None]


def _cells(line: str, separator: str) -> list[str]:
    """Cells of a line; a quote that is not closed reaches to its end."""
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:  # longer than any cell may be
        return line.split(separator)


def _is_open(line: str, separator: str) -> bool:
    """Return whether a quote opens a cell and is not closed; one behind a number means seconds."""
    try:
        list(csv.reader([line], delimiter=separator, strict=True))
    except csv.Error:
        return True
    return False


def _frame(
    cleaned: _Text, table: TableEntry, header: list[str], kinds: dict[str, type[pl.DataType]]
) -> pl.DataFrame | None:
    """The whole table; with texts instead of numbers where it must be. ``None`` if rows differ in length."""
    separator, headed = table.delimiter or ",", not isinstance(table.columns, list)
    count = cleaned.content.count(separator.encode())
    if count != len(cleaned.lines) * (len(header) - 1) or len(set(header)) < len(header):
        return None
    for wanted in (kinds, dict.fromkeys(kinds, pl.String)):
        try:
            frame = pl.read_csv(
                cleaned.content,
                has_header=False,
                skip_rows=int(headed),
                schema=wanted,
                separator=separator,
                quote_char=None if separator == " " else '"',
                glob=False,
            )
        except pl.exceptions.PolarsError:
            continue
        return frame if frame.height == len(cleaned.lines) - int(headed) else None
    return None


def _one_by_one(
    cleaned: _Text, names: list[str | None], table: TableEntry, file: str, problems: list[Message]
) -> Source | None:
    """Rows that are no plain table: those of the wrong length are told; quotes may hide separators."""
    separator = table.delimiter or ","
    headed = not isinstance(table.columns, list)
    if b'"' not in cleaned.content or separator == " ":
        data = np.frombuffer(cleaned.content, dtype=np.uint8)
        ends = _line_ends(data)
        starts = (
            np.concatenate([[0], ends[:-1] + 1]) if cleaned.content.endswith(b"\n") else np.concatenate([[0], ends + 1])
        )
        counts: IntArray = np.add.reduceat(data == ord(separator), starts, dtype=np.int64)
        found = counts[int(headed) :] + 1
        source = Lines(cleaned.lines[int(headed) :], file, problems)
        source.tell_where(found != len(names), lambda row: wrong_length(int(found[row]), names))
        if (found != len(names)).any():
            return None
    content = cleaned.content.decode("utf-8").split("\n")[int(headed) :]
    lines = cleaned.lines[int(headed) :]
    source = Lines(lines, file, problems)
    content = content[: len(lines)]
    open_ = np.array([line.count('"') % 2 == 1 and _is_open(line, separator) for line in content])
    source.tell_where(open_, "a quote that opens in this line is not closed in it")
    if open_.any():
        return None
    rows = [_cells(line, separator) for line in content]
    found = np.array([len(row) for row in rows])
    source.tell_where(found != len(names), lambda row: wrong_length(int(found[row]), names))
    if (found != len(names)).any():
        return None
    columns = {name: pl.Series(name, [row[k] for row in rows], dtype=pl.String) for k, name in enumerate(names) if name}
    return Source(lines, file, problems, [name for name in names if name], _plain(columns, cleaned))


# ---- Tables in spreadsheets (.xlsx, .xls, .ods), read by python-calamine.


def is_spreadsheet(path: Path) -> bool:
    """Return True for a file whose name ends like that of a spreadsheet."""
    return path.suffix.lower() in {".xlsx", ".xlsm", ".xls", ".ods"}


def read_spreadsheet(path: Path, sheet: str | None = None) -> pl.DataFrame:
    """Return the cells of a sheet as texts; its first row that is not empty has the names of the columns.

    Titles may stand above it: rows of one cell, above a row of several that are no numbers.
    ``sheet`` is needed if several sheets hold something. Raises :class:`InputError` if the file cannot be read, if the
    sheet is missing or not named, and if python-calamine (extra ``formats``) is not installed.
    """
    _, (header, *rows) = sheet_rows(path, sheet)
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise InputError([Message(f"column {', '.join(map(repr, twice))} is given twice", str(path))])
    columns = {name: [row[k] or None for row in rows] for k, name in enumerate(header)}
    return pl.DataFrame(columns, schema=dict.fromkeys(header, pl.String))


def sheet_rows(path: Path, sheet: str | None) -> tuple[list[int], list[list[str]]]:
    """Return numbers of rows, and their cells: the names of the columns, perhaps given twice, then the rows."""
    sheets = read_sheets(path)
    filled = [name for name, rows in sheets.items() if rows]
    if sheet is not None and sheet not in sheets:
        words = f"found no sheet {sheet!r}{nearest(sheet, sheets)} (sheets: {', '.join(sheets)})"
        raise InputError([Message(words, str(path))])
    if sheet is None and len(filled) != 1:
        words = f"found {len(filled)} sheets with content ({', '.join(filled)}), expected one; set sheet: NAME"
        raise InputError([Message(words, str(path))])
    numbered = [(k, row) for k, row in enumerate(sheets[sheet or filled[0]], 1) if any(cell != "" for cell in row)]
    if not numbered:
        raise InputError([Message("the table is empty", str(path))])
    numbers, rows = [k for k, _ in numbered], [[_text(cell) for cell in row] for _, row in numbered]
    titles = next((k for k, row in enumerate(rows) if sum(map(bool, row)) > 1), 0)
    if not any(cell.replace(".", "").removeprefix("-").isdigit() for cell in rows[titles]):
        numbers, rows = numbers[titles:], rows[titles:]
    return numbers, [[name or f"column{k + 1}" for k, name in enumerate(rows[0])], *rows[1:]]


def read_sheets(path: Path) -> Mapping[str, Sequence[Sequence[object]]]:
    """Return the rows of each sheet. Raises :class:`InputError`."""
    try:
        import python_calamine
    except ImportError:
        words = "spreadsheets need the extra formats: pip install 'mor-adjustment[formats]'"
        raise InputError([Message(words, str(path))]) from None
    check_regular(path)
    check_size(path.stat().st_size, path, TABLE)
    note_file(path)
    try:
        book = python_calamine.CalamineWorkbook.from_path(str(path))
        sheets = {name: book.get_sheet_by_name(name) for name in book.sheet_names}
        above = {name: sheet.start[0] if sheet.start else 0 for name, sheet in sheets.items()}
        return {
            name: [*[[]] * above[name], *sheet.to_python()] if sheet.start else [] for name, sheet in sheets.items()
        }
    except (python_calamine.CalamineError, OSError) as error:
        raise InputError([Message(f"this file cannot be read: {error}", str(path))]) from None


def _text(cell: object) -> str:
    """Text of a cell: spreadsheets keep whole numbers, and names made of digits, as floating-point numbers."""
    if isinstance(cell, bool):
        return str(cell).lower()
    if isinstance(cell, float):
        return repr(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else np.format_float_positional(cell, trim="-")
    if isinstance(cell, timedelta):  # hours and minutes that are often degrees and minutes
        minutes, seconds = divmod(round(abs(cell.total_seconds()), 6), 60.0)
        sign = "-" if cell < timedelta() else ""
        return f"{sign}{minutes // 60.0:.0f}:{minutes % 60.0:02.0f}:{f'{seconds:09.6f}'.rstrip('0').rstrip('.')}"
    if isinstance(cell, datetime | date | time):
        return cell.isoformat()
    return str(cell).strip()


# ---- Where the rows of a table come from: the project file, CSV or Parquet, with declared or headed columns.


def raw_table(table: TableEntry, place: TableLocation) -> Source | None:
    """A whole table as it stands in its file; ``None`` if mistakes were told instead."""
    parts = list(_sources(table, {}, place))
    if len(parts) < 2:
        return parts[0] if parts else None
    columns = {name: pl.concat([part.columns[name] for part in parts]) for name in parts[0].columns}
    return replace(parts[0], lines=np.concatenate([part.lines for part in parts]), columns=columns)


def _sources(table: TableEntry, known: dict[str, Column], place: TableLocation) -> Iterator[Source]:
    """Rows of a table, long ones of Parquet in parts; none if mistakes were told instead."""
    return _from_rows(table, place) if table.rows is not None else _from_file(table, known, place)


def _from_rows(table: TableEntry, place: TableLocation) -> Iterator[Source]:
    declared = list(table.columns or [])
    rows = table.rows or []
    file = place.document.file_of(place.path)
    lines = np.array([place.document.line((*place.path, "rows", i)) for i in range(len(rows))], dtype=np.int32)
    for row, line in zip(rows, lines, strict=True):
        if len(row) != len(declared):
            place.problems.append(Message(wrong_length(len(row), declared), file, int(line)))
    columns = {
        name: pl.Series(name, [row[k] if k < len(row) else None for row in rows], dtype=pl.String)
        for k, name in enumerate(declared)
        if name
    }
    yield Source(lines, file, place.problems, [name for name in declared if name], columns)


def _from_file(table: TableEntry, known: dict[str, Column], place: TableLocation) -> Iterator[Source]:
    frame = place.document.frame(str(table.file))
    if frame is not None:
        source = _from_frame(frame, table, place.document.file_of(place.path), place.problems)
        is_read = bool(place.document.lines)  # rows of what a reader of a file made are no lines of that file
        yield replace(source, lines=np.zeros_like(source.lines)) if is_read else source
        return
    path = place.folder / str(table.file)
    try:
        check_regular(path)
    except InputError as error:
        place.tell(f"file {table.file!r} {_words(error, path)}", "file")
        return
    try:
        if path.suffix == ".parquet":
            yield from _from_parquet(path, table, place.problems)
        elif is_spreadsheet(path):
            yield _from_frame(read_spreadsheet(path, table.sheet), table, str(path), place.problems)
        elif (text := from_text(read_bytes(path), table, known, str(path), place.problems)) is not None:
            yield text
    except InputError as error:
        place.problems.extend(error.problems)
    except pl.exceptions.PolarsError as error:
        place.problems.append(Message(f"this file cannot be read: {str(error).splitlines()[0]}", str(path)))


def _from_parquet(path: Path, table: TableEntry, problems: list[Message]) -> Iterator[Source]:
    lazy = pl.scan_parquet(path)
    columns = len(lazy.collect_schema())
    if columns > limit(COLUMNS):
        raise InputError([Message(too_many_columns(columns), str(path))])
    rows = lazy.select(pl.len()).collect().item()
    # Bytes of a number, or of the reference to a text, in memory.
    check_size(rows * columns * 8, path, TABLE)
    note_file(path)
    together = 2_000_000  # rows that are in memory together, as they stand in the file
    for first in range(0, max(rows, 1), together):
        yield _from_frame(lazy.slice(first, together).collect(), table, str(path), problems, first)


def _words(error: InputError, path: Path) -> str:
    others = [other.name for other in path.parent.iterdir()] if is_folder(path.parent) else []
    near = nearest(path.name, others) if path.name not in others else ""
    said = "; ".join(problem.message for problem in error.problems)
    return said.removeprefix("this file ").removeprefix("this ") + near


def _from_frame(frame: pl.DataFrame, table: TableEntry, file: str, problems: list[Message], before: int = 0) -> Source:
    """Columns of a Parquet file or a data frame: texts and numbers as they are; a row counts as a line, from 1.

    So many rows of the file are ``before`` it.
    """
    columns = {}
    for name in frame.columns:
        ours = our_name(table, name)
        if ours is not None:
            columns[ours] = frame[name]
    lines = np.arange(before + 1, before + frame.height + 1, dtype=np.int32)
    return Source(lines, file, problems, list(columns), columns)


# ---- Tables: rows in the project file, or files beside it, turned into identifiers and numbers in internal units.


def read_table(table: TableEntry, columns: Sequence[Column], place: TableLocation) -> Rows | None:
    """Rows of a table; ``None`` if mistakes were told instead."""
    before = len(place.problems)
    known = {column.name: column for column in columns}
    named = list(table.values)
    if isinstance(table.units, dict):
        named += list(table.units)
    if isinstance(table.columns, list):
        named += [name for name in table.columns if name is not None]
    if isinstance(table.columns, dict):
        named += [name for name in table.columns.values() if name is not None]
    for name in dict.fromkeys(named):
        if name not in known:
            place.tell(f"unknown column {name!r}{nearest(name, known)} (known here: {', '.join(known)})")
    if isinstance(table.units, str) and not any(_fits(column, table.units) for column in columns):
        numbers = ", ".join(column.name for column in columns if column.parse is not None)
        place.tell(f"unit {table.units!r} fits none of the columns ({numbers})", "units")
    sources = _sources(table, known, place)
    first = next(sources, None)
    if first is None or len(place.problems) > before:
        return None
    names = first.names
    for name in sorted({name for name in names if names.count(name) > 1}):
        place.tell(f"column {name!r} is given twice")
    missing = [c.name for c in columns if c.required and c.name not in names and c.name not in table.values]
    if missing:
        found = ", ".join(names) or "none"
        hint = next((f"; is {sign!r} the delimiter?" for sign in ";\t| " if sign in found.replace(", ", "")), "")
        place.tell(f"column {', '.join(map(repr, missing))} is missing (found: {found}){hint}")
    if len(place.problems) > before:
        return None
    parts = [_convert(source, table, known, place) for source in chain([first], sources)]
    return None if len(place.problems) > before else _joined([part for part in parts if part is not None])


def _joined(parts: list[Rows]) -> Rows:
    """Rows of a table that was read in parts; columns are taken from the parts, one after the other."""
    first = parts[0]
    if len(parts) == 1:
        return first
    texts = {}
    for name in list(first.texts):
        own = [part.texts.pop(name) for part in parts]
        known = pl.concat([one.known for one in own]).unique(maintain_order=True)
        texts[name] = Coded(
            known, _end_to_end([kept(places(one.known, known, unique=True)[one.numbers]) for one in own])
        )
    numbers = {name: _end_to_end([part.numbers.pop(name) for part in parts]) for name in list(first.numbers)}
    lines = _end_to_end([part.lines for part in parts])
    return Rows(lines, first.file, first.problems, len(lines), texts, numbers)


def _end_to_end(arrays: list[Part]) -> Part:
    count = sum(map(len, arrays))
    if all(0 in array.strides for array in arrays):
        return np.broadcast_to(arrays[0][0], (count,))
    return cast("Part", np.concatenate(arrays, out=empty(count, arrays[0].dtype)))


def _convert(source: Source, table: TableEntry, known: dict[str, Column], place: TableLocation) -> Rows | None:
    before = len(place.problems)
    count = len(source.lines)
    if count == 0:
        place.tell("the table is empty")
        return None
    texts: dict[str, Coded] = {}
    numbers: dict[str, FloatArray] = {}
    for name, value in table.values.items():
        _constant(known[name], value, table, count, place, texts, numbers)
    for name, cells in source.columns.items():
        column = known.get(name)
        if column is None:
            words = f"unknown column {name!r}{nearest(name, known)} (known here: {', '.join(known)})"
            place.problems.append(Message(words, source.file, 1))
        elif column.parse is None:
            texts[name] = _identifiers(column, cells, source)
        else:
            if table.decimal == "," and cells.dtype == pl.String:
                cells = cells.str.replace(",", ".", literal=True)
            numbers[name] = _numbers(column, cells, table, source, place)
    if len(place.problems) > before:
        return None
    texts = {name: Coded(found, kept(places)) for name, (found, places) in texts.items()}
    numbers = {name: kept(cells) for name, cells in numbers.items()}
    return Rows(source.lines, source.file, source.problems, count, texts, numbers)


def _constant(
    column: Column,
    value: str,
    table: TableEntry,
    count: int,
    place: TableLocation,
    texts: dict[str, Coded],
    numbers: dict[str, FloatArray],
) -> None:
    """A column with one value in every row; a mistake in it is one mistake, in the project file."""
    if column.parse is None:
        texts[column.name] = _one_text(value, count)
        return
    at = place.at("values", column.name)
    try:
        number = column.parse(value, _unit_of(table, column))
    except ValueError as error:
        at.tell(f"{column.name}: {error}")
        return
    if column.name.startswith("sigma") and number < 0.0:
        at.tell(f"{column.name}: found {value}, expected a σ ≥ 0")
    numbers[column.name] = np.broadcast_to(np.float64(number), (count,))


def _one_text(text: str, count: int) -> Coded:
    return Coded(pl.Series([text], dtype=pl.String), np.broadcast_to(np.int32(0), (count,)))


def _unit_of(table: TableEntry, column: Column) -> str:
    """Unit of a column that its cells do not carry themselves; one unit for all means: for all it fits."""
    if isinstance(table.units, str):
        return table.units if _fits(column, table.units) else ""
    return table.unit_of(column.name)


def _identifiers(column: Column, cells: pl.Series, source: Source) -> Coded:
    result = coded(cells.cast(pl.String).fill_null(""))
    known = result.known.str.strip_chars()
    if not known.equals(result.known):  # two of them may be the same now
        known, numbers = coded(known)
        result = Coded(known, numbers[result.numbers])
    if column.required:
        source.tell_where((known == "").to_numpy()[result.numbers], f"{column.name} is empty")
    broken = known.str.contains("[\n\r\\x00]").to_numpy()[result.numbers]
    source.tell_where(
        broken, lambda row: f"found {known[int(result.numbers[row])]!r}, expected a name without line breaks"
    )
    return result


def _numbers(column: Column, cells: pl.Series, table: TableEntry, source: Source, place: TableLocation) -> FloatArray:
    unit = _unit_of(table, column)
    assert column.parse is not None
    if not cells.dtype.is_numeric():
        cells = cells.cast(pl.String).str.strip_chars().replace("", None)
    missing = cells.is_null().to_numpy()
    if column.required:
        source.tell_where(missing, f"{column.name} is empty")
    factor = _factor(column, unit)
    if factor is None and column.factor is not None:
        _, words = _parsed(column, "1", unit)
        if words or cells.dtype.is_numeric():
            place.tell(f"column {column.name}: {words}", "units")
            return np.zeros(len(cells))
    plain = cells.cast(pl.Float64, strict=False) if factor is not None else pl.repeat(None, len(cells), eager=True)
    values = plain.cast(pl.Float64).fill_null(np.nan).to_numpy() * (1.0 if factor is None else factor)
    others = ~(np.abs(values) <= LARGEST) & ~missing
    if others.any():
        values = np.array(values)
        # More than plain numbers: with a unit of their own, angles d-m-s, mistakes.
        wrong = np.zeros(len(others), dtype=bool)
        for row in np.flatnonzero(others).tolist():
            values[row], words = _parsed(column, str(cells[row]), unit)
            wrong[row] = bool(words)
        source.tell_where(wrong, lambda row: f"{column.name}: {_parsed(column, str(cells[row]), unit)[1]}")
    return values


def _factor(column: Column, unit: str) -> float | None:
    """Internal units per unit of plain numbers; ``None`` if they must be read one by one."""
    try:
        return column.factor(unit) if column.factor is not None else None
    except ValueError:
        return None


def _parsed(column: Column, text: str, unit: str) -> tuple[float, str]:
    assert column.parse is not None
    try:
        value = column.parse(text, unit)
    except ValueError as error:
        return np.nan, str(error)
    return (value, "") if abs(value) <= LARGEST else (np.nan, beyond(text, value))


def _fits(column: Column, unit: str) -> bool:
    if column.factor is None:
        return column.parse is not None
    try:
        column.factor(unit)
    except ValueError:
        return False
    return True


# ---- Free, fixed or observed: from columns and settings to values, free flags and σ of components.


class Statuses(NamedTuple):
    """Components of n blocks: value, free or fixed, σ where observed, start value where it differs; (n, size) each."""

    values: FloatArray
    free: BoolArray
    sigma: FloatArray
    start: FloatArray

    def rows(self, chosen: IntArray) -> Statuses:
        """Some of the blocks."""
        return Statuses(self.values[chosen], self.free[chosen], self.sigma[chosen], self.start[chosen])


def number_column(name: str, quantity: Quantity, edge: Edge, required: bool = False) -> Column:
    """A column of numbers of a quantity, converted to internal units."""
    return Column(
        name,
        parse=lambda text, unit: edge.number(text, quantity, unit),
        factor=None if quantity == ANGLE and edge.units.angle == "dms" else lambda unit: edge.factor(quantity, unit),
        required=required,
    )


def component_columns(components: Iterable[Component], edge: Edge) -> list[Column]:
    """For each component a column for its value, its σ, and a start value that differs from an observed one."""
    columns = []
    for component in components:
        columns.append(number_column(component.name, component.quantity, edge))
        columns.append(number_column(f"sigma_{component.name}", component.quantity, edge))
        columns.append(number_column(f"start_{component.name}", component.quantity, edge))
    return columns


def component_rows(
    rows: Rows, components: Sequence[Component], fixed: Sequence[str], common_sigma: FloatArray | None = None
) -> Statuses:
    """Statuses of n blocks: no σ is free, σ = 0 is fixed, σ > 0 is observed; ``common_sigma`` (n,) for given values."""
    values = np.stack([rows.number(c.name) for c in components], axis=1)
    sigma = np.stack([rows.number(f"sigma_{c.name}") for c in components], axis=1)
    if common_sigma is not None:
        # The common σ is that of the given components; a row without any shows the mistake at all of them.
        given = ~np.isnan(values)
        given |= ~given.any(axis=1, keepdims=True)
        sigma = np.where(np.isnan(sigma) & given, common_sigma[:, None], sigma)
        rows.tell_where(common_sigma < 0.0, "sigma: found a negative σ, expected a σ ≥ 0")
        sigma[common_sigma < 0.0] = np.nan
    for k, component in enumerate(components):
        rows.tell_where(sigma[:, k] < 0.0, f"sigma_{component.name}: found a negative σ, expected a σ ≥ 0")
        valueless = ~np.isnan(sigma[:, k]) & np.isnan(values[:, k])
        rows.tell_where(valueless, f"{component.name} has a σ but no value")
    held = np.array([c.name in fixed for c in components])
    sigma[:, held] = np.nan
    free = ~held[None, :] & ~(sigma == 0.0)
    for k, component in enumerate(components):
        rows.tell_where(~free[:, k] & np.isnan(values[:, k]), f"{component.name} is fixed but has no value")
    start = np.stack([rows.number(f"start_{c.name}") for c in components], axis=1)
    return Statuses(values, free, np.where(sigma > 0.0, sigma, np.nan), np.where(free, start, np.nan))


def settings(
    given: dict[str, str | Value],
    components: Sequence[Component],
    edge: Edge,
    place: TableLocation,
    image: ImageScale | None = None,
) -> Statuses:
    """Statuses (1, size) of one block from settings by component; a plain number is fixed."""
    values = np.array([[component.default for component in components]])
    free = np.zeros(values.shape, dtype=bool)
    sigma = np.full(values.shape, np.nan)
    start = np.full(values.shape, np.nan)
    names = [component.name for component in components]
    for name, setting in given.items():
        at = place.at(name)
        if name not in names:
            at.tell(f"unknown component {name!r}{nearest(name, names)} (known: {', '.join(names)})")
            continue
        k = names.index(name)
        quantity = components[k].quantity
        try:
            text = setting if isinstance(setting, str) else setting.free or setting.fixed or setting.observed or ""
            values[0, k] = edge.number(text, quantity, "", image)
            if isinstance(setting, Value) and setting.sigma is not None:
                sigma[0, k] = edge.number(setting.sigma, quantity, "", image)
            if isinstance(setting, Value) and setting.start is not None:
                start[0, k] = edge.number(setting.start, quantity, "", image)
        except UnitError as error:
            at.tell(f"{name}: {error}")
            continue
        if sigma[0, k] < 0.0:
            at.tell(f"{name}: found a negative σ, expected a σ ≥ 0")
        free[0, k] = isinstance(setting, Value) and setting.fixed is None and sigma[0, k] != 0.0
    return Statuses(values, free, np.where(sigma > 0.0, sigma, np.nan), start)
