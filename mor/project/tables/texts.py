"""Rows of a text file (CSV and its kin): typed columns in one go, whatever the number of rows.

Comments (a # that stands first or after a blank: point A#1 is a point) and empty lines are taken out of the bytes
first, and the lines of the rows are remembered. Where columns do not hold plain numbers only, they are read as texts.
Rows are looked at one by one only where quotes hide separators.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import polars as pl

from mor.arrays import IntArray, SmallIntArray
from mor.counting import counted
from mor.errors import Problem
from mor.input_files import as_utf8, limit, raise_it
from mor.project.file.table import Table
from mor.project.tables.columns import Column, Source, tell_rows
from mor.project.tables.guarded import plain_column

_PART = 1 << 24
"""Bytes of a file that are looked at together."""
_SKIPPED = "skip {}"
"""Name of a column that is left out."""


class _Text(NamedTuple):
    """Bytes without comments and empty lines, and the line of every one that is left."""

    content: bytes
    lines: SmallIntArray


def our_name(table: Table, name: str) -> str | None:
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
    text: bytes, table: Table, known: dict[str, Column], file: str, problems: list[Problem]
) -> Source | None:
    """Rows of a text file; ``None`` if ``problems`` were added instead."""
    text = as_utf8(text)
    line = _first_undecodable_line(text)
    if line:
        problems.append(Problem("this is not UTF-8 text", file, line))
        return None
    cleaned = _cleaned(text, table.delimiter)
    del text
    width = _first_line(cleaned).count((table.delimiter or ",").encode()) + 1
    if width > limit(COLUMNS):
        problems.append(Problem(too_many_columns(width), file, 1))
        return None
    header = _header(cleaned, table)
    names = [None if name.startswith("skip ") else our_name(table, name) for name in header]
    lines = cleaned.lines if isinstance(table.columns, list) else cleaned.lines[1:]
    if len(lines) == 0:
        problems.append(Problem("the table is empty", file))
        return None
    kinds: dict[str, type[pl.DataType]] = {}
    for name, ours in zip(header, names, strict=True):
        column = known.get(ours or "")
        kinds[name] = pl.Float64 if column is not None and column.factor is not None else pl.String
    frame = _frame(cleaned, table, header, kinds)
    if frame is None:
        return _one_by_one(cleaned, names, table, file, problems)
    columns = {ours: frame[name] for name, ours in zip(header, names, strict=True) if ours is not None}
    return Source([name for name in names if name], _plain(columns, cleaned), lines, file)


def _plain(columns: dict[str, pl.Series], cleaned: _Text) -> dict[str, pl.Series]:
    """Columns without the apostrophes that guard names."""
    if b"'" not in cleaned.content:
        return columns
    return {
        name: plain_column(cells) if cells.dtype == pl.String else cells for name, cells in columns.items()
    }


def _first_undecodable_line(text: bytes) -> int:
    """Line of the first bytes that are no UTF-8, 0 where all is well."""
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
    if len(ends) and not (data[starts] <= ord(" ")).any():
        return _Text(text, np.arange(1, len(ends) + 1, dtype=np.int32))
    full = np.logical_or.reduceat(data > ord(" "), starts) if len(ends) else np.zeros(0, dtype=bool)
    kept = np.repeat(full, ends - starts + 1)[: len(data)]
    return _Text(data[kept].tobytes(), (np.flatnonzero(full) + 1).astype(np.int32))


def _line_ends(data: npt.NDArray[np.uint8]) -> IntArray:
    """Places of the line ends, looked for in one part of the file after the other."""
    starts = range(0, len(data), _PART)
    found = [np.flatnonzero(data[start : start + _PART] == ord("\n")) + start for start in starts]
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


def _header(cleaned: _Text, table: Table) -> list[str]:
    """Names of the columns as the file (or its declaration) has them, each once."""
    if isinstance(table.columns, list):
        return [name or _SKIPPED.format(k) for k, name in enumerate(table.columns)]
    return [cell.strip() for cell in _cells(_first_line(cleaned).decode("utf-8"), table.delimiter or ",")]


def _first_line(cleaned: _Text) -> bytes:
    end = cleaned.content.find(b"\n")
    return cleaned.content[: end if end >= 0 else None]


def _separators(content: bytes, separator: str) -> IntArray:
    """Number of separators in each line."""
    data = np.frombuffer(content, dtype=np.uint8)
    ends = _line_ends(data)
    starts = (
        np.concatenate([[0], ends[:-1] + 1]) if content.endswith(b"\n") else np.concatenate([[0], ends + 1])
    )
    counts: IntArray = np.add.reduceat(data == ord(separator), starts, dtype=np.int64)
    return counts


def _cells(line: str, separator: str) -> list[str]:
    """Cells of a line; a quote that is not closed reaches to its end."""
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:  # longer than any cell may be
        return line.split(separator)


def _frame(
    cleaned: _Text, table: Table, header: list[str], kinds: dict[str, type[pl.DataType]]
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
    cleaned: _Text, names: list[str | None], table: Table, file: str, problems: list[Problem]
) -> Source | None:
    """Rows that are no plain table: those of the wrong length are told; quotes may hide separators."""
    separator = table.delimiter or ","
    headed = not isinstance(table.columns, list)
    if b'"' not in cleaned.content or separator == " ":
        found = _separators(cleaned.content, separator)[int(headed) :] + 1
        source = Source([], {}, cleaned.lines[int(headed) :], file)
        tell_rows(problems, found != len(names), source, lambda row: wrong_length(int(found[row]), names))
        if (found != len(names)).any():
            return None
    content = cleaned.content.decode("utf-8").split("\n")[int(headed) :]
    lines = cleaned.lines[int(headed) :]
    source = Source([], {}, lines, file)
    content = content[: len(lines)]
    open_ = np.array([line.count('"') % 2 == 1 for line in content])
    tell_rows(problems, open_, source, "a quote that opens in this line is not closed in it")
    if open_.any():
        return None
    rows = [_cells(line, separator) for line in content]
    found = np.array([len(row) for row in rows])
    tell_rows(problems, found != len(names), source, lambda row: wrong_length(int(found[row]), names))
    if (found != len(names)).any():
        return None
    columns = {
        name: pl.Series(name, [row[k] for row in rows], dtype=pl.String)
        for k, name in enumerate(names)
        if name
    }
    return Source([name for name in names if name], _plain(columns, cleaned), lines, file)
